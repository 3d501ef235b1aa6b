"""Facts about bodies for the comparison of exports, and portable MJCF."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from pathlib import Path

import mujoco
import numpy as np

from palpate.common.pose import Array, Pose
from palpate.mjcf.shapes import mesh_corners, mesh_vertices

CLOSE = 1e-5
"""Relative tolerance: single precision of USD and of meshes, six digits of MuJoCo's own MJCF."""
WORLD = "world"
GROUND = np.array([10.0, 10.0, 0.01])
"""m: half extents of the box whose top represents a plane."""
CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
"""Corners (8, 3) of a cube with edges of 2."""


@dataclass(frozen=True, slots=True, eq=False)
class Facts:
    """A body, with its n shapes in the order of the file.

    Attributes:
        pose: (4, 4) of its frame in the world.
        mass: (1,) kg.
        com: (3,) m, in the body's frame.
        inertia: (3, 3) kg m^2 about the centre of mass, in the body's frame.
        shape: (n, 2, 3) m, lowest and highest world coordinates of each shape.
        friction: (k,) sliding coefficients of the shapes that collide and state one.
    """

    pose: Array
    mass: Array
    com: Array
    inertia: Array
    shape: Array
    friction: Array


def facts_of(model: mujoco.MjModel, colliding: bool = False) -> dict[str, Facts]:
    """Collect the bodies of a model in its initial configuration, the world included.

    With `colliding`, only geoms that collide are included.
    """
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    found: dict[str, Facts] = {}
    for body in range(model.nbody):
        touching = [geom for geom in geoms_of(model, body) if collides(model, geom)]
        # Boxes of the shapes in world axes.
        boxes: list[Array] = []
        for geom in touching if colliding else geoms_of(model, body):
            frame = homogeneous(data.geom_xmat[geom], data.geom_xpos[geom])
            boxes.append(box_of(model, geom, frame))
        found[body_name(model, body)] = Facts(
            homogeneous(data.xmat[body], data.xpos[body]),
            np.array([model.body_mass[body]]),
            model.body_ipos[body].copy(),
            tensor(model.body_inertia[body], model.body_iquat[body]),
            np.array(boxes).reshape(-1, 2, 3),
            np.array([float(model.geom_friction[geom, 0]) for geom in touching]),
        )
    return found


def body_name(model: mujoco.MjModel, body: int) -> str:
    """Name of a body, its link and its frame."""
    return model.body(body).name or fallback_name(body)


def fallback_name(body: int) -> str:
    """Name of a body without a name."""
    return f"body_{body}"


def geoms_of(model: mujoco.MjModel, body: int) -> range:
    """The geoms of a body."""
    first = int(model.body_geomadr[body])
    return range(first, first + int(model.body_geomnum[body]))


def collides(model: mujoco.MjModel, geom: int) -> bool:
    """True if a geom collides with anything."""
    return bool(model.geom_contype[geom] or model.geom_conaffinity[geom])


def is_free(model: mujoco.MjModel, body: int) -> bool:
    """True if a body has a free joint."""
    joint = int(model.body_jntadr[body])
    return joint >= 0 and model.jnt_type[joint] == int(mujoco.mjtJoint.mjJNT_FREE)


