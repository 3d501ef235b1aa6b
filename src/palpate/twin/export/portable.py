"""Models whose bodies, masses and shapes formats other than MJCF can state."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np

from palpate.geometry.pose import Array, Pose
from palpate.mjcf.shapes import mesh_corners
from palpate.twin.export.facts import unnamed

SCENE = "scene.xml"
"""The name of the scene among its files."""
SUBDIVISIONS = 3
"""Of an icosahedron: an ellipsoid is then a mesh of 642 points."""
READ = (".obj", ".stl")
"""Formats of meshes that are read everywhere."""
_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("rest", "<u2")])


def ready(scene: Path) -> tuple[mujoco.MjSpec, list[str]]:
    """The scene in a file, prepared for another format, and a note for each replaced shape: every body,
    geom and joint has a name, every body its mass as a number, and no shape is an ellipsoid or a height
    field."""
    spec = mujoco.MjSpec.from_file(str(scene))
    state_inertia(spec, spec.compile())
    for body in spec.bodies:
        body.name = body.name or unnamed(body.id)
    for things, kind in ((spec.geoms, "geom"), (spec.joints, "joint")):
        for i, thing in enumerate(things):
            thing.name = thing.name or f"{kind}_{i}"
    notes: list[str] = []
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
    """State every mass and inertia as compiled, in place of the options from which they follow."""
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
    """Write STL files of the meshes that stand in the scene itself, or in rarely readable formats."""
    model = spec.compile()
    for mesh in spec.meshes:
        if Path(mesh.file).suffix.lower() in READ or mesh.plugin.active:
            continue
        # MuJoCo has moved the vertices into the mesh's principal frame; this moves them back.
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
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    triangles = np.zeros(len(corners), _TRIANGLE)
    triangles["corners"] = corners
    triangles["normal"] = across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-30)
    # A header of 80 bytes, the number of triangles, and the triangles.
    path.write_bytes(bytes(80) + np.uint32(len(corners)).tobytes() + triangles.tobytes())
