"""Compiled geometry of a scene: convex hulls of geoms, boxes of bodies, volumes, poses.

A geom is represented by points whose convex hull approximates it: corners of a box, two rings of a
cylinder, rings between the poles of a ball, extreme vertices of a mesh.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache

import mujoco
import numpy as np
from numpy.typing import NDArray

from palpate.common.errors import InputError
from palpate.common.outline import Convex
from palpate.common.pose import Array, Pose
from palpate.mjcf.compile import BASE_SITE, ModelTree, compile_model, compile_spec, model_tree
from palpate.mjcf.document import Document, Element, elements
from palpate.mjcf.edits import Edit, Insert
from palpate.mjcf.roles import Roles

INFINITE_PLANE = 10.0  # m: half extent of an infinite plane
# Number of corners of a circle: a multiple of four, so that boxes around round shapes are exact.
_CIRCLE = 48
# Number of rings of a ball between its poles, and of points on each: odd, and a multiple of four,
# for the same reason.
_LATITUDES, _LONGITUDES = 11, 24
_TRIANGULATED = (int(mujoco.mjtGeom.mjGEOM_MESH), int(mujoco.mjtGeom.mjGEOM_SDF))


def hull_points(model: mujoco.MjModel, geom: int) -> Array:
    """Compute points (k, 3), m, in the geom's frame whose convex hull is the geom; circles become polygons."""
    kind = int(model.geom_type[geom])
    size = np.array(model.geom_size[geom])
    data = int(model.geom_dataid[geom])
    if kind in _TRIANGULATED:
        # Meshes: their vertices, or the extreme ones of many.
        points = mesh_vertices(model, data)
        if len(points) <= len(_directions()):
            return points
        # The extreme vertices in many directions have nearly the same hull as all vertices.
        return points[np.unique(np.argmax(_directions() @ points.T, axis=1))]
    if kind == mujoco.mjtGeom.mjGEOM_HFIELD:
        # A height field becomes the box from its base to its highest elevation.
        x, y, top, below = model.hfield_size[data]
        first, count = model.hfield_adr[data], model.hfield_nrow[data] * model.hfield_ncol[data]
        top *= max(model.hfield_data[first : first + count].astype(float), default=0.0)
        return _corners(np.array([x, y, (top + below) / 2])) + np.array([0, 0, (top - below) / 2])
    if kind not in _OUTLINES:
        return np.zeros((1, 3))
    return _OUTLINES[kind](size)


@cache
def hull_edges(kind: int, count: int) -> NDArray[np.intp]:
    """Return index pairs (m, 2) of points of `hull_points`, with all edges of the hull; `kind` is MuJoCo's type."""
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        return _ring_edges(2, _CIRCLE)
    if kind in (mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_ELLIPSOID):
        return _ball_edges()
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:  # two balls, and lines between equal points of both
        half = count // 2
        across = np.column_stack([np.arange(half), np.arange(half) + half])
        return np.concatenate([_ball_edges(), _ball_edges() + half, across])
    return np.column_stack(np.triu_indices(count, 1))  # edges not known: all pairs


def _ring_edges(rings: int, corners: int) -> NDArray[np.intp]:
    """Return the edges (m, 2) along and between `rings` polygons of consecutive points."""
    # Edges to the next corner of a ring, and to the same corner of the next ring.
    index = np.arange(rings * corners).reshape(rings, corners)
    along = np.column_stack([index.ravel(), np.roll(index, -1, axis=1).ravel()])
    return np.concatenate([along, np.column_stack([index[:-1].ravel(), index[1:].ravel()])])


def _ball_edges() -> NDArray[np.intp]:
    """Return the edges (m, 2) of the points of `_directions`: rings from south to north, then the poles."""
    # The poles follow the rings; each is connected to the ring next to it.
    north = _LATITUDES * _LONGITUDES
    south = north + 1
    lowest, highest = np.arange(_LONGITUDES), np.arange(north - _LONGITUDES, north)
    return np.concatenate(
        [
            _ring_edges(_LATITUDES, _LONGITUDES),
            np.column_stack([lowest, np.full(_LONGITUDES, south)]),
            np.column_stack([highest, np.full(_LONGITUDES, north)]),
        ]
    )


