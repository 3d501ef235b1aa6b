"""The arm that `--arm` and `--robot-config` mean."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from palpate.errors import InputError
from palpate.robots.description import RobotDescription
from palpate.robots.owner.calibrated import calibrated
from palpate.robots.owner.config import RobotConfig, read_config
from palpate.robots.owner.datasheet import Datasheet, informed
from palpate.robots.registry import load_description


def own_arm(
    name: str,
    cautious: bool,
    config: Path | None,
    told: Datasheet | None = None,
    real: bool = False,
) -> RobotDescription:
    """The arm as its owner knows it: its description, with the springs of a `real` one, what a
    datasheet tells, and what the robot.yaml `config` says was measured of it.

    Raises:
        InputError: no such arm, or the file cannot be read, or is another arm's.
    """
    arm = load_description(name, cautious)
    if real:
        arm = _real(arm)
    if told is not None:
        arm = informed(arm, told)
    if config is None:
        return arm
    measured = read_config(config)
    if measured.arm is not None and measured.arm != arm.name:
        raise InputError(f"{config} was measured of the arm '{measured.arm}', not of '{arm.name}'")
    return calibrated(arm, measured)


@cache
def _real(arm: RobotDescription) -> RobotDescription:
    """Return the real arm; cached, because results computed for it are cached by identity."""
    return arm.real()


def require_same(
    config: RobotConfig | None, simulated: tuple[str, int] | None, where: str = "the robot_config="
) -> None:
    """Require that a robot.yaml was measured on the arm that is to move: the embedded one's
    noise model and seed, None for a real one.

    Raises:
        InputError: it was another one; `where` names the file.
    """
    measured = config.simulated if config is not None else None
    if measured is None or (measured.noise, measured.seed) == simulated:
        return
    here = "a real arm" if simulated is None else f"noise {simulated[0]}, seed {simulated[1]}"
    raise InputError(
        f"{where} was measured of the embedded arm of noise {measured.noise}, seed {measured.seed}, and "
        f"this is another one ({here}); without its section 'simulated' it is taken as it is"
    )
