"""Kinds of faults during a run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING

import numpy as np

from bench.faults.faulty import (
    Act,
    FaultyRobot,
    Lie,
    broken,
    frozen,
    telling,
    wrenched,
)
from palpate.common.errors import ExecutionAborted
from palpate.common.pose import Array
from palpate.robots.description import PREFIX
from palpate.robots.simulated.actuators import DRIVE

if TYPE_CHECKING:
    import mujoco

    from palpate.trace.samples import Samples

OBJECT = "green_bottle"
"""The object that is weighed."""
NAN, INF = float("nan"), float("inf")
EVERYTHING = ("q", "dq", "tau", "tau_ext", "pose_world_tcp", "twist", "wrench", "contact", "width")

Meddle = Callable[[FaultyRobot], None]


@dataclass(frozen=True, slots=True)
class Fault:
    """A kind of fault.

    Attributes:
        meddle: makes a robot faulty.
        patches: functions that fail, by `module:name`.
        bytes: largest file size, for a full disk; None for no limit.
        holds: holding still keeps the load.
        honest: all forces are the arm's own: nobody pushes, and the arm can bear its weight.
    """

    name: str
    meddle: Meddle
    patches: tuple[str, ...] = ()
    bytes: int | None = None
    holds: bool = True
    honest: bool = True


def _lies(lie: Lie, once: bool = False) -> Meddle:
    def meddle(robot: FaultyRobot) -> None:
        robot.lie, robot.once = lie, once

    return meddle


def _raises(error: BaseException, *calls: str, once: bool = False) -> Meddle:
    def meddle(robot: FaultyRobot) -> None:
        robot.raises, robot.once = dict.fromkeys(calls, error), once

    return meddle


def _ignores(*calls: str) -> Meddle:
    def meddle(robot: FaultyRobot) -> None:
        robot.ignores = frozenset(calls)

    return meddle


def _acts(act: Act) -> Meddle:
    def meddle(robot: FaultyRobot) -> None:
        robot.act = act

    return meddle


def _spoils(spoil: Callable[[Samples], Samples]) -> Meddle:
    def meddle(robot: FaultyRobot) -> None:
        robot.spoil = spoil

    return meddle


def _nothing(_: FaultyRobot) -> None:
    """The robot is sound."""


def _push(x: float, y: float, z: float, seconds: float = 0.5) -> Act:
    """Push the hand with a force, N."""

    def act(model: mujoco.MjModel, data: mujoco.MjData, since: float) -> None:
        body = _hand(model)
        data.xfrc_applied[body, :3] = (x, y, z) if since < seconds else (0.0, 0.0, 0.0)

    return act


def _bump(model: mujoco.MjModel, data: mujoco.MjData, since: float) -> None:
    """Push the object with 10 N for 50 ms."""
    push = (10.0, 0.0, 0.0) if since < 0.05 else (0.0, 0.0, 0.0)
    data.xfrc_applied[model.body(OBJECT).id, :3] = push


def _slippery(friction: float) -> Act:
    def act(model: mujoco.MjModel, data: mujoco.MjData, since: float) -> None:
        for geom in range(model.ngeom):
            if "pad" in model.geom(geom).name:
                model.geom_friction[geom, 0] = friction

    return act


def _weak_grip(share: float) -> Act:
    """Reduce the force of the fingers' drive to a share."""

    def act(model: mujoco.MjModel, data: mujoco.MjData, since: float) -> None:
        drive = model.actuator(PREFIX + DRIVE).id
        left = min(80.0 * share, float(model.actuator_forcerange[drive, 1]))
        model.actuator_forcerange[drive] = (-left, left)

    return act


def _weak_arm(share: float) -> Act:
    """Reduce the torque of the arm's joints to a share."""

    strong: list[Array] = []

    def act(model: mujoco.MjModel, data: mujoco.MjData, since: float) -> None:
        if not strong:
            strong.append(model.jnt_actfrcrange.copy())
        model.jnt_actfrcrange[:] = share * strong[0]

    return act