def homogeneous(rotation: Array, position: Array) -> Array:
    """Homogeneous transformation (4, 4) of a rotation matrix, (9,) or (3, 3), and a position
    (3,)."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation.reshape(3, 3), position
    return pose


def tensor(principal: Array, quaternion: Array) -> Array:
    """Inertia tensor (3, 3), R diag(I) R^T, of principal moments (3,) and the quaternion (4,) of
    their axes.
    """
    axes = np.empty(9)
    mujoco.mju_quat2Mat(axes, quaternion)
    rotation = axes.reshape(3, 3)
    return rotation @ np.diag(principal) @ rotation.T


def box_of(model: mujoco.MjModel, geom: int, frame: Array) -> Array:
    # MuJoCo's sizes are radii and half lengths; a capsule is measured to its caps' centres.
    kind, size = mujoco.mjtGeom(model.geom_type[geom]), model.geom_size[geom]
    radius, half = float(size[0]), float(size[1])
    match kind:
        case mujoco.mjtGeom.mjGEOM_MESH | mujoco.mjtGeom.mjGEOM_SDF:
            return box_around(frame, mesh_vertices(model, int(model.geom_dataid[geom])))
        case mujoco.mjtGeom.mjGEOM_PLANE:
            return plane_box(frame)
        case mujoco.mjtGeom.mjGEOM_SPHERE:
            return round_box(frame, radius)
        case mujoco.mjtGeom.mjGEOM_CAPSULE:
            return round_box(frame, radius, half)
        case mujoco.mjtGeom.mjGEOM_CYLINDER:
            return round_box(frame, radius, half, axes=2)
        case mujoco.mjtGeom.mjGEOM_ELLIPSOID:
            return round_box(frame @ np.diag([*size, 1.0]), 1.0)
        case _:
            return box_around(frame, CORNERS * size)


def box_around(frame: Array, points: Array) -> Array:
    """Box (2, 3) around points (n, 3) of a frame (4, 4), which may be stretched."""
    there = points @ frame[:3, :3].T + frame[:3, 3]
    return np.array([there.min(axis=0), there.max(axis=0)])


def round_box(frame: Array, radius: float, half: float = 0.0, axes: int = 3) -> Array:
    """Box (2, 3) of a capsule with that half length along z.

    A half length of 0 gives a ball, two `axes` a cylinder. The frame may be stretched.
    """
    # Support function of the shape along the world axes: segment plus ball or disc.
    reach = half * np.abs(frame[:3, 2]) + radius * np.linalg.norm(frame[:3, :axes], axis=1)
    return np.array([frame[:3, 3] - reach, frame[:3, 3] + reach])


def plane_box(frame: Array) -> Array:
    """Box (2, 3) around the box that represents an infinite plane."""
    return box_around(frame, CORNERS * GROUND - [0.0, 0.0, GROUND[2]])


def differences(
    twin: Mapping[str, Facts], made: Mapping[str, Facts], friction: bool = True
) -> Iterator[tuple[str, str]]:
    """Yield the bodies of the twin that differ in an export, each with a description.

    `friction` is true if the format has friction.
    """
    for name, facts in twin.items():
        other = made.get(name)
        if other is None:
            yield name, "it is missing"
            continue
        for what in (each.name for each in fields(Facts)):
            of_mass = what in ("mass", "com", "inertia")
            if (of_mass and not facts.mass[0] > 0.0) or (what == "friction" and not friction):
                continue
            mine, its = getattr(facts, what), getattr(other, what)
            if mine.shape != its.shape:
                yield name, f"its {what} has {its.size} numbers instead of {mine.size}"
                continue
            # A small number in an array of large ones has their absolute precision.
            least = max(CLOSE * float(np.abs(mine).max(initial=0.0)), 1e-15)
            if not np.allclose(its, mine, CLOSE, least):
                i = int(np.argmax(np.abs(its - mine)))
                yield name, f"its {what} has {its.flat[i]:.8g} instead of {mine.flat[i]:.8g}"


# Models whose bodies, masses and shapes fit formats other than MJCF.


SCENE = "scene.xml"
"""Name of the scene among its files."""
SHARE = 1e-6
"""Share of a body's mass and inertia in a link between two of its joints, or in a massless body."""
SPREAD = 0.01
"""m: radius of gyration of a massless body."""
SUBDIVISIONS = 3
"""Subdivisions of an icosahedron. An ellipsoid then becomes a mesh of 642 points."""
READ = (".obj", ".stl")
"""Formats of meshes that all simulators read."""
_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("rest", "<u2")])


