"""Support of an object: hanging free, dragged, falling or tipping."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from palpate.errors import InputError
from palpate.geometry.outline import depth
from palpate.geometry.pose import Array, Pose
from palpate.vocabulary.admissible.footing import SUNK, Footing, footing
from palpate.vocabulary.admissible.solids import solids
from palpate.vocabulary.state import SymbolicState
from palpate.vocabulary.violation import PRECONDITION, Violation

LIFTED = 0.005
"""m: a held object whose bottom is this far above its support is clear of it."""
TIPPING = 0.005
"""m that a centre of mass must be inside the support polygon."""
OFF_CENTRE = 0.1
"""Part of an object's extent by which a centre of mass that nobody states may be off the middle,
each way: as `quantities.com` has it."""
EDGE = 0.003
"""m that an object whose centre of mass is unknown keeps from the edge of what carries it."""
AS_FOUND = 0.003
"""m: an object this near to where it stood stands again."""
UPRIGHT = np.radians(2.0)
"""rad that an object may lean."""
MIN_SLIDE = 0.03
"""m: a shorter slide is not much more than the grip's and the arm's compliance."""


def clear_of_support(state: SymbolicState, name: str, pose_world_object: Pose) -> bool:
    """True if object `name` at that pose hangs free of whatever is below it."""
    return footing(state, name, pose_world_object).gap > LIFTED


def stable(state: SymbolicState, name: str, pose_world_object: Pose) -> str | None:
    """Reason why an object released at a pose (world) would not stay there; None if it would.

    It stays where it stood before, on what carried it then. Elsewhere it must be upright, and its
    centre of mass over the support polygon with `TIPPING` to spare: a stated one, or the middle
    with its uncertainty where the file leaves it to the shapes. An unknown one may be anywhere:
    then all that is to be seen of it from above must be over what carries it.
    """
    if _is_as_found(state, name, pose_world_object):
        return None
    lean = leaning(state, name, pose_world_object)
    if lean > UPRIGHT:
        return f"it would lean by {np.degrees(lean):.0f}° and tip over"
    there = footing(state, name, pose_world_object)
    if not there.carriers:
        return _unsupported(there)
    if _lies_inside(there) or _is_balanced(state, name, pose_world_object, there):
        return _unstable_carrier(state, name, pose_world_object, there)
    carriers = " and ".join(f"'{owner}'" for owner in _owners(there))
    return f"it would tip over the edge of {carriers}"


def leaning(state: SymbolicState, name: str, pose_world_object: Pose) -> float:
    """rad by which an object at a pose (world) leans, against how the scene has it."""
    up = state.scene.body(name).pose_world.rotation[2]
    return float(np.arccos(np.clip(pose_world_object.rotation[2] @ up, -1.0, 1.0)))


def riders(state: SymbolicState, name: str) -> list[str]:
    """Objects that stand on object `name`, and would go where it goes."""
    at = state.pose_of(name)
    body, found = state.scene.body(name), list[str]()
    for other in state.scene.objects.values():
        pose = state.pose_of(other.name)
        x, y, _ = (pose.position - at.position).tolist()
        if other.name in (name, state.holding) or not body.is_near(x, y, other.reach):
            continue
        if other.bottom_z(pose) < body.bottom_z(at):
            continue
        standing = replace(state, holding=None)
        if name in _owners(footing(standing, other.name, pose)):
            found.append(other.name)
    return found


def _is_as_found(state: SymbolicState, name: str, pose: Pose) -> bool:
    """True if an object stands where the scene has it, on what carried it there."""
    found = state.scene.body(name).pose_world
    if pose.distance_to(found) > AS_FOUND or pose.angle_to(found) > UPRIGHT:
        return False
    for owner in _owners(footing(SymbolicState(state.scene), name, found)):
        if owner == state.holding:
            return False
        if owner in state.moved and not _is_as_found(state, owner, state.moved[owner]):
            return False
    return True


def _owners(there: Footing) -> list[str]:
    return list(dict.fromkeys(top.owner for top in there.carriers))


def _unsupported(there: Footing) -> str:
    if math.isinf(there.gap):
        return "nothing is below it"
    if there.gap > 0:
        return f"it would fall by {there.gap:.3f} m"
    return f"it would be pressed {-there.gap:.3f} m into what is below it"


def _lies_inside(there: Footing) -> bool:
    """True if all that is seen of it from above is over what carries it."""
    tops = [top.outline for top in there.carriers]
    return all(max(depth(top, corner) for top in tops) >= EDGE for corner in there.outline)


def _is_balanced(state: SymbolicState, name: str, pose: Pose, there: Footing) -> bool:
    """True if its centre of mass is over its support polygon; of an unknown one nobody can say."""
    centre = _centre_of_mass(state, name, pose)
    if centre is None:
        return False
    point, spread = centre
    return depth(there.support, point) >= TIPPING + spread


def _centre_of_mass(state: SymbolicState, name: str, pose: Pose) -> tuple[Array, float] | None:
    """Centre of mass seen from above (2,), and its uncertainty, m; None where it is unknown."""
    body = state.scene.body(name)
    if "com" in body.known:
        return pose.apply(body.known["com"])[:2], 0.0
    if "com" not in body.assumed:
        return None
    middle = pose.apply(solids(state.scene).centre_of_mass(name))
    extent = np.abs(pose.rotation[:2]) @ body.size
    return middle[:2], float(OFF_CENTRE * extent.max())


def _unstable_carrier(state: SymbolicState, name: str, pose: Pose, there: Footing) -> str | None:
    """Reason why a carrier of the object would not stay with it on top; None if all would."""
    for owner in _owners(there):
        if owner not in state.scene.objects:
            continue
        without = replace(state, moved={**state.moved, name: pose})
        below = footing(without, owner, state.pose_of(owner))
        inside = all(depth(below.support, corner) >= 0 for corner in there.support)
        if not inside:
            return f"'{owner}' would tip under it"
    return None


def slides(before: SymbolicState, after: SymbolicState) -> bool:
    """True if a motion from one state to the other drags the held object along its support."""
    stands = before.holding is not None and not before.lifted and not after.lifted
    return stands and _travel(before, after) > LIFTED and _descent(before, after) <= SUNK


def dragged_off(before: SymbolicState, after: SymbolicState) -> str | None:
    """Reason why a held object on its support would no longer stand at the end of a motion that
    does not lift it; None if it would, or is lifted."""
    held = before.holding
    if held is None or before.lifted or _travel(before, after) <= LIFTED:
        return None
    start, end = before.pose_of(held), after.pose_of(held)
    rise = float(end.position[2] - start.position[2])
    if rise > LIFTED:
        return None
    if rise < -SUNK:
        return f"'{after.at}' is {-1e3 * rise:.0f} mm lower than where it stands"
    return stable(before, held, end)


def would_fall(state: SymbolicState) -> list[Violation]:
    """Violation of opening the fingers: the held object would not stay."""
    if not state.holding:
        return []
    if not state.lifted:
        reason = stable(state, state.holding, state.pose_of(state.holding))
        return [_unstable(state, reason)] if reason else []
    return [
        Violation(
            "gripper-state",
            f"'{state.holding}' is lifted and would fall; MovePose it onto its support first, "
            f"e.g. to '{state.grasp}'",
        )
    ]


def _unstable(state: SymbolicState, reason: str) -> Violation:
    return Violation(
        "unsupported",
        f"'{state.holding}' would not stay where it is let go of: {reason}; MovePose it to where "
        f"it stood, e.g. to '{state.grasp}', or well inside a surface, before OpenGripper",
    )


def above(state: SymbolicState, expression: str | None) -> str:
    """A pose expression with one z_offset more; what is no pose expression stays as it is."""
    try:
        return str(state.scene.symbols.parse(expression or "").shifted("z_offset", 1))
    except InputError:
        return f"{expression}"


def would_be_dragged(state: SymbolicState) -> list[Violation]:
    """Violation of a joint motion, which is no straight line, with a held object on its support."""
    if not state.holding or state.lifted:
        return []
    return [
        Violation(
            PRECONDITION,
            f"'{state.holding}' stands on its support in the gripper; lift it: MovePose to "
            f"'{above(state, state.grasp)}' first; or open the gripper",
        )
    ]


def _descent(before: SymbolicState, after: SymbolicState) -> float:
    """m that the TCP goes down; 0 where that is not known."""
    if before.pose_world_tcp is None or after.pose_world_tcp is None:
        return 0.0
    return float(before.pose_world_tcp.position[2] - after.pose_world_tcp.position[2])


def _travel(before: SymbolicState, after: SymbolicState) -> float:
    """Distance between the two TCPs, m; 0 where one is not known."""
    if before.pose_world_tcp is None or after.pose_world_tcp is None:
        return 0.0
    return before.pose_world_tcp.distance_to(after.pose_world_tcp)
