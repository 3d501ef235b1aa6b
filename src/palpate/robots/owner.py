"""Registry of arms, and an arm as its owner knows it: description < datasheet < robot.yaml."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import BeforeValidator, Field

from palpate.common.errors import InputError
from palpate.common.extensions import Registry, extensions
from palpate.common.files import Section, plain_number
from palpate.robots.description import RobotDescription, read_description, reflexes
from palpate.robots.robot_config import RobotConfig, read_config
from palpate.robots.sheet import FILE, Cautious
from palpate.trace.recording import NominalHand

GROUP = "palpate.robots"  # entry points: packages with a `description.yaml`, named like the arm
DEFAULT = "fr3"


class Arms(Registry[Path]):
    """Folders of arms by name."""

    kind = "arm"

    def __init__(self, folders: Mapping[str, Path]) -> None:
        super().__init__(folders)
        self._read: dict[tuple[Path, int], RobotDescription] = {}

    def load(self, name_or_path: str) -> RobotDescription:
        """Load the arm of that name or folder; an unchanged file is the same object.

        Raises InputError: unknown; the message lists the valid names. Or the folder's description is not valid.
        """
        folder = Path(name_or_path)
        if name_or_path in self or not (folder / FILE).is_file():
            folder = self.named(name_or_path, f"Or give a folder with a {FILE}: PATH/")
        folder = folder.resolve()
        version = (folder, (folder / FILE).stat().st_mtime_ns)
        if version not in self._read:
            names = {path.resolve(): name for name, path in self.items()}
            name = names.get(folder, folder.name)
            self._read[version] = read_description(folder, name, self)
        return self._read[version]


@cache
def arms() -> Arms:
    """Return all arms: those of this folder, and those of the entry-point group `palpate.robots`."""
    found = {path.parent.name: path.parent for path in Path(__file__).parent.glob(f"*/{FILE}")}
    for module in extensions(GROUP):
        found.setdefault(module.__name__.rpartition(".")[2], Path(str(module.__file__)).parent)
    return Arms(dict(sorted(found.items())))


def load_description(name_or_path: str = DEFAULT, cautious: bool = False) -> RobotDescription:
    """Load the arm of `--arm NAME|PATH/`; `cautious` limits its pace, as `--cautious`."""
    arm = arms().load(name_or_path)
    return arm.cautious() if cautious else arm


# The arm as its owner knows it: description < datasheet < robot.yaml.


Stated = Annotated[float, BeforeValidator(plain_number), Field(ge=0, allow_inf_nan=False)]


class Datasheet(Section):
    """Accuracies stated to the arm's owner, the only section that estimators know.

    None means the figure of the arm's description.
    """

    force_resolution: Stated | None = None  # N
    force_repeatability: Stated | None = None  # N, per approach
    force_accuracy: Stated | None = None  # N, of an absolute force
    pose_repeatability: Stated | None = None  # m
    torque_gain_max: Stated | None = None  # relative, half width
    tip_offset: Stated | None = None  # m, from the TCP to the pads' end along the tool
    # m, standard deviation; without calibration it includes the effect of the arm's frame on a height
    tip_offset_std: Stated | None = None
    # m/N, of pads and joints beyond the encoders, under a force along the tool
    tip_compliance: Stated | None = None
    tip_compliance_std: Stated | None = None  # m/N, standard deviation
    # N m that friction and ripple leave in each joint at rest, where larger than in the description
    rest_torque: Stated | None = None


def own_arm(
    name: str,
    cautious: bool,
    config: Path | None,
    sheet: Datasheet | None = None,
    real: bool = False,
) -> RobotDescription:
    """Return the arm of `--arm` and `--robot-config`.

    It is the description with the springs of a `real` arm, the figures of a datasheet, and the figures of the
    robot.yaml `config`; later figures replace earlier ones.
    Raises InputError: no such arm, or the file cannot be read, or belongs to another arm.
    """
    arm = load_description(name, cautious)
    if real:
        arm = arm.real()
    if sheet is not None:
        arm = apply_datasheet(arm, sheet)
    if config is None:
        return arm
    measured = read_config(config)
    if measured.arm is not None and measured.arm != arm.name:
        raise InputError(f"{config} was measured of the arm '{measured.arm}', not of '{arm.name}'")
    return apply_calibration(arm, measured)


def require_same(
    config: RobotConfig | None, simulated: tuple[str, int] | None, where: str = "the robot_config="
) -> None:
    """Require that a robot.yaml was measured on this arm.

    `simulated` is the noise model and seed of the embedded arm, None for a real one.
    Raises InputError: it was measured on another arm; `where` names the file.
    """
    measured = config.simulated if config is not None else None
    if measured is None or (measured.noise, measured.seed) == simulated:
        return
    here = "a real arm" if simulated is None else f"noise {simulated[0]}, seed {simulated[1]}"
    raise InputError(
        f"{where} was measured of the embedded arm of noise {measured.noise}, seed {measured.seed}, and "
        f"this is another one ({here}); without its section 'simulated' it is taken as it is"
    )


def apply_datasheet(arm: RobotDescription, sheet: Datasheet) -> RobotDescription:
    """Return the arm with the figures of a datasheet in place of its description's."""
    stated: dict[str, float] = sheet.model_dump(exclude_none=True)
    if "torque_gain_max" in stated:
        stated["torque_gain"] = stated.pop("torque_gain_max")
    rest = stated.pop("rest_torque", arm.rest_torque)
    new = {name: value for name, value in stated.items() if getattr(arm.nominal, name) != value}
    changes = new or rest != arm.rest_torque
    return _apply_figures(arm, rest, tuple(sorted(new.items()))) if changes else arm


