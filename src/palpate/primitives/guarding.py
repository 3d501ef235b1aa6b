"""Contact during motions: contact detection, settling, guarded spans, lowering and sliding."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Generator
from dataclasses import replace
from functools import partial

import numpy as np

from palpate.common.pose import Array, Pose
from palpate.primitives.base import Blackboard, LeafFailure, Wait
from palpate.primitives.load import BREAKAWAY, ROUGHEST, UNFELT, FingerLoad
from palpate.primitives.rules.grasp import most_sideways
from palpate.primitives.rules.profile import GUARDED_SPEED, POSE_ERROR, PathSpan, leaves, speed
from palpate.primitives.rules.support import footing, support_friction
from palpate.robots.pace import SUSTAINED, mistaken_force
from palpate.robots.robot import Robot, RobotState
from palpate.robots.sheet import Reflex, Reflexes

SETTLED_SPEED = 0.003  # m/s
# rad/s. An arm with a faster joint still moves its elbow, although the TCP is at rest. The joints'
# friction reverses with that motion. If the arm is folded near its base, the sensed force then
# changes by newtons. At rest an FR3 reports up to 0.004 rad/s (a recording at 1 kHz).
CREEPING = 0.01
# s at rest after which the arm counts as settled, if its wrench is compared with an earlier one.
# The estimators also use the samples of this window.
DWELL = 0.3
BRIEF = 0.1  # s at rest after which the arm counts as settled, if no wrench is compared
SETTLE_LIMIT = 3.0  # s
MEDIAN_TIME = 0.06  # s, duration of the ticks of a median wrench
# N, change of the contact force that counts as a contact. It is five times the effect of joint
# friction and sensor bias at the start of a motion.
MET = 8.0
# s after the start of a probe: begin and end of its start phase. The arm no longer swings then, and
# its joints' friction has reversed.
SETTING_OUT = (0.2, 0.4)
# N, growth of the reaction force during the start phase that counts as contact. At 12 mm/s and an
# arm stiffness of 3000 N/m, a rigid body presses by 3.6 N more, and a body of 600 N/m by 0.7 N.
GROWS = 1.0
# N/m and N m/m, largest gradient of the free-air wrench with position. It is 1.5 times that of an
# uncalibrated arm: 15 N/m and 40 N m/m over 12 arms, due to gains, links and friction.
DRIFT = np.array([20.0, 20.0, 20.0, 60.0, 60.0, 60.0])
# N and N m, largest total change of the free-air wrench: the drift of an uncalibrated arm over 0.1
# m. A soft body is pressed by at most this much more than a threshold.
DRIFT_MOST = np.array([1.5, 1.5, 1.5, 6.0, 6.0, 6.0])


class WrenchFilter:
    """Median filter of the external wrench over the last ticks.

    Attributes:
        first: (6,) the first median, in the convention of `palpate.trace`; nan before.
    """

    def __init__(self, robot: Robot) -> None:
        self.first: Array = np.full(6, np.nan)
        self._robot = robot
        self._ticks: deque[Array] = deque(maxlen=SUSTAINED)

    def now(self) -> Array:
        """Update once a tick and return the median (6,) of the last ticks; nan, which exceeds nothing, at first."""
        self._ticks.append(self._robot.state.contact)
        if len(self._ticks) < SUSTAINED:
            return np.full(6, np.nan)
        a, b, c = self._ticks
        # Median of three: max(min(a, b), min(max(a, b), c)). np.median takes ten times as long.
        wrench = np.maximum(np.minimum(a, b), np.minimum(np.maximum(a, b), c))
        if np.isnan(self.first).any():
            self.first = wrench
        return wrench


class FreeAir:
    """Baseline of a probe's wrench in free air; updated once a tick.

    At first it is the wrench at rest. During motion, joint friction adds a step, and the wrench drifts
    with position. A contact comes later than the step, and grows more steeply than the drift.

    Attributes:
        wrench: (6,) in the convention of `palpate.trace`; nan before the first tick.
    """

    def __init__(self, robot: Robot, direction: Array) -> None:
        self.wrench: Array = np.full(6, np.nan)
        self._robot, self._direction = robot, direction
        self._begin, self._at = robot.state.t, robot.state.pose_world_tcp
        self._setting_out: list[Array] = []
        self._under_way: Array | None = None

    @property
    def known(self) -> bool:
        """True after the start phase of the motion."""
        return self._under_way is not None

    def follow(self, wrench: Array) -> None:
        """Update with the median wrench (6,) of a tick."""
        if np.isnan(self.wrench).any():
            self.wrench = wrench
        here, since = self._robot.state.pose_world_tcp, self._robot.state.t - self._begin
        if since > SETTING_OUT[1]:
            if self._under_way is None:
                self._under_way = self.wrench = self._start_wrench()
            # Follow the wrench, limited by the gradient and the total drift of free air.
            most = DRIFT * here.distance_to(self._at)
            drifted = self.wrench + np.clip(wrench - self.wrench, -most, most)
            total = np.clip(drifted - self._under_way, -DRIFT_MOST, DRIFT_MOST)
            self.wrench = self._under_way + total
        elif since > SETTING_OUT[0]:
            self._setting_out.append(wrench)
        self._at = here

    def _start_wrench(self) -> Array:
        """Median wrench (6,) of the start phase; the wrench at rest if it grew as in contact."""
        wrenches = self._setting_out
        if not wrenches:
            return self.wrench
        # Growth along the motion, between the two halves of the start phase.
        half = len(wrenches) // 2
        grown = np.median(wrenches[half:], axis=0) - np.median(wrenches[: half + 1], axis=0)
        if abs(grown[:3] @ self._direction) > GROWS:
            return self.wrench
        return np.median(wrenches, axis=0)


def median_wrench(blackboard: Blackboard) -> Generator[float | None, None, Array]:
    """Wait for `SUSTAINED` ticks and return their median wrench (6,)."""
    wrenches: list[Array] = []
    for _ in range(SUSTAINED):
        wrenches.append(blackboard.robot.state.contact)
        yield
    return np.median(wrenches, axis=0)


def settle(blackboard: Blackboard, dwell: float = DWELL) -> Wait:
    """Wait until all joints and the TCP have been at rest for `dwell` s; `LeafFailure` if they do not rest."""
    start = since = blackboard.robot.state.t
    while (now := blackboard.robot.state.t) - since < dwell:
        since = max(since, _last_motion_time(blackboard))
        if now - start > SETTLE_LIMIT + dwell:
            raise LeafFailure(f"the arm does not settle within {SETTLE_LIMIT:g} s")
        yield dwell - (now - since)


def is_in_motion(state: RobotState) -> bool:
    """Test if the arm moves, by a command or because it yields."""
    return bool(
        np.linalg.norm(state.twist[:3]) > SETTLED_SPEED or np.abs(state.dq).max() > CREEPING
    )


def _last_motion_time(blackboard: Blackboard) -> float:
    """Return the robot time, s, of the last motion since the last tick; -inf if the arm was at rest."""
    state, rows = blackboard.robot.state, blackboard.recorder.newest
    if is_in_motion(state):
        return state.t
    moves = np.linalg.norm(rows.twist[:, :3], axis=1) > SETTLED_SPEED
    moves |= np.abs(rows.dq).max(1, initial=0.0) > CREEPING
    return float(rows.t[moves].max(initial=-np.inf))


def finish(blackboard: Blackboard) -> Wait:
    """Wait until the arm's commanded motion has ended."""
    yield
    while blackboard.robot.state.moving:
        yield np.inf