def geom_volume(model: mujoco.MjModel, geom: int) -> float:
    """Compute the volume of a geom, m³."""
    r, h, z = model.geom_size[geom].tolist()
    kind = int(model.geom_type[geom])
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        # Divergence theorem: signed tetrahedra a · (b × c) / 6 from the origin to each triangle.
        a, b, c = np.moveaxis(mesh_corners(model, int(model.geom_dataid[geom])), 1, 0)
        return abs(float(np.einsum("ij,ij->", a, np.cross(b, c)))) / 6
    # Closed formulas; sizes are radii or half lengths.
    return {
        int(mujoco.mjtGeom.mjGEOM_BOX): 8 * r * h * z,
        int(mujoco.mjtGeom.mjGEOM_SPHERE): 4 / 3 * np.pi * r**3,
        int(mujoco.mjtGeom.mjGEOM_CYLINDER): 2 * np.pi * r**2 * h,
        int(mujoco.mjtGeom.mjGEOM_CAPSULE): 2 * np.pi * r**2 * h + 4 / 3 * np.pi * r**3,
        int(mujoco.mjtGeom.mjGEOM_ELLIPSOID): 4 / 3 * np.pi * r * h * z,
    }.get(kind, 0.0)


def mesh_vertices(model: mujoco.MjModel, mesh: int) -> Array:
    """Return the vertices (n, 3) of a mesh, m, in the frame of its geoms."""
    first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
    return np.asarray(model.mesh_vert[first : first + count], dtype=float)


def mesh_corners(model: mujoco.MjModel, mesh: int) -> Array:
    """Return the corners (m, 3, 3) of the triangles of a mesh, as `mesh_vertices`."""
    first, count = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
    return mesh_vertices(model, mesh)[model.mesh_face[first : first + count]]


def _corners(half: Array) -> Array:
    # All combinations of signs of the half extents.
    signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).T.reshape(-1, 3)
    return signs * half


def _cylinder(size: Array) -> Array:
    # One circle, at the bottom and at the top.
    angle = np.arange(_CIRCLE) * 2 * np.pi / _CIRCLE
    ring = np.column_stack([np.cos(angle), np.sin(angle)]) * size[0]
    return np.concatenate(
        [np.column_stack([ring, np.full(_CIRCLE, z)]) for z in (-size[1], size[1])]
    )


@cache
def _directions() -> Array:
    """Compute unit vectors (m, 3) over the sphere, symmetric about every coordinate plane."""
    # A grid of latitudes and longitudes, plus the two poles.
    latitude = (np.arange(_LATITUDES) + 1)[:, None] * np.pi / (_LATITUDES + 1) - np.pi / 2
    longitude = np.arange(_LONGITUDES) * 2 * np.pi / _LONGITUDES
    grid = np.stack(
        np.broadcast_arrays(
            np.cos(latitude) * np.cos(longitude),
            np.cos(latitude) * np.sin(longitude),
            np.sin(latitude),
        ),
        axis=-1,
    )
    return np.concatenate([grid.reshape(-1, 3), [[0, 0, 1], [0, 0, -1]]])


def _capsule(size: Array) -> Array:
    ball = _directions() * size[0]
    up = np.array([0, 0, size[1]])
    return np.concatenate([ball + up, ball - up])


_OUTLINES: dict[int, Callable[[Array], Array]] = {
    int(mujoco.mjtGeom.mjGEOM_PLANE): lambda size: _corners(
        np.where(size > 0, size, INFINITE_PLANE) * np.array([1, 1, 0])
    ),
    int(mujoco.mjtGeom.mjGEOM_BOX): _corners,
    int(mujoco.mjtGeom.mjGEOM_SPHERE): lambda size: _directions() * size[0],
    int(mujoco.mjtGeom.mjGEOM_ELLIPSOID): lambda size: _directions() * size,
    int(mujoco.mjtGeom.mjGEOM_CYLINDER): _cylinder,
    int(mujoco.mjtGeom.mjGEOM_CAPSULE): _capsule,
}


USUAL_DENSITY = 1000.0  # kg/m³, MuJoCo's density of a geom that states none


