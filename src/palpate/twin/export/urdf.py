"""URDF of a compiled model: links, joints and their shapes.

Written here: the converters that there are leave out primitives and collisions, and give every joint
a mass. URDF has neither friction nor contact parameters, no planes, capsules or ball joints.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import mujoco
import numpy as np
from lxml import etree

from palpate.geometry.pose import Array, Pose
from palpate.mjcf.document import Element
from palpate.mjcf.shapes import mesh_corners
from palpate.twin.export.facts import GROUND, Facts, Shape, facts_of, touches, unnamed
from palpate.twin.export.stl import write_stl

MESHES = "meshes"
SHOWN = 2
"""Groups of geoms up to this one are shown, as in MuJoCo's viewer."""
NOT_SIMPLE = (
    mujoco.mjtGeom.mjGEOM_MESH,
    mujoco.mjtGeom.mjGEOM_SDF,
    mujoco.mjtGeom.mjGEOM_ELLIPSOID,
    mujoco.mjtGeom.mjGEOM_HFIELD,
)
"""URDF has them in files, or not at all."""
EFFORT, SPEED = "1e6", "1e3"
"""N or N m, m/s or rad/s: MJCF bounds neither, and URDF has to have a number."""

Inset = tuple[Pose, str, dict[str, str]]
"""A part of a geom: its pose in the link, and an element of `<geometry>`."""


@dataclass(slots=True)
class Written:
    """Written URDF.

    Attributes:
        parts: by link, into how many shapes each geom that collides was made.
        notes: what URDF cannot hold as it was.
    """

    parts: dict[str, list[int]] = field(default_factory=dict[str, list[int]])
    notes: list[str] = field(default_factory=list[str])


def write_urdf(model: mujoco.MjModel, path: Path) -> Written:
    """Write a model, all of whose bodies, geoms and joints have names, and its meshes beside it."""
    root = etree.Element("robot", {"name": path.stem})
    written = Written()
    for body in range(model.nbody):
        _add_link(root, model, body, written)
    for body in range(1, model.nbody):
        _add_joints(root, model, body, written)
    _write_meshes(model, path.parent)
    etree.indent(root)
    path.write_bytes(etree.tostring(root, encoding="utf-8", xml_declaration=True))
    return written


def urdf_to_look_at(model: mujoco.MjModel) -> str:
    """A model's links, their joints and what is seen of them, in one text: what URDF has no shape for,
    or only in another file, is the box around it."""
    root = etree.Element("robot", {"name": "cell"})
    for body in range(model.nbody):
        link = etree.SubElement(root, "link", {"name": body_name(model, body)})
        for geom in _geoms(model, body):
            if model.geom_group[geom] <= SHOWN:
                _add_visuals(link, model, geom, list(_simple_insets(model, geom)))
    for body in range(1, model.nbody):
        _add_joints(root, model, body, Written())
    return etree.tostring(root, encoding="unicode")


def body_name(model: mujoco.MjModel, body: int) -> str:
    """Name of a body, its link and its frame."""
    return model.body(body).name or unnamed(body)


def _geoms(model: mujoco.MjModel, body: int) -> range:
    first = int(model.body_geomadr[body])
    return range(first, first + int(model.body_geomnum[body]))


def _simple_insets(model: mujoco.MjModel, geom: int) -> Iterator[Inset]:
    """A geom in shapes that need no file."""
    if mujoco.mjtGeom(model.geom_type[geom]) not in NOT_SIMPLE:
        yield from _insets(model, geom)
        return
    centre, half = np.split(model.geom_aabb[geom], 2)
    pose = Pose.of(model.geom_pos[geom], model.geom_quat[geom]) @ Pose.of(centre)
    yield pose, "box", {"size": _numbers(2 * half)}


def read_urdf(path: Path, written: Written) -> dict[str, Facts]:
    """Read the file back by MuJoCo; the parts of a geom are joined again.

    Raises:
        ValueError: MuJoCo does not accept it.
    """
    spec = mujoco.MjSpec.from_file(str(path))
    spec.compiler.fusestatic = False
    spec.compiler.discardvisual = True
    spec.compiler.boundmass = spec.compiler.boundinertia = 1e-12  # links between two joints
    found = facts_of(spec.compile())
    for name, facts in found.items():
        shapes = tuple(_united(facts.shapes, written.parts.get(name, [])))
        found[name] = Facts(facts.pose, facts.mass, facts.com, facts.inertia, shapes)
    return found