@cache
def _apply_figures(
    arm: RobotDescription, rest_torque: float, stated: tuple[tuple[str, float], ...]
) -> RobotDescription:
    return replace(arm, nominal=replace(arm.nominal, **dict(stated)), rest_torque=rest_torque)


@cache
def apply_calibration(arm: RobotDescription, config: RobotConfig) -> RobotDescription:
    """Return the arm with the figures of a robot.yaml.

    Raises InputError: the figures are those of an arm with another number of joints.
    """
    lists = {
        "torque_gain.value": config.torque_gain and config.torque_gain.value,
        "stiffness.joints": config.stiffness and config.stiffness.joints,
    }
    for name, values in lists.items():
        if values is not None and len(values) != len(arm.joints):
            raise InputError(
                f"the robot.yaml has {len(values)} numbers in '{name}', and the arm '{arm.name}' has "
                f"{len(arm.joints)} joints: give one a joint, or the arm that it was measured of"
            )
    # The fence can only shrink the workspace.
    limits, fence, pace = arm.limits, config.workspace, arm.pace
    if fence is not None:
        limits = replace(
            limits,
            workspace_min=np.maximum(limits.workspace_min, fence.min),
            workspace_max=np.minimum(limits.workspace_max, fence.max),
        )
    if config.reflex is not None:
        own = reflexes(config.reflex, limits.payload)
        limits = replace(limits, reflexes=replace(limits.reflexes, **own))
    if config.speed is not None:  # scales all speeds, cautious ones too; accelerations stay
        part, slow = config.speed, pace.cautious
        cautious = {name: getattr(slow, name) * part for name in Cautious.model_fields}
        speeds = {n: getattr(pace, n) * part for n in ("speed", "turning_speed", "joint_speed")}
        pace = pace.model_copy(update={**speeds, "cautious": Cautious(**cautious)})
    return replace(
        arm,
        nominal=measured_hand(arm.nominal, config),
        limits=limits,
        stiffness=config.stiffness or arm.stiffness,
        pace=pace,
        end_effector=config.end_effector or arm.end_effector,
        config=config,
        described=arm,
    )


def measured_hand(hand: NominalHand, config: RobotConfig) -> NominalHand:
    """Return the estimators' data of the arm with the figures of a robot.yaml."""
    tip, soft, gains = config.tip_offset, config.tip_compliance, config.torque_gain
    if tip is not None:
        hand = replace(hand, tip_offset=tip.value, tip_offset_std=tip.std)
    if config.pose_repeatability is not None:
        hand = replace(hand, pose_repeatability=config.pose_repeatability.value)
    if soft is not None:
        hand = replace(hand, tip_compliance=soft.value, tip_compliance_std=soft.std)
    if gains is None:
        return hand
    # Uncertainty of the gains that remains after their correction. `torque_gain` is one figure for all joints:
    # the half width of a uniform distribution with the worst joint's deviation.
    left = gains.spread / np.outer(1.0 + gains.value, 1.0 + gains.value)
    rows = tuple(tuple(row) for row in left.tolist())
    worst = float(np.sqrt(3.0 * left.diagonal().max()))
    return replace(hand, torque_gain=worst, gain_covariance=rows)


def owner_arm(arm: RobotDescription, sheet: Datasheet) -> RobotDescription:
    """Return the arm with the figures of a datasheet, below those of its robot.yaml."""
    if arm.described is None or arm.config is None:
        return apply_datasheet(arm, sheet)
    return apply_calibration(apply_datasheet(arm.described, sheet), arm.config)


def without_calibration_figures(arm: RobotDescription) -> RobotDescription:
    """Return the arm without the figures of its robot.yaml."""
    return arm.described or arm


@cache
def measured_arm(arm: RobotDescription) -> RobotDescription:
    """Return the arm as measured, with sensors that need no correction, for predictions."""
    return replace(arm, config=None, described=None)