def never() -> bool:
    """Return False: a contact is always possible."""
    return False


def wait_for_contact(
    blackboard: Blackboard, touching: Callable[[], bool], far: Callable[[], bool] = never
) -> Generator[float | None, None, bool]:
    """Wait until the arm's motion is in contact, and hold it there.

    Returns False if the motion ended first. While it is `far` from a contact, the next tick may wait
    for an event of the robot.
    """
    yield
    while not touching():
        if not blackboard.robot.state.moving:
            return False
        yield np.inf if far() else None
    blackboard.robot.hold()
    return True


def in_words(force: Array) -> str:
    """A force (3,), N, as text with size and main direction: `12 N downwards`."""
    size = float(np.linalg.norm(force))
    names = (("+x", "-x"), ("+y", "-y"), ("upwards", "downwards"))
    axis = int(np.abs(force).argmax())
    direction = names[axis][int(force[axis] < 0)]
    return f"{size:.0f} N {direction}"


# Contact during straight motions: guarded spans, lowering, sliding.


# N in addition to its weight with which a held object presses on its support when set down.
SET_DOWN = 10.0
DOWN = np.array([0.0, 0.0, -1.0])  # World axes
LOWERINGS = 3  # Largest number of times that an object without full support is lowered further
WAVERS = 0.4  # N by which the sensed force of an arm at rest fluctuates
# N, change of that force within 0.1 s which shows that the arm still creeps. The posture of an arm
# that is folded near its base creeps on after a motion.
CREEPS = 1.0
CREEPINGS = 5  # Largest number of waits for the end of the creep
# N, first press above the least measurable force: enough remains with the arm at rest
PRESSES = 1.0
# Largest ratio of the normal force on a slide to the commanded pressing force. The arm presses
# harder while it starts and changes its speed (21.3 N for 15 N, simulated FR3, friction 1).
PEAK = 1.4
# Largest ratio of a peak of 5 ms to the sustained sideways force: a rough object sticks and slips. A
# wall adds 4 to 7 N in the 60 ms until the sustained force shows it (20 to 40 mm/s, 3000 N/m).
STICKS = 1.5
CONTACT_SPEED = 0.02  # m/s, speed in contact or where contact is possible
# Fraction of the force that would turn an object between the pads which a slide may use. The margin
# is needed since pads creep.
FIRMLY = 0.8
# Largest relative difference of two frictions that count as the same: a slide at `measured` is up to 15 % off.
SAME_FRICTION = 0.2
STEADY = 0.016  # m of a drag after which its friction is judged: the pads and the arm yield by some millimetres first
NORMAL_CHANGE = 2.0  # N, least change of the normal force on a drag that shows its friction
LIGHTLY = 3.0  # N, least pressing force: with less, a slide could lift the dragged object
# Parts of a slide: end as a share of the path, pressing force, N, and largest speed, m/s. The
# torque sensors resolve this normal force. It rises and falls, so that the arm's friction, or a
# pull along the path like that of a spring, is not taken for friction of the object. Two speeds
# separate viscous friction.
PRESSED = (
    (0.0, LIGHTLY, CONTACT_SPEED),
    (0.5, 15.0, CONTACT_SPEED),
    (1.0, LIGHTLY, 2.0 * CONTACT_SPEED),
)


