"""The one `<inertial>` of an object: where its mass, centre of mass and inertia stand.

Without an `<inertial>`, MuJoCo infers all three from the geoms. A mass alone is then written on the
geoms that lack one, shared by volume; a centre of mass or an inertia makes a new `<inertial>`,
which has to state all three.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from palpate.errors import InputError
from palpate.geometry.inertia import components, rotation, tensor_of
from palpate.geometry.pose import Array
from palpate.mjcf.body import BodyDescription
from palpate.mjcf.document import UNKNOWN, Element, compiler_settings, has_unknown, tokens
from palpate.mjcf.edits import Change, Edit, Insert, number, unknown_only
from palpate.mjcf.roles import inertial_of
from palpate.mjcf.shapes import USUAL_DENSITY
from palpate.mjcf.whole import away, whole

GROUPS = "0 5"
"""MuJoCo's `inertiagrouprange`: geoms of all groups make an object's inertia."""


ORIENTATIONS = frozenset({"quat", "axisangle", "xyaxes", "zaxis", "euler"})
"""What gives an `<inertial>` axes of its own, in which `diaginertia` is."""


@dataclass(frozen=True, slots=True)
class Statement:
    """What is to be stated of an object's inertia; several of them make one `<inertial>`.

    Attributes:
        mass: kg.
        com: (3,) m, in the body frame.
        inertia: xx yy zz xy xz yz about it, kg m².
        std: standard deviation, which decides how many digits are written.
    """

    mass: float | None = None
    com: tuple[float, ...] | None = None
    inertia: tuple[float, ...] | None = None
    std: float | None = None


def unweighed_geoms(body: BodyDescription) -> tuple[Element, ...]:
    """Geoms that carry a missing mass: those of which nothing states a mass or a density, though
    others of the object may, and those marked `?`."""
    if body.elements.inertial is not None:
        return ()
    found: list[Element] = []
    for geom in _weighing(body):
        stated = _stated_weights(body, geom)
        if not stated or UNKNOWN in stated:
            found.append(geom)
    return tuple(found)


def _weighing(body: BodyDescription) -> Iterator[Element]:
    """The geoms that MuJoCo takes an object's mass from: those in the groups of the compiler's
    `inertiagrouprange`, but for parts that have an `<inertial>` of their own."""
    for geom in body.elements.geoms:
        root = geom.getroottree().getroot()
        low, high = compiler_settings(root).get("inertiagrouprange", GROUPS).split()
        part = next(geom.iterancestors("body"), body.elements.element)
        group = body.defaults.attribute(geom, "group") or "0"
        if int(low) <= int(group) <= int(high) and inertial_of(part) is None:
            yield geom


def _stated_weights(body: BodyDescription, geom: Element) -> list[str]:
    """The parts of a geom's mass and density."""
    mass = body.defaults.attribute(geom, "mass")
    density = body.defaults.attribute(geom, "density")
    return tokens(mass) + tokens(density)


def mass_is_open(body: BodyDescription) -> bool:
    """Whether nothing states the object's mass."""
    inertial = body.elements.inertial
    if inertial is None:
        return bool(unweighed_geoms(body))
    return lacks(inertial, "mass")


def inertia_is_open(inertial: Element) -> bool:
    """Whether an `<inertial>` leaves its inertia open."""
    if inertial.get("diaginertia") is None and inertial.get("fullinertia") is None:
        return True
    return has_unknown(inertial, "diaginertia") or has_unknown(inertial, "fullinertia")


def lacks(inertial: Element, attribute: str) -> bool:
    """Whether an `<inertial>` does not state all numbers of an attribute."""
    return inertial.get(attribute) is None or has_unknown(inertial, attribute)


def mass_of(body: BodyDescription) -> float:
    """The object's mass with all its parts, kg, as MuJoCo has it (with stand-ins where it is
    open)."""
    model = body.shapes.model
    return float(model.body_subtreemass[model.body(body.name).id])


def mass_beside(body: BodyDescription) -> float:
    """What the object weighs besides that part of its mass that is open, kg."""
    inertial = body.elements.inertial
    if inertial is not None:
        model = body.shapes.model
        return mass_of(body) - float(model.body_mass[model.body(body.name).id])
    unweighed = unweighed_geoms(body)
    if not unweighed:
        return 0.0
    stated = _stated_masses(body, unweighed)
    if stated is not None:
        return stated
    standing_in = sum(_stand_in(body, geom) for geom in unweighed)
    return max(mass_of(body) - standing_in, 0.0)


