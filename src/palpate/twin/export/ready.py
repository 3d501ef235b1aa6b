"""A model made ready for another format: every body, geom and joint has a name, every body its mass
as a number, and a shape that other formats do not have is another one, or out."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np

from palpate.geometry.pose import Pose
from palpate.mjcf.shapes import mesh_corners
from palpate.twin.export.facts import unnamed
from palpate.twin.export.stl import write_stl

SUBDIVISIONS = 3
"""Of an icosahedron: an ellipsoid is then a mesh of 642 points."""
READ = (".obj", ".stl")
"""Formats of meshes that are read everywhere."""


def ready(scene: Path) -> tuple[mujoco.MjSpec, list[str]]:
    """The scene in a file, and a line for every shape that is another one now."""
    spec = mujoco.MjSpec.from_file(str(scene))
    _state_inertia(spec, spec.compile())
    _name_all(spec)
    notes: list[str] = []
    for geom in list(spec.geoms):
        if geom.type == mujoco.mjtGeom.mjGEOM_ELLIPSOID:
            _mesh(spec, geom)
            notes.append(f"the ellipsoid '{geom.name}' is a mesh")
        elif geom.type == mujoco.mjtGeom.mjGEOM_HFIELD:
            notes.append(f"the height field '{geom.name}' is left out")
            spec.delete(geom)
    _file_meshes(spec, scene.parent)
    return spec, notes


def _state_inertia(spec: mujoco.MjSpec, model: mujoco.MjModel) -> None:
    """Every mass as MuJoCo computes it, instead of how it does."""
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


def _name_all(spec: mujoco.MjSpec) -> None:
    for body in spec.bodies:
        body.name = body.name or unnamed(body.id)
    for things, kind in ((spec.geoms, "geom"), (spec.joints, "joint")):
        for i, thing in enumerate(things):
            thing.name = thing.name or f"{kind}_{i}"


def _mesh(spec: mujoco.MjSpec, geom: mujoco.MjsGeom) -> None:
    """An ellipsoid as a mesh."""
    mesh = spec.add_mesh()
    mesh.name = f"{geom.name}_mesh"
    mesh.make_sphere(SUBDIVISIONS)
    mesh.scale = geom.size
    geom.type, geom.meshname = mujoco.mjtGeom.mjGEOM_MESH, mesh.name


def _file_meshes(spec: mujoco.MjSpec, folder: Path) -> None:
    """Meshes that stand in the scene itself, or in files that are rarely read elsewhere, as files."""
    model = spec.compile()
    for mesh in spec.meshes:
        if Path(mesh.file).suffix.lower() in READ or mesh.plugin.active:
            continue
        # MuJoCo has moved and turned the vertices; here they are where they were.
        was = Pose.of(model.mesh_pos[mesh.id], model.mesh_quat[mesh.id])
        corners = mesh_corners(model, mesh.id) @ was.rotation.T + was.position
        mesh.file = f"filed_{mesh.id}.stl"
        write_stl(folder / mesh.file, corners)
        mesh.content_type = ""
        mesh.scale, mesh.refpos, mesh.refquat = np.ones(3), np.zeros(3), [1.0, 0.0, 0.0, 0.0]
        mesh.uservert, mesh.userface, mesh.usernormal = [], [], []
        mesh.usertexcoord, mesh.userfacenormal, mesh.userfacetexcoord = [], [], []