def _united(shapes: Iterable[Shape], parts: Iterable[int]) -> Iterator[Shape]:
    left = iter(shapes)
    for number in parts:
        boxes = np.array([next(left).box for _ in range(number)])
        yield Shape(np.array([boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)]), None)
    yield from left


def _add_link(root: Element, model: mujoco.MjModel, body: int, written: Written) -> None:
    name = body_name(model, body)
    link = etree.SubElement(root, "link", {"name": name})
    if model.body_mass[body] > 0.0:
        _add_inertial(link, model, body)
    for geom in _geoms(model, body):
        insets = list(_insets(model, geom))
        if model.geom_group[geom] <= SHOWN:
            _add_visuals(link, model, geom, insets)
        if touches(model, geom):
            for inset in insets:
                _add_shape(link, "collision", inset)
            written.parts.setdefault(name, []).append(len(insets))
        if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_PLANE:
            plane = model.geom(geom).name
            written.notes.append(
                f"the plane '{plane}' is the top of a box, {2 * GROUND[0]:g} m wide"
            )


def _add_inertial(link: Element, model: mujoco.MjModel, body: int) -> None:
    inertial = etree.SubElement(link, "inertial")
    _add_origin(inertial, Pose.of(model.body_ipos[body]))
    etree.SubElement(inertial, "mass", {"value": _number(model.body_mass[body])})
    turned = Pose.of(np.zeros(3), model.body_iquat[body]).rotation
    tensor = turned @ np.diag(model.body_inertia[body]) @ turned.T
    entries: dict[str, str] = {}
    for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)):
        entries[f"i{'xyz'[i]}{'xyz'[j]}"] = _number(tensor[i, j])
    etree.SubElement(inertial, "inertia", entries)


def _insets(model: mujoco.MjModel, geom: int) -> Iterator[Inset]:
    """A geom in URDF's shapes, in its link's frame."""
    kind, size = mujoco.mjtGeom(model.geom_type[geom]), model.geom_size[geom].tolist()
    pose = Pose.of(model.geom_pos[geom], model.geom_quat[geom])
    ball = {"radius": _number(size[0])}
    if kind in (mujoco.mjtGeom.mjGEOM_MESH, mujoco.mjtGeom.mjGEOM_SDF):
        yield pose, "mesh", {"filename": _mesh_file(int(model.geom_dataid[geom]))}
    elif kind == mujoco.mjtGeom.mjGEOM_PLANE:
        below = Pose.of([0.0, 0.0, -GROUND[2]])
        yield pose @ below, "box", {"size": _numbers(2 * GROUND)}
    elif kind == mujoco.mjtGeom.mjGEOM_BOX:
        yield pose, "box", {"size": _numbers(2 * np.array(size))}
    elif kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        yield pose, "sphere", ball
    else:
        yield pose, "cylinder", {**ball, "length": _number(2 * size[1])}
        if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
            for end in (-size[1], size[1]):
                yield pose @ Pose.of([0.0, 0.0, end]), "sphere", ball


def _add_visuals(link: Element, model: mujoco.MjModel, geom: int, insets: Iterable[Inset]) -> None:
    for inset in insets:
        visual = _add_shape(link, "visual", inset)
        _add_colour(visual, model, geom)


def _add_shape(link: Element, tag: str, inset: Inset) -> Element:
    pose, kind, attributes = inset
    shape = etree.SubElement(link, tag)
    _add_origin(shape, pose)
    etree.SubElement(etree.SubElement(shape, "geometry"), kind, attributes)
    return shape


def _add_colour(visual: Element, model: mujoco.MjModel, geom: int) -> None:
    material = int(model.geom_matid[geom])
    rgba = model.geom_rgba[geom] if material < 0 else model.mat_rgba[material]
    named = etree.SubElement(visual, "material", {"name": f"{_geom_name(model, geom)}_colour"})
    etree.SubElement(named, "color", {"rgba": _numbers(rgba)})


def _geom_name(model: mujoco.MjModel, geom: int) -> str:
    return model.geom(geom).name or f"geom_{geom}"