def _stated_masses(body: BodyDescription, unweighed: Sequence[Element]) -> float | None:
    """kg of the parts that state a mass; None where one states a density instead, which weighs what
    MuJoCo takes for its volume."""
    total = 0.0
    for geom in _weighing(body):
        mass = tokens(body.defaults.attribute(geom, "mass"))
        if geom not in unweighed:
            if not mass:
                return None
            total += float(mass[0])
    for part in body.elements.parts:
        inertial = inertial_of(part)
        total += 0.0 if inertial is None else float(inertial.get("mass") or 0.0)
    return total


def _stand_in(body: BodyDescription, geom: Element) -> float:
    """kg that a geom of open mass weighs in the compiled scene."""
    mass = tokens(body.defaults.attribute(geom, "mass"))
    if mass:
        return 1.0 if UNKNOWN in mass else float(mass[0])
    return USUAL_DENSITY * body.shapes.mass_per_density(geom)


def com_of(body: BodyDescription) -> tuple[float, ...]:
    """Centre of mass in the body frame, as MuJoCo has it, m."""
    return tuple(whole(body.shapes.model, body.name).com.tolist())


def inertia_for(body: BodyDescription, mass: float, com: Sequence[float]) -> tuple[float, ...]:
    """xx yy zz xy xz yz about `com` (body frame, m), kg m², of the geoms scaled to `mass` (kg)."""
    return tuple(components(_tensor(body, mass, np.array(com))))


def _tensor(body: BodyDescription, mass: float, com: Array) -> Array:
    """(3, 3) about `com` in body axes: the geoms' own inertia, or their box's where an `<inertial>`
    hides it, moved by the parallel axis theorem."""
    if body.elements.inertial is None:
        tensor, centre = _of_geoms(body, mass)
    else:
        tensor, centre = _of_box(body, mass)
    return tensor + mass * away(com - centre)


def _of_geoms(body: BodyDescription, mass: float) -> tuple[Array, Array]:
    compiled = whole(body.shapes.model, body.name)
    return compiled.tensor * (mass / compiled.mass), compiled.com


def _of_box(body: BodyDescription, mass: float) -> tuple[Array, Array]:
    to_body = body.shapes.body_pose(body.name).inverse()
    cloud = np.array([to_body.apply(point) for point in body.shapes.cloud(body.elements.geoms)])
    low, high = cloud.min(axis=0), cloud.max(axis=0)
    squares = (high - low) ** 2
    return np.diag(mass / 12 * (squares.sum() - squares)), (high + low) / 2


def written(
    body: BodyDescription, stated: Sequence[Statement], known: Iterable[Statement]
) -> Iterator[Change]:
    """The changes that state all of `stated` at once; `known` is what they rest on but leave alone.

    Raises:
        InputError: a mass that is none, or an `<inertial>` that cannot be made.
    """
    mine = _Together(stated)
    if mine.com is not None or mine.inertia is not None:
        yield from _inertial(body, mine, _Together(known))
    elif mine.mass is not None:
        yield from _mass(body, mine.mass, mine.mass_std)


class _Together:
    """Several statements as one."""

    def __init__(self, statements: Iterable[Statement]) -> None:
        self.mass: float | None = None
        self.mass_std: float | None = None
        self.com: tuple[float, ...] | None = None
        self.com_std: float | None = None
        self.inertia: tuple[float, ...] | None = None
        for statement in statements:
            if statement.mass is not None:
                self.mass, self.mass_std = statement.mass, statement.std
            if statement.com is not None:
                self.com, self.com_std = statement.com, statement.std
            if statement.inertia is not None:
                self.inertia = statement.inertia


def _mass(body: BodyDescription, mass: float, std: float | None) -> Iterator[Edit]:
    own = mass - mass_beside(body)
    if own <= 0:
        raise InputError(
            f"a mass of {mass:.6g} kg for '{body.name}' cannot be written; {_least(body)}"
        )
    if body.elements.inertial is not None:
        yield Edit(body.elements.inertial, "mass", {0: number(own, std)})
        return
    weights = _weights(body)
    total = sum(weights.values())
    for geom, weight in weights.items():
        share = own * weight / total
        is_dense = body.defaults.attribute(geom, "mass") is None
        if is_dense and UNKNOWN in tokens(geom.get("density")):
            yield Edit(geom, "density", {0: number(share / body.shapes.mass_per_density(geom))})
        else:
            digits = std if len(weights) == 1 else None
            yield Edit(geom, "mass", {0: number(share, digits)})


