"""The `<inertial>` of an object: mass, centre of mass and inertia, as stated by the file or inferred by
MuJoCo, and the changes of the file that state them.

Without an `<inertial>`, MuJoCo infers all three from the geoms. A mass alone is then written on the geoms
that lack one, shared by volume. A centre of mass or an inertia needs a new `<inertial>`, which has to
state all three.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from palpate.common.errors import InputError
from palpate.common.pose import Array, Pose, components, tensor_of
from palpate.mjcf.body import BodyDescription
from palpate.mjcf.document import UNKNOWN, Element, compiler_settings, has_unknown, tokens
from palpate.mjcf.edits import Change, Edit, Insert, number, unknown_only
from palpate.mjcf.elements import PLACING, inertial_of
from palpate.mjcf.shapes import USUAL_DENSITY


@dataclass(frozen=True, slots=True, eq=False)
class WholeInertia:
    """Mass, kg, centre of mass (3,), m, and inertia about it (3, 3), kg m², in the object's body frame."""

    mass: float
    com: Array
    tensor: Array


def total_inertia(model: mujoco.MjModel, name: str) -> WholeInertia:
    """Compute the inertia of a body and all bodies below it as one rigid body, at the file's configuration."""
    root = int(model.body(name).id)
    # Pose and inertia of each body of the subtree, in the root body's frame.
    poses = {root: Pose.of((0.0, 0.0, 0.0))}
    parts: list[WholeInertia] = []
    for body in range(root, model.nbody):
        parent = int(model.body_parentid[body])
        if body != root and parent not in poses:
            break  # MuJoCo numbers a body's descendants without a gap
        com = model.body_ipos[body].copy()
        if body != root:
            poses[body] = poses[parent] @ Pose.of(model.body_pos[body], model.body_quat[body])
            com = poses[body].apply(com)
        # Rotate the principal moments into the frame: R diag(I) Rᵀ.
        inner = Pose.of((0.0, 0.0, 0.0), model.body_iquat[body])
        axes = poses[body].rotation @ inner.rotation
        tensor = axes @ np.diag(model.body_inertia[body]) @ axes.T
        parts.append(WholeInertia(float(model.body_mass[body]), com, tensor))
    mass = sum(part.mass for part in parts)
    if len(parts) == 1 or mass == 0.0:
        return parts[0]
    # Centre of mass of the whole, and inertia about it by the parallel axis theorem.
    com = np.sum([part.mass * part.com for part in parts], axis=0) / mass
    tensor = np.zeros((3, 3))
    for part in parts:
        tensor += part.tensor + part.mass * parallel_axis(part.com - com)
    return WholeInertia(mass, com, tensor)


def parallel_axis(offset: Array) -> Array:
    """Compute the inertia (3, 3), m², of a unit mass at an offset d by the parallel axis theorem: |d|² E - d dᵀ."""
    return offset @ offset * np.eye(3) - np.outer(offset, offset)


def unweighed_geoms(body: BodyDescription) -> tuple[Element, ...]:
    """Find the geoms that carry a missing mass: without mass and density, or with a `?` in one."""
    if body.elements.inertial is not None:
        return ()
    geoms: list[Element] = []
    for geom in weighing_geoms(body):
        # A geom is open if it states neither mass nor density, or marks one with `?`.
        stated = tokens(body.defaults.attribute(geom, "mass"))
        stated += tokens(body.defaults.attribute(geom, "density"))
        if not stated or UNKNOWN in stated:
            geoms.append(geom)
    return tuple(geoms)


def mass_is_open(body: BodyDescription) -> bool:
    """Test if the mass of the object is stated nowhere."""
    inertial = body.elements.inertial
    return bool(unweighed_geoms(body)) if inertial is None else is_incomplete(inertial, "mass")


def inertia_is_open(inertial: Element) -> bool:
    """Test if an `<inertial>` leaves its inertia open."""
    if inertial.get("diaginertia") is None and inertial.get("fullinertia") is None:
        return True
    return has_unknown(inertial, "diaginertia") or has_unknown(inertial, "fullinertia")


def is_incomplete(inertial: Element, attribute: str) -> bool:
    """Test if an `<inertial>` does not state all numbers of an attribute."""
    return inertial.get(attribute) is None or has_unknown(inertial, attribute)


def mass_of(body: BodyDescription) -> float:
    """Return the compiled mass of the object with all its parts, kg, with stand-ins for open values."""
    model = body.shapes.model
    return float(model.body_subtreemass[model.body(body.name).id])


def mass_beside(body: BodyDescription) -> float:
    """Compute the mass of the object without the unknown part, kg."""
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
    # Otherwise subtract the stand-ins from the compiled mass.
    standing_in = 0.0  # the compiled scene has stand-ins for the open masses
    for geom in unweighed:
        mass = tokens(body.defaults.attribute(geom, "mass"))
        if mass:
            standing_in += 1.0 if UNKNOWN in mass else float(mass[0])
        else:
            standing_in += USUAL_DENSITY * body.shapes.mass_per_density(geom)
    return max(mass_of(body) - standing_in, 0.0)


