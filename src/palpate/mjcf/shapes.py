"""The compiled geometry of a scene: convex outlines of geoms, boxes of bodies, volumes.

Every geom is handed on as a cloud of points whose convex hull it is (`mjcf.hulls`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import mujoco
import numpy as np

from palpate.errors import InputError
from palpate.geometry.outline import Convex
from palpate.geometry.pose import Array, Pose
from palpate.mjcf.compile import BASE_SITE, ModelTree, compile_model, compile_spec, model_tree
from palpate.mjcf.document import Document, Element, elements
from palpate.mjcf.edits import Edit, Insert
from palpate.mjcf.hulls import geom_volume, hull_edges, hull_points
from palpate.mjcf.roles.roles import Roles

USUAL_DENSITY = 1000.0
"""kg/m³, of a geom that states none, by MuJoCo."""


@dataclass(frozen=True, slots=True, eq=False)
class Shapes:
    """Geometry of a compiled scene at rest.

    `geom_ids` refers to elements of the document. `tree` is what was compiled.
    """

    model: mujoco.MjModel
    data: mujoco.MjData
    geom_ids: Mapping[Element, int]
    tree: ModelTree
    _per_density: dict[Element, float] = field(default_factory=dict[Element, float])

    def body_pose(self, name: str) -> Pose:
        """Pose of a body's frame in the world."""
        body = self.data.body(name)
        return Pose.of(body.xpos, body.xquat)

    def geom_pose(self, geom: Element) -> Pose:
        """Pose of a geom's frame in the world."""
        i = self.geom_ids[geom]
        return _pose(self.data.geom_xpos[i], self.data.geom_xmat[i])

    def points(self, geom: Element) -> Array:
        """(k, 3) points in the world whose convex hull is the geom, m."""
        return self.geom_points(self.geom_ids[geom])

    def geom_points(self, geom: int) -> Array:
        """Points of a geom, as `points`, by its id in the model."""
        rotation = self.data.geom_xmat[geom].reshape(3, 3)
        return hull_points(self.model, geom) @ rotation.T + self.data.geom_xpos[geom]

    def convex(self, geom: Element) -> Convex:
        """The geom with its edges, in the world."""
        points = self.points(geom)
        kind = int(self.model.geom_type[self.geom_ids[geom]])
        return Convex(points, hull_edges(kind, len(points)))

    def cloud(self, geoms: Iterable[Element]) -> Array:
        """(k, 3) points of several geoms in the world."""
        return np.concatenate([self.points(geom) for geom in geoms])

    def volume(self, geom: Element) -> float:
        """m³ of a geom; of a mesh as triangulated."""
        return geom_volume(self.model, self.geom_ids[geom])

    def mass_per_density(self, geom: Element) -> float:
        """m³ (m² of a shell) by which MuJoCo multiplies a geom's density, m: of meshes that are not
        closed, or count as their hulls, another number than their volume."""
        i = self.geom_ids[geom]
        has_shells = any(part.get("shellinertia") == "true" for part in elements(self.tree.root))
        if int(self.model.geom_type[i]) not in _TRIANGULATED and not has_shells:
            return self.volume(geom)
        if geom not in self._per_density:
            body, twin = int(self.model.geom_bodyid[i]), self.tree.twin_of[geom]
            self._per_density[geom] = _mass_per_density(self.tree, twin, body)
        return self._per_density[geom] or self.volume(geom)

    def solid_geoms(self) -> list[int]:
        """Ids of all geoms that can touch something, planes left out."""
        masks = self.model.geom_contype | self.model.geom_conaffinity
        solid = (masks != 0) & (self.model.geom_type != mujoco.mjtGeom.mjGEOM_PLANE)
        return np.flatnonzero(solid).tolist()

    def up(self, geom: Element) -> float:
        """World z component of the geom's z axis."""
        return float(self.data.geom_xmat[self.geom_ids[geom]][8])

    def base(self) -> Pose:
        """Pose of the site `robot_base`, else the origin."""
        site = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_SITE, BASE_SITE)
        if site < 0:
            return Pose.of((0, 0, 0))
        return _pose(self.data.site_xpos[site], self.data.site_xmat[site])


def compile_shapes(document: Document, roles: Roles, edits: Sequence[Edit | Insert]) -> Shapes:
    """Compile the scene with `edits` in its initial configuration.

    Raises:
        InputError: MuJoCo does not accept the scene, or one of its numbers is not finite.
    """
    tree = model_tree(document, roles, edits)
    names = _name_geoms(tree, roles)
    model = compile_model(compile_spec(tree))
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    _require_finite(model, data)
    ids: dict[Element, int] = {}
    for geom, name in names.items():
        i = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, name)
        if i >= 0:
            ids[geom] = i
    return Shapes(model, data, ids, tree)


_TRIANGULATED = (int(mujoco.mjtGeom.mjGEOM_MESH), int(mujoco.mjtGeom.mjGEOM_SDF))


def _mass_per_density(tree: ModelTree, geom: Element, body: int) -> float:
    """Derivative of a body's mass by the density of one of its geoms, from MuJoCo."""
    stated, masses = dict(geom.attrib), list[float]()
    for density in (USUAL_DENSITY, 2 * USUAL_DENSITY):
        geom.attrib.pop("mass", None)
        geom.set("density", repr(density))
        masses.append(float(compile_model(compile_spec(tree)).body_mass[body]))
    geom.attrib.clear()
    geom.attrib.update(stated)
    lighter, heavier = masses
    return (heavier - lighter) / USUAL_DENSITY


def _require_finite(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    numbers = (
        data.xpos,
        data.xquat,
        data.geom_xpos,
        data.geom_xmat,
        data.site_xpos,
        model.geom_size,
        model.geom_friction,
        model.body_mass,
        model.body_inertia,
        model.body_ipos,
        model.opt.gravity,
    )
    if not all(np.isfinite(array).all() for array in numbers):
        raise InputError("the scene has a number that is not finite (nan or inf)")


_NO_GEOMS = ("default", "tendon")
"""Parents below which `<geom>` is a default, or a tendon's wrapping geom."""


def _name_geoms(tree: ModelTree, roles: Roles) -> dict[Element, str]:
    """Names by which the compiled geoms are found again; what has none is given one."""
    names: dict[Element, str] = {}
    for i, (original, twin) in enumerate(tree.twin_of.items()):
        if original.tag == "geom" and next(original.iterancestors(*_NO_GEOMS), None) is None:
            name = twin.get("name") or f"palpate:{i}"
            twin.set("name", name)
            compiled = roles.compiled_name(original, name)
            if compiled is not None:
                names[original] = compiled
    return names


def _pose(position: Array, matrix: Array) -> Pose:
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, matrix)
    return Pose.of(position, quaternion)


RESTING = 0.02
"""m: an object whose bottom is this close to a top stands on it."""


def box_around(pose: Pose, cloud: Array) -> tuple[Array, Array]:
    """Centre and size of the box around world points, in the frame `pose`."""
    local = (cloud - pose.position) @ pose.rotation
    low, high = local.min(axis=0), local.max(axis=0)
    return (low + high) / 2, high - low
