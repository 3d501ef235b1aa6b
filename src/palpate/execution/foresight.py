"""Foresight: poses of objects, and widths and weights in the fingers, after each leaf of a rehearsal.

Effects of primitives are purely geometric. In physics, closing fingers centre an object, a dragged object
lags behind, and a released object settles. The rehearsal compares the believed poses with the simulated
ones after each motion, and corrects the symbolic state. The run applies the same corrections. It stops if
the fingers' width differs from the rehearsal, or if the weight contradicts the one that the scene states.
Later motions would not be rehearsed. An unknown weight contradicts nothing: payload, torques and slip limit it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import ConfigDict, Field, PlainSerializer, PlainValidator

from palpate.common.pose import Pose
from palpate.primitives.base import Blackboard, LeafFailure
from palpate.primitives.state import SymbolicState
from palpate.robots.sheet import finite_array
from palpate.robots.simulated.world import World

# m, least difference of positions that is corrected. Smaller ones come from the softness of
# simulated contacts and the scatter of real grasps.
NOTICED = 1e-3
TURNED = 0.02  # rad, least difference of attitudes that is corrected
OTHER_WIDTH = 0.005  # m, largest difference of the fingers' widths in rehearsal and run, plus a seen object's doubt
FARTHEST = 0.1  # m, largest valid shift of an object in a stored rehearsal
# Factor on a stated weight, and least margin in N: largest difference of a weight in the run. The
# margin is at least the error of the measured weight, which joint friction causes.
OTHER_WEIGHT, UNSURE = 3.0, 3.0


def _shift(row: Any) -> Pose:
    """Read a shift from seven numbers, position and quaternion."""
    numbers = finite_array(row, (7,), "give seven numbers")
    pose = Pose(numbers[:3], numbers[3:])
    if np.linalg.norm(pose.position) > FARTHEST or abs(np.linalg.norm(pose.quaternion) - 1) > 1e-6:
        raise ValueError("no shift of an object")
    return pose


def _row(pose: Pose) -> list[float]:
    return pose.vector.tolist()


Shift = Annotated[Pose, PlainValidator(_shift), PlainSerializer(_row)]
Finite = Annotated[float, Field(allow_inf_nan=False)]


@dataclass(frozen=True, slots=True)
class Foresight:
    """Observations of a rehearsal."""

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid")

    # Pose of the simulated object in the frame of the believed one, by path of a leaf and name of
    # the object. For a held object, both are poses in the hand.
    shifts: Mapping[str, Mapping[str, Shift]] = field(default_factory=dict[str, Mapping[str, Pose]])
    # m between the fingers after a leaf, by its path, while they hold an object.
    widths: Mapping[str, Finite] = field(default_factory=dict[str, float])
    # N, least and largest weight of each object in all worlds.
    weights: Mapping[str, tuple[Finite, Finite]] = field(
        default_factory=dict[str, tuple[float, float]]
    )

    def settled(self, path: str, blackboard: Blackboard) -> SymbolicState:
        """State after the leaf `path`, with all objects at their final poses of the rehearsal.

        Raises LeafFailure: the fingers hold another object than in the rehearsal.
        """
        if reason := self._other(path, blackboard):
            raise LeafFailure(f"not as rehearsed: {reason}")
        return moved_by(blackboard.state, self.shifts.get(path, {}))

    def _other(self, path: str, blackboard: Blackboard) -> str | None:
        """Reason why the fingers do not hold the rehearsed object; None if they do."""
        name, load, rehearsed = blackboard.state.holding, blackboard.load, self.widths.get(path)
        if name is None or rehearsed is None:
            return None
        # By the width: another object, or another grasp of the same one.
        width, body = blackboard.robot.state.width, blackboard.scene.body(name)
        doubt = load.gives + (2.0 * (body.accuracy or 0.0) if body.seen else 0.0)
        if abs(width - rehearsed) > OTHER_WIDTH + doubt:
            return f"the fingers hold '{name}' at {1e3 * width:.0f} mm, and {1e3 * rehearsed:.0f} mm then"
        # By the weight, if the scene states it: outside of the rehearsed range, with margins.
        if "mass" not in body.known:
            return None
        least, most = self.weights.get(name, (0.0, float("inf")))
        margin = max(UNSURE, load.error)
        low, high = least / OTHER_WEIGHT - margin, most * OTHER_WEIGHT + margin
        if load.hanging is None or low <= load.weight <= high:
            return None
        return (
            f"'{name}' pulls with {load.weight:.1f} N, and with {least:.1f} to {most:.1f} N then: state about "
            "what it weighs, or see what hangs on it"
        )

    def displaced_most(self, name: str) -> str:
        """Path of the leaf that displaced an object most; `tree` without one."""
        # Length of the shift of the object after each leaf.
        ways = {
            path: float(np.linalg.norm(shifts[name].position))
            for path, shifts in self.shifts.items()
            if name in shifts
        }
        return max(ways, key=ways.__getitem__, default="tree")

    def among(self, *others: Foresight) -> Foresight:
        """This foresight with weight ranges that include those of other worlds."""
        weights = dict(self.weights)
        # Union of the ranges of all worlds.
        for other in others:
            for name, (least, most) in other.weights.items():
                low, high = weights.get(name, (least, most))
                weights[name] = min(low, least), max(high, most)
        return replace(self, weights=weights)


class WorldComparison:
    """Comparison of the symbolic state with a simulated world after every leaf."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._shifts: dict[str, dict[str, Pose]] = {}
        self._widths: dict[str, float] = {}

    @property
    def foresight(self) -> Foresight:
        """Observations so far."""
        weights = {name: (weight, weight) for name, weight in self._world.weights().items()}
        return Foresight(self._shifts, self._widths, weights)

    def settled(self, path: str, blackboard: Blackboard) -> SymbolicState:
        """State after the leaf `path`, with all objects at their true poses; records the differences."""
        state, shifts = blackboard.state, dict[str, Pose]()
        if state.holding is not None:
            self._widths[path] = blackboard.robot.state.width
        # Compare the believed pose of every object with its pose in the simulated world.
        tcp = self._world.true_tcp()
        for name, pose in self._world.true_poses(state.scene.objects).items():
            shift = difference(state, name, pose, tcp)
            if shift is not None:
                shifts[name] = shift
        if shifts:
            self._shifts[path] = shifts
        return moved_by(state, shifts)


def difference(state: SymbolicState, name: str, true: Pose, tcp: Pose) -> Pose | None:
    """Pose of an object at `true` in the frame of the believed one; None if they agree.

    For a held object, both are poses in the hand at `tcp`: the sag of the arm is no property of the
    grasp.
    """
    believed = state.pose_of(name)
    if name == state.holding:
        if state.pose_tcp_object is None:
            return None
        believed, true = state.pose_tcp_object, tcp.inverse() @ true
    if believed.distance_to(true) <= NOTICED and believed.angle_to(true) <= TURNED:
        return None
    return believed.inverse() @ true


def moved_by(state: SymbolicState, shifts: Mapping[str, Pose]) -> SymbolicState:
    """State with objects displaced by `shifts`, each in its own frame."""
    if not shifts:
        return state
    moved = dict(state.moved)
    in_hand = state.pose_tcp_object
    for name, shift in shifts.items():
        # A held object shifts in the hand, any other one in the world.
        if name != state.holding:
            moved[name] = state.pose_of(name) @ shift
        elif in_hand is not None:
            in_hand = in_hand @ shift
            moved[name] = state.tcp @ in_hand
    return replace(state, moved=moved, pose_tcp_object=in_hand)
