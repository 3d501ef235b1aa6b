"""Graspable objects: width, mass and moment."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from palpate.common.errors import InputError
from palpate.common.pose import Array, Pose
from palpate.mjcf.body import Body
from palpate.primitives.rules.collision import finger_collisions
from palpate.primitives.rules.solids import LEFT, solids
from palpate.primitives.state import SymbolicState, Violation
from palpate.scene.scene import Scene

# m, largest offset of an object from the middle of the fingers. Beyond it, one finger pushes the
# object before both touch it, and a tall object tips.
PUSHED = 0.010
# Mean lever of an evenly pressed square pad over its side: ∫∫ sqrt(x² + y²) dx dy over the unit
# square about its centre. Friction times force times this lever resists turning.
TORSION = 0.38
SURELY_HELD = (
    0.5  # Largest fraction of the pads' friction that a weight may use: it may be half as rough
)


def ungraspable(state: SymbolicState, body: Body) -> list[Violation]:
    """Violations of closing the fingers on an object at the hand's pose.

    The object does not fit, is known to be too heavy, would twist, or the fingers would collide.
    """
    # The grasp needs an object between the pads at the hand's pose.
    pose = state.pose_world_tcp
    held = None if pose is None else state.grip_of(body, pose)
    if pose is None or held is None:
        return []
    found: list[Violation] = []
    # By width, by mass, and by the offset from the middle of the fingers.
    left_out = f"remove measurements that grasp '{body.name}', and explain"
    if unfit := does_not_fit(state.scene, body.name):
        found.append(Violation("too-wide", f"{unfit}; {left_out}"))
    if heavy := too_heavy(state.scene, body):
        found.append(Violation("payload", f"{heavy}; {left_out}"))
    if abs(held.aside) > PUSHED:
        problem = (
            f"'{body.name}' is {1e3 * abs(held.aside):.0f} mm off the middle of the fingers, which would "
            f"push it; MovePose to '{body.name}_pose' first"
        )
        found.append(Violation("gripper-state", problem))
    found += [*_sliding(state, body), *_twisting(state, body, pose)]
    return [*found, *finger_collisions(state, held.width, body.name)]


def _sliding(state: SymbolicState, body: Body) -> Iterator[Violation]:
    """Violation of a grasp whose friction, at a fraction `SURELY_HELD`, does not hold the believed weight."""
    scene, shapes = state.scene, solids(state.scene)
    weight, friction = shapes.mass(body.name) * scene.gravity, grip_friction(scene, body.name)
    held = friction * scene.arm.hand.force
    if weight > SURELY_HELD * held:
        yield Violation(
            "twist",
            f"'{body.name}' may slide out of the pads: its friction of {friction:g} holds {held:.1f} N at "
            f"most, and its weight of {weight:.1f} N is more than {100 * SURELY_HELD:.0f} % of that; do not lift "
            "it, or state its friction on the pads",
        )


def _twisting(state: SymbolicState, body: Body, pose_world_tcp: Pose) -> list[Violation]:
    """Violation of a grasp in which the believed weight of the object would turn it about the pads."""
    scene, shapes = state.scene, solids(state.scene)
    # Lever of the weight: distance of the centre of mass from the pads along the tool's x.
    centre = state.pose_of(body.name).apply(shapes.centre_of_mass(body.name))
    beside = float((centre - pose_world_tcp.position) @ pose_world_tcp.rotation[:, 0])
    weight = shapes.mass(body.name) * scene.gravity
    moment, most = weight * abs(beside), torsion(scene, body.name)
    if moment <= most:
        return []
    problem = (
        f"held {1e3 * abs(beside):.0f} mm from its centre of mass, '{body.name}' would turn in "
        f"the grip with {moment:.1f} N m, of at most {most:.1f} N m; grasp it within "
        f"{1e3 * most / weight:.0f} mm{_nearer(state, beside)}"
    )
    return [Violation("twist", problem)]


def _nearer(state: SymbolicState, beside: float) -> str:
    """Return the remedy: a grasp above the centre of mass, which is `beside` m off along the tool's x."""
    symbols = state.scene.symbols
    try:
        here = symbols.parse(state.at or "")
        # Number of x offsets that brings the tool over the centre of mass.
        step = float(symbols.offset("x_offset", here.name)[0])
    except InputError:
        return ""
    if not step:
        return ""
    nearer = here.shift("x_offset", round(beside / step, 1))
    return f"; MovePose to '{nearer}' first"


def most_sideways(state: SymbolicState, way: Array) -> float:
    """Largest horizontal force, N, at the bottom of the held object that does not turn it in the pads.

    `way` is the direction (3,) in the world. A force along the line between the pads has no lever.
    """
    scene, pose = state.scene, state.pose_world_tcp
    if pose is None or state.holding is None:
        return np.inf
    bottom = scene.body(state.holding).bottom_z(state.pose_of(state.holding))
    # Component of the force across the line between the pads, and its lever below them.
    across = abs(float(way @ pose.rotation[:, 0])) / max(float(np.linalg.norm(way)), 1e-9)
    lever = max(float(pose.position[2]) - bottom, 0.0) * across
    return torsion(scene, state.holding) / max(lever, 1e-9)


def grip_friction(scene: Scene, name: str) -> float:
    """Sliding friction between the pads and an object."""
    shapes = solids(scene)
    return shapes.friction(shapes.pads[LEFT].geoms[:1], shapes.objects[name].geoms)


def torsion(scene: Scene, name: str) -> float:
    """Largest moment, N m, with which the two pads resist turning of an object about the line between them.

    μ F times the mean lever `TORSION` times the side of a pad.
    """
    shapes = solids(scene)
    size = shapes.model.geom_size[shapes.pads[LEFT].geoms[0]]
    # Side of a square of the pad's area, from the half extents of its box.
    side = 2 * float(np.sqrt(size[0] * size[2]))
    return grip_friction(scene, name) * scene.arm.hand.force * TORSION * side


def does_not_fit(scene: Scene, name: str) -> str:
    """Reason why the hand cannot take the object; empty if it can."""
    # The named grasps state why an object has none.
    reason = scene.symbols.ungraspable.get(name)
    return f"'{name}' cannot be grasped: {reason}" if reason else ""


def too_heavy(scene: Scene, body: Body) -> str:
    """Message for a known mass beyond the payload; empty below it."""
    mass, payload = body.known.get("mass", (0.0,))[0], scene.arm.limits.payload
    if mass <= payload:
        return ""
    return f"'{body.name}' weighs {mass:g} kg, more than the payload of {payload:g} kg"