@dataclass(frozen=True, slots=True, eq=False)
class Shapes:
    """Geometry of a compiled scene in its initial configuration."""

    model: mujoco.MjModel
    data: mujoco.MjData
    geom_ids: Mapping[Element, int]  # id in the model of each geom of the document
    tree: ModelTree  # the compiled elements
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
        """Compute points (k, 3), m, in the world whose convex hull is the geom."""
        return self.geom_points(self.geom_ids[geom])

    def geom_points(self, geom: int) -> Array:
        """Compute the points of a geom, as `points`, by its id in the model."""
        rotation = self.data.geom_xmat[geom].reshape(3, 3)
        return hull_points(self.model, geom) @ rotation.T + self.data.geom_xpos[geom]

    def convex(self, geom: Element) -> Convex:
        """Return the geom with its edges, in the world."""
        points = self.points(geom)
        kind = int(self.model.geom_type[self.geom_ids[geom]])
        return Convex(points, hull_edges(kind, len(points)))

    def cloud(self, geoms: Iterable[Element]) -> Array:
        """Compute the points (k, 3), m, of several geoms in the world."""
        return np.concatenate([self.points(geom) for geom in geoms])

    def volume(self, geom: Element) -> float:
        """Volume of a geom, m³; of a mesh as triangulated."""
        return geom_volume(self.model, self.geom_ids[geom])

    def mass_per_density(self, geom: Element) -> float:
        """Compute the derivative of a geom's mass by its density, m³ (m² of a shell).

        It differs from the volume for open meshes, and for meshes that MuJoCo weighs by their hulls.
        """
        i = self.geom_ids[geom]
        # A closed solid primitive: the derivative is the volume.
        has_shells = any(part.get("shellinertia") == "true" for part in elements(self.tree.root))
        if int(self.model.geom_type[i]) not in _TRIANGULATED and not has_shells:
            return self.volume(geom)
        if geom not in self._per_density:
            # The masses that MuJoCo computes at two densities give the derivative.
            body, twin = int(self.model.geom_bodyid[i]), self.tree.twin_of[geom]
            stated, masses = dict(twin.attrib), list[float]()
            for density in (USUAL_DENSITY, 2 * USUAL_DENSITY):
                twin.attrib.pop("mass", None)
                twin.set("density", repr(density))
                masses.append(float(compile_model(compile_spec(self.tree)).body_mass[body]))
            # Restore the attributes of the geom.
            twin.attrib.clear()
            twin.attrib.update(stated)
            lighter, heavier = masses
            self._per_density[geom] = (heavier - lighter) / USUAL_DENSITY
        return self._per_density[geom] or self.volume(geom)

    def solid_geoms(self) -> list[int]:
        """Return the ids of all geoms that can collide, except planes."""
        # A geom with both masks 0 never collides: it is visual.
        masks = self.model.geom_contype | self.model.geom_conaffinity
        solid = (masks != 0) & (self.model.geom_type != mujoco.mjtGeom.mjGEOM_PLANE)
        return np.flatnonzero(solid).tolist()

    def base(self) -> Pose:
        """Pose of the site `robot_base`, else the origin."""
        site = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_SITE, BASE_SITE)
        if site < 0:
            return Pose.of((0, 0, 0))
        return _pose(self.data.site_xpos[site], self.data.site_xmat[site])


def compile_shapes(document: Document, roles: Roles, edits: Sequence[Edit | Insert]) -> Shapes:
    """Compile the scene with `edits` in its initial configuration.

    Raises InputError: MuJoCo does not accept the scene, or one of its numbers is not finite.
    """
    # Compile a copy whose geoms all have names.
    tree = model_tree(document, roles, edits, is_drawn=False)
    names = _name_geoms(tree, roles)
    model = compile_model(compile_spec(tree))
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    # Reject non-finite numbers, which later computations could not handle.
    numbers = (
        *(data.xpos, data.xquat, data.geom_xpos, data.geom_xmat, data.site_xpos),
        *(model.geom_size, model.geom_friction, model.opt.gravity),
        *(model.body_mass, model.body_inertia, model.body_ipos),
    )
    if not all(np.isfinite(array).all() for array in numbers):
        raise InputError("the scene has a number that is not finite (nan or inf)")
    # Look up the geoms of the document in the model.
    ids: dict[Element, int] = {}
    for geom, name in names.items():
        i = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, name)
        if i >= 0:
            ids[geom] = i
    return Shapes(model, data, ids, tree)


# Ancestors of a `<geom>` that is a default, or a wrapping geom of a tendon.
_NO_GEOMS = ("default", "tendon")


def _name_geoms(tree: ModelTree, roles: Roles) -> dict[Element, str]:
    """Return the compiled names of the document's geoms; a geom without a name gets one in the tree."""
    names: dict[Element, str] = {}
    for i, (original, twin) in enumerate(tree.twin_of.items()):
        # Elements are found in the compiled model by name only, so every geom needs one.
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


RESTING = 0.02  # m: largest distance of an object's bottom from the top that it rests on