def _stated_masses(body: BodyDescription, unweighed: Sequence[Element]) -> float | None:
    """Sum the stated masses, kg; None where a geom states a density, whose mass only MuJoCo knows."""
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


def com_of(body: BodyDescription) -> tuple[float, ...]:
    """Return the compiled centre of mass in the body frame, m."""
    return tuple(total_inertia(body.shapes.model, body.name).com.tolist())


def inertia_for(body: BodyDescription, mass: float, com: Sequence[float]) -> tuple[float, ...]:
    """Compute the inertia xx yy zz xy xz yz, kg m², about `com` (body frame, m), of the geoms scaled to `mass`."""
    return tuple(components(tensor_about(body, mass, np.array(com))))


def tensor_about(body: BodyDescription, mass: float, com: Array) -> Array:
    """Compute the inertia (3, 3), kg m², about `com` in body axes, of the geoms scaled to `mass`."""
    if body.elements.inertial is None:
        compiled = total_inertia(body.shapes.model, body.name)
        tensor, centre = compiled.tensor * (mass / compiled.mass), compiled.com
    else:
        # An `<inertial>` hides the inertia of the geoms. Use that of a solid box around them: m (b² + c²) /
        # 12 about the axis along a.
        to_body = body.shapes.body_pose(body.name).inverse()
        cloud = np.array([to_body.apply(point) for point in body.shapes.cloud(body.elements.geoms)])
        low, high = cloud.min(axis=0), cloud.max(axis=0)
        squares = (high - low) ** 2
        tensor, centre = np.diag(mass / 12 * (squares.sum() - squares)), (high + low) / 2
    # Shift it to `com` by the parallel axis theorem.
    return tensor + mass * parallel_axis(com - centre)


def weighing_geoms(body: BodyDescription) -> Iterator[Element]:
    """Yield the geoms from which mass is inferred: in `inertiagrouprange`, of a body without `<inertial>`."""
    for geom in body.elements.geoms:
        # The compiler infers masses from geoms of some groups only.
        root = geom.getroottree().getroot()
        low, high = compiler_settings(root).get("inertiagrouprange", "0 5").split()
        part = next(geom.iterancestors("body"), body.elements.element)
        group = body.defaults.attribute(geom, "group") or "0"
        if int(low) <= int(group) <= int(high) and inertial_of(part) is None:
            yield geom


@dataclass(frozen=True, slots=True)
class Statement:
    """Statement about an object's inertia; several statements make one `<inertial>`."""

    mass: float | None = None  # kg
    com: tuple[float, ...] | None = None  # (3,) m, in the body frame
    inertia: tuple[float, ...] | None = None  # xx yy zz xy xz yz about `com`, kg m²
    std: float | None = None  # standard deviation, which sets the number of written digits


def write_inertia(
    body: BodyDescription, stated: Sequence[Statement], known: Iterable[Statement]
) -> Iterator[Change]:
    """Yield the changes that state all of `stated` together.

    `known` are values that they depend on and that are not written. Raises InputError: a mass that is
    not positive, or an `<inertial>` that cannot be written.
    """
    # A mass alone needs no `<inertial>`.
    measured = _Together(stated)
    if measured.com is not None or measured.inertia is not None:
        yield from _inertial(body, measured, _Together(known))
    elif measured.mass is not None:
        yield from _mass(body, measured.mass, measured.mass_std)


class _Together:
    """Several statements as one; later ones replace earlier ones."""

    def __init__(self, statements: Iterable[Statement]) -> None:
        self.mass: float | None = None
        self.mass_std: float | None = None
        self.com: tuple[float, ...] | None = None
        self.com_std: float | None = None
        self.inertia: tuple[float, ...] | None = None
        # The last statement of each value counts.
        for statement in statements:
            if statement.mass is not None:
                self.mass, self.mass_std = statement.mass, statement.std
            if statement.com is not None:
                self.com, self.com_std = statement.com, statement.std
            if statement.inertia is not None:
                self.inertia = statement.inertia


def _mass(body: BodyDescription, mass: float, std: float | None) -> Iterator[Edit]:
    others_mass = mass_beside(body)
    # The open part of the mass is the difference from the stated parts.
    own = mass - others_mass
    if own <= 0:
        least = "it must be above zero"
        if others_mass != 0.0:
            least = f"the parts with a stated mass weigh {others_mass:.6g} kg"
        raise InputError(f"a mass of {mass:.6g} kg for '{body.name}' cannot be written; {least}")
    if body.elements.inertial is not None:
        yield Edit(body.elements.inertial, "mass", {0: number(own, std)})
        return
    # Share it among the open geoms by their volumes.
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


