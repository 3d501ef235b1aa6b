"""What a scene's file leads one to believe before anything is touched: priors, poses, boxes, known
values."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from palpate.errors import InputError, unknown_name
from palpate.geometry.inertia import inertia_components
from palpate.geometry.pose import Array
from palpate.mjcf.body import Body
from palpate.mjcf.compile import compile_spec, model_tree
from palpate.mjcf.document import Document, Element, has_unknown, label
from palpate.mjcf.edits import Edit, Insert
from palpate.mjcf.roles import Inventory, ObjectEntry, SurfaceEntry, inventory
from palpate.mjcf.shapes import RESTING, Shapes, box_around, compile_shapes, standing_point
from palpate.parameter import Parameter
from palpate.scene.fill import Filler, carrier, placeholders
from palpate.scene.poses import Poses
from palpate.scene.priors import derive_priors
from palpate.scene.words import thing_words

CARRYING = 0.10
"""m: a static thing narrower than this is a surface only when something stands on it."""

MOUNT = 0.5
"""m: what the arm stands on is its mount, and no surface, when it is smaller than this and carries
nothing else."""

_ORIENTATIONS = ("euler", "axisangle", "xyaxes", "zaxis")


@dataclass(frozen=True, slots=True, eq=False)
class Source:
    """A parsed scene file that can be completed: the basis of simulated models and of the twin."""

    document: Document
    found: Inventory
    filler: Filler
    overrides: tuple[Edit, ...]
    poses: Poses

    def edits(self, values: Mapping[Parameter, tuple[float, ...]]) -> list[Edit | Insert]:
        """Poses that came with the scene, then `values`."""
        return [*self.overrides, *self.filler.edits(values, {})]

    def spec(
        self,
        priors: Mapping[Parameter, tuple[float, ...]],
        values: Mapping[Parameter, tuple[float, ...]],
    ) -> mujoco.MjSpec:
        """An editable model without any robot in which `values` hold, and `priors` for the rest."""
        root, _ = model_tree(
            self.document, self.found, self.edits(self.filler.completed(priors, values))
        )
        return compile_spec(root, self.document.folder)


@dataclass(frozen=True, slots=True, eq=False)
class ResolvedScene:
    """A source, what is believed of its unknowns, and the geometry that follows."""

    source: Source
    priors: dict[Parameter, tuple[float, ...]]
    shapes: Shapes

    def bodies(self) -> Iterator[Body]:
        """Objects and surfaces in document order."""
        found = self.source.found
        for name in found.order:
            if name in found.objects:
                yield self._object(found.objects[name])
            elif name in found.surfaces:
                yield self._surface(found.surfaces[name])

    def _object(self, thing: ObjectEntry) -> Body:
        pose = self.shapes.body_pose(thing.name)
        centre, size = box_around(pose, self.shapes.cloud(thing.colliding))
        return Body(
            thing.name,
            "object",
            self._words(thing.name, thing.geoms),
            pose,
            centre,
            size,
            known_values(self.source.filler, self.shapes, thing),
            thing.missing,
            thing.assumed,
        )

    def _surface(self, surface: SurfaceEntry) -> Body:
        geom = carrier(self.shapes, surface)
        is_body = surface.element.tag == "body"
        pose = (
            self.shapes.body_pose(surface.name)
            if is_body
            else self.shapes.geom_pose(surface.element)
        )
        cloud = self.shapes.points(geom)
        centre, size = box_around(pose, cloud)
        known = {} if surface.missing else {"height": (float(cloud[:, 2].max()),)}
        return Body(
            surface.name,
            "surface",
            self._words(surface.name, (geom,), shapes=False),
            pose,
            centre,
            size,
            known,
            surface.missing,
        )

    def _words(self, name: str, geoms: tuple[Element, ...], shapes: bool = True) -> frozenset[str]:
        return thing_words(
            name, geoms, self.source.found.defaults, self.source.document.root, shapes
        )


def resolve(document: Document, poses: Poses) -> ResolvedScene:
    """Sort the document, take in the poses, draw the priors and compile the geometry.

    Raises:
        InputError: names that do not match, scenes MuJoCo does not accept.
    """
    found = inventory(document)
    _check_names(poses, found)
    overrides, given_z = _overrides(poses, found)
    first = compile_shapes(document, found, [*placeholders(found), *overrides])
    found = replace(found, surfaces=_carrying(found, first))
    filler = Filler(found, first, given_z={n: z for n, z in given_z.items() if n in found.objects})
    source = Source(document, found, filler, tuple(overrides), poses)
    priors = derive_priors(filler, poses, given_z)
    shapes = (
        compile_shapes(document, found, source.edits(priors)) if priors or _open_z(found) else first
    )
    _check_heights(filler, shapes, priors)
    return ResolvedScene(source, priors, shapes)


def known_values(
    filler: Filler, shapes: Shapes, thing: ObjectEntry
) -> dict[str, tuple[float, ...]]:
    """What the MJCF states of an object."""
    body = shapes.model.body(thing.name)
    known: dict[str, tuple[float, ...]] = {}
    if "mass" not in thing.missing:
        known["mass"] = (filler.mass(thing),)
    if "friction" not in thing.missing:
        ids = [shapes.geom_ids[geom] for geom in thing.colliding]
        known["friction"] = (float(max(shapes.model.geom_friction[i][0] for i in ids)),)
    if thing.inertial is not None and "com" not in thing.missing:
        known["com"] = tuple(float(v) for v in body.ipos)
    if thing.inertial is not None and "inertia" not in thing.missing:
        known["inertia"] = inertia_components(body.inertia, body.iquat)
    if "position" not in thing.missing:
        x, y, _ = shapes.body_pose(thing.name).position
        known["position"] = (float(x), float(y))
    return known


def _check_names(poses: Poses, found: Inventory) -> None:
    for name in poses.objects:
        if name not in found.order:
            raise unknown_name("object in poses", name, found.order)
    for name in poses.grasps:
        if name not in found.objects:
            raise unknown_name("object in grasps", name, found.objects)


def _overrides(poses: Poses, found: Inventory) -> tuple[list[Edit], dict[str, float]]:
    """Edits that put bodies where the poses say, and the z of those whose own is `?`."""
    edits: list[Edit] = []
    given_z: dict[str, float] = {}
    for name, entry in poses.objects.items():
        element = (found.objects.get(name) or found.surfaces[name]).element
        _require_in_world(element)
        open_z = has_unknown(element, "pos", 2)
        if open_z:
            given_z[name] = entry.pos[2]
        pose = entry.body_pose()
        numbers = {
            i: repr(float(v)) for i, v in enumerate(pose.position) if not (i == 2 and open_z)
        }
        edits += [Edit(element, a, None) for a in _ORIENTATIONS if element.get(a) is not None]
        edits += [
            Edit(element, "pos", numbers, "0 0 0"),
            Edit(
                element,
                "quat",
                {i: repr(float(v)) for i, v in enumerate(pose.quaternion)},
                "1 0 0 0",
            ),
        ]
    return edits, given_z


def _require_in_world(element: Element) -> None:
    parent = element.getparent()
    if parent is None or parent.tag != "worldbody" or element.get("fromto"):
        raise InputError(
            f"{label(element)} is not placed by its own pos in the worldbody, so poses cannot move it"
        )


def _open_z(found: Inventory) -> bool:
    return any(has_unknown(thing.element, "pos", 2) for thing in found.objects.values())


def _carrying(found: Inventory, shapes: Shapes) -> dict[str, SurfaceEntry]:
    bottoms = {name: standing_point(shapes, thing) for name, thing in found.objects.items()}
    return {
        name: surface
        for name, surface in found.surfaces.items()
        if surface.missing or _is_surface(surface, shapes, list(bottoms.values()))
    }


def _is_surface(surface: SurfaceEntry, shapes: Shapes, standing: list[Array]) -> bool:
    geom = carrier(shapes, surface)
    cloud = shapes.points(geom)
    low, high = cloud.min(axis=0), cloud.max(axis=0)
    if not _level(shapes, geom):
        return False

    def carries(point: Array) -> bool:
        inside = np.all(point[:2] >= low[:2]) and np.all(point[:2] <= high[:2])
        return bool(inside and abs(point[2] - high[2]) < RESTING)

    if any(carries(point) for point in standing):
        return True
    extent = (high - low)[:2]
    return bool(np.min(extent) >= CARRYING) and not (
        np.max(extent) < MOUNT and carries(shapes.base().position)
    )


def _level(shapes: Shapes, geom: Element) -> bool:
    """Whether the geom has a level face on top."""
    kind = int(shapes.model.geom_type[shapes.geom_ids[geom]])
    up = np.abs(shapes.data.geom_xmat[shapes.geom_ids[geom]].reshape(3, 3)[2])
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return bool(up.max() > 0.999)
    if kind in (mujoco.mjtGeom.mjGEOM_CYLINDER, mujoco.mjtGeom.mjGEOM_PLANE):
        return bool(up[2] > 0.999)
    return kind in (mujoco.mjtGeom.mjGEOM_MESH, mujoco.mjtGeom.mjGEOM_HFIELD)


def _check_heights(
    filler: Filler, shapes: Shapes, priors: Mapping[Parameter, tuple[float, ...]]
) -> None:
    for parameter, value in priors.items():
        if parameter.quantity != "height":
            continue
        surface = filler.found.surfaces[parameter.object]
        top = float(shapes.points(carrier(filler.shapes, surface))[:, 2].max())
        if abs(top - value[0]) > 1e-4:
            raise InputError(
                f"the unknown number of {label(surface.element)} does not raise its top straight up; "
                f"`?` needs an upright box, cylinder or plane"
            )
