"""Calibration procedures: weigh a known mass, touch known heights, weigh the arm itself."""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from palpate.calibration import bench, own_weight
from palpate.calibration.gains import GainBelief, weighed
from palpate.calibration.session import Session
from palpate.calibration.stated import Known, Stated
from palpate.calibration.tips import gauged, require_places
from palpate.errors import InputError, unknown_name
from palpate.geometry.pose import Array
from palpate.parameter import Parameter
from palpate.planning.plan import Node, Plan
from palpate.planning.symbolic.planner import assemble
from palpate.robots.owner.config import JOINTS, Gains, Lean, Repeated, Value
from palpate.scene.load import load_scene, parse_scene
from palpate.scene.scene import Scene
from palpate.trace.samples import STANDARD_GRAVITY

SPEED = 0.05
"""m/s at which a weight is taken up and set down: slow enough for white noise to average out, quick
enough for drift."""
DIGITS = 13
"""Decimals of a relative variance: of a gain that is known to 0.001 % three are left."""
ROUNDS = 2
"""How often every gauge is touched: what differs from place to place is told from what differs from
touch to touch."""
SAME = 1e-6
"""Relative: what a scene states and what is said of it."""


def weigh_itself(session: Session) -> None:
    """Own weight: gains of all joints but those whose axes are upright."""
    session.callbacks.progress(
        f"weighing the arm itself in {own_weight.CONFIGURATIONS} configurations"
    )
    scene = _own_scene(session) or parse_scene(bench.plain(STANDARD_GRAVITY), arm=session.arm)
    plan = _plan((), own_weight.tree(session.arm))
    run = session.perform(scene, plan, None if session.settings.scene else scene)
    assert run.trace_if_any is not None
    by = f"its own weight in {own_weight.CONFIGURATIONS} configurations"
    _take_gains(session, own_weight.weighed_itself(run.trace_if_any, session.arm), by)


def weigh(session: Session, known: Known) -> None:
    """A known weight: gains of the joints that bear it. On the bench it stands at several places,
    one after the other; in a scene of one's own where that has it."""
    by = f"a weight of {known.size.text}"
    own = _own_scene(session)
    if own is not None:
        _weigh_once(session, own, None, _object(own, known), known.size, by)
        return
    true = bench.truth(known.size, session.settings.seed, "weight")
    for i, x in enumerate(bench.PLACES, 1):
        session.callbacks.progress(f"weighing {known.size.text}, place {i} of {len(bench.PLACES)}")
        scene = parse_scene(
            bench.with_weight(known.size.value, x, STANDARD_GRAVITY), arm=session.arm
        )
        world = parse_scene(bench.with_weight(true, x, STANDARD_GRAVITY), arm=session.arm)
        _weigh_once(session, scene, world, bench.BLOCK, known.size, by)


def gauge(session: Session, known: Known) -> None:
    """Known heights: where the fingertips end, and how far they give way."""
    own = _own_scene(session)
    if own is None:
        session.callbacks.progress(f"touching gauges of {known.size.text}")
        true = bench.truth(known.size, session.settings.seed, "gauge")
        said = bench.with_gauges(known.size.value, STANDARD_GRAVITY)
        scene = parse_scene(said, arm=session.arm)
        hidden = bench.with_gauges(true, STANDARD_GRAVITY)
        world = parse_scene(hidden, arm=session.arm)
        names = bench.gauges()
    else:
        scene, world, names = own, None, _surfaces(own, known)
    require_places(len(names))
    heights = tuple(Parameter(name, "height") for name in names)
    once = _measuring(scene, heights).tree
    assert once is not None
    # One touch that tells nothing is no reason to stop: touches are judged together.
    often = Node("Sequence", children=(_without(once, "Pose2Height"),) * ROUNDS)
    run = session.perform(scene, _plan((), often), world)
    assert run.trace_if_any is not None
    arm = session.arm
    base = arm.stands(scene.pose_world_base)
    found = gauged(run.trace_if_any, heights, known.size, base, arm.reach.stretched)
    by = f"{found.touches} touches of gauges of {known.size.text}"
    today = datetime.date.today()
    tips = {
        "tip_offset": Value(value=found.offset, std=found.offset_std, date=today, by=by),
        "base_lean": Lean(
            value=found.lean + _leaning(session), std=found.lean_std, date=today, by=by
        ),
        "pose_repeatability": Repeated(value=found.repeatability, date=today, by=by),
        "tip_compliance": Value(
            value=found.compliance, std=found.compliance_std, date=today, by=by
        ),
    }
    session.config = session.config.model_copy(update=tips)


def _leaning(session: Session) -> Array:
    """(2,) rad, what was known of it before."""
    lean = session.config.base_lean
    return np.zeros(2) if lean is None else lean.value