def span_reflex(of: Reflexes, span: PathSpan, holding: str | None, sets_down: bool) -> Reflex:
    """Return the reflex thresholds on a span, where a held object may press on its support."""
    if span.guarded and (sets_down or leaves(span.start, span.end)):
        return replace(of.probing, load=of.carrying.load)
    return of.carrying if holding else of.free


def follow_free(blackboard: Blackboard, span: PathSpan, left: float) -> Wait:
    """Wait until the current motion has passed a span with no body near."""
    fastest = blackboard.scene.arm.pace.speed
    yield
    while not _is_past(blackboard, span, left):
        yield _soonest(blackboard, span, left, fastest)


def wait_guarded_span(
    blackboard: Blackboard, span: PathSpan, left: float, sets_down: bool, goal: str
) -> Generator[float | None, None, bool]:
    """Wait until the current motion has passed a guarded span, with `left` m of path behind the span.

    Returns True if the held object is set down on its support, which ends the motion.
    Raises LeafFailure: any other contact; the arm still presses on it.
    """
    robot, filtered, scene = blackboard.robot, WrenchFilter(blackboard.robot), blackboard.scene
    # Joints that reverse, in a lift or as the elbow sways, reverse their friction: that is no contact.
    least = max(MET, mistaken_force(scene.arm, robot.state.q))
    fastest = speed(span, scene)
    yield
    while not _is_past(blackboard, span, left):
        wrench = filtered.now()
        change = wrench - filtered.first
        # Joint friction may bias either reference by newtons. A press shows in both.
        if sets_down and min(-blackboard.load.borne(wrench), -change[2]) > SET_DOWN:
            robot.hold()
            return True
        # A contact is the part of the change that the motion does not explain.
        met = change[:3] - _explained_force(blackboard, change, sets_down, span)
        if np.linalg.norm(met) > least:
            before = 1e3 * (left + robot.state.pose_world_tcp.distance_to(span.end))
            raise LeafFailure(
                f"unexpected contact: the hand pushes with {in_words(met)} on an obstacle "
                f"{before:.0f} mm before '{goal}'"
            )
        yield None if np.isnan(wrench).any() else _soonest(blackboard, span, left, fastest)
    return False


