"""Pose expressions to visit: where evidence is missing, around an object, beside it."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator

import numpy as np

from palpate.errors import InputError
from palpate.parameter import Parameter
from palpate.planning.symbolic.steps import ASIDE, SLIDE
from palpate.scene.raised import TEMPORARY
from palpate.scene.scene import Scene
from palpate.vocabulary.admissible.solids import solids
from palpate.vocabulary.admissible.support import carriers
from palpate.vocabulary.state import SymbolicState

SPOT = 1.5
"""Offsets between the spots of a surface that are touched: 75 mm, of which three define a plane."""
SIDEWAYS = ("y_offset", "x_offset")
"""Offsets along which objects are slid: the closing direction of the fingers first, across which an
object may tip in their grip."""
BALANCE = "_balance"
"""Ending of the name of the pose at which an object balances, as a run estimates it."""
NEARER = 0.005
"""m by which a centre of mass must be beside the grasp for one side to be nearer to it."""


def places(scene: Scene, parameter: Parameter, state: SymbolicState) -> Iterator[list[str]]:
    """Pose expressions where the missing evidence has to be recorded, if its declaration says so; else
    around the object."""
    quantity, name = scene.catalogue[parameter.quantity], parameter.object
    if any(one.distinct == "place" and one.count > 1 for one in quantity.evidence):
        # Three spots of a surface that are not in line, in four ways.
        _, spot = approach(scene, name)
        first, other = SIDEWAYS
        for sign in "+-":
            for across in "+-":
                yield [spot, f"{spot} {sign} {SPOT}*{first}", f"{spot} {across} {SPOT}*{other}"]
        return
    if not any(evidence.place for evidence in quantity.evidence):
        yield from domains(scene, name)
        return
    done = {kind for kind, _ in quantity.pieces(parameter, state.logged)}
    for kind, evidence in enumerate(quantity.evidence):
        spot = f"{name}_{evidence.place}"
        if kind not in done:
            yield [f"{spot} + z_offset", spot] if evidence.holding else [spot]


def balanced(scene: Scene, parameter: Parameter, state: SymbolicState) -> Iterator[list[str]]:
    """Pose expressions where an object balances, for the last of several grasps: the grasps before
    locate the balance point. None if it is believed to lie at the first grasp."""
    quantity, name = scene.catalogue[parameter.quantity], parameter.object
    line = scene.symbols.lines.get(f"{name}{BALANCE}")
    if line is None or abs(line.believed) < NEARER:
        return
    recorded = Counter(kind for kind, _ in quantity.pieces(parameter, state.logged))
    for kind, evidence in enumerate(quantity.evidence):
        if evidence.distinct == "grasp" and recorded[kind] == evidence.count - 1 > 0:
            yield [f"{name}{BALANCE} + z_offset", f"{name}{BALANCE}"]


def domains(scene: Scene, name: str) -> Iterator[list[str]]:
    """Pose expressions around an object or surface, few first: above and at it, then shifted along its
    axes."""
    above, spot = approach(scene, name)
    if name not in scene.bodies:  # the gripper itself: above any object
        yield [approach(scene, other)[0] for other in scene.objects]
        return
    if name not in scene.objects:
        yield [spot, above]
        return
    yield [above, spot]
    for axis in SIDEWAYS:
        factor = multiples(scene, axis, spot, SLIDE)
        yield [above, spot, *(f"{spot} {sign} {factor}*{axis}" for sign in "+-")]
    if stands_on_seam(scene, name):
        place = f"{name}{TEMPORARY}"
        for axis in SIDEWAYS if exists(scene, place) else ():
            factor = multiples(scene, axis, place, SLIDE)
            ends = [place, *(f"{place} {sign} {factor}*{axis}" for sign in "+-")]
            yield [above, spot, *ends, *(f"{end} + z_offset" for end in ends)]
    # Other grasps, last the one nearer to the believed centre of mass: there the object sags least in
    # the fingers when it is turned after all grasps.
    for axis in reversed(SIDEWAYS):
        expressions = [above, spot]
        for sign in "-+" if towards_centre(scene, name, axis) > NEARER else "+-":
            shifted = f"{spot} {sign} {axis}"
            expressions += [f"{shifted} + z_offset", shifted]
        yield expressions


def corners(scene: Scene, name: str, axis: str, state: SymbolicState, sides: str) -> Iterator[str]:
    """Goals of a second slide, beside where the object stood, after one along `axis`: a third slide,
    along the other axis, closes the triangle."""
    _, spot = approach(scene, name)
    (other,) = (one for one in SIDEWAYS if one != axis)
    there, aside = multiples(scene, axis, spot, SLIDE), multiples(scene, other, spot, ASIDE)
    if state.at in [f"{spot} {sign} {there}*{axis}" for sign in "+-"]:
        for sign in sides:
            yield f"{spot} {sign} {aside}*{other}"


def approach(scene: Scene, name: str) -> tuple[str, str]:
    """Pose expressions above an object or surface and at it."""
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
    """True if several surfaces carry an object together, so that it has to be slid elsewhere."""
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
    """Least multiple of an offset whose length reaches `distance` (m)."""
    length = float(np.linalg.norm(scene.symbols.offset(axis, spot)))
    return max(1, math.ceil(distance / max(length, 1e-3)))