def _joint_name(model: mujoco.MjModel, joint: int) -> str:
    return model.joint(joint).name or f"joint_{joint}"


def _add_joints(root: Element, model: mujoco.MjModel, body: int, written: Written) -> None:
    """The way from a body's parent to it. A link's frame is its joint's: where a joint is elsewhere,
    or is one of several, there is a link in between."""
    name, parent = body_name(model, body), body_name(model, int(model.body_parentid[body]))
    way = Pose.of(model.body_pos[body], model.body_quat[body])
    first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
    for joint in range(first, first + count):
        kind, attributes = _kind(model, joint, written)
        at = Pose.of(model.jnt_pos[joint])
        is_last = joint == first + count - 1 and not model.jnt_pos[joint].any()
        child = name if is_last else f"{_joint_name(model, joint)}_link"
        if not is_last:
            etree.SubElement(root, "link", {"name": child})
        element = _add_joint(root, _joint_name(model, joint), kind, (parent, child), way @ at)
        for tag, values in attributes.items():
            etree.SubElement(element, tag, values)
        parent, way = child, at.inverse()
    if parent != name:
        _add_joint(root, f"{name}_mount", "fixed", (parent, name), way)


def _kind(
    model: mujoco.MjModel, joint: int, written: Written
) -> tuple[str, dict[str, dict[str, str]]]:
    """A joint's type, and its axis and limits. URDF's zero is where MuJoCo's model starts."""
    kind = mujoco.mjtJoint(model.jnt_type[joint])
    if kind == mujoco.mjtJoint.mjJNT_FREE:
        return "floating", {}
    if kind == mujoco.mjtJoint.mjJNT_BALL:
        written.notes.append(f"the ball joint '{model.joint(joint).name}' is fixed")
        return "fixed", {}
    axis = {"axis": {"xyz": _numbers(model.jnt_axis[joint])}}
    if not model.jnt_limited[joint] and kind == mujoco.mjtJoint.mjJNT_HINGE:
        return "continuous", axis
    low, high = model.jnt_range[joint] - model.qpos0[model.jnt_qposadr[joint]]
    if not model.jnt_limited[joint]:
        low, high = -GROUND[0], GROUND[0]
    bounds = {"lower": _number(low), "upper": _number(high), "effort": EFFORT, "velocity": SPEED}
    turning = kind == mujoco.mjtJoint.mjJNT_HINGE
    return "revolute" if turning else "prismatic", {**axis, "limit": bounds}


def _add_joint(root: Element, name: str, kind: str, links: tuple[str, str], way: Pose) -> Element:
    joint = etree.SubElement(root, "joint", {"name": name, "type": kind})
    for tag, link in zip(("parent", "child"), links, strict=True):
        etree.SubElement(joint, tag, {"link": link})
    _add_origin(joint, way)
    return joint


def _add_origin(element: Element, pose: Pose) -> None:
    origin = {"xyz": _numbers(pose.position), "rpy": _numbers(_roll_pitch_yaw(pose.rotation))}
    etree.SubElement(element, "origin", origin)


def _roll_pitch_yaw(turned: Array) -> Array:
    """(3,) rad about the fixed x, then y, then z. At ±90 degrees of pitch, roll is 0."""
    level = float(np.hypot(turned[0, 0], turned[1, 0]))
    pitch = np.arctan2(-turned[2, 0], level)
    if level < 1e-9:
        return np.array([0.0, pitch, np.arctan2(-turned[0, 1], turned[1, 1])])
    roll = np.arctan2(turned[2, 1], turned[2, 2])
    return np.array([roll, pitch, np.arctan2(turned[1, 0], turned[0, 0])])


def _mesh_file(mesh: int) -> str:
    return f"{MESHES}/mesh_{mesh}.stl"


def _write_meshes(model: mujoco.MjModel, folder: Path) -> None:
    """Write the meshes of MuJoCo's geoms, in their frames."""
    if model.nmesh:
        (folder / MESHES).mkdir()
    for mesh in range(model.nmesh):
        write_stl(folder / _mesh_file(mesh), mesh_corners(model, mesh))


def _numbers(values: Iterable[float]) -> str:
    return " ".join(_number(value) for value in values)


def _number(value: float) -> str:
    """Nine digits, without a negative zero."""
    return f"{float(value) + 0.0:.9g}"
