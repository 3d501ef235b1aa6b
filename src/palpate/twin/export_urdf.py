"""URDF of a compiled model: links, joints and their shapes.

Existing converters leave out primitives and collisions, and give every joint a mass. URDF has
neither friction nor contact parameters, and no planes, capsules or ball joints.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path

import mujoco
import numpy as np
from lxml import etree

from palpate.common.pose import Array, Pose
from palpate.mjcf.document import Element
from palpate.mjcf.shapes import mesh_corners
from palpate.twin.export_facts import (
    GROUND,
    Facts,
    body_name,
    collides,
    facts_of,
    geoms_of,
    tensor,
    write_stl,
)

MESHES = "meshes"
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
class Written:
    """Result of writing a URDF.

    Attributes:
        parts: by link, the count of shapes for each geom that collides.
        notes: contents that URDF cannot state.
    """

    parts: dict[str, list[int]] = field(default_factory=dict[str, list[int]])
    notes: list[str] = field(default_factory=list[str])


def write_urdf(model: mujoco.MjModel, path: Path) -> Written:
    """Write a model, and its meshes in a folder next to it. All bodies, geoms and joints must have
    names.
    """
    root = etree.Element("robot", {"name": path.stem})
    written = Written()
    # Links first, then the joints between them, then the files of the meshes.
    for body in range(model.nbody):
        add_link(root, model, body, written)
    for body in range(1, model.nbody):
        add_joints(root, model, body, written)
    if model.nmesh:
        (path.parent / MESHES).mkdir()
    for mesh in range(model.nmesh):
        write_stl(path.parent / mesh_file(mesh), mesh_corners(model, mesh))
    etree.indent(root)
    path.write_bytes(etree.tostring(root, encoding="utf-8", xml_declaration=True))
    return written


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
    for body in range(1, model.nbody):
        add_joints(root, model, body, Written())
    return etree.tostring(root, encoding="unicode")


def read_urdf(path: Path, written: Written) -> dict[str, Facts]:
    """Read the file back by MuJoCo, and join the parts of each geom again.

    Raises:
        ValueError: MuJoCo does not accept it.
    """
    spec = mujoco.MjSpec.from_file(str(path))
    spec.compiler.fusestatic = False
    spec.compiler.discardvisual = True
    spec.compiler.boundmass = spec.compiler.boundinertia = 1e-12  # links between two joints
    found = facts_of(spec.compile())
    # Several shapes of one geom become the box around all of them.
    for name, facts in found.items():
        joined: list[Array] = []
        first = 0
        for number in written.parts.get(name, []):
            parts = facts.shape[first : first + number]
            joined.append(np.array([parts[:, 0].min(axis=0), parts[:, 1].max(axis=0)]))
            first += number
        shape = np.array([*joined, *facts.shape[first:]]).reshape(-1, 2, 3)
        found[name] = replace(facts, shape=shape)
    return found


def add_link(root: Element, model: mujoco.MjModel, body: int, written: Written) -> None:
    name = body_name(model, body)
    link = etree.SubElement(root, "link", {"name": name})
    # Inertia of the link: principal axes rotated into its frame.
    if model.body_mass[body] > 0.0:
        inertial = etree.SubElement(link, "inertial")
        add_origin(inertial, Pose.of(model.body_ipos[body]))
        etree.SubElement(inertial, "mass", {"value": _number(model.body_mass[body])})
        # Six entries of the symmetric tensor, in the link's axes.
        inertia = tensor(model.body_inertia[body], model.body_iquat[body])
        entries: dict[str, str] = {}
        for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)):
            entries[f"i{'xyz'[i]}{'xyz'[j]}"] = _number(inertia[i, j])
        etree.SubElement(inertial, "inertia", entries)
    for geom in geoms_of(model, body):
        # Visible and colliding shapes are separate elements.
        insets = list(insets_of(model, geom))
        if model.geom_group[geom] <= SHOWN:
            add_visuals(link, model, geom, insets)
        if collides(model, geom):
            for inset in insets:
                add_shape(link, "collision", inset)
            written.parts.setdefault(name, []).append(len(insets))
        if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_PLANE:
            plane = model.geom(geom).name
            written.notes.append(
                f"the plane '{plane}' is the top of a box, {2 * GROUND[0]:g} m wide"
            )


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


def add_joints(root: Element, model: mujoco.MjModel, body: int, written: Written) -> None:
    """Add the joints from a body's parent to it.

    A link's frame is its joint's. If a joint is away from the body's origin, or is one of several,
    a link is inserted.
    """
    name, parent = body_name(model, body), body_name(model, int(model.body_parentid[body]))
    # Chain the joints: each link's frame is at its joint.
    way = Pose.of(model.body_pos[body], model.body_quat[body])
    first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
    for joint in range(first, first + count):
        kind, attributes = joint_type(model, joint, written)
        at = Pose.of(model.jnt_pos[joint])
        is_last = joint == first + count - 1 and not model.jnt_pos[joint].any()
        joint_name = model.joint(joint).name or f"joint_{joint}"
        child = name if is_last else f"{joint_name}_link"
        if not is_last:
            etree.SubElement(root, "link", {"name": child})
        element = add_joint(root, joint_name, kind, (parent, child), way @ at)
        for tag, values in attributes.items():
            etree.SubElement(element, tag, values)
        parent, way = child, at.inverse()
    # A body without a joint at its origin is fixed to the last link.
    if parent != name:
        add_joint(root, f"{name}_mount", "fixed", (parent, name), way)


def joint_type(
    model: mujoco.MjModel, joint: int, written: Written
) -> tuple[str, dict[str, dict[str, str]]]:
    """Type, axis and limits of a joint. URDF's zero is MuJoCo's initial configuration."""
    # Free joints float; URDF has no ball joints.
    kind = mujoco.mjtJoint(model.jnt_type[joint])
    if kind == mujoco.mjtJoint.mjJNT_FREE:
        return "floating", {}
    if kind == mujoco.mjtJoint.mjJNT_BALL:
        written.notes.append(f"the ball joint '{model.joint(joint).name}' is fixed")
        return "fixed", {}
    axis = {"axis": {"xyz": _numbers(model.jnt_axis[joint])}}
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


def add_joint(root: Element, name: str, kind: str, links: tuple[str, str], way: Pose) -> Element:
    joint = etree.SubElement(root, "joint", {"name": name, "type": kind})
    for tag, link in zip(("parent", "child"), links, strict=True):
        etree.SubElement(joint, tag, {"link": link})
    add_origin(joint, way)
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
    return f"{MESHES}/mesh_{mesh}.stl"


def _numbers(values: Iterable[float]) -> str:
    return " ".join(_number(value) for value in values)


def _number(value: float) -> str:
    """Format with nine digits, without a negative zero."""
    return f"{float(value) + 0.0:.9g}"
