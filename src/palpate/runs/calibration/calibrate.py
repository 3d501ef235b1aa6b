"""`palpate calibrate`: calibrate one arm with references of known weight and height, and write
robot.yaml.

Each procedure is a visit to the arm: plan, check, execution and estimation as in any run. Here the
measured size is known and the arm is not. Each visit is corrected by the findings before it, and so
tests them.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from palpate.common.errors import InputError
from palpate.estimation.wrench_observation import gain_root
from palpate.robots.owner import require_same
from palpate.robots.robot_config import RobotConfig, Simulated, read_config, write_config
from palpate.runs.calibration.gains import LENGTH, MASS, NamedSize
from palpate.runs.calibration.procedures import gauge, weigh, weigh_itself
from palpate.runs.calibration.session import CalibrationSession
from palpate.runs.callbacks import SILENT, RunCallbacks
from palpate.runs.settings import References, Settings, noise_source
from palpate.trace.recording import NominalHand

if TYPE_CHECKING:
    from palpate.perception.hand_eye_fit import CalibrationViews, HandEye
    from palpate.robots.description import RobotDescription


# Keys of robot.yaml that a calibration writes. It leaves all others unchanged.
MEASURED = (
    "torque_gain",
    "tip_offset",
    "base_lean",
    "pose_repeatability",
    "tip_compliance",
    "camera",
)


@dataclass(frozen=True, slots=True)
class CalibratedFigure:
    """Calibrated figure, before and after."""

    name: str  # its key in robot.yaml, with the number of the joint or the axis
    unit: str  # SI; `1` for a relative figure
    # before, after: value and standard deviation.
    before: tuple[float, float]
    after: tuple[float, float]
    by: str  # procedure that measured it


@dataclass(frozen=True, slots=True)
class Calibration:
    """Result of a calibration and its file."""

    config: RobotConfig  # the calibrated figures
    figures: tuple[CalibratedFigure, ...]  # figures before and after
    file: Path  # the robot.yaml
    robot_seconds: float  # duration of the motions, s
    pictures: HandEye | None = None  # to which the camera's pose was fitted


def calibrate(
    settings: Settings, wanted: References, out: Path, callbacks: RunCallbacks = SILENT
) -> Calibration:
    """Calibrate an arm and write the findings into `out`; other figures of an existing file stay.

    Without a scene the embedded arm is on a bench. The calibration refines `settings.robot_config`,
    or the datasheet where there is none.

    Raises:
        InputError: bad input; or the measurements contradict the stated references: nothing is
            written.
        Unavailable: no such robot.
        ExecutionAborted: not confirmed, or stopped.
    """
    # Check everything before the arm moves.
    weight, height, tag = (
        None if text is None else NamedSize.of(text, units, what)
        for text, units, what in (
            (wanted.weight, MASS, "the weight"),
            (wanted.gauge, LENGTH, "the gauge's height"),
            (wanted.tag, LENGTH, "the tag's side"),
        )
    )
    settings = settings.check_values(at_hand=True)
    existing = read_config(out) if out.exists() else None
    require_consistent(settings, wanted, out, existing)
    before = RobotConfig()
    if settings.robot_config is not None:
        before = read_config(settings.robot_config)
    # Count visits to the embedded arm over all sessions: each visit draws new errors.
    simulated = [config.simulated for config in (before, existing) if config is not None]
    visits = max([result.visits for result in simulated if result is not None], default=0)
    session = CalibrationSession(settings, before, callbacks, visits)
    # Begin with the torque gains: all later procedures use the torques.
    start = session.arm
    if wanted.own_weight:
        weigh_itself(session)
    if weight is not None:
        weigh(session, weight)
    if height is not None:
        gauge(session, height)
    # The camera last: its pose uses the calibrated arm.
    seen, rows = None, list[CalibratedFigure]()
    if wanted.camera is not None:
        from palpate.runs.calibration.camera import locate

        assert tag is not None
        seen, believed = locate(session, wanted.camera, wanted.intrinsics, tag)
        rows = compare_camera(believed, seen, tag)
    # Write the findings over the figures of the existing file.
    config = merge_findings(existing or before, session)
    write_config(out, config)
    if seen is not None and wanted.plot is not None:
        from palpate.perception.hand_eye import draw_residuals

        draw_residuals(seen, wanted.plot)
    figures = (*compare_figures(start, session.arm), *rows)
    return Calibration(config, figures, out, session.seconds, seen)


def require_consistent(
    settings: Settings, wanted: References, out: Path, existing: RobotConfig | None
) -> None:
    """Require a reference, a scene for a real arm, and files of this same arm. Raises InputError:
    one of them is missing or contradicts another."""
    # Require references and options that belong together.
    if wanted == References():
        raise InputError(
            "nothing to calibrate with: give a known weight (--weight 0.5kg±0.1g), known heights "
            "(--gauge 50mm±0.01mm), a camera and a tag (--camera 0 --tag 0=100mm), or let the arm weigh "
            "itself (--own-weight)"
        )
    if (wanted.camera is None) != (wanted.tag is None):
        raise InputError(
            "camera= and tag= go together: a camera, and the number and side of a tag, e.g. 0=100mm±0.1mm"
        )
    for name in ("intrinsics", "plot"):
        if wanted.camera is None and getattr(wanted, name) is not None:
            raise InputError(f"{name}= goes with camera=SOURCE")
    if wanted.plot is not None and wanted.plot.exists():
        raise InputError(f"'{wanted.plot}' exists already: choose another plot=")
    # A real arm has no bench.
    if settings.robot is not None and settings.scene is None:
        raise InputError(
            "a real arm needs a scene=D.xml that says where it, the weight and the gauges stand"
        )
    # An embedded arm is identified by its noise model and seed.
    simulated = (noise_source(settings.noise), settings.seed) if settings.robot is None else None
    arm = settings.described_arm()
    require_same(arm.config, simulated)
    require_same(existing, simulated, f"'{out}'")
    if existing is not None and existing.arm not in (None, arm.name):
        raise InputError(f"'{out}' is of the arm '{existing.arm}', not of '{arm.name}'")


def merge_findings(under: RobotConfig, session: CalibrationSession) -> RobotConfig:
    """Merge the findings of a session over the figures of an existing file."""
    settings = session.settings
    # Take only the figures of this session; all others stay.
    figures = {name: getattr(session.config, name) for name in MEASURED}
    update = {name: figure for name, figure in figures.items() if figure is not None}
    update |= {"arm": session.arm.name, "simulated": None}
    if settings.robot is None:
        noise, visits = noise_source(settings.noise), session.visits
        update["simulated"] = Simulated(noise=noise, seed=settings.seed, visits=visits)
    return under.model_copy(update=update)


def compare_figures(start: RobotDescription, end: RobotDescription) -> list[CalibratedFigure]:
    """Compare each measured figure with its value before the calibration."""
    old, new, rows = start.config, end.config, list[CalibratedFigure]()
    assert new is not None
    first, last = start.nominal, end.nominal

    def is_new(name: str) -> bool:
        # Compare by identity: a new measurement may give the same value.
        figure = getattr(new, name)
        return figure is not None and figure is not getattr(old, name, None)

    # Torque gains joint by joint, then the tilt by axis, then the scalar figures.
    gains, lean = new.torque_gain, new.base_lean
    if gains is not None and is_new("torque_gain"):
        pairs = zip(gain_values(start), gain_values(end), strict=True)
        for joint, (before, after) in enumerate(pairs, 1):
            rows.append(
                CalibratedFigure(f"torque_gain {joint}", "1", before, after, gains.by or "")
            )
    if lean is not None and is_new("base_lean"):
        # Without a calibration the tilt has the uncertainty of the tip length, over the reach.
        values, stds = (0.0, 0.0), (first.tip_offset_std / start.reach.stretched,) * 2
        if old is not None and old.base_lean is not None:
            values, stds = old.base_lean.value.tolist(), old.base_lean.std.tolist()
        for i, axis in enumerate("xy"):
            after = float(lean.value[i]), float(lean.std[i])
            before = values[i], stds[i]
            rows.append(CalibratedFigure(f"base_lean {axis}", "rad", before, after, lean.by or ""))
    for name, unit in (("pose_repeatability", "m"), ("tip_offset", "m"), ("tip_compliance", "m/N")):
        if is_new(name):
            before, after = (value_and_std(hand, name) for hand in (first, last))
            rows.append(CalibratedFigure(name, unit, before, after, getattr(new, name).by or ""))
    return rows


def compare_camera(
    before: CalibrationViews, after: HandEye, tag: NamedSize
) -> list[CalibratedFigure]:
    """Compare position, rotation and focal length of the camera with those believed before."""
    from palpate.perception.solve import pose_difference

    # Pose difference as six coordinates, with the deviations from both covariances.
    off = pose_difference(after.mount.pose_world_camera, before.mount.pose_world_camera)
    stds = np.sqrt(np.diag(after.mount.covariance)), np.sqrt(np.diag(before.mount.covariance))
    by = f"a tag of {tag.size.text} in {len(after.corners)} pictures"
    figures: list[CalibratedFigure] = []
    for i, (name, unit) in enumerate([*(("camera", "m"),) * 3, *(("camera turn", "rad"),) * 3]):
        start = float(before.mount.pose_world_camera.position[i]) if i < 3 else 0.0
        was, now = (start, float(stds[1][i])), (start + float(off[i]), float(stds[0][i]))
        figures.append(CalibratedFigure(f"{name} {'xyz'[i % 3]}", unit, was, now, by))
    # Relative change of the focal length.
    zoom = after.lens.matrix[0, 0] / before.lens.matrix[0, 0] - 1.0
    was, now = (0.0, before.lens.focal_std), (float(zoom), float(stds[0][6]))
    return [*figures, CalibratedFigure("camera focal length", "1", was, now, by)]


def value_and_std(hand: NominalHand, name: str) -> tuple[float, float]:
    """Look up a figure of an arm with its standard deviation. A repeatability is itself a standard
    deviation, of an error with mean 0.
    """
    if name == "pose_repeatability":
        return 0.0, hand.pose_repeatability
    return getattr(hand, name), getattr(hand, f"{name}_std")


def gain_values(arm: RobotDescription) -> list[tuple[float, float]]:
    """Value and standard deviation of each joint's gain, relative."""
    # From the calibration, or zero with the datasheet's deviation.
    gains = arm.config.torque_gain if arm.config is not None else None
    if gains is not None:
        stds = np.sqrt(gains.spread.diagonal()).tolist()
        return list(zip(gains.value.tolist(), stds, strict=True))
    root = gain_root(arm.nominal, len(arm.joints))
    return [(0.0, float(np.linalg.norm(row))) for row in root]
