"""The compiled geometry of a scene: convex outlines of geoms, boxes of bodies, volumes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache

import mujoco
import numpy as np

from palpate.pose import Array, Pose
from palpate.scene.edits import Edit, Insert
from palpate.scene.gap import Inventory
from palpate.scene.mjcf import Document, Element
from palpate.scene.model import BASE_SITE, compile_model, compile_spec, model_tree

INFINITE_PLANE = 10.0
"""m: half extent given to a plane without one."""

_CIRCLE = 48
"""Corners of a circle; a multiple of four, so that boxes around round things are exact."""


@dataclass(frozen=True, slots=True, eq=False)
class Shapes:
    """Geometry of a compiled scene at rest.

    `geom_ids` and `names` refer to elements of the document.
    """

    model: mujoco.MjModel
    data: mujoco.MjData
    geom_ids: Mapping[Element, int]

    def body_pose(self, name: str) -> Pose:
        """Pose of a body's frame in the world."""
        body = self.data.body(name)
        return Pose.of(body.xpos, body.xquat)

    def geom_pose(self, geom: Element) -> Pose:
        """Pose of a geom's frame in the world."""
        return _pose(self.data.geom_xpos[self.geom_ids[geom]], self.data.geom_xmat[self.geom_ids[geom]])

    def points(self, geom: Element) -> Array:
        """(k, 3) points in the world whose convex hull is the geom, m."""
        return self.geom_points(self.geom_ids[geom])

    def geom_points(self, geom: int) -> Array:
        """As `points`, by id in the model."""
        rotation = self.data.geom_xmat[geom].reshape(3, 3)
        return hull_points(self.model, geom) @ rotation.T + self.data.geom_xpos[geom]

    def cloud(self, geoms: Iterable[Element]) -> Array:
        """(k, 3) points of several geoms in the world."""
        return np.concatenate([self.points(geom) for geom in geoms])

    def volume(self, geom: Element) -> float:
        """m³ of a geom; of a mesh as triangulated."""
        return geom_volume(self.model, self.geom_ids[geom])

    def up(self, geom: Element) -> float:
        """World z component of the geom's z axis."""
        return float(self.data.geom_xmat[self.geom_ids[geom]][8])

    def base(self) -> Pose:
        """Pose of the site `robot_base`, else the origin."""
        site = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_SITE, BASE_SITE)
        return _pose(self.data.site_xpos[site], self.data.site_xmat[site]) if site >= 0 else Pose.of((0, 0, 0))


def compile_shapes(document: Document, found: Inventory, edits: Sequence[Edit | Insert]) -> Shapes:
    """Compile the scene with `edits` and look at it in its initial configuration.

    Raises:
        InputError: MuJoCo does not accept the scene.
    """
    root, twin_of = model_tree(document, found, edits)
    names = _name_geoms(twin_of)
    model = compile_model(compile_spec(root, document.folder))
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    ids = {geom: mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, name) for geom, name in names.items()}
    return Shapes(model, data, {geom: i for geom, i in ids.items() if i >= 0})


def _name_geoms(twin_of: Mapping[Element, Element]) -> dict[Element, str]:
    names: dict[Element, str] = {}
    for i, (original, twin) in enumerate(twin_of.items()):
        if original.tag == "geom" and next(original.iterancestors("default"), None) is None:
            names[original] = twin.get("name") or f"palpate:{i}"
            twin.set("name", names[original])
    return names


def _pose(position: Array, matrix: Array) -> Pose:
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, matrix)
    return Pose.of(position, quaternion)


def hull_points(model: mujoco.MjModel, geom: int) -> Array:
    """(k, 3) points in the geom's frame whose convex hull is the geom (round ones as fine polygons)."""
    kind = int(model.geom_type[geom])
    size = np.array(model.geom_size[geom])
    if kind in (mujoco.mjtGeom.mjGEOM_MESH, mujoco.mjtGeom.mjGEOM_SDF):
        return _extremes(_mesh_vertices(model, int(model.geom_dataid[geom])))
    if kind == mujoco.mjtGeom.mjGEOM_HFIELD:
        x, y, top, below = model.hfield_size[model.geom_dataid[geom]]
        return _corners(np.array([x, y, (top + below) / 2])) + [0, 0, (top - below) / 2]
    outline = _OUTLINES.get(kind)
    return outline(size) if outline else np.zeros((1, 3))


