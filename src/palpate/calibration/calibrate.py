"""`palpate calibrate`: what is known of one very arm after it weighed and touched what is known.

Every procedure is a visit to the arm: plan, check, execution and the trace's own equations as in any
run, with what is known taken for known. What it found is corrected in the next visit, so that each
one also tests those before it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from palpate.calibration.procedures import gauge, weigh, weigh_itself
from palpate.calibration.session import Session
from palpate.calibration.stated import LENGTH, MASS, Known
from palpate.callbacks import SILENT, RunCallbacks
from palpate.errors import InputError
from palpate.estimation.load.observation import gain_root
from palpate.robots.owner.config import (
    JOINTS,
    Gains,
    RobotConfig,
    Simulated,
    read_config,
    write_config,
)
from palpate.robots.owner.registered import require_same
from palpate.settings import Settings, noise_told

if TYPE_CHECKING:
    from palpate.robots.description import RobotDescription

MEASURED = ("torque_gain", "tip_offset", "base_lean", "pose_repeatability", "tip_compliance")
"""What a calibration writes; all other keys of a file stay."""


@dataclass(frozen=True, slots=True)
class Wanted:
    """References and procedures of one calibration.

    Attributes:
        weight: a known mass, kg.
        gauge: known heights, m.
        own_weight: the arm weighs itself.
    """

    weight: Known | None = None
    gauge: Known | None = None
    own_weight: bool = False


def wanted(weight: str | None, gauge: str | None, own_weight: bool) -> Wanted:
    """Parse the references from text: `0.5kg±0.1g`, `block=50mm±0.01mm`.

    Raises:
        InputError: no such size.
    """
    return Wanted(
        None if weight is None else Known.of(weight, MASS, "the weight"),
        None if gauge is None else Known.of(gauge, LENGTH, "the gauge's height"),
        own_weight,
    )


@dataclass(frozen=True, slots=True)
class Found:
    """Calibrated value, before and after.

    Attributes:
        name: its key in robot.yaml, a joint's with its number.
        unit: `1` where it is relative.
        before, after: value and standard deviation.
        by: procedure that measured it.
    """

    name: str
    unit: str
    before: tuple[float, float]
    after: tuple[float, float]
    by: str


@dataclass(frozen=True, slots=True)
class Calibration:
    """Result of a calibration and the file it is in. `robot_seconds`: duration of the motions, s."""

    config: RobotConfig
    found: tuple[Found, ...]
    file: Path
    robot_seconds: float


def calibrate(
    settings: Settings,
    wanted: Wanted,
    out: Path,
    callbacks: RunCallbacks = SILENT,
) -> Calibration:
    """Calibrate an arm, and write what was found into `out`: other figures of an existing file stay.

    Without a scene the embedded arm stands on a bench of its own. What `settings.robot_config` says
    is known before, and is refined; else the arm's datasheet is.

    Raises:
        InputError: bad input; or what was measured contradicts what is said to be known: then
            nothing is written.
        Unavailable: no such robot.
        ExecutionAborted: not confirmed, or stopped.
    """
    settings = settings.checked(at_hand=True)
    there = _existing(out)
    _require_sense(settings, wanted, out, there)
    before = RobotConfig()
    if settings.robot_config is not None:
        before = read_config(settings.robot_config)
    session = Session(settings, before, callbacks, _visits(before, there))
    start = session.arm
    if wanted.own_weight:
        weigh_itself(session)
    if wanted.weight is not None:
        weigh(session, wanted.weight)
    if wanted.gauge is not None:
        gauge(session, wanted.gauge)
    config = _merged(there or before, session)
    write_config(out, config)
    return Calibration(config, tuple(_compared(start, session.arm)), out, session.seconds)


def _existing(out: Path) -> RobotConfig | None:
    return read_config(out) if out.exists() else None


def _visits(*configs: RobotConfig | None) -> int:
    """Return the number of earlier visits to the embedded arm."""
    simulated = [config.simulated for config in configs if config is not None]
    return max([one.visits for one in simulated if one is not None], default=0)


def _require_sense(
    settings: Settings, wanted: Wanted, out: Path, there: RobotConfig | None
) -> None:
    """Raises InputError where there is nothing to do, or not of this arm."""
    if wanted == Wanted():
        raise InputError(
            "nothing to calibrate with: give a known weight (--weight 0.5kg±0.1g), known heights "
            "(--gauge 50mm±0.01mm), or let the arm weigh itself (--own-weight)"
        )
    if settings.robot is not None and settings.scene is None:
        raise InputError(
            "a real arm needs a scene=D.xml that says where it, the weight and the gauges stand"
        )
    simulated = None
    if settings.robot is None:
        simulated = (noise_told(settings.noise), settings.seed)
    arm = settings.described_arm()
    require_same(arm.config, simulated)
    require_same(there, simulated, f"'{out}'")
    if there is not None and there.arm not in (None, arm.name):
        raise InputError(f"'{out}' is of the arm '{there.arm}', not of '{arm.name}'")


def _merged(under: RobotConfig, session: Session) -> RobotConfig:
    """The file as it was, with what is known now."""
    settings, config = session.settings, session.config
    measured = {name: getattr(config, name) for name in MEASURED}
    new = {name: figure for name, figure in measured.items() if figure is not None}
    simulated = None
    if settings.robot is None:
        simulated = Simulated(
            noise=noise_told(settings.noise), seed=settings.seed, visits=session.visits
        )
    return under.model_copy(update={"arm": session.arm.name, "simulated": simulated, **new})


def _compared(start: RobotDescription, end: RobotDescription) -> Iterator[Found]:
    """Compare each measured value with its value before the calibration."""
    assert end.config is not None
    gains, told, known = end.config.torque_gain, start.nominal, end.nominal
    if gains is not None and gains is not _gains(start):
        before, after = _gain_values(start), _gain_values(end)
        for i in range(JOINTS):
            yield Found(f"torque_gain {i + 1}", "1", before[i], after[i], gains.by or "")
    lean = end.config.base_lean
    if lean is not None and lean is not getattr(start.config, "base_lean", None):
        before = (0.0, 0.0), (told.tip_offset_std / start.reach.stretched,) * 2
        if start.config is not None and start.config.base_lean is not None:
            before = start.config.base_lean.value.tolist(), start.config.base_lean.std.tolist()
        for i, axis in enumerate("xy"):
            one = (before[0][i], before[1][i])
            now = (float(lean.value[i]), float(lean.std[i]))
            yield Found(f"base_lean {axis}", "rad", one, now, lean.by or "")
    repeated = end.config.pose_repeatability
    if repeated is not None and repeated is not getattr(start.config, "pose_repeatability", None):
        one, other = (0.0, told.pose_repeatability), (0.0, known.pose_repeatability)
        yield Found("pose_repeatability", "m", one, other, repeated.by or "")
    for name, unit in (("tip_offset", "m"), ("tip_compliance", "m/N")):
        figure = getattr(end.config, name)
        if figure is not None and figure is not getattr(start.config, name, None):
            one, other = (
                (getattr(hand, name), getattr(hand, f"{name}_std")) for hand in (told, known)
            )
            yield Found(name, unit, one, other, figure.by or "")


def _gains(arm: RobotDescription) -> Gains | None:
    return arm.config.torque_gain if arm.config is not None else None


def _gain_values(arm: RobotDescription) -> list[tuple[float, float]]:
    """Value and standard deviation of each joint's gain, as it is known."""
    gains = _gains(arm)
    if gains is not None:
        spread = gains.spread.diagonal()
        return list(zip(gains.value.tolist(), np.sqrt(spread).tolist(), strict=True))
    root = gain_root(arm.nominal, JOINTS)
    return [(0.0, float(np.linalg.norm(row))) for row in root]
