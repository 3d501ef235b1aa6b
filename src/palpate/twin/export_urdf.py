"""URDF of a compiled model: links, joints and their shapes.

Existing converters leave out primitives and collisions, and give every joint a mass. URDF has
neither friction nor contact parameters, and no planes, capsules or ball joints. Each free body has
a file of its own, with its pose in `placement.json`.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Sequence
from copy import copy
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from lxml import etree

from palpate.common.pose import Array, Pose
from palpate.mjcf.document import Element
from palpate.mjcf.shapes import RESTING, mesh_corners
from palpate.twin.export_facts import (
    GROUND,
    SHARE,
    body_name,
    collides,
    geoms_of,
    is_free,
    tensor,
    write_obj,
)
from palpate.twin.export_readers import Placement

MESHES = "meshes"
PLACEMENT = "placement.json"
DRAKE = "http://drake.mit.edu"
"""Namespace of Drake's elements."""
SHOWN = 2
"""Last group of geoms that is shown, as in MuJoCo's viewer."""
NOT_SIMPLE = (
    mujoco.mjtGeom.mjGEOM_MESH,
    mujoco.mjtGeom.mjGEOM_SDF,
    mujoco.mjtGeom.mjGEOM_ELLIPSOID,
    mujoco.mjtGeom.mjGEOM_HFIELD,
)
"""Shapes that URDF has only in files, or not at all."""
EFFORT, SPEED = "1e6", "1e3"
"""Limits of a joint: N or N m, and m/s or rad/s. MJCF bounds neither, and URDF requires numbers."""

Inset = tuple[Pose, str, dict[str, str]]
"""Part of a geom: its pose in the link, and an element of `<geometry>`."""


@dataclass(slots=True)
class UrdfFiles:
    """Result of writing a model as URDF.

    Attributes:
        notes: contents that URDF cannot state.
        frictions: (geoms, 2), by `pair_frictions`.
        placement: file and pose of each free body, by its name.
    """

    notes: list[str] = field(default_factory=list[str])
    frictions: Array = field(default_factory=lambda: np.zeros((0, 2)))
    placement: Placement = field(default_factory=dict[str, dict[str, Any]])


def write_urdf(model: mujoco.MjModel, path: Path) -> UrdfFiles:
    """Write a model, with its meshes in a folder and its free bodies in files of their own.

    Readers ignore the origin of a floating joint, or fix it (findings/urdf_floating_origin.sh). All
    bodies, geoms and joints must have names.
    """
    written = UrdfFiles(frictions=pair_frictions(model))
    # Group the bodies by file: each free body with all below it, and the rest.
    free = [b for b in range(model.nbody) if is_free(model, b)]
    of_scene = [b for b in range(model.nbody) if int(model.body_rootid[b]) not in free]
    write_bodies(model, of_scene, path, written)
    for root in free:
        name = body_name(model, root)
        safe = re.sub(r"[^\w.-]", "_", name)
        file = path.with_name(f"{safe}.urdf")
        while file.exists():
            file = file.with_name(f"{file.stem}_.urdf")
        below = [b for b in range(model.nbody) if int(model.body_rootid[b]) == root]
        write_bodies(model, below, file, written)
        pose = model.body_pos[root].tolist(), np.roll(model.body_quat[root], -1).tolist()
        keys = ("file", "position", "quaternion_xyzw")
        written.placement[name] = dict(zip(keys, (file.name, *pose), strict=True))
    placement = json.dumps(written.placement, indent=2) + "\n"
    path.with_name(PLACEMENT).write_text(placement, encoding="utf-8")
    # Meshes are shared by all files.
    if model.nmesh:
        (path.parent / MESHES).mkdir()
    for mesh in range(model.nmesh):
        write_obj(path.parent / mesh_file(mesh), mesh_corners(model, mesh))
    return written


def write_bodies(
    model: mujoco.MjModel, bodies: Sequence[int], path: Path, written: UrdfFiles
) -> None:
    """Write one file of bodies, the first of them as the root: links, then the joints."""
    root = etree.Element("robot", {"name": path.stem}, nsmap={"drake": DRAKE})
    for body in bodies:
        add_link(root, model, body, written)
    for body in bodies[1:]:
        add_joints(root, model, body, written)
    etree.indent(root)
    path.write_bytes(etree.tostring(root, encoding="utf-8", xml_declaration=True))