def ready(scene: Path) -> tuple[mujoco.MjSpec, list[str]]:
    """Prepare the scene in a file for another format.

    Every body, geom and joint gets a name, every body its mass as a number. Ellipsoids and height
    fields are replaced or removed.

    Returns:
        The scene, and a note for each such shape.
    """
    spec = mujoco.MjSpec.from_file(str(scene))
    model = spec.compile()
    state_inertia(spec, model)
    # Name all elements: links and joints of other formats need names.
    for body in spec.bodies:
        body.name = body.name or fallback_name(body.id)
    for things, kind in ((spec.geoms, "geom"), (spec.joints, "joint")):
        for i, thing in enumerate(things):
            thing.name = thing.name or f"{kind}_{i}"
    notes: list[str] = []
    # Readers refuse a moving body without mass, or lose it: give it a share of what it carries.
    for body in spec.bodies:
        if model.body_weldid[body.id] and not model.body_mass[body.id] > 0.0:
            body.explicitinertial, body.ipos = True, np.zeros(3)
            body.mass = SHARE * model.body_subtreemass[body.id]
            body.inertia = np.full(3, body.mass * SPREAD**2)
            notes.append(f"'{body.name}' has no mass of its own: it weighs {1e6 * body.mass:.3g} mg")
    # Replace ellipsoids by meshes, and remove height fields.
    for geom in list(spec.geoms):  # a copy: geoms are deleted on the way
        if geom.type == mujoco.mjtGeom.mjGEOM_ELLIPSOID:
            mesh = spec.add_mesh()
            mesh.name = f"{geom.name}_mesh"
            mesh.make_sphere(SUBDIVISIONS)
            mesh.scale = geom.size
            geom.type, geom.meshname = mujoco.mjtGeom.mjGEOM_MESH, mesh.name
            notes.append(f"the ellipsoid '{geom.name}' is a mesh")
        elif geom.type == mujoco.mjtGeom.mjGEOM_HFIELD:
            notes.append(f"the height field '{geom.name}' is left out")
            spec.delete(geom)
    file_meshes(spec, scene.parent)
    return spec, notes


def state_inertia(spec: mujoco.MjSpec, model: mujoco.MjModel) -> None:
    """State every mass and inertia as compiled, and reset the options that would compute them."""
    for body in spec.bodies:
        if model.body_mass[body.id] > 0.0:
            body.explicitinertial = True
            body.mass = model.body_mass[body.id]
            body.ipos = model.body_ipos[body.id]
            body.iquat = model.body_iquat[body.id]
            body.inertia = model.body_inertia[body.id]
            body.fullinertia = np.full(6, np.nan)
            body.ialt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
    spec.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_AUTO
    spec.compiler.settotalmass = -1.0
    spec.compiler.boundmass = spec.compiler.boundinertia = 0.0


def file_meshes(spec: mujoco.MjSpec, folder: Path) -> None:
    """Write STL files of the meshes that are defined in the scene itself, or in formats that few
    programs read.
    """
    model = spec.compile()
    for mesh in spec.meshes:
        if Path(mesh.file).suffix.lower() in READ or mesh.plugin.active:
            continue
        # MuJoCo has moved the vertices into the mesh's principal frame: move them back.
        was = Pose.of(model.mesh_pos[mesh.id], model.mesh_quat[mesh.id])
        corners = mesh_corners(model, mesh.id) @ was.rotation.T + was.position
        mesh.file = f"filed_{mesh.id}.stl"
        write_stl(folder / mesh.file, corners)
        mesh.content_type = ""
        mesh.scale, mesh.refpos, mesh.refquat = np.ones(3), np.zeros(3), [1.0, 0.0, 0.0, 0.0]
        mesh.uservert, mesh.userface, mesh.usernormal = [], [], []
        mesh.usertexcoord, mesh.userfacenormal, mesh.userfacetexcoord = [], [], []


def write_stl(path: Path, corners: Array) -> None:
    """Write binary STL of triangles: `corners` (n, 3, 3) in m, each corner a row."""
    # Unit normals from the edges; degenerate triangles get a zero normal.
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    triangles = np.zeros(len(corners), _TRIANGLE)
    triangles["corners"] = corners
    triangles["normal"] = across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-30)
    # Layout: a header of 80 bytes, the count of triangles, and the triangles.
    path.write_bytes(bytes(80) + np.uint32(len(corners)).tobytes() + triangles.tobytes())
