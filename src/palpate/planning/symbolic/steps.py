"""Steps of a plan under construction, and candidate pose expressions."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from palpate.common.errors import InputError
from palpate.common.parameter import Parameter
from palpate.planning.plan import Node
from palpate.primitives.base import Primitive
from palpate.primitives.gripper import TOP
from palpate.primitives.rules import motion
from palpate.primitives.rules.clearance import straddled_object
from palpate.primitives.rules.solids import solids
from palpate.primitives.rules.support import carriers, surfaces_slid_on
from palpate.primitives.state import (
    HOME_CONFIG,
    RESTORED_POSITION,
    SAME_POSE,
    SymbolicState,
    Violation,
    during,
    parallel,
)
from palpate.scene.load import TEMPORARY
from palpate.scene.scene import Scene

TURNED = 0.1  # rad. Maximum rotation of an object that still counts as restored.
SLIDE = 0.06  # m. Minimum length of a slide for friction.
ASIDE = 0.03  # m. Minimum offset of a slide along the other axis.


@dataclass(frozen=True, slots=True)
class Step:
    """Primitives that run together, as a Parallel when there are several."""

    primitives: tuple[Primitive, ...]  # the primitives
    touches: bool = False  # the step ends in contact with a surface

    @property
    def moving(self) -> list[Primitive]:
        """Primitives that claim the arm or the gripper."""
        return [primitive for primitive in self.primitives if primitive.claims]

    @property
    def sensing(self) -> list[Primitive]:
        """Primitives that only sense or convert."""
        return [primitive for primitive in self.primitives if not primitive.claims]

    @property
    def label(self) -> str:
        """Label for people."""
        return " beside ".join(primitive.label for primitive in self.primitives)

    def harm(self, state: SymbolicState) -> Violation | None:
        """Return the first violation of its motions by the exact check; None without any."""
        for primitive in self.moving:
            for violation in primitive.violations(state):
                return violation
        return None

    def effect(self, state: SymbolicState) -> SymbolicState:
        """Return the state after the step."""
        moving, sensing = self.moving, self.sensing
        branches = [sensing] if sensing else []
        meanwhile = during(moving, state) if sensing else state
        return parallel(state, meanwhile, moving, branches, lambda leaf, before: before.after(leaf))

    def apply(self, state: SymbolicState) -> SymbolicState | None:
        """Return the state after the step; None if a precondition fails or the step is not preferred."""
        moving, sensing = self.moving, self.sensing
        try:
            meanwhile = during(moving, state) if sensing else state
            if any(primitive.violations(meanwhile) for primitive in sensing):
                return None
            # Computing the effects of a guarded motion is slow: test its preconditions first.
            if any(state.unmet(primitive) for primitive in moving):
                return None
            after = self.effect(state)
        except InputError:
            return None
        preferred = (is_preferred(part, state, after, recorded=bool(sensing)) for part in moving)
        return after if all(preferred) else None

    def node(self) -> Node:
        """Return the node of a plan, with arguments in file format."""
        nodes: list[Node] = []
        for primitive in self.primitives:
            # Plans hold JSON arrays as tuples, so that nodes are comparable.
            arguments: list[tuple[str, Any]] = []
            for name, value in primitive.model_dump(mode="json", exclude_none=True).items():
                if isinstance(value, list):
                    value = tuple(cast("list[object]", value))
                arguments.append((name, value))
            nodes.append(Node(type(primitive).__name__, tuple(arguments)))
        return nodes[0] if len(nodes) == 1 else Node("Parallel", children=tuple(nodes))


def is_preferred(
    primitive: Primitive, before: SymbolicState, after: SymbolicState, recorded: bool
) -> bool:
    """True if this planner uses an action; it is stricter than the check and avoids detours.

    Args:
        primitive: the action.
        before, after: the states before and after it.
        recorded: a sensing primitive runs in parallel.
    """
    # From an unknown pose, only the home configuration is a target.
    if before.pose_world_tcp is None:
        return after.at == HOME_CONFIG
    if "arm" not in primitive.claims:
        if after.gripper != "closed":
            return releases_in_place(before)
        # The empty hand closes only above an object, to probe its top with the fingertips.
        probes = after.at is not None and after.at.endswith(TOP)
        return probes or after.holding is not None
    if after.contact:
        # A guarded motion begins without contact.
        return not before.contact and not straddles(before)
    if after.is_bent:
        # Joint motions need a free hand.
        return not (before.contact or before.holding or straddles(before))
    # A motion to the current pose is useless unless it records a tilt.
    if after.at == before.at and not before.contact and not (primitive.tilts and recorded):
        return False
    # A dragged object must slide along an acceptable path.
    dragged = before.holding is not None and not before.lifted and not after.lifted
    if dragged and not slides_well(before, after, recorded):
        return False
    return motion.is_cautious(before, after)


def releases_in_place(before: SymbolicState) -> bool:
    """True if an object is released at its scene pose or temporary place, or the closed hand is empty.

    An object taken at its scene pose is released at the expression of its grasp. A put-down at a short offset
    would be within the tolerance of the scene pose, and the next grasp there would hold the same spot of it.
    """
    name = before.holding
    if before.gripper == "open" or name is None:
        return before.gripper != "open"
    angle = before.pose_of(name).angle_to(before.scene.body(name).pose_world)
    is_return = before.at == before.grasp or (before.grasp or "").endswith(TEMPORARY)
    if is_return and not is_away(before, name) and angle < TURNED:
        return True
    return before.at == f"{name}{TEMPORARY}"


def slides_well(before: SymbolicState, after: SymbolicState, recorded: bool) -> bool:
    """True if a slide on one surface is long enough to record friction, or leads back to the initial pose."""
    if before.pose_world_tcp is None or after.pose_world_tcp is None:
        return False
    if after.pose_world_tcp.angle_to(before.pose_world_tcp) > SAME_POSE:
        return False
    # The friction estimate uses every drag, also those without a parallel recording.
    if len(surfaces_slid_on(before, after)) != 1:
        return False
    travel = after.pose_world_tcp.distance_to(before.pose_world_tcp)
    if recorded:
        return travel >= SLIDE - RESTORED_POSITION
    if travel >= 2 * SLIDE or (after.grasp or "").endswith(TEMPORARY):
        return False
    return not is_away(after, after.holding or "")


def straddles(state: SymbolicState) -> bool:
    """True if an object is between the open fingers."""
    return not state.holding and straddled_object(state, state.pose_world_tcp) is not None


def is_away(state: SymbolicState, name: str) -> bool:
    """True if an object is not at its scene pose."""
    return name in state.displaced_objects()


def is_clear(state: SymbolicState) -> bool:
    """True if the hand is open, empty, and free of contact."""
    idle = state.gripper == "open" and not state.holding and not state.contact
    return idle and not straddles(state)


def nodes(steps: Sequence[Step]) -> Iterator[Node]:
    """Yield the steps as nodes; sensing joins the contact before it in one Sequence."""
    group: list[Node] = []
    for i, step in enumerate(steps):
        group.append(step.node())
        sensing_follows = i + 1 < len(steps) and not steps[i + 1].moving
        if sensing_follows and (step.touches or step.sensing or not step.moving):
            continue
        yield Node("Sequence", children=tuple(group)) if len(group) > 1 else group[0]
        group = []


# Candidate pose expressions for missing evidence, around an object.


# Offsets. Distance between the touched spots of a surface: 1.5 offsets are 75 mm. Three spots
# define a plane.
SPOT = 1.5
# Offsets of slides. The closing direction of the fingers is first; an object may tip in the grip
# across it.
SIDEWAYS = ("y_offset", "x_offset")
BALANCE = "_balance"  # Name ending of the pose at which an object balances, as estimated in a run
# m. Minimum offset of the centre of mass from the grasp for one side to count as nearer.
NEARER = 0.005


def places(scene: Scene, parameter: Parameter, state: SymbolicState) -> Iterator[list[str]]:
    """Yield sets of pose expressions for the missing evidence: declared places, else around the object."""
    quantity, name = scene.catalogue[parameter.quantity], parameter.object
    if any(item.distinct == "place" and item.count > 1 for item in quantity.evidence):
        # Three spots of a surface that are not collinear, in four arrangements.
        _, spot = approach(scene, name)
        first, other = SIDEWAYS
        for sign in "+-":
            for across in "+-":
                yield [spot, f"{spot} {sign} {SPOT}*{first}", f"{spot} {across} {SPOT}*{other}"]
        return
    if not any(evidence.place for evidence in quantity.evidence):
        yield from domains(scene, name)
        return
    # Yield the dedicated places of evidence that is still missing.
    done = {kind for kind, _ in quantity.pieces(parameter, state.logged)}
    for kind, evidence in enumerate(quantity.evidence):
        spot = f"{name}_{evidence.place}"
        if kind not in done:
            yield [f"{spot} + z_offset", spot] if evidence.holding else [spot]


def balance_expressions(
    scene: Scene, parameter: Parameter, state: SymbolicState
) -> Iterator[list[str]]:
    """Yield pose expressions at the balance point for the last of several grasps.

    The earlier grasps locate the balance point. Yield none if it is believed to lie at the first
    grasp.
    """
    quantity, name = scene.catalogue[parameter.quantity], parameter.object
    line = scene.symbols.lines.get(f"{name}{BALANCE}")
    if line is None or abs(line.believed) < NEARER:
        return
    recorded = Counter(kind for kind, _ in quantity.pieces(parameter, state.logged))
    for kind, evidence in enumerate(quantity.evidence):
        if evidence.distinct == "grasp" and recorded[kind] == evidence.count - 1 > 0:
            yield [f"{name}{BALANCE} + z_offset", f"{name}{BALANCE}"]


def domains(scene: Scene, name: str) -> Iterator[list[str]]:
    """Yield growing sets of pose expressions around a body: above and at it, then shifted ones."""
    above, spot = approach(scene, name)
    if name not in scene.bodies:  # the gripper: above any object
        yield [approach(scene, other)[0] for other in scene.objects]
        return
    if name not in scene.objects:
        yield [spot, above]
        return
    yield [above, spot]
    # Slides from the initial pose in both directions of an axis.
    for axis in SIDEWAYS:
        factor = multiples(scene, axis, spot, SLIDE)
        yield [above, spot, *(f"{spot} {sign} {factor}*{axis}" for sign in "+-")]
    # An object on several surfaces slides at its temporary place on one surface instead.
    if stands_on_seam(scene, name):
        place = f"{name}{TEMPORARY}"
        for axis in SIDEWAYS if exists(scene, place) else ():
            factor = multiples(scene, axis, place, SLIDE)
            ends = [place, *(f"{place} {sign} {factor}*{axis}" for sign in "+-")]
            yield [above, spot, *ends, *(f"{end} + z_offset" for end in ends)]
    # Other grasps. The grasp nearest to the believed centre of mass is last: after all grasps the
    # object turns least there.
    for axis in reversed(SIDEWAYS):
        expressions = [above, spot]
        for sign in "-+" if towards_centre(scene, name, axis) > NEARER else "+-":
            shifted = f"{spot} {sign} {axis}"
            expressions += [f"{shifted} + z_offset", shifted]
        yield expressions


def corners(scene: Scene, name: str, axis: str, state: SymbolicState, sides: str) -> Iterator[str]:
    """Yield end points of a second slide that starts after one along `axis`.

    The end point lies next to the initial pose. A third slide along the other axis closes the
    triangle.
    """
    _, spot = approach(scene, name)
    (other,) = (other_axis for other_axis in SIDEWAYS if other_axis != axis)
    along, aside = multiples(scene, axis, spot, SLIDE), multiples(scene, other, spot, ASIDE)
    if state.at in [f"{spot} {sign} {along}*{axis}" for sign in "+-"]:
        for sign in sides:
            yield f"{spot} {sign} {aside}*{other}"


def approach(scene: Scene, name: str) -> tuple[str, str]:
    """Return the pose expressions above an object or surface and at it."""
    graspable = name in scene.objects or name in scene.fixtures
    spot = f"{name}_pose" if graspable else f"{name}_approach"
    return f"{spot} + z_offset", spot


def exists(scene: Scene, expression: str) -> bool:
    """True if the scene can resolve a pose expression."""
    try:
        scene.symbols.resolve(expression)
    except InputError:
        return False
    return True


def stands_on_seam(scene: Scene, name: str) -> bool:
    """True if several surfaces carry an object together, so that it must be slid elsewhere."""
    return len(carriers(SymbolicState(scene), name, [scene.body(name).pose_world])) > 1


def towards_centre(scene: Scene, name: str, axis: str) -> float:
    """Distance (m) along an offset from the grasp of an object to its believed centre of mass."""
    grasp = f"{name}_pose"
    offset = scene.symbols.offset(axis, grasp)
    length = float(np.linalg.norm(offset))
    if length == 0.0:
        return 0.0
    centre = scene.body(name).pose_world.apply(solids(scene).centre_of_mass(name))
    return float((centre - scene.symbols.resolve(grasp).position) @ offset) / length


def multiples(scene: Scene, axis: str, spot: str, distance: float) -> int:
    """Return the smallest multiple of an offset with a length of at least `distance` (m)."""
    length = float(np.linalg.norm(scene.symbols.offset(axis, spot)))
    return max(1, math.ceil(distance / max(length, 1e-3)))