def link_offset(model: mujoco.MjModel, body: int) -> Pose:
    """Frame of a link in its body's frame: a link is at its last joint."""
    if not model.body_jntnum[body] or is_free(model, body):
        return Pose.of([0.0, 0.0, 0.0])
    return Pose.of(model.jnt_pos[model.body_jntadr[body] + model.body_jntnum[body] - 1])


def urdf_to_look_at(model: mujoco.MjModel) -> str:
    """Write links, joints and visible shapes of a model into one text.

    A shape that URDF lacks, or has only in another file, is replaced by the box around it.
    """
    root = etree.Element("robot", {"name": "cell"})
    for body in range(model.nbody):
        link = etree.SubElement(root, "link", {"name": body_name(model, body)})
        for geom in geoms_of(model, body):
            if model.geom_group[geom] > SHOWN:
                continue
            insets = insets_of(model, geom)
            # The box of MuJoCo's AABB, in the geom's frame.
            if mujoco.mjtGeom(model.geom_type[geom]) in NOT_SIMPLE:
                centre, half = np.split(model.geom_aabb[geom], 2)
                pose = Pose.of(model.geom_pos[geom], model.geom_quat[geom]) @ Pose.of(centre)
                insets = [(pose, "box", {"size": _numbers(2 * half)})]
            add_visuals(link, model, geom, insets)
    # Viewers take the poses of moving links from elsewhere: a floating joint allows them all.
    for body in range(1, model.nbody):
        kind = "floating" if model.body_jntnum[body] else "fixed"
        names = body_name(model, int(model.body_parentid[body])), body_name(model, body)
        place = Pose.of(model.body_pos[body], model.body_quat[body])
        add_joint(root, f"{names[1]}_mount", kind, names, place)
    return etree.tostring(root, encoding="unicode")


def add_link(root: Element, model: mujoco.MjModel, body: int, written: UrdfFiles) -> None:
    name = body_name(model, body)
    link = etree.SubElement(root, "link", {"name": name})
    to_link = link_offset(model, body).inverse()
    # Inertia of the link: principal axes rotated into its frame. It is stated also where it is zero:
    # readers compute the mass of a link without it from the shapes.
    inertia = tensor(model.body_inertia[body], model.body_iquat[body])
    com = to_link @ Pose.of(model.body_ipos[body])
    add_inertial(link, com, float(model.body_mass[body]), inertia)
    for geom in geoms_of(model, body):
        # Visible and colliding shapes are separate elements.
        insets = [(to_link @ at, kind, size) for at, kind, size in insets_of(model, geom)]
        if model.geom_group[geom] <= SHOWN:
            add_visuals(link, model, geom, insets)
        if collides(model, geom):
            harmonic, product = written.frictions[geom].tolist()
            for inset in insets:
                shape = add_shape(link, "collision", inset)
                properties = etree.SubElement(shape, f"{{{DRAKE}}}proximity_properties")
                for coefficient in ("mu_static", "mu_dynamic"):
                    tag = f"{{{DRAKE}}}{coefficient}"
                    etree.SubElement(properties, tag, {"value": _number(harmonic)})
            # Bullet has one friction for a link: that of its first shape.
            if link.find("contact") is None:
                contact = etree.SubElement(link, "contact")
                etree.SubElement(contact, "lateral_friction", {"value": _number(product)})
        if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_PLANE:
            plane = model.geom(geom).name
            written.notes.append(
                f"the plane '{plane}' is the top of a box, {2 * GROUND[0]:g} m wide"
            )


def pair_frictions(model: mujoco.MjModel) -> Array:
    """Compute (geoms, 2) frictions that act as in MuJoCo on what each geom touches at the start.

    The first is for Drake, which takes 2 a b / (a + b) of two geoms; the second for Bullet, which
    takes a b. A geom that touches nothing fixed has its own.
    """
    frictions = np.repeat(model.geom_friction[:, :1], 2, axis=1)
    # A margin lets MuJoCo find what an object does not quite touch.
    model = copy(model)
    model.geom_margin[:] = model.body_margin[:] = RESTING
    data = mujoco.MjData(model)
    mujoco.mj_fwdPosition(model, data)
    found_contacts = data.contact
    for i, geoms in enumerate(found_contacts.geom.tolist()):
        roots = model.body_rootid[model.geom_bodyid[geoms]].tolist()
        fixed = [not is_free(model, root) for root in roots]
        if not any(fixed):
            continue
        # MuJoCo has combined the friction of the contact already.
        acting = float(found_contacts.friction[i, 0]) * (found_contacts.dim[i] > 1)
        own, support = geoms[::-1] if fixed[0] else geoms
        other = max(float(model.geom_friction[support, 0]), 1e-3)
        # Solve both rules for the own friction; the harmonic mean is below 2 b.
        frictions[own] = (acting * other / max(2.0 * other - acting, 1e-3), acting / other)
    return frictions


