"""Calibration procedures: weigh the arm itself, weigh a known mass, touch known heights."""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from palpate.common.errors import InputError, unknown_name
from palpate.common.parameter import Parameter
from palpate.planning.plan import Node, Plan
from palpate.planning.symbolic.planner import assemble
from palpate.robots.robot_config import Lean, Repeated, SensorGains, Value
from palpate.runs.calibration import gains
from palpate.runs.calibration.gains import CONFIGURATIONS, GainBelief, NamedSize, StatedSize
from palpate.runs.calibration.session import BLOCK, GAUGE_NAMES, PLACES, CalibrationSession, truth
from palpate.runs.calibration.tips import fit_tips, require_places
from palpate.scene.scene import Scene

# m/s: speed at which a weight is lifted and lowered. It is slow enough to average white noise, and
# fast enough to avoid drift.
SPEED = 0.05
# Decimals of a relative variance. They give three digits of a gain that is known to 0.001 %.
DIGITS = 13
# Touches of each gauge. Two separate the scatter between places from that between touches.
ROUNDS = 2
SAME = 1e-6  # Relative tolerance between the size in a scene and the stated one


def weigh_itself(session: CalibrationSession) -> None:
    """Calibrate the gains by the arm's own weight. Joints with vertical axes stay uncalibrated."""
    session.callbacks.progress(f"weighing the arm itself in {CONFIGURATIONS} configurations")
    own = scene_of_settings(session)
    scene = own or session.empty_bench()
    plan = calibration_plan((), gains.own_weight_tree(session.arm))
    trace = session.perform(scene, plan, scene if own is None else None)
    by = f"its own weight in {CONFIGURATIONS} configurations"
    correct_gains(session, gains.gains_from_own_weight(trace, session.arm), by)


def weigh(session: CalibrationSession, known: NamedSize) -> None:
    """Calibrate the gains of the joints that carry a known weight.

    On the bench the weight is measured at several places, in the user's scene at its own place.
    """
    own, size = scene_of_settings(session), known.size
    if own is not None:
        masses = {n: b.known["mass"][0] for n, b in own.objects.items() if "mass" in b.known}
        name = reference(masses, known, "mass", "kg", "object")
        weigh_once(session, own, None, name, size)
        return
    # On the bench: the scene states the nominal mass, the world has the true one.
    true = truth(size, session.settings.seed, "weight")
    for i, x in enumerate(PLACES, 1):
        session.callbacks.progress(f"weighing {size.text}, place {i} of {len(PLACES)}")
        scene, world = session.bench_with_weight(size.value, x), session.bench_with_weight(true, x)
        weigh_once(session, scene, world, BLOCK, size)


def weigh_once(
    session: CalibrationSession, scene: Scene, world: Scene | None, name: str, known: StatedSize
) -> None:
    """Weigh the object `name` of a known mass, and correct the gains."""
    # Plan the weighing as in any run.
    mass = Parameter(name, "mass")
    tree = measuring_tree(scene, (mass,))
    # Slow down the ways from and to the grasp; the first way only leads there from home.
    ways = [
        motion
        for _, motion in tree.walk()
        if motion.type == "MovePose" and str(dict(motion.args)["pose"]).startswith(f"{name}_pose")
    ]
    plan = calibration_plan((mass,), slow_motions(tree, ways[1:]))
    trace = session.perform(scene, plan, world)
    correct_gains(
        session, gains.gains_from_weighing(trace, mass, known), f"a weight of {known.text}"
    )


def gauge(session: CalibrationSession, known: NamedSize) -> None:
    """Calibrate tip length, tip compliance and base tilt by touches of known heights."""
    own, size = scene_of_settings(session), known.size
    if own is None:
        session.callbacks.progress(f"touching gauges of {size.text}")
        true = truth(size, session.settings.seed, "gauge")
        scene, world = session.bench_with_gauges(size.value), session.bench_with_gauges(true)
        names = GAUGE_NAMES
    else:
        scene, world, names = own, None, gauges_of(own, known)
    require_places(len(names))
    heights = tuple(Parameter(name, "height") for name in names)
    # Without the conversions to heights: a touch without contact is no reason to stop. All touches
    # are judged together.
    once = drop_leaves(measuring_tree(scene, heights), "Pose2Height")
    plan = calibration_plan((), Node("Sequence", children=(once,) * ROUNDS))
    trace = session.perform(scene, plan, world)
    # Fit the touches in the frame of the base, as calibrated so far.
    arm = session.arm
    base = arm.stands(scene.pose_world_base)
    tips = fit_tips(trace, heights, size, base, arm.reach.stretched)
    by, date = f"{tips.touches} touches of gauges of {size.text}", datetime.date.today()
    # Compose the tilt with the one already corrected.
    before = session.config.base_lean
    lean = tips.lean + (np.zeros(2) if before is None else before.value)
    offset, compliance = (tips.offset, tips.offset_std), (tips.compliance, tips.compliance_std)
    # Correct the next visits by all figures of this one.
    figures = {
        "tip_offset": Value(value=offset[0], std=offset[1], date=date, by=by),
        "base_lean": Lean(value=lean, std=tips.lean_std, date=date, by=by),
        "pose_repeatability": Repeated(value=tips.repeatability, date=date, by=by),
        "tip_compliance": Value(value=compliance[0], std=compliance[1], date=date, by=by),
    }
    session.config = session.config.model_copy(update=figures)