def geom_volume(model: mujoco.MjModel, geom: int) -> float:
    """Volume of a geom, m³."""
    r, h, z = (float(s) for s in model.geom_size[geom])
    kind = int(model.geom_type[geom])
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        return _mesh_volume(model, int(model.geom_dataid[geom]))
    return {
        int(mujoco.mjtGeom.mjGEOM_BOX): 8 * r * h * z,
        int(mujoco.mjtGeom.mjGEOM_SPHERE): 4 / 3 * np.pi * r**3,
        int(mujoco.mjtGeom.mjGEOM_CYLINDER): 2 * np.pi * r**2 * h,
        int(mujoco.mjtGeom.mjGEOM_CAPSULE): 2 * np.pi * r**2 * h + 4 / 3 * np.pi * r**3,
        int(mujoco.mjtGeom.mjGEOM_ELLIPSOID): 4 / 3 * np.pi * r * h * z,
    }.get(kind, 0.0)


def _mesh_vertices(model: mujoco.MjModel, mesh: int) -> Array:
    first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
    return np.asarray(model.mesh_vert[first : first + count], dtype=float)


def _mesh_volume(model: mujoco.MjModel, mesh: int) -> float:
    first, count = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
    a, b, c = np.moveaxis(_mesh_vertices(model, mesh)[model.mesh_face[first : first + count]], 1, 0)
    return abs(float(np.einsum("ij,ij->", a, np.cross(b, c)))) / 6


def _corners(half: Array) -> Array:
    signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).T.reshape(-1, 3)
    return signs * half


def _plane(size: Array) -> Array:
    return _corners(np.where(size > 0, size, INFINITE_PLANE) * [1, 1, 0])


def _circle() -> Array:
    angle = np.arange(_CIRCLE) * 2 * np.pi / _CIRCLE
    return np.column_stack([np.cos(angle), np.sin(angle)])


def _cylinder(size: Array) -> Array:
    ring = _circle() * size[0]
    return np.concatenate([np.column_stack([ring, np.full(_CIRCLE, z)]) for z in (-size[1], size[1])])


@cache
def _directions() -> Array:
    """(m, 3) unit vectors: the axes and an even spread over the sphere (Fibonacci lattice)."""
    n = 194
    z = 1 - 2 * (np.arange(n) + 0.5) / n
    turn = np.arange(n) * np.pi * (3 - np.sqrt(5))
    ring = np.sqrt(1 - z**2)
    return np.concatenate([np.eye(3), -np.eye(3), np.column_stack([ring * np.cos(turn), ring * np.sin(turn), z])])


def _capsule(size: Array) -> Array:
    ball = _directions() * size[0]
    return np.concatenate([ball + [0, 0, size[1]], ball - [0, 0, size[1]]])


def _extremes(points: Array) -> Array:
    """The points farthest out in each of many directions: a small set with nearly the same convex hull."""
    if len(points) <= len(_directions()):
        return points
    return points[np.unique(np.argmax(points @ _directions().T, axis=0))]


_OUTLINES: dict[int, Callable[[Array], Array]] = {
    int(mujoco.mjtGeom.mjGEOM_PLANE): _plane,
    int(mujoco.mjtGeom.mjGEOM_BOX): _corners,
    int(mujoco.mjtGeom.mjGEOM_SPHERE): lambda size: _directions() * size[0],
    int(mujoco.mjtGeom.mjGEOM_ELLIPSOID): lambda size: _directions() * size,
    int(mujoco.mjtGeom.mjGEOM_CYLINDER): _cylinder,
    int(mujoco.mjtGeom.mjGEOM_CAPSULE): _capsule,
}
