"""Estimates from a recording that another program made."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import numpy as np

from palpate.api.given import known_keywords
from palpate.api.runs import Run, run_of
from palpate.callbacks import Progress, RunCallbacks, quiet
from palpate.errors import InputError
from palpate.settings import settings_of
from palpate.stages.recorded import LOAD, Carrying, Recorded, estimate_recorded, pose_text
from palpate.threads import single_threaded_blas

HEAVIEST_HAND = 50.0
"""kg; more on a flange is a mistake of the unit."""


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
    progress: Progress = quiet,
) -> Run:
    """Estimate mass, centre of mass and inertia of what an arm carried, from anybody's recording.

    Args:
        log: CSV, NPZ, MCAP, rosbag2, a ROS bag or Parquet, with joint positions and sensed joint torques.
        loaded: one window `(start, stop)`, or several, in s since its first row, in which the load hung free
            on the hand; none: all of it. At other times the hand is empty, and touches nothing.
        empty: another recording, of the empty hand.
        hand: mass of what is mounted on the flange, kg, or `found`, to weigh it from the recording; by default that
            of the arm's description.
        scene: MJCF whose `object` the load is; its twin is built.
        object: name of the load.
        in_hand: pose of the object in the hand: three or seven numbers, m and quaternion wxyz. Without it centre of
            mass and inertia are in the axes of the tool, from the TCP, and a scene's twin has the mass alone.
        arm: a name, or the folder of a description.
        robot_config: `robot.yaml`: what was measured of this very arm.
        columns: YAML that says which columns of the recording are what.
        progress: told of the present stage.

    Returns:
        A run without a plan's tree, which `save` writes.

    Raises:
        InputError: a file that cannot be used; the message lists the columns that it has.
        Unavailable: the library for its format is not installed.
    """
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
    settings = settings_of(scene=scene, arm=arm, robot_config=robot_config)
    recorded = Recorded(
        Path(log),
        Carrying(object or LOAD, windows, pose, hand),
        None if empty is None else Path(empty),
        None if columns is None else Path(columns),
    )
    with single_threaded_blas():
        return run_of(estimate_recorded(settings, recorded, RunCallbacks(progress=progress)))