def correct_gains(session: CalibrationSession, belief: GainBelief, by: str) -> None:
    """Compose the gains for the next visits with `belief`. `by` names the procedure."""
    before = session.config.torque_gain
    # Compose with the gains that corrected these readings.
    whole = belief.after(np.zeros(len(session.arm.joints)) if before is None else before.value)
    ways = [] if before is None or before.by is None else before.by.split("; ")
    # Remove asymmetry by rounding errors, and digits without meaning.
    covariance = ((whole.covariance + whole.covariance.T) / 2).round(DIGITS)
    figure = SensorGains(
        date=datetime.date.today(),
        by="; ".join(dict.fromkeys([*ways, by])),
        value=whole.mean.round(DIGITS // 2),
        covariance=covariance,
    )
    session.config = session.config.model_copy(update={"torque_gain": figure})


def scene_of_settings(session: CalibrationSession) -> Scene | None:
    """Load the user's scene for the arm as calibrated so far; None for the bench."""
    return None if session.settings.scene is None else session.settings.read_scene(session.arm)


def gauges_of(scene: Scene, known: NamedSize) -> tuple[str, ...]:
    """Find the gauges in a scene: the named one, or all surfaces of that height. Raises InputError: there is none."""
    # Take the named surface, or all surfaces that state that height.
    heights = {n: b.known["height"][0] for n, b in scene.surfaces.items() if "height" in b.known}
    if known.name is not None:
        return (reference(heights, known, "height", "m", "surface"),)
    gauges = tuple(name for name, height in heights.items() if agrees(height, known.size))
    if not gauges:
        listed = ", ".join(f"{name} {height:g} m" for name, height in heights.items())
        raise InputError(
            f"no surface of the scene is {known.size.text} high; it states: {listed or 'none'}"
        )
    return gauges


def reference(stated: dict[str, float], known: NamedSize, what: str, unit: str, kind: str) -> str:
    """Find the reference among bodies that state a size: the named one, or the only one.
    Raises InputError: there is none, or the scene states another size for it."""
    # A named reference must exist; without a name it must be the only one.
    if known.name is not None and known.name not in stated:
        raise unknown_name(kind, known.name, stated, f"It must state its {what}.")
    if known.name is None and len(stated) != 1:
        raise InputError(
            f"the scene states the {what} of {', '.join(stated) or 'nothing'}: say which one is known, "
            f"as NAME={known.size.text}"
        )
    name = known.name or next(iter(stated))
    if not agrees(stated[name], known.size):
        raise InputError(
            f"the scene states a {what} of {stated[name]:g} {unit} for '{name}', and it is said to be "
            f"{known.size.text}"
        )
    return name


def agrees(value: float, stated: StatedSize) -> bool:
    """True if a scene's value is within the stated limits of the reference."""
    return abs(value - stated.value) <= stated.limit + SAME * stated.value


def measuring_tree(scene: Scene, parameters: tuple[Parameter, ...]) -> Node:
    """Make the tree that measures all of `parameters`. Raises InputError: some of them cannot be measured there."""
    assembled = assemble(scene, parameters)
    if assembled.failed or assembled.tree is None:
        reasons = " ".join(failure.reason for failure in assembled.failed)
        raise InputError(f"nothing is calibrated there: {reasons}")
    return assembled.tree


def calibration_plan(parameters: tuple[Parameter, ...], tree: Node) -> Plan:
    """Plan of a calibration."""
    return Plan(parameters, tree, "What is known is measured, to calibrate the arm.", "calibration")


def drop_leaves(node: Node, kind: str) -> Node:
    """Copy a tree without the leaves of type `kind`."""
    kept = [drop_leaves(child, kind) for child in node.children if child.type != kind]
    return replace(node, children=tuple(kept))


def slow_motions(node: Node, ways: Sequence[Node]) -> Node:
    """Copy a tree with the motions `ways` slowed down to `SPEED`."""
    children = tuple(slow_motions(child, ways) for child in node.children)
    # Compared by identity: equal motions elsewhere in the tree stay as they are.
    is_slow = any(node is motion for motion in ways)
    args = (*node.args, ("speed", SPEED)) if is_slow else node.args
    return replace(node, args=args, children=children)