def _is_past(blackboard: Blackboard, span: PathSpan, left: float) -> bool:
    """True if a motion has passed a span, or has ended."""
    state = blackboard.robot.state
    return not state.moving or (left > 0.0 and _ahead(blackboard, span) <= 0.0)


def _soonest(blackboard: Blackboard, span: PathSpan, left: float, fastest: float) -> float:
    """Return the earliest time, s, at which a span may be passed; inf for the last, whose end is an event."""
    return _ahead(blackboard, span) / fastest if left > 0.0 else np.inf


def _ahead(blackboard: Blackboard, span: PathSpan) -> float:
    """Length, m, of a span that the commanded target has not passed."""
    gone = blackboard.robot.state.target_world_tcp.distance_to(span.start)
    return span.start.distance_to(span.end) - gone


def _explained_force(
    blackboard: Blackboard, change: Array, sets_down: bool, span: PathSpan
) -> Array:
    """Part (3,), N, of a change of the wrench (6,) that the motion itself explains."""
    lift = float(change[2])
    if sets_down:
        # An object that has turned in the pads presses with one end first. Its support resists
        # there with a sideways force up to the largest friction.
        pressed = max(-lift, 0.0)
        sideways = float(np.linalg.norm(change[:2]))
        rubs = min(1.0, ROUGHEST * pressed / max(sideways, 1e-9))
        return np.array([*(rubs * change[:2]), -pressed])
    if not leaves(span.start, span.end):
        return np.zeros(3)
    if blackboard.state.holding is None:
        return change[:3]  # the hand pressed on the body that it leaves
    heaviest = blackboard.robot.limits.payload * blackboard.robot.gravity
    return np.array([0.0, 0.0, min(max(lift, 0.0), heaviest)])


def lower(blackboard: Blackboard, goal: str) -> Wait:
    """Lower a held object until its support carries its weight.

    The arm sags, and fingers that press slip. The last sag before the arm rests may unload the
    support again. The joint friction of a folded arm may look like that too. So repeat, each time
    with twice the press. The contact is intended: `lifted` is false meanwhile, since reversed joint
    friction may exceed the forces that carrying explains.
    Raises LeafFailure: no support carries the object within `POSE_ERROR` below.
    """
    before = blackboard.state
    for lowering in range(LOWERINGS):
        yield from _rest(blackboard)
        if (
            blackboard.load.explain_carried_load((yield from median_wrench(blackboard)), WAVERS)
            is None
        ):
            return
        # Go down slowly until the support carries the load, pressing twice as hard each time.
        pressed = PRESSES * 2**lowering
        borne = partial(_is_borne, blackboard.load, WrenchFilter(blackboard.robot), pressed)
        blackboard.robot.move_axis(DOWN, GUARDED_SPEED, POSE_ERROR)
        blackboard.state = replace(before, lifted=False)
        try:
            stands = yield from wait_for_contact(blackboard, borne)
        finally:  # a stop during this motion has to lower the object
            blackboard.state = before
        if not stands:
            raise LeafFailure(
                f"no support for '{blackboard.state.holding}' at '{goal}' or up to "
                f"{1e3 * POSE_ERROR:.0f} mm below: it stays in the fingers"
            )