def insets_of(model: mujoco.MjModel, geom: int) -> Iterable[Inset]:
    """Convert a geom to URDF's shapes, in its link's frame."""
    # MuJoCo states half sizes, URDF full ones.
    x, y, z = model.geom_size[geom].tolist()
    pose = Pose.of(model.geom_pos[geom], model.geom_quat[geom])
    ball = {"radius": _number(x)}
    match mujoco.mjtGeom(model.geom_type[geom]):
        case mujoco.mjtGeom.mjGEOM_MESH | mujoco.mjtGeom.mjGEOM_SDF:
            yield pose, "mesh", {"filename": mesh_file(int(model.geom_dataid[geom]))}
        case mujoco.mjtGeom.mjGEOM_PLANE:
            below = Pose.of([0.0, 0.0, -GROUND[2]])
            yield pose @ below, "box", {"size": _numbers(2 * GROUND)}
        case mujoco.mjtGeom.mjGEOM_BOX:
            yield pose, "box", {"size": _numbers((2 * x, 2 * y, 2 * z))}
        case mujoco.mjtGeom.mjGEOM_SPHERE:
            yield pose, "sphere", ball
        case kind:
            # URDF has no capsules: use a cylinder with a ball at each end.
            yield pose, "cylinder", {**ball, "length": _number(2 * y)}
            if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
                for end in (-y, y):
                    yield pose @ Pose.of([0.0, 0.0, end]), "sphere", ball


def add_visuals(link: Element, model: mujoco.MjModel, geom: int, insets: Iterable[Inset]) -> None:
    material = int(model.geom_matid[geom])
    rgba = model.geom_rgba[geom] if material < 0 else model.mat_rgba[material]
    name = model.geom(geom).name or f"geom_{geom}"
    for inset in insets:
        visual = add_shape(link, "visual", inset)
        colour = etree.SubElement(visual, "material", {"name": f"{name}_colour"})
        etree.SubElement(colour, "color", {"rgba": _numbers(rgba)})


def add_shape(link: Element, tag: str, inset: Inset) -> Element:
    pose, kind, attributes = inset
    shape = etree.SubElement(link, tag)
    add_origin(shape, pose)
    etree.SubElement(etree.SubElement(shape, "geometry"), kind, attributes)
    return shape


def add_inertial(link: Element, com: Pose, mass: float, inertia: Array) -> None:
    """Add mass, kg, and inertia (3, 3), kg m^2, about `com` in the link's axes."""
    inertial = etree.SubElement(link, "inertial")
    add_origin(inertial, com)
    etree.SubElement(inertial, "mass", {"value": _number(mass)})
    # Six entries of the symmetric tensor.
    entries: dict[str, str] = {}
    for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)):
        entries[f"i{'xyz'[i]}{'xyz'[j]}"] = _number(inertia[i, j])
    etree.SubElement(inertial, "inertia", entries)


def add_joints(root: Element, model: mujoco.MjModel, body: int, written: UrdfFiles) -> None:
    """Add the joints from a body's parent to it.

    A link's frame is its joint's. A body with several joints gets a link before each but the last.
    """
    name, above = body_name(model, body), int(model.body_parentid[body])
    parent = body_name(model, above)
    # From the parent's link to the body's frame.
    pose = link_offset(model, above).inverse()
    pose = pose @ Pose.of(model.body_pos[body], model.body_quat[body])
    first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
    if not count:
        add_joint(root, f"{name}_mount", "fixed", (parent, name), pose)
    for joint in range(first, first + count):
        kind, attributes = joint_type(model, joint, written)
        at, joint_name = Pose.of(model.jnt_pos[joint]), model.joint(joint).name
        child = name
        if joint < first + count - 1:
            # A share of the body's mass: readers refuse a massless link, or give it 1 kg.
            child, mass = f"{joint_name}_link", SHARE * float(model.body_mass[body])
            link = etree.SubElement(root, "link", {"name": child})
            inertia = SHARE * float(model.body_inertia[body].min()) * np.eye(3)
            add_inertial(link, Pose.of([0.0, 0.0, 0.0]), mass, inertia)
            written.notes.append(f"'{child}', between two joints, weighs {1e6 * mass:.3g} mg")
        element = add_joint(root, joint_name, kind, (parent, child), pose @ at)
        for tag, values in attributes.items():
            etree.SubElement(element, tag, values)
        parent, pose = child, at.inverse()
    if link_offset(model, body).position.any():
        written.notes.append(f"the frame of the link '{name}' is at its joint")


