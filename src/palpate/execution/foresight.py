"""Where things really end: what a rehearsal saw after each leaf, for later leaves and for the run.

Effects of primitives are geometry alone. In physics closing fingers centre an object, a dragged one lags
behind, a released one settles. The rehearsal compares the believed poses with the simulated ones after each
motion, and corrects the symbolic state; the run corrects its own by the same differences.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from palpate.geometry.pose import Pose
from palpate.robots.simulated.world import World
from palpate.vocabulary.state import SymbolicState

NOTICED = 1e-3
"""m: smaller differences are left: a simulated contact's softness, and what a real grasp scatters."""
TURNED = 0.02  # rad, likewise


@dataclass(frozen=True, slots=True)
class Foresight:
    """Differences between believed and simulated poses.

    Attributes:
        shifts: by path of a leaf and name of an object, the pose of the simulated object in the frame of the
            believed one; of a held object in the hand, of others in the world.
    """

    shifts: Mapping[str, Mapping[str, Pose]] = field(default_factory=dict[str, Mapping[str, Pose]])

    def settled(self, path: str, state: SymbolicState) -> SymbolicState:
        """State after the leaf `path`, with every object where it ended in the rehearsal."""
        return moved_by(state, self.shifts.get(path, {}))


class Look:
    """Comparison of the symbolic state with a simulated world after every leaf."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._shifts: dict[str, dict[str, Pose]] = {}

    @property
    def foresight(self) -> Foresight:
        """What was seen so far."""
        return Foresight(self._shifts)

    def settled(self, path: str, state: SymbolicState) -> SymbolicState:
        """State after the leaf `path`, with every object where it is; the differences are kept."""
        tcp, shifts = self._world.true_tcp(), dict[str, Pose]()
        for name, pose in self._world.true_poses(state.scene.objects).items():
            shift = difference(state, name, pose, tcp)
            if shift is not None:
                shifts[name] = shift
        if shifts:
            self._shifts[path] = shifts
        return moved_by(state, shifts)


def difference(state: SymbolicState, name: str, true: Pose, tcp: Pose) -> Pose | None:
    """Pose of an object that is at `true`, in the frame of the believed one, None where they agree; for a
    held object as it is in the hand at `tcp`: how far the arm sags is no property of the grasp."""
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
        if name != state.holding:
            moved[name] = state.pose_of(name) @ shift
        elif in_hand is not None:
            in_hand = in_hand @ shift
    return replace(state, moved=moved, pose_tcp_object=in_hand)
