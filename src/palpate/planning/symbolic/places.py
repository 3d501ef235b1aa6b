"""Pose expressions to go to: where evidence is missing, around a thing, beside it."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator

import numpy as np

from palpate.errors import InputError
from palpate.parameter import Parameter
from palpate.planning.symbolic.steps import ASIDE, SLIDE
from palpate.scene.scene import Scene
from palpate.vocabulary.admissible.solids import solids
from palpate.vocabulary.state import SymbolicState

SPOT = 1.5
"""Offsets between the spots of a surface that are touched: 75 mm, of which three make a plane."""
SIDEWAYS = ("y_offset", "x_offset")
"""Offsets along which things are slid."""
BALANCE = "_balance"
"""Ending of the name of the pose at which an object balances, as a run finds out."""
NEARER = 0.005
"""m by which a centre of mass must be beside the grasp for one side to be nearer to it."""


def places(scene: Scene, parameter: Parameter, state: SymbolicState) -> Iterator[list[str]]:
    """Pose expressions where the evidence that is missing has to be recorded, if it says so; else
    around the thing."""
    quantity, name = scene.catalogue[parameter.quantity], parameter.object
    if any(one.distinct == "place" and one.count > 1 for one in quantity.evidence):
        yield from _spots(scene, name)
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
    """Pose expressions where an object balances, for the last of several grasps: those before tell where
    that is. None of what is believed to balance where it is grasped first."""
    quantity, name = scene.catalogue[parameter.quantity], parameter.object
    line = scene.symbols.lines.get(f"{name}{BALANCE}")
    if line is None or abs(line.believed) < NEARER:
        return
    taken = Counter(kind for kind, _ in quantity.pieces(parameter, state.logged))
    for kind, evidence in enumerate(quantity.evidence):
        if evidence.distinct == "grasp" and taken[kind] == evidence.count - 1 > 0:
            yield [f"{name}{BALANCE} + z_offset", f"{name}{BALANCE}"]


def domains(scene: Scene, name: str) -> Iterator[list[str]]:
    """Pose expressions around a thing, few first: above and at it, then shifted along its
    axes."""
    above, spot = approach(scene, name)
    if name not in scene.bodies:
        yield [approach(scene, other)[0] for other in scene.objects]
    elif name not in scene.objects:
        yield [spot, above]
    else:
        yield [above, spot]
        yield from _slid(scene, above, spot)
        yield from _beside(scene, name)


def corners(scene: Scene, name: str, axis: str, state: SymbolicState, sides: str) -> Iterator[str]:
    """Places beside where an object stood, to which it can be slid on after it was slid along `axis`:
    a third slide, along the other one, closes a triangle."""
    _, spot = approach(scene, name)
    (other,) = (one for one in SIDEWAYS if one != axis)
    there, aside = _times(scene, axis, spot, SLIDE), _times(scene, other, spot, ASIDE)
    if state.at in [f"{spot} {sign} {there}*{axis}" for sign in "+-"]:
        for sign in sides:
            yield f"{spot} {sign} {aside}*{other}"


def approach(scene: Scene, name: str) -> tuple[str, str]:
    """Pose expressions above a thing and at it."""
    spot = f"{name}_pose" if name in scene.objects else f"{name}_approach"
    return f"{spot} + z_offset", spot


def exists(scene: Scene, expression: str) -> bool:
    """True if the scene knows a pose of that expression."""
    try:
        scene.symbols.resolve(expression)
    except InputError:
        return False
    return True


def _spots(scene: Scene, name: str) -> Iterator[list[str]]:
    """Three spots of a surface that are not in line, in four ways."""
    _, spot = approach(scene, name)
    first, other = SIDEWAYS
    for sign in "+-":
        for across in "+-":
            yield [spot, f"{spot} {sign} {SPOT}*{first}", f"{spot} {across} {SPOT}*{other}"]


def _slid(scene: Scene, above: str, spot: str) -> Iterator[list[str]]:
    """Places to which an object can be slid far enough to be felt; first along the direction in
    which the fingers close, across which it may tip in their grip."""
    for axis in SIDEWAYS:
        factor = _times(scene, axis, spot, SLIDE)
        yield [above, spot, *(f"{spot} {sign} {factor}*{axis}" for sign in "+-")]


def _beside(scene: Scene, name: str) -> Iterator[list[str]]:
    """Other places at which an object can be grasped and lifted, last those nearer to where its centre of
    mass is believed: what it is turned for after all grasps turns it least in the fingers there."""
    above, spot = approach(scene, name)
    for axis in reversed(SIDEWAYS):
        expressions = [above, spot]
        heavier = _towards_centre(scene, name, axis)
        for sign in "-+" if heavier > NEARER else "+-":
            shifted = f"{spot} {sign} {axis}"
            expressions += [f"{shifted} + z_offset", shifted]
        yield expressions


def _towards_centre(scene: Scene, name: str, axis: str) -> float:
    """m along an offset from where an object is grasped to its centre of mass, as it is believed."""
    body, spot = scene.body(name), scene.symbols.resolve(f"{name}_pose")
    offset = scene.symbols.offset(axis, f"{name}_pose")
    length = float(np.linalg.norm(offset))
    if length == 0.0:
        return 0.0
    centre = body.pose_world.apply(solids(scene).centre_of_mass(name))
    return float((centre - spot.position) @ offset) / length


def _times(scene: Scene, axis: str, spot: str, way: float) -> int:
    """Least multiple of an offset for a path of so many m."""
    length = float(np.linalg.norm(scene.symbols.offset(axis, spot)))
    return max(1, math.ceil(way / max(length, 1e-3)))