def joint_type(
    model: mujoco.MjModel, joint: int, written: UrdfFiles
) -> tuple[str, dict[str, dict[str, str]]]:
    """Type, axis and limits of a joint. URDF's zero is MuJoCo's initial configuration."""
    # URDF has no ball joints.
    name, kind = model.joint(joint).name, mujoco.mjtJoint(model.jnt_type[joint])
    if kind == mujoco.mjtJoint.mjJNT_BALL:
        written.notes.append(f"the ball joint '{name}' is fixed")
        return "fixed", {}
    # Passive forces: URDF has damping and friction.
    dof = int(model.jnt_dofadr[joint])
    dynamics = {"damping": model.dof_damping[dof], "friction": model.dof_frictionloss[dof]}
    absent = {"stiffness": model.jnt_stiffness[joint], "armature": model.dof_armature[dof]}
    left = " and ".join(what for what, value in absent.items() if value)
    if left:
        written.notes.append(f"the {left} of the joint '{name}' is left out")
    axis = {"axis": {"xyz": _numbers(model.jnt_axis[joint])}}
    if any(dynamics.values()):
        axis["dynamics"] = {what: _number(value) for what, value in dynamics.items()}
    hinge, limited = kind == mujoco.mjtJoint.mjJNT_HINGE, bool(model.jnt_limited[joint])
    if hinge and not limited:
        return "continuous", axis
    # Shift the limits to URDF's zero.
    low, high = model.jnt_range[joint] - model.qpos0[model.jnt_qposadr[joint]]
    if not limited:
        # URDF has no slide without limits: use the size of the ground.
        low, high = -GROUND[0], GROUND[0]
    bounds = {"lower": _number(low), "upper": _number(high), "effort": EFFORT, "velocity": SPEED}
    return "revolute" if hinge else "prismatic", {**axis, "limit": bounds}


def add_joint(root: Element, name: str, kind: str, links: tuple[str, str], pose: Pose) -> Element:
    joint = etree.SubElement(root, "joint", {"name": name, "type": kind})
    for tag, link in zip(("parent", "child"), links, strict=True):
        etree.SubElement(joint, tag, {"link": link})
    add_origin(joint, pose)
    return joint


def add_origin(element: Element, pose: Pose) -> None:
    origin = {"xyz": _numbers(pose.position), "rpy": _numbers(roll_pitch_yaw(pose.rotation))}
    etree.SubElement(element, "origin", origin)


def roll_pitch_yaw(rotation: Array) -> Array:
    """Angles (3,) rad about the fixed x, then y, then z axis. At ±90 degrees of pitch, roll is
    0."""
    # Pitch from the first column of R = Rz Ry Rx.
    level = float(np.hypot(rotation[0, 0], rotation[1, 0]))
    pitch = np.arctan2(-rotation[2, 0], level)
    # Gimbal lock: only the sum of roll and yaw is determined.
    if level < 1e-9:
        return np.array([0.0, pitch, np.arctan2(-rotation[0, 1], rotation[1, 1])])
    roll = np.arctan2(rotation[2, 1], rotation[2, 2])
    return np.array([roll, pitch, np.arctan2(rotation[1, 0], rotation[0, 0])])


def mesh_file(mesh: int) -> str:
    return f"{MESHES}/mesh_{mesh}.obj"


def _numbers(values: Iterable[float]) -> str:
    return " ".join(_number(value) for value in values)


def _number(value: float) -> str:
    """Format with nine digits, without a negative zero."""
    return f"{float(value) + 0.0:.9g}"
