"""Recordings in one call: estimate a load, dynamics and noise of an arm, and poses from a
camera."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from palpate.common.display import to_json
from palpate.common.errors import InputError
from palpate.common.files import path_of, write_new
from palpate.common.processes import single_threaded_blas
from palpate.estimation.arm_dynamics import DynamicsFit as InnerDynamics
from palpate.estimation.arm_dynamics import identify
from palpate.estimation.logs.noise_model import (
    LogStatistics,
    noise_file,
    stated_figures,
    statistics,
)
from palpate.estimation.logs.torque_errors import FigureInterval
from palpate.estimation.logs.trace import Carrying
from palpate.perception.look import Seen
from palpate.robots.description import RobotDescription
from palpate.robots.owner import DEFAULT, load_description
from palpate.runs.callbacks import Progress, RunCallbacks, ignore
from palpate.runs.recorded import LOAD, estimate_recording, pose_text
from palpate.runs.settings import settings_of
from palpate.runs.stored import Run, contents_of, known_keywords, run_of
from palpate.scene.scene import Scene
from palpate.trace.recording import ArmLog

HEAVIEST_HAND = 50.0  # kg: largest mass on a flange. A larger number is an error of the unit.


@known_keywords
def estimate(
    log: str | Path,
    loaded: tuple[float, float] | Sequence[tuple[float, float]] = (),
    *,
    empty: str | Path | None = None,
    hand: float | Literal["found"] | None = None,
    scene: str | Path | None = None,
    object: str | None = None,
    in_hand: str | Sequence[float] | None = None,
    arm: str | Path = "fr3",
    robot_config: str | Path | None = None,
    columns: str | Path | None = None,
    remeasure: bool = False,
    progress: Progress = ignore,
) -> Run:
    """Estimate mass, centre of mass and inertia of a load from a recording of any arm.

    Args:
        log: CSV, NPZ, MCAP, rosbag2, a ROS bag or Parquet, with joint positions and sensed joint
            torques, or with the wrench and the pose of a six-axis sensor.
        loaded: one window `(start, stop)`, or several, in s since its first row, in which the load
            hung free on the hand; none: all of it. At other times the hand is empty, and touches
            nothing.
        empty: another recording, of the empty hand.
        hand: mass of everything mounted on the flange, kg, or `found`, to estimate it from the
            recording; by default that of the arm's description.
        scene: MJCF whose `object` the load is; its twin is built.
        object: name of the load.
        in_hand: pose of the object in the hand: three or seven numbers, m and quaternion wxyz.
            Without it centre of mass and inertia are in the axes of the tool, from the TCP, and a
            scene's twin has only the mass.
        arm: a name, or the folder of a description.
        robot_config: `robot.yaml`: calibration of this very arm.
        columns: YAML that maps the recording's columns to signals.
        remeasure: replace values that the scene states in its twin; else the twin keeps them.
        progress: called with the name of the present stage.

    Returns:
        A run without a plan's tree, which `save` writes.

    Raises:
        InputError: a file that cannot be used; the message lists the columns that it has.
        Unavailable: the library for its format is not installed.
    """
    # Check the arguments before any file is read.
    if scene is not None and object is None:
        raise InputError("a scene needs object=, the name of the body that was carried")
    is_mass = isinstance(hand, float | int) and not isinstance(hand, bool)
    if not (hand in (None, "found") or (is_mass and 0.0 <= hand < HEAVIEST_HAND)):
        raise InputError(f"hand={hand!r}: give a number of kg, 0 to {HEAVIEST_HAND:g}, or 'found'")
    if in_hand is not None and not isinstance(in_hand, str):
        in_hand = " ".join(f"{number:g}" for number in in_hand)
    pose = None if in_hand is None else pose_text(in_hand)
    try:
        windows = tuple((float(start), float(stop)) for start, stop in np.reshape(loaded, (-1, 2)))
    except (TypeError, ValueError):
        raise InputError(f"loaded={loaded}: give (start, stop) in s, or several of these") from None
    # Estimate with one BLAS thread: the matrices are small.
    settings = settings_of(scene=scene, arm=arm, robot_config=robot_config, remeasure=remeasure)
    carrying, callbacks = (
        Carrying(object or LOAD, windows, pose, hand),
        RunCallbacks(progress=progress),
    )
    unloaded = None if empty is None else path_of(empty, "empty")
    names = None if columns is None else path_of(columns, "columns")
    with single_threaded_blas():
        recording = path_of(log, "log")
        run = estimate_recording(settings, recording, carrying, unloaded, names, callbacks)
        return run_of(run)


# Dynamics of an arm, from a recording of it.


class ArmDynamics(InnerDynamics):
    """Dynamics of an arm that can be written into its MJCF."""

    def save(self, path: str | Path) -> tuple[Path, ...]:
        """Write the arm's MJCF with the identified friction, damping, armature and inertias to `path`.

        Returns:
            Every file written, `path` first.

        Raises:
            InputError: it exists, or cannot be written.
        """
        from palpate.twin.arm import save_arm

        return save_arm(self, Path(path))


@known_keywords
def dynamics(
    log: str | Path | ArmLog,
    arm: str | Path = DEFAULT,
    *,
    hand: float | None = None,
    columns: str | Path | None = None,
) -> ArmDynamics:
    """Identify the dynamics of an arm from a recording of its free motion.

    Args:
        log: CSV, NPZ, MCAP, rosbag2 or Parquet with time, joint positions and torques; or an
            `ArmLog`.
        arm: name of the arm, or folder of its description.
        hand: kg of everything mounted on the flange; 0 is a bare flange; None estimates it.
        columns: YAML that maps the log's columns to signals.

    Raises:
        InputError: a file that cannot be read, no such arm, too short a recording, or no joint
            moves.
    """
    from palpate.estimation.logs.reading import log_of, require_joint_torques

    described = load_description(str(arm))
    require_joint_torques(described)
    log = log_of(log, columns)
    fit = identify(log, described, hand)
    return ArmDynamics(**contents_of(fit, InnerDynamics))


# Noise of an arm, from a recording of it.

COMPARED_MODELS = ("measured", "hardware", "datasheet", "lab")


@dataclass(frozen=True, slots=True, eq=False)
class ArmNoise:
    """Errors of an arm's joint signals in a recording of free motion.

    Attributes:
        source: name of the recording.
        seconds: its length.
        statistics: figures of each joint.
        arm: description of the arm.
        notes: repairs at reading.
    """

    source: str
    seconds: float
    statistics: LogStatistics
    arm: RobotDescription
    notes: tuple[str, ...] = ()

    @property
    def figures(self) -> dict[str, FigureInterval]:
        """Figures of each joint, by name."""
        return self.statistics.figures()

    @property
    def models(self) -> dict[str, dict[str, list[float]]]:
        """Figures in palpate's own noise models, by the model's name."""
        return {
            name: {key: values.tolist() for key, values in stated_figures(name, self.arm).items()}
            for name in COMPARED_MODELS
        }

    def record(self) -> dict[str, Any]:
        """Return all figures, and those of the noise models for comparison, as JSON."""
        figures = {
            name: {"value": figure.value, "low": figure.low, "high": figure.high}
            for name, figure in self.figures.items()
        }
        head = {"log": self.source, "seconds": self.seconds, "notes": self.notes}
        return to_json(head | {"figures": figures, "models": self.models})

    def save(self, path: str | Path) -> Path:
        """Write a noise model with these figures, for `noise=FILE.yaml`.

        Raises InputError: the file exists, or cannot be written.
        """
        path = Path(path)
        text = noise_file(self.statistics, self.arm, path.stem, self.seconds)
        write_new(path, text)
        return path


@known_keywords
def noise(
    log: str | Path | ArmLog, arm: str | Path = DEFAULT, *, columns: str | Path | None = None
) -> ArmNoise:
    """Measure the errors of an arm's joint signals in a recording of its free motion.

    Args:
        log: CSV, NPZ, MCAP, rosbag2 or Parquet with time, joint positions and torques; or an
            `ArmLog`.
        arm: name of the arm, or folder of its description.
        columns: YAML that maps the log's columns to signals.

    Raises:
        InputError: a file that cannot be read, no such arm, or too short a recording.
    """
    from palpate.estimation.logs.reading import log_of, require_joint_torques

    described = load_description(str(arm))
    require_joint_torques(described)
    log = log_of(log, columns)
    figures = statistics(log, described)
    return ArmNoise(log.source, float(log.t[-1] - log.t[0]), figures, described, log.notes)


# A look at the workspace.


@known_keywords
def see(
    scene: str | Path | Scene,
    camera: str | int,
    *,
    intrinsics: str | Path | None = None,
    world: str | Path | None = None,
    poses: str | Path | None = None,
    arm: str | Path = DEFAULT,
    root: str | Path | None = None,
    seed: int = 0,
    pose_estimator: str | None = None,
    robot_config: str | Path | None = None,
) -> Seen:
    """Find a scene's objects in one look of a camera: by their tags, by a pose estimator, or both.

    Args:
        scene: a file, MJCF text, or a `Scene`, with a site `tag_12` for every tag.
        camera: a picture or a video, the number of a camera, or `world:NAME`, a camera of the
            simulated world.
        intrinsics: YAML with the lens of a real camera.
        world: MJCF of the simulated world; the scene itself without one.
        poses, arm, root, robot_config: as for `load`, if the scene is read here.
        seed: of the simulated camera's errors.
        pose_estimator: a command, or `http://HOST:PORT/PATH`, that returns the poses of the
            objects.

    Returns:
        The seen poses with their covariances; `save` writes them to a poses.yaml.

    Raises:
        InputError: no such camera, nothing to see by, or a file or an answer that cannot be used.
        Unavailable: OpenCV is not installed, or a camera or pose estimator does not answer.
    """
    from palpate.runs.api import load
    from palpate.runs.workplace import look_at_source

    known = (
        scene
        if isinstance(scene, Scene)
        else load(scene, poses, arm, root=root, robot_config=robot_config)
    )
    lens, hidden = (None if file is None else Path(file) for file in (intrinsics, world))
    return look_at_source(known, str(camera), lens, hidden, seed, pose_estimator)