def _least(body: BodyDescription) -> str:
    beside = mass_beside(body)
    if beside == 0.0:
        return "it must be above zero"
    return f"the parts of which the file states it weigh {beside:.6g} kg"


def _weights(body: BodyDescription) -> dict[Element, float]:
    """The geoms on which a mass is written, with their shares in it: by volume where it is open,
    else as the file has them."""
    unweighed = unweighed_geoms(body)
    if unweighed:
        return {geom: _volume(body, geom) for geom in unweighed}
    stated: dict[Element, float] = {}
    for geom in _weighing(body):
        mass = body.defaults.attribute(geom, "mass")
        density = body.defaults.attribute(geom, "density")
        stated[geom] = float(mass) if mass else float(density or 0) * _volume(body, geom)
    return {geom: weight for geom, weight in stated.items() if weight > 0.0}


def _volume(body: BodyDescription, geom: Element) -> float:
    """m³, of a flat thing a very small one."""
    return max(body.shapes.volume(geom), 1e-12)


def _inertial(body: BodyDescription, mine: _Together, known: _Together) -> Iterator[Change]:
    if body.elements.parts:
        raise InputError(
            f"'{body.name}' is made of several bodies; MJCF has no one place for its centre of mass"
        )
    mass = _mass_for(body, mine, known)
    com = np.array(mine.com or known.com or com_of(body))
    tensor = _tensor(body, mass, com) if mine.inertia is None else tensor_of(mine.inertia)
    pos = _numbered(com.tolist(), mine.com_std)
    mass_text = number(mass, mine.mass_std)
    inertial = body.elements.inertial
    if inertial is None:
        stated = {"pos": " ".join(pos.values()), "mass": mass_text}
        attributes = {**stated, **_inertia_attributes(tensor)}
        yield Insert(body.elements.element, "inertial", attributes)
        yield from _weights_answered(body, mass)
        return
    if mine.com is not None:
        yield Edit(inertial, "pos", unknown_only(inertial, "pos", pos), "? ? ?")
    if mine.mass is not None:
        yield Edit(inertial, "mass", {0: mass_text})
    if inertia_is_open(inertial) or mine.inertia is not None:
        yield _inertia_stated(body, inertial, tensor)


def _numbered(values: Sequence[float], std: float | None = None) -> dict[int, str]:
    """Numbers as text by their position in an attribute."""
    return {i: number(value, std) for i, value in enumerate(values)}


def _mass_for(body: BodyDescription, mine: _Together, known: _Together) -> float:
    given = known.mass if mine.mass is None else mine.mass
    if given is None and mass_is_open(body):
        raise InputError(f"the centre of mass of '{body.name}' cannot be written without its mass")
    return mass_of(body) if given is None else given


def _weights_answered(body: BodyDescription, mass: float) -> Iterator[Edit]:
    """A `?` on the geoms, which a new `<inertial>` makes meaningless, becomes a number."""
    geoms = unweighed_geoms(body)
    for geom in geoms:
        for attribute in ("mass", "density"):
            if UNKNOWN in tokens(geom.get(attribute)):
                yield Edit(geom, attribute, {0: number(mass / len(geoms))})


def _inertia_attributes(tensor: Array) -> dict[str, str]:
    """`diaginertia`, or `fullinertia` where the axes are not the body's."""
    parts = components(tensor)
    texts = list(_numbered(parts).values())
    level, beside = np.abs(parts).max(), np.abs(parts[3:]).max()
    if beside < 1e-5 * level:
        return {"diaginertia": " ".join(texts[:3])}
    return {"fullinertia": " ".join(texts)}


def _inertia_stated(body: BodyDescription, inertial: Element, tensor: Array) -> Edit:
    if inertial.get("fullinertia") is not None:
        texts = unknown_only(inertial, "fullinertia", _numbered(components(tensor)))
        return Edit(inertial, "fullinertia", texts)
    if ORIENTATIONS & set(inertial.keys()):
        axes = rotation(np.asarray(body.shapes.model.body(body.name).iquat))
        tensor = axes.T @ tensor @ axes
    texts = unknown_only(inertial, "diaginertia", _numbered(np.diag(tensor).tolist()))
    return Edit(inertial, "diaginertia", texts, "? ? ?")