def _weigh_once(
    session: Session, scene: Scene, world: Scene | None, name: str, known: Stated, by: str
) -> None:
    mass = Parameter(name, "mass")
    plan = _measuring(scene, (mass,))
    assert plan.tree is not None
    slow = replace(plan, tree=_slowly(plan.tree, f"{name}_pose"))
    run = session.perform(scene, slow, world)
    assert run.trace_if_any is not None
    _take_gains(session, weighed(run.trace_if_any, mass, known), by)


def _take_gains(session: Session, found: GainBelief, by: str) -> None:
    """Correct what was found from now on."""
    before = session.config.torque_gain
    whole = found.after(np.zeros(JOINTS) if before is None else before.value)
    ways = [] if before is None or before.by is None else before.by.split("; ")
    gains = Gains(
        date=datetime.date.today(),
        by="; ".join(dict.fromkeys([*ways, by])),
        value=whole.mean.round(DIGITS // 2),
        covariance=_symmetric(whole.covariance),
    )
    session.config = session.config.model_copy(update={"torque_gain": gains})


def _symmetric(square: Array) -> Array:
    """Without what rounding leaves, and with no more digits than are worth writing down."""
    return ((square + square.T) / 2).round(DIGITS)


def _own_scene(session: Session) -> Scene | None:
    settings = session.settings
    if settings.scene is None:
        return None
    return load_scene(settings.scene, settings.poses, session.arm)


def _object(scene: Scene, known: Known) -> str:
    """The weight in a scene: the one that is named, or the only object that states a mass.

    Raises:
        InputError: there is none, or it is stated to weigh something else.
    """
    stated = {n: body.known["mass"][0] for n, body in scene.objects.items() if "mass" in body.known}
    return _one_of(stated, known, "mass", "kg", "object")


def _surfaces(scene: Scene, known: Known) -> tuple[str, ...]:
    """The gauges in a scene: the one that is named, or all surfaces of that height."""
    stated = {
        n: body.known["height"][0] for n, body in scene.surfaces.items() if "height" in body.known
    }
    if known.name is not None:
        return (_one_of(stated, known, "height", "m", "surface"),)
    high = tuple(name for name, height in stated.items() if _agrees(height, known.size))
    if not high:
        told = ", ".join(f"{name} {height:g} m" for name, height in stated.items())
        raise InputError(
            f"no surface of the scene is {known.size.text} high; it states: {told or 'none'}"
        )
    return high


def _one_of(stated: dict[str, float], known: Known, what: str, unit: str, kind: str) -> str:
    if known.name is not None and known.name not in stated:
        raise unknown_name(kind, known.name, stated, f"It must state its {what}.")
    if known.name is None and len(stated) != 1:
        raise InputError(
            f"the scene states the {what} of {', '.join(stated) or 'nothing'}: say which one is known, "
            f"as NAME={known.size.text}"
        )
    name = known.name or next(iter(stated))
    if not _agrees(stated[name], known.size):
        raise InputError(
            f"the scene states a {what} of {stated[name]:g} {unit} for '{name}', and it is said to be "
            f"{known.size.text}"
        )
    return name


def _agrees(value: float, said: Stated) -> bool:
    return abs(value - said.value) <= said.limit + SAME * said.value


def _measuring(scene: Scene, parameters: tuple[Parameter, ...]) -> Plan:
    """The plan that measures all of them.

    Raises:
        InputError: some of them cannot be measured there.
    """
    made = assemble(scene, parameters)
    if made.failed or made.tree is None:
        raise InputError(f"nothing is calibrated there: {' '.join(made.failed)}")
    return _plan(parameters, made.tree)


def _plan(parameters: tuple[Parameter, ...], tree: Node) -> Plan:
    return Plan(parameters, tree, "What is known is measured, to calibrate the arm.", "calibration")


def _without(node: Node, kind: str) -> Node:
    """The same tree without the leaves of a kind."""
    kept = [_without(child, kind) for child in node.children if child.type != kind]
    return replace(node, children=tuple(kept))


def _slowly(node: Node, pose: str) -> Node:
    """The same tree with slow ways from and to a pose; the first of them leads there from home."""
    ways = [way for _, way in node.walk() if _leads(way, pose)]
    return _slowed(node, ways[1:])


def _leads(node: Node, pose: str) -> bool:
    return node.type == "MovePose" and str(dict(node.args)["pose"]).startswith(pose)


def _slowed(node: Node, ways: Sequence[Node]) -> Node:
    children = tuple(_slowed(child, ways) for child in node.children)
    slow = any(node is way for way in ways)
    args = (*node.args, ("speed", SPEED)) if slow else node.args
    return replace(node, args=args, children=children)