def _weights(body: BodyDescription) -> dict[Element, float]:
    """Return the shares of a mass by geom: by volume where the mass is open, else as in the file."""

    def volume(geom: Element) -> float:
        return max(body.shapes.volume(geom), 1e-12)  # a flat geom has no volume

    unweighed = unweighed_geoms(body)
    if unweighed:
        return {geom: volume(geom) for geom in unweighed}
    # Without open geoms, keep the ratios of the stated masses.
    stated: dict[Element, float] = {}
    for geom in weighing_geoms(body):
        mass = body.defaults.attribute(geom, "mass")
        density = body.defaults.attribute(geom, "density")
        stated[geom] = float(mass) if mass else float(density or 0) * volume(geom)
    return {geom: weight for geom, weight in stated.items() if weight > 0.0}


def _inertial(body: BodyDescription, new: _Together, known: _Together) -> Iterator[Change]:
    """Yield the changes that make or complete an `<inertial>`."""
    if body.elements.parts:
        raise InputError(
            f"'{body.name}' has several bodies; MJCF has no single place for its centre of mass"
        )
    # Mass and centre of mass: new values, else known ones, else those of the compiled model.
    mass = known.mass if new.mass is None else new.mass
    if mass is None and mass_is_open(body):
        raise InputError(f"the centre of mass of '{body.name}' cannot be written without its mass")
    if mass is None:
        mass = mass_of(body)
    com = np.array(new.com or known.com or com_of(body))
    tensor = tensor_about(body, mass, com) if new.inertia is None else tensor_of(new.inertia)
    pos = _format_numbers(com.tolist(), new.com_std)
    mass_text = number(mass, new.mass_std)
    inertial = body.elements.inertial
    # A new `<inertial>` states all three values.
    if inertial is None:
        stated = {"pos": " ".join(pos.values()), "mass": mass_text}
        moments = list(_format_numbers(components(tensor)).values())
        if _is_diagonal(tensor):
            stated["diaginertia"] = " ".join(moments[:3])
        else:
            stated["fullinertia"] = " ".join(moments)
        yield Insert(body.elements.element, "inertial", stated)
        # A `?` on a geom has no meaning next to an `<inertial>`, and becomes a number.
        geoms = unweighed_geoms(body)
        for geom in geoms:
            for attribute in ("mass", "density"):
                if UNKNOWN in tokens(geom.get(attribute)):
                    yield Edit(geom, attribute, {0: number(mass / len(geoms))})
        return
    # An existing `<inertial>` gets only the new or open values.
    if new.com is not None:
        yield Edit(inertial, "pos", unknown_only(inertial, "pos", pos), "? ? ?")
    if new.mass is not None:
        yield Edit(inertial, "mass", {0: mass_text})
    if inertia_is_open(inertial) or new.inertia is not None:
        yield from _moments(body, inertial, tensor, is_measured=new.inertia is not None)


def _moments(
    body: BodyDescription, inertial: Element, tensor: Array, is_measured: bool
) -> Iterator[Edit]:
    """Yield the changes that state the inertia in an existing `<inertial>`."""
    # `fullinertia` states all six components in body axes.
    full = _format_numbers(components(tensor))
    if inertial.get("fullinertia") is not None:
        yield Edit(inertial, "fullinertia", unknown_only(inertial, "fullinertia", full))
        return
    # An orientation gives the `<inertial>` its own axes, to which `diaginertia` refers.
    is_turned = bool((PLACING - {"pos"}) & set(inertial.keys()))
    is_open = set(tokens(inertial.get("diaginertia"))) <= {UNKNOWN}
    if is_measured and is_open and not is_turned and not _is_diagonal(tensor):
        # `diaginertia` cannot state products of inertia.
        yield Edit(inertial, "diaginertia", None)
        yield Edit(inertial, "fullinertia", full, " ".join([UNKNOWN] * 6))
        return
    # Rotate the inertia into the axes of the `<inertial>`.
    if is_turned:
        axes = Pose.of((0.0, 0.0, 0.0), body.shapes.model.body(body.name).iquat).rotation
        tensor = axes.T @ tensor @ axes
    texts = unknown_only(inertial, "diaginertia", _format_numbers(np.diag(tensor).tolist()))
    yield Edit(inertial, "diaginertia", texts, "? ? ?")


def _format_numbers(values: Sequence[float], std: float | None = None) -> dict[int, str]:
    """Format numbers, by their position in an attribute."""
    return {i: number(value, std) for i, value in enumerate(values)}


def _is_diagonal(tensor: Array) -> bool:
    """Test if the products of inertia are negligible: the principal axes are those of the body."""
    parts = components(tensor)
    return bool(np.abs(parts[3:]).max() < 1e-5 * np.abs(parts).max())