def _rest(blackboard: Blackboard) -> Wait:
    """Wait until the arm is at rest, and the force on it constant."""
    for _ in range(CREEPINGS):
        forces: list[float] = []
        for _ in settle(blackboard):
            forces.append(float(blackboard.robot.state.contact[2]))
            yield
        # Compare the medians of the last two thirds: creep changes the force in between.
        third = max(len(forces) // 3, 1)
        earlier, later = np.median(forces[-2 * third : -third]), np.median(forces[-third:])
        if abs(later - earlier) < CREEPS:
            return


def _is_borne(load: FingerLoad, filtered: WrenchFilter, pressed: float) -> bool:
    """True if a support carries the whole load; a light load is pressed on it with `pressed` N."""
    wrench = filtered.now()
    if not load.borne(wrench) < 0.0:
        return False
    return load.hanging is None or load.support_load(wrench) > UNFELT + pressed


def slide(blackboard: Blackboard, target: Pose, most: float) -> Wait:
    """Drag the held object to a pose at most at `most` m/s: pressed lightly, firmly, lightly (`PRESSED`)."""
    robot = blackboard.robot
    start, weight = robot.state.target_world_tcp, _weight(blackboard)
    # A larger sideways force than the roughest support exerts is a collision.
    normal = PEAK * max(force for _, force, _ in PRESSED) + weight
    sideways = BREAKAWAY * ROUGHEST * normal + MET
    blackboard.set_reflex(replace(robot.limits.reflexes.contact, sideways=STICKS * sideways))
    way = target.position - start.position
    safe = max(CONTACT_SPEED, speed(PathSpan(start, target, True), blackboard.scene))
    fastest = min(safe, most)
    for share, force, pace in PRESSED:
        # A larger drag would turn the object between the pads. Then press less, down to unloading
        # the support of half the object's weight.
        load = blackboard.load
        bearable = FIRMLY * most_sideways(blackboard.state, way) / load.rough
        pressed = min(force, max(bearable - weight, -0.5 * load.weight))
        # The target lies below the support by force over stiffness.
        down = pressed / blackboard.scene.arm.stiffness.translation
        here = Pose(start.position + share * way - [0.0, 0.0, down], target.quaternion)
        robot.move_pose(here, min(pace, fastest))
        wrench = yield from drag(blackboard, sideways)
        if share > 0.0:
            blackboard.load = blackboard.load.after_drag(wrench)
        yield from settle(blackboard, BRIEF)
    robot.move_pose(target, min(CONTACT_SPEED, fastest))
    yield from finish(blackboard)
    yield from settle(blackboard)


def drag(blackboard: Blackboard, most: float) -> Generator[float | None, None, Array]:
    """Wait until the commanded motion has ended, and return the wrench (6,) right before.

    Raises LeafFailure: the median force of some ticks is more than `most` N sideways, or the carrier may move along.
    """
    robot, filtered, rows = blackboard.robot, WrenchFilter(blackboard.robot), list[Array]()
    start, looked = robot.state.pose_world_tcp, False
    yield
    wrench = filtered.now()
    while robot.state.moving:
        yield
        wrench = filtered.now()
        rows.append(wrench)
        sideways = math.hypot(*wrench[:2])
        if sideways > most:
            raise LeafFailure(
                f"unexpected contact: the slide takes {sideways:.1f} N sideways, more than {most:.0f} N"
            )
        # As soon as the object slides steadily, and at the end.
        if not looked and robot.state.pose_world_tcp.distance_to(start) > STEADY:
            looked = True
            require_still_carrier(blackboard, np.array(rows[len(rows) // 2 :]))
    if looked:
        require_still_carrier(blackboard, np.array(rows[len(rows) // 2 :]))
    return wrench


def require_still_carrier(blackboard: Blackboard, wrenches: Array) -> None:
    """Require that a slide has another friction than its carrier on the carrier's own support.

    A loose carrier that moves along has that friction, whatever it weighs. `wrenches` (n, 6) are those of the slide.
    Raises LeafFailure: the carrier may move with the held object.
    """
    state, hanging = blackboard.state, blackboard.load.hanging
    if hanging is None or state.holding is None:
        return
    # Coulomb friction: slope of the sideways force over the normal force.
    forces = hanging[:3] - wrenches[:, :3]
    if not np.ptp(forces[:, 2]) > NORMAL_CHANGE:
        return
    slope = float(np.polyfit(forces[:, 2], np.hypot(forces[:, 0], forces[:, 1]), 1)[0])
    for owner in footing(state, state.holding, state.pose_of(state.holding)).owners:
        own = support_friction(state, owner) if owner in state.scene.objects else math.nan
        if abs(slope - own) < SAME_FRICTION * own:
            raise LeafFailure(
                f"the slide meets a friction of {slope:.2f}, as between '{owner}' and its support: '{owner}' may move "
                "with it; slide on a fixed body, or state it without a joint if it cannot move"
            )


def _weight(blackboard: Blackboard) -> float:
    """Weight of the held object, N: measured or known, else the largest that the arm carries."""
    robot, state = blackboard.robot, blackboard.state
    if blackboard.load.weight > 0.0:
        return blackboard.load.weight
    assert state.holding is not None
    known = state.scene.body(state.holding).known.get("mass", (robot.limits.payload,))
    return known[0] * robot.gravity
