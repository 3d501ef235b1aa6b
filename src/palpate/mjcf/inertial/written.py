"""The changes of a file that state an object's mass, centre of mass and inertia."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from palpate.errors import InputError
from palpate.geometry.pose import Array, components, rotation, tensor_of
from palpate.mjcf.body import BodyDescription
from palpate.mjcf.document import UNKNOWN, Element, tokens
from palpate.mjcf.edits import Change, Edit, Insert, number, unknown_only
from palpate.mjcf.inertial.stated import (
    com_of,
    inertia_is_open,
    mass_beside,
    mass_is_open,
    mass_of,
    tensor_about,
    unweighed_geoms,
    weighing_geoms,
)

ORIENTATIONS = frozenset({"quat", "axisangle", "xyaxes", "zaxis", "euler"})
"""Attributes that give an `<inertial>` its own axes, to which `diaginertia` refers."""


@dataclass(frozen=True, slots=True)
class Statement:
    """Statement about an object's inertia; several of them make one `<inertial>`.

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
    for geom in weighing_geoms(body):
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
    tensor = tensor_about(body, mass, com) if mine.inertia is None else tensor_of(mine.inertia)
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
        measured = mine.inertia is not None
        yield from _inertia_stated(body, inertial, tensor, measured)


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
    texts = list(_numbered(components(tensor)).values())
    if _is_diagonal(tensor):
        return {"diaginertia": " ".join(texts[:3])}
    return {"fullinertia": " ".join(texts)}


def _is_diagonal(tensor: Array) -> bool:
    """True if its axes are the body's."""
    parts = components(tensor)
    return bool(np.abs(parts[3:]).max() < 1e-5 * np.abs(parts).max())


def _inertia_stated(
    body: BodyDescription, inertial: Element, tensor: Array, measured: bool
) -> Iterator[Edit]:
    """A `diaginertia` of which nothing is stated gives way to a `fullinertia` where what was measured has
    axes that are not the body's: it has no place for them."""
    if inertial.get("fullinertia") is not None:
        texts = unknown_only(inertial, "fullinertia", _numbered(components(tensor)))
        yield Edit(inertial, "fullinertia", texts)
        return
    turned = bool(ORIENTATIONS & set(inertial.keys()))
    is_open = set(tokens(inertial.get("diaginertia"))) <= {UNKNOWN}
    if measured and is_open and not turned and not _is_diagonal(tensor):
        yield Edit(inertial, "diaginertia", None)
        yield Edit(inertial, "fullinertia", _numbered(components(tensor)), " ".join([UNKNOWN] * 6))
        return
    if turned:
        axes = rotation(np.asarray(body.shapes.model.body(body.name).iquat))
        tensor = axes.T @ tensor @ axes
    texts = unknown_only(inertial, "diaginertia", _numbered(np.diag(tensor).tolist()))
    yield Edit(inertial, "diaginertia", texts, "? ? ?")
