"""Extents of an object in its file: the `size` of its geoms, or the `scale` of its meshes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from palpate.errors import InputError
from palpate.estimation import tuning
from palpate.geometry.pose import Array, Pose
from palpate.mjcf.body import BodyDescription
from palpate.mjcf.document import UNKNOWN, Element, label, tokens
from palpate.mjcf.edits import Edit, number, unknown_only
from palpate.mjcf.elements import Elements

_RADII: Mapping[str, tuple[tuple[int, ...], ...]] = {
    "box": ((0,), (1,), (2,)),
    "ellipsoid": ((0,), (1,), (2,)),
    "cylinder": ((0, 1), (2,), (2,)),
    "capsule": ((0, 1), (2,), (2,)),
    "sphere": ((0, 1, 2), (0,), (0,)),
}
"""By type, along which of a geom's axes each of its sizes lies."""
_SIZES: Mapping[str, int] = {"box": 3, "ellipsoid": 3, "cylinder": 2, "capsule": 2, "sphere": 1}


def is_one_shape(elements: Elements) -> bool:
    """The object is a single geom whose `size` states its extents."""
    if len(elements.geoms) != 1 or elements.geoms[0].get("fromto"):
        return False
    return (elements.defaults.attribute(elements.geoms[0], "type") or "sphere") in _RADII


def open_extents(body: BodyDescription) -> NDArray[np.bool_]:
    """(3,) which extents of an object, along its own axes, the file leaves open."""
    if not is_one_shape(body.elements):
        return np.zeros(3, dtype=np.bool_)
    (geom,) = body.elements.geoms
    own = np.zeros(3, dtype=np.bool_)
    kind = body.defaults.attribute(geom, "type") or "sphere"
    for i, part in enumerate(tokens(geom.get("size"))[: _SIZES[kind]]):
        if part == UNKNOWN:
            own[list(_RADII[kind][i])] = True
    turned = np.abs((body.pose_world.inverse() @ body.shapes.geom_pose(geom)).rotation)
    return own[turned.argmax(axis=1)]


def filled(body: BodyDescription, geom: Element, scale: Array, std: float | None) -> Edit:
    """The change that states the open numbers of a shape."""
    turned = np.abs((body.pose_world.inverse() @ body.shapes.geom_pose(geom)).rotation)
    return Edit(geom, "size", unknown_only(geom, "size", _sizes(body, geom, scale @ turned, std)))


def _sizes(body: BodyDescription, geom: Element, scale: Array, std: float | None) -> dict[int, str]:
    """The numbers of a shape that is scaled along its own axes."""
    kind = body.defaults.attribute(geom, "type") or "sphere"
    sizes = body.shapes.model.geom_size[body.shapes.geom_ids[geom]]
    wanted = sizes * [float(np.mean(scale[list(which)])) for which in _RADII[kind]]
    return {i: number(float(wanted[i]), std) for i in range(_SIZES[kind])}


def scaled(
    body: BodyDescription, geom: Element, scale: Array, anchor: Array, std: float | None
) -> Iterator[Edit]:
    """The changes that scale a geom about a point of its body.

    Raises:
        InputError: a shape that does not lie along the body's axes, or a mesh that others use.
    """
    kind = body.defaults.attribute(geom, "type") or "sphere"
    frame = body.pose_world.inverse() @ _stated_pose(body, geom, kind)
    turned = np.abs(frame.rotation)
    has_numbers = kind in _RADII or kind == "mesh"
    if not has_numbers or geom.get("fromto") or (turned.max(axis=0) < tuning.ALIGNED).any():
        raise InputError(
            f"{label(geom)} of '{body.name}' has no numbers that state its extents; shapes along "
            "the axes of their body have"
        )
    if kind == "mesh":
        yield _scaled_mesh(body, geom, scale @ turned)
    else:
        sizes = body.shapes.model.geom_size[body.shapes.geom_ids[geom]][: _SIZES[kind]]
        stated = " ".join(number(float(value)) for value in sizes)
        yield Edit(geom, "size", _sizes(body, geom, scale @ turned, std), stated)
    shifted = (frame.position - anchor) * (scale - 1.0)
    if geom is body.elements.element or np.abs(shifted).max() < 1e-7:
        return
    middle = frame.position + shifted
    place = {i: number(float(middle[i]), std) for i in range(3)}
    yield Edit(geom, "pos", place, "0 0 0")


def _stated_pose(body: BodyDescription, geom: Element, kind: str) -> Pose:
    """In the world, of a geom as the file places it; MuJoCo moves a mesh into its own middle."""
    found = body.shapes.geom_pose(geom)
    if kind != "mesh":
        return found
    model = body.shapes.model
    mesh = int(model.geom_dataid[body.shapes.geom_ids[geom]])
    return found @ Pose.of(model.mesh_pos[mesh], model.mesh_quat[mesh]).inverse()


def _scaled_mesh(body: BodyDescription, geom: Element, scale: Array) -> Edit:
    """The change of the mesh itself, whose `scale` is all that states its extents.

    Raises:
        InputError: other things are made of it, too.
    """
    name = body.defaults.attribute(geom, "mesh")
    root = geom.getroottree().getroot()
    for other in root.iter("geom"):
        if other.get("mesh") == name and other not in body.elements.geoms:
            raise InputError(
                f"the mesh '{name}' of '{body.name}' is that of {label(other)}, too; give each a mesh "
                "of its own to have its size written"
            )
    for mesh in root.iterfind("asset/mesh"):
        if name in (mesh.get("name"), Path(mesh.get("file") or "").stem):
            stated = body.defaults.attribute(mesh, "scale") or "1 1 1"
            factors = [float(part) for part in tokens(stated)]
            numbers = {i: number(factors[i] * float(scale[i])) for i in range(3)}
            return Edit(mesh, "scale", numbers, stated)
    raise InputError(f"{label(geom)} of '{body.name}' is of a mesh that the scene does not state")