def _heavy(model: mujoco.MjModel, data: mujoco.MjData, since: float) -> None:
    """Make the object 20 N heavier."""
    data.xfrc_applied[model.body(OBJECT).id, 2] = -20.0


def _hand(model: mujoco.MjModel) -> int:
    """The body that carries the fingers."""
    finger = model.body(PREFIX + "left_finger").id
    return int(model.body_parentid[finger])


def _every_other(samples: Samples) -> Samples:
    kept = {field.name: getattr(samples, field.name)[::2] for field in fields(samples)}
    return replace(samples, **kept)


def _spoiled(**values: float) -> Callable[[Samples], Samples]:
    def spoil(samples: Samples) -> Samples:
        changes = {name: np.full_like(getattr(samples, name), v) for name, v in values.items()}
        return replace(samples, **changes)

    return spoil


def _shifted(seconds: float) -> Callable[[Samples], Samples]:
    return lambda samples: replace(samples, t=samples.t + seconds)


def _spike(size: float, axis: int) -> Lie:
    return wrenched(lambda w, _: w + size * np.eye(6)[axis])


LOST = ConnectionError("the robot does not answer")

FAULTS: tuple[Fault, ...] = (
    # reported state
    Fault("NaN wrench", _lies(wrenched(lambda w, _: np.full(6, NAN)))),
    Fault("NaN wrench for a tick", _lies(wrenched(lambda w, _: np.full(6, NAN)), once=True)),
    Fault("infinite wrench", _lies(wrenched(lambda w, _: np.full(6, INF)))),
    Fault("NaN angle", _lies(broken("q", NAN, 3))),
    Fault("NaN angles for a tick", _lies(broken("q", NAN), once=True)),
    Fault("infinite angle", _lies(broken("q", INF, 3))),
    Fault("NaN rate", _lies(broken("dq", NAN))),
    Fault("NaN torque", _lies(broken("tau_ext", NAN))),
    Fault("NaN twist", _lies(broken("twist", NAN))),
    Fault("NaN width", _lies(telling(width=NAN))),
    Fault("NaN stamp", _lies(telling(stamp=NAN))),
    Fault("NaN time", _lies(telling(t=NAN))),
    Fault("short wrench", _lies(telling(wrench=np.zeros(5), contact=np.zeros(5)))),
    Fault("frozen wrench", _lies(frozen("wrench", "contact", "tau_ext"))),
    Fault("frozen encoders", _lies(frozen("q", "dq", "pose_world_tcp", "twist"))),
    Fault("frozen signals", _lies(frozen(*EVERYTHING))),
    Fault("frozen stamp", _lies(frozen("stamp"))),
    Fault("frozen time", _lies(frozen("t", "stamp"))),
    Fault("frozen state", _lies(lambda state, robot: robot.seen or state)),
    Fault("stamp backwards", _lies(lambda s, _: replace(s, stamp=s.stamp - 1.0))),
    Fault("stamp ahead", _lies(lambda s, _: replace(s, stamp=s.stamp + 10.0))),
    Fault("time backwards", _lies(lambda s, _: replace(s, t=s.t - 5.0), once=True)),
    Fault("time ahead", _lies(lambda s, _: replace(s, t=s.t + 60.0))),
    Fault("spike of 200 N", _lies(_spike(200.0, 2), once=True)),
    Fault("spike of 20 N down", _lies(_spike(-20.0, 2), once=True)),
    Fault("spike of 20 N m", _lies(_spike(20.0, 4), once=True)),
    Fault("wrench off by 5 N", _lies(_spike(5.0, 0))),
    Fault("wrench off by 40 N", _lies(_spike(40.0, 2))),
    Fault("wrench drifts", _lies(wrenched(lambda w, t: w + 2.0 * t * np.eye(6)[2]))),
    Fault("wrench of zeros", _lies(wrenched(lambda w, _: np.zeros(6)))),
    Fault("wrench of the other sign", _lies(wrenched(lambda w, _: -w))),
    Fault("wrench ten times too big", _lies(wrenched(lambda w, _: 10 * w))),
    Fault("width of nothing", _lies(telling(width=0.0))),
    Fault("width of open fingers", _lies(telling(width=0.08))),
    Fault("says it grips", _lies(telling(gripping=True))),
    Fault("says it does not grip", _lies(telling(gripping=False))),
    Fault("moves for ever", _lies(telling(moving=True))),
    Fault("never moves", _lies(telling(moving=False))),
    Fault("fingers move for ever", _lies(telling(gripper_moving=True))),
    Fault("fingers never move", _lies(telling(gripper_moving=False))),
    Fault("a reflex that was none", _lies(telling(reflex="the arm stopped itself"), once=True)),
    # calls
    Fault("state fails", _raises(LOST, "state")),
    Fault("state fails once", _raises(LOST, "state", once=True)),
    Fault("advance fails", _raises(LOST, "advance")),
    Fault("advance fails once", _raises(OSError("timeout"), "advance", once=True)),
    Fault("robot gives up", _raises(ExecutionAborted("emergency stop pressed"), "advance")),
    Fault("drain fails", _raises(LOST, "drain")),
    Fault("drain fails once", _raises(IndexError("ring buffer"), "drain", once=True)),
    Fault("hold fails", _raises(LOST, "hold", "advance")),
    Fault("close fails", _raises(LOST, "close")),
    Fault("no motion starts", _raises(RuntimeError("rejected"), "move_pose", "move_joints")),
    Fault("fingers fail", _raises(RuntimeError("jammed"), "open_gripper", "close_gripper")),
    Fault("motions are ignored", _ignores("move_pose", "move_joints", "move_axis")),
    Fault("opening is ignored", _ignores("open_gripper")),
    Fault("closing is ignored", _ignores("close_gripper")),
    # logged samples
    Fault("every other sample lost", _spoils(_every_other)),
    Fault("NaN samples", _spoils(_spoiled(wrench=NAN))),
    Fault("samples a second late", _spoils(_shifted(-1.0))),
    Fault("samples ahead of time", _spoils(_shifted(100.0))),
    # the world
    Fault("hand pushed aside with 20 N", _acts(_push(0, 20, 0)), honest=False),
    Fault("hand pushed aside with 80 N", _acts(_push(0, 80, 0)), honest=False),
    Fault("hand pushed down with 40 N", _acts(_push(0, 0, -40)), honest=False),
    Fault("hand pushed down with 80 N", _acts(_push(0, 0, -80)), honest=False),
    Fault("hand pushed up with 40 N", _acts(_push(0, 0, 40)), honest=False),
    Fault("hand leant on with 30 N", _acts(_push(20, 0, -22, 60.0)), honest=False),
    Fault("object bumped", _acts(_bump), honest=False, holds=False),
    Fault("object grows heavy", _acts(_heavy), honest=False, holds=False),
    Fault("pads without friction", _acts(_slippery(0.02)), holds=False),
    Fault("pads with little friction", _acts(_slippery(0.15)), holds=False),
    Fault("grip gives out", _acts(_weak_grip(0.02)), holds=False),
    Fault("grip weakens", _acts(_weak_grip(0.4))),
    Fault("arm weakens", _acts(_weak_arm(0.6))),
    Fault("arm gives out", _acts(_weak_arm(0.25)), honest=False, holds=False),
    # the rest of the program
    Fault("watcher fails", _nothing),
    Fault("disk full at 2 kB", _nothing, bytes=2_000),
    Fault("disk full at 100 kB", _nothing, bytes=100_000),
    Fault("disk full at 1 MB", _nothing, bytes=1_000_000),
    Fault("estimator fails", _nothing, ("palpate.estimation.quantities.mass:estimate_mass",)),
    Fault("twin fails", _nothing, ("palpate.twin.twin:build_twin",)),
    Fault("pictures fail", _nothing, ("palpate.runs.report.writing:take_stills",)),
    Fault("film fails", _nothing, ("palpate.runs.report.writing:take_film",)),
    Fault("report fails", _nothing, ("palpate.runs.report.page:write_report",)),
)
