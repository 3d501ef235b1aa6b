"""Bodies and geoms of exported models, and MJCF that fits formats other than MJCF."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np

from palpate.common.pose import Array, Pose
from palpate.mjcf.shapes import mesh_corners

GROUND = np.array([10.0, 10.0, 0.01])
"""m: half extents of the box whose top represents a plane."""


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


def tensor(principal: Array, quaternion: Array) -> Array:
    """Inertia tensor (3, 3), R diag(I) R^T, of principal moments (3,) and the quaternion (4,) of
    their axes.
    """
    axes = np.empty(9)
    mujoco.mju_quat2Mat(axes, quaternion)
    rotation = axes.reshape(3, 3)
    return rotation @ np.diag(principal) @ rotation.T


# Models whose bodies, masses and shapes fit formats other than MJCF.


SCENE = "scene.xml"
"""Name of the scene among its files."""
SHARE = 1e-6
"""Share of a body's mass and inertia in a link between two of its joints, or in a massless body."""
SPREAD = 0.01
"""m: radius of gyration of a massless body."""
SUBDIVISIONS = 3
"""Subdivisions of an icosahedron. An ellipsoid then becomes a mesh of 642 points."""
READ = ".obj"
"""Format of meshes that all simulators read; Drake reads no other that MuJoCo reads."""


def prepare(scene: Path) -> tuple[mujoco.MjSpec, list[str]]:
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
    for elements, kind in ((spec.geoms, "geom"), (spec.joints, "joint")):
        for i, element in enumerate(elements):
            element.name = element.name or f"{kind}_{i}"
    notes: list[str] = []
    for body in range(1, model.nbody):
        first = int(model.body_dofadr[body])
        if is_free(model, body) and model.dof_damping[first : first + 6].any():
            name = body_name(model, body)
            notes.append(f"the damping of the free body '{name}' is left out")
    # Readers refuse or lose a moving body without mass: give it a share of the mass that it carries.
    for body in spec.bodies:
        if model.body_weldid[body.id] and not model.body_mass[body.id] > 0.0:
            body.explicitinertial, body.ipos = True, np.zeros(3)
            body.mass = SHARE * model.body_subtreemass[body.id]
            body.inertia = np.full(3, body.mass * SPREAD**2)
            notes.append(
                f"'{body.name}' has no mass of its own: it weighs {1e6 * body.mass:.3g} mg"
            )
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
    """Write OBJ files of the meshes that are defined in the scene itself, or in other formats.

    `folder` is that of the scene.
    """
    model = spec.compile()
    for mesh in spec.meshes:
        if Path(mesh.file).suffix.lower() == READ or mesh.plugin.active:
            continue
        # MuJoCo has moved the vertices into the mesh's principal frame: move them back.
        was = Pose.of(model.mesh_pos[mesh.id], model.mesh_quat[mesh.id])
        corners = mesh_corners(model, mesh.id) @ was.rotation.T + was.position
        mesh.file = f"filed_{mesh.id}{READ}"
        write_obj(folder / mesh.file, corners)
        mesh.content_type = ""
        mesh.scale, mesh.refpos, mesh.refquat = np.ones(3), np.zeros(3), [1.0, 0.0, 0.0, 0.0]
        mesh.uservert, mesh.userface, mesh.usernormal = [], [], []
        mesh.usertexcoord, mesh.userfacenormal, mesh.userfacetexcoord = [], [], []


def write_obj(path: Path, corners: Array) -> None:
    """Write an OBJ file of triangles: `corners` (n, 3, 3) in m, each corner a row."""
    points, faces = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in points.tolist()]
    lines += [f"f {a} {b} {c}" for a, b, c in (faces.reshape(-1, 3) + 1).tolist()]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
