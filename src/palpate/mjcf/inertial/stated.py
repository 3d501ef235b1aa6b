"""Stated mass, centre of mass and inertia of an object, and MuJoCo's inference from them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from palpate.geometry.pose import Array, components
from palpate.mjcf.body import BodyDescription
from palpate.mjcf.document import UNKNOWN, Element, compiler_settings, has_unknown, tokens
from palpate.mjcf.roles.elements import inertial_of
from palpate.mjcf.shapes import USUAL_DENSITY
from palpate.mjcf.whole import away, whole

GROUPS = "0 5"
"""MuJoCo's `inertiagrouprange`: geoms of all groups make an object's inertia."""


def unweighed_geoms(body: BodyDescription) -> tuple[Element, ...]:
    """Geoms that carry a missing mass: those of which nothing states a mass or a density, though
    others of the object may, and those marked `?`."""
    if body.elements.inertial is not None:
        return ()
    found: list[Element] = []
    for geom in weighing_geoms(body):
        stated = _stated_weights(body, geom)
        if not stated or UNKNOWN in stated:
            found.append(geom)
    return tuple(found)


def mass_is_open(body: BodyDescription) -> bool:
    """True if nothing states the object's mass."""
    inertial = body.elements.inertial
    if inertial is None:
        return bool(unweighed_geoms(body))
    return lacks(inertial, "mass")


def inertia_is_open(inertial: Element) -> bool:
    """True if an `<inertial>` leaves its inertia open."""
    if inertial.get("diaginertia") is None and inertial.get("fullinertia") is None:
        return True
    return has_unknown(inertial, "diaginertia") or has_unknown(inertial, "fullinertia")


def lacks(inertial: Element, attribute: str) -> bool:
    """True if an `<inertial>` does not state all numbers of an attribute."""
    return inertial.get(attribute) is None or has_unknown(inertial, attribute)


def mass_of(body: BodyDescription) -> float:
    """The object's mass with all its parts, kg, as MuJoCo has it (with stand-ins where it is
    open)."""
    model = body.shapes.model
    return float(model.body_subtreemass[model.body(body.name).id])


def mass_beside(body: BodyDescription) -> float:
    """Mass of the object without the unknown part, kg."""
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


def com_of(body: BodyDescription) -> tuple[float, ...]:
    """Centre of mass in the body frame, as MuJoCo has it, m."""
    return tuple(whole(body.shapes.model, body.name).com.tolist())


def inertia_for(body: BodyDescription, mass: float, com: Sequence[float]) -> tuple[float, ...]:
    """xx yy zz xy xz yz about `com` (body frame, m), kg m², of the geoms scaled to `mass` (kg)."""
    return tuple(components(tensor_about(body, mass, np.array(com))))


def tensor_about(body: BodyDescription, mass: float, com: Array) -> Array:
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


def weighing_geoms(body: BodyDescription) -> Iterator[Element]:
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


def _stated_masses(body: BodyDescription, unweighed: Sequence[Element]) -> float | None:
    """kg of the parts that state a mass; None where one states a density instead, which weighs what
    MuJoCo takes for its volume."""
    total = 0.0
    for geom in weighing_geoms(body):
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
