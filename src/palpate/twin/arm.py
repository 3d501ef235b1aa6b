"""An arm's own MJCF with its identified dynamics: joint friction, damping, armature, inertias."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from palpate.common.errors import InputError
from palpate.common.pose import Array, components
from palpate.estimation.arm_dynamics import DynamicsFit, JointFigure
from palpate.estimation.arm_fit import Bodies
from palpate.estimation.quantities.friction import SIGNIFICANT
from palpate.estimation.rigid_bodies import inertia_about_centre, parameters
from palpate.mjcf.document import Document, Element, elements
from palpate.mjcf.edits import Change, Edit, Insert, number
from palpate.mjcf.elements import inertial_of
from palpate.mjcf.reading import read_document
from palpate.robots.description import compile_mjcf, triple
from palpate.trace.recording import ChainLink
from palpate.twin.files import write_files
from palpate.twin.text import rewrite

# Attributes of a joint, by figure. A figure that is not significantly above 0 keeps the value in
# the file: sensors behind the gears do not show the inertia of the motors.
WRITTEN = {"frictionloss": "coulomb", "damping": "viscous", "armature": "armature"}
# Attributes of an `<inertial>` that `fullinertia` replaces.
ORIENTATIONS = ("diaginertia", "quat", "axisangle", "xyaxes", "zaxis", "euler")


def save_arm(fit: DynamicsFit, path: Path) -> tuple[Path, ...]:
    """Write the arm's MJCF with the identified dynamics to `path`, with the files that it needs
    there.

    Returns:
        Every file written, `path` first.

    Raises:
        InputError: `path` exists, or cannot be written, or a joint or link is in an attached model;
            or the dynamics are contradicted, or the arm's file lacks a sensor that its
            description mounts.
    """
    if fit.contradictions:
        raise InputError(f"{path} is not written: {fit.contradictions[0]}")
    sensor = fit.arm.wrench_sensor
    if sensor is not None and (sensor.mass or sensor.height):
        raise InputError(
            f"{path} is not written: '{fit.arm.name}' mounts a sensor that {fit.arm.mjcf.name} does "
            "not have; put it into the MJCF, and state 'mass: 0' and 'height: 0' in wrench_sensor"
        )
    # Edit joints and links in the arm's own text.
    document = read_document(fit.arm.mjcf)
    texts = rewrite(document, [*_joints(fit, document), *_links(fit, document)])
    return write_files(texts, document, path)


def _find_element(document: Document, tag: str, name: str) -> Element:
    """Find the joint or body with a name."""
    for element in elements(document.root):
        if element.tag == tag and element.get("name") == name:
            return element
    raise InputError(f"'{name}' is in a model that the arm's MJCF attaches: give a file of its own")


def _joints(fit: DynamicsFit, document: Document) -> Iterator[Change]:
    for i, name in enumerate(fit.arm.joints):
        joint = _find_element(document, "joint", name)
        for attribute, figure in WRITTEN.items():
            each: JointFigure = getattr(fit, figure)
            value, std = float(each.value[i]), float(each.std[i])
            if each.observed[i] and value > SIGNIFICANT * std:
                yield Edit(joint, attribute, {0: number(value, std)})


def _links(fit: DynamicsFit, document: Document) -> Iterator[Change]:
    """Yield the changes of the links' inertias, and of the hand's if it was identified."""
    # Poses of all bodies at joint angles 0.
    arm, model = fit.arm, compile_mjcf(fit.arm.mjcf)
    data: Any = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    chain, known = arm.nominal.chain, arm.sensors
    assert chain is not None
    # Change of each link's parameters: identified less described.
    bodies = Bodies.of(chain, known.link_mass, known.link_com, arm.limits.payload)
    changed = [
        (int(model.jnt_bodyid[model.joint(name).id]), joint, fit.parameters[joint] - described)
        for joint, (name, described) in enumerate(zip(arm.joints, bodies.links, strict=True))
    ]
    if fit.hand is not None and fit.hand.centre is not None:
        hand = int(model.body(arm.hand.body).id)
        changed.append((hand, len(bodies.links) - 1, fit.hand.parameters - bodies.hand))
    for body, joint, change in changed:
        yield from _inertial(document, data, body, change, bodies.anchors[joint])


def _link(data: Any, body: int) -> ChainLink:
    """Describe a body as in the file, at joint angles 0."""
    # Inertia in world axes: R diag(I) R^T.
    axes = np.asarray(data.ximat[body]).reshape(3, 3)
    tensor = (axes * data.model.body_inertia[body]) @ axes.T
    xx, yy, zz, xy, xz, yz = components(tensor)
    mass = float(data.model.body_mass[body])
    return ChainLink(0, mass, triple(data.xipos[body]), (xx, yy, zz, xy, xz, yz))


def _inertial(
    document: Document, data: Any, body: int, change: Array, anchor: Array
) -> Iterator[Change]:
    """Yield the changes that add parameters (10,), about an anchor (3,), to those of a body."""
    # Add the change to mass, first moments and inertia about the anchor; skip a mass of zero or
    # less.
    old = parameters([_link(data, body)], anchor)
    new = old + change
    if new[0] <= 0.0:
        return
    tensor = inertia_about_centre(new)
    if not physical(tensor):  # of less than the recording shows: the described one stays
        tensor = inertia_about_centre(old) * new[0] / old[0]
    # Convert centre and tensor to the frame of the body.
    frame = np.asarray(data.xmat[body]).reshape(3, 3)
    centre = frame.T @ (anchor + new[1:4] / new[0] - data.xpos[body])
    texts = {
        "pos": [number(part, 1e-5) for part in centre.tolist()],
        "mass": [number(float(new[0]), 1e-4)],
        "fullinertia": [number(part) for part in components(frame.T @ tensor @ frame)],
    }
    # Replace the `<inertial>`, or insert one.
    element = _find_element(document, "body", data.model.body(body).name)
    inertial = inertial_of(element)
    if inertial is None:
        yield Insert(element, "inertial", {key: " ".join(text) for key, text in texts.items()})
        return
    for attribute, text in texts.items():
        base = " ".join("?" * len(text))
        yield Edit(inertial, attribute, dict(enumerate(text)), base)
    for attribute in ORIENTATIONS:
        if inertial.get(attribute) is not None:
            yield Edit(inertial, attribute, None)


def physical(tensor: Array) -> bool:
    """True if a rigid body can have an inertia (3, 3): positive moments, none above the sum of the others."""
    # Triangle inequality of the principal moments.
    moments = np.linalg.eigvalsh(tensor)
    return bool(moments[0] > 0.0 and moments[2] <= moments[0] + moments[1])
