"""Friction from drags: bias, direction, pressure; and worlds in which it is not all there is."""

from dataclasses import replace

import numpy as np
import pytest

from palpate.common.parameter import Parameter
from palpate.estimation.quantities.estimators import estimate_all
from palpate.estimation.quantities.friction import PRIOR_SPREAD, estimate_friction
from palpate.estimation.rigid_bodies import own_motion
from palpate.estimation.wrench_observation import observe, observe_wrench
from palpate.robots.owner import load_description
from palpate.trace.recording import WrenchSensor

STATIC, DYNAMIC = 0.41, 0.34
PARAMETER = Parameter("bottle", "friction")
ABOVE, GRASP, GOAL = (0.5, 0.1, 0.3), (0.5, 0.1, 0.2), (0.6, 0.1, 0.2)
PRESSED, CONSTANT = (0.003, 0.012, 0.003), (0.006, 0.006, 0.006)


def drag(bench, noise, seed=0, press=PRESSED, there_and_back=True, goal=GOAL, **world):
    """A weighing, a slide and the way back, each in two halves as MovePose makes them."""
    b = grasped(bench, noise, seed)
    slide(b, goal, press, **world)
    if there_and_back:
        slide(b, GRASP, press, **world)
    return released(b)


def grasped(bench, noise, seed=0):
    b = bench(noise, seed)
    b.go("bottle_pose + z_offset", ABOVE)
    b.go("bottle_pose", GRASP)
    b.close("bottle", 0.254)
    b.go("bottle_pose + z_offset", ABOVE)
    b.measure()
    b.go("bottle_pose", GRASP)
    return b


def slide(b, goal, press, static=STATIC, dynamic=DYNAMIC, **world):
    middle = (np.array(b.position) + goal) / 2
    b.drag("middle", middle, static, dynamic, press[:2], **world)
    b.drag("place", goal, static, dynamic, press[1:], **world)


def released(b):
    b.open()
    b.go("bottle_pose + z_offset", ABOVE)
    return b.trace()


def test_friction_is_exact_with_perfect_sensors(bench, noises):
    found = estimate_friction(drag(bench, noises["none"]), PARAMETER, None)
    assert found.values[0] == pytest.approx(DYNAMIC, abs=2e-3)
    assert found.parts["static"].value == pytest.approx(STATIC, abs=0.03)
    assert found.verdict == "identified"
    assert len(found.evidence) == 4


@pytest.mark.parametrize("mass", [5.0, 11.0])
def test_the_apparent_mass_of_the_arm_does_not_reach_the_breakaway(
    bench, noises, monkeypatch, mass
):
    """Towards its base it is twice as heavy as to the side; the end of a drag shows it."""
    monkeypatch.setattr("recordings.APPARENT", mass)
    found = estimate_friction(drag(bench, noises["lab"]), PARAMETER, None)
    assert found.parts["static"].value == pytest.approx(STATIC, abs=0.03)


@pytest.mark.long
@pytest.mark.parametrize("world", ["lab", "datasheet"])
def test_the_arms_own_friction_does_not_reach_the_estimate(bench, noises, world):
    found = [
        estimate_friction(drag(bench, noises[world], seed), PARAMETER, None) for seed in range(10)
    ]
    dynamic = np.array([e.values[0] for e in found])
    static = np.array([e.parts["static"].value for e in found])
    covers = [low <= DYNAMIC <= high for ((low, high),) in (e.intervals for e in found)]
    assert np.abs(dynamic - DYNAMIC).max() < 0.02
    assert np.abs(static.mean() - STATIC) < 0.03
    assert sum(covers) >= 8
    assert all(e.verdict == "identified" for e in found)


def test_a_constant_pressure_leaves_the_bias_in_and_says_so(bench, noises):
    trace = drag(bench, noises["lab"], 1, CONSTANT)
    pressed = estimate_friction(drag(bench, noises["lab"], 1), PARAMETER, None)
    constant = estimate_friction(trace, PARAMETER, None)
    assert constant.stds[0] > 3 * pressed.stds[0]
    assert abs(constant.values[0] - DYNAMIC) < 3 * constant.stds[0]


@pytest.mark.parametrize("seed", [2, 5])
def test_noise_in_a_constant_pressure_is_no_force_without_pressure(bench, noises, seed):
    found = estimate_friction(drag(bench, noises["datasheet"], seed, CONSTANT), PARAMETER, None)
    assert is_right(found)


@pytest.mark.parametrize("goal", [(0.6, 0.1, 0.2), (0.5, 0.2, 0.2), (0.43, 0.03, 0.2)])
def test_friction_is_independent_of_direction(bench, noises, goal):
    found = estimate_friction(drag(bench, noises["none"], goal=goal), PARAMETER, None)
    assert found.values[0] == pytest.approx(DYNAMIC, abs=2e-3)


def test_soft_springs_are_lowered_steeply_and_the_hand_goes_level_all_the_same(bench, noises):
    """800 N/m: the command of the same slide dives by 20 mm on 50."""
    stiff = drag(bench, noises["lab"], 1)
    target = stiff.samples.target_world_tcp.copy()
    pressed = stiff.samples.pose_world_tcp[:, 2] - target[:, 2]
    target[:, 2] -= 4.0 * np.maximum(pressed, 0.0)
    soft = replace(stiff, samples=replace(stiff.samples, target_world_tcp=target))
    found = estimate_friction(soft, PARAMETER, None)
    again = estimate_friction(stiff, PARAMETER, None)
    assert found.values[0] == pytest.approx(again.values[0], abs=1e-3)
    assert found.stds[0] == pytest.approx(again.stds[0], rel=0.1)


def swaying(trace, amplitude):
    """As an FR3 felt it whose joints swing by `amplitude`, rad, once a second while it drags."""
    chain, samples = load_description().nominal.chain, trace.samples
    low = samples.pose_world_tcp[:, 2] < GRASP[2] + 0.005
    size = amplitude * np.convolve(low, np.hanning(100) / np.hanning(100).sum(), mode="same")
    joints = np.array([1.0, 1.0, 0.0, -1.0, 0.0, 1.0, 0.0])
    q = load_description().home + np.outer(size * np.sin(2 * np.pi * samples.t), joints)
    # A row is the mean over its period: what was gained from its beginning to its end.
    dq, ddq = gained(q, samples.t), gained(np.gradient(q, samples.t, axis=0), samples.t)
    nothing = replace(samples, q=q, dq=dq, tau_ext=np.zeros(q.shape), wrench=np.zeros((len(q), 6)))
    hand = replace(trace.hand, chain=chain)
    maps = observe(replace(trace, samples=nothing, hand=hand)).maps(q)
    tau = (maps @ samples.wrench[:, :, None])[:, :, 0] + own_motion(chain, q, dq, ddq)
    wrench = (np.linalg.pinv(maps) @ tau[:, :, None])[:, :, 0]
    return replace(trace, samples=replace(nothing, tau_ext=tau, wrench=wrench), hand=hand)


def gained(values, t):
    """A second, as rows are logged: each is the mean since the one before."""
    return np.diff(values, axis=0, prepend=values[:1]) / np.diff(t, prepend=-1.0)[:, None]


def test_inertia_of_a_swaying_arm_is_no_friction(bench, noises, monkeypatch):
    """On springs of 800 N/m it sways for a second after each breakaway."""
    monkeypatch.setattr("recordings.APPARENT", 0.0)
    still, sways = (swaying(drag(bench, noises["none"]), size) for size in (0.0, 0.005))
    assert np.abs(sways.samples.wrench - still.samples.wrench)[:, :3].max() > 0.5
    found = estimate_friction(sways, PARAMETER, None)
    assert found.values[0] == pytest.approx(DYNAMIC, abs=2e-3)
    assert found.parts["static"].value == pytest.approx(STATIC, abs=0.03)


def test_friction_without_a_drag_is_not_identified(weighing, noises):
    trace = weighing(0.254, noises["none"])
    found = estimate_friction(trace, PARAMETER, None)
    assert found.verdict == "not identified"
    assert len(found.values) == 0


def test_friction_indistinguishable_from_zero_is_a_limit(bench, noises):
    """Something on ice, under a pressure that tells little."""
    trace = drag(bench, noises["lab"], 1, CONSTANT, static=0.05, dynamic=0.02)
    (found,) = estimate_all([PARAMETER], trace, {})
    assert found.verdict == "prior-dominated"
    assert found.doubt.startswith("at most 0.")
    assert found.ci95[0] < 0.0 < 0.02 < found.ci95[1]
    assert "static" not in found.parts
    assert len(found.evidence) == 4


def test_friction_as_uncertain_as_its_prior_is_prior_dominated(bench, noises):
    """Sensors whose gains may be off by 40 %, and a pressure that tells nothing of it."""
    trace = drag(bench, noises["none"], press=CONSTANT, static=1.1, dynamic=1.0)
    unsure = replace(trace, hand=replace(trace.hand, torque_gain=0.4))
    found = estimate_friction(unsure, PARAMETER, None)
    assert found.values[0] > 2.0 * found.stds[0] > 2.0 * PRIOR_SPREAD
    assert found.verdict == "prior-dominated"


def leash(stiffness):
    """A spring of so many N/m that is slack where the object was grasped."""
    return lambda position: stiffness * (np.array(GRASP) - position) * [1.0, 1.0, 0.0]


def zones(first, last):
    """The coefficient on either side of the middle of the slide."""
    middle = (GRASP[0] + GOAL[0]) / 2
    return lambda position: first if position[0] < middle else last


def slid(bench, noise, **world):
    return estimate_friction(drag(bench, noise, **world), PARAMETER, None)


def is_right(found):
    return found.verdict == "identified" and abs(found.z_score(DYNAMIC)) < 3


@pytest.mark.parametrize("world", ["lab", "datasheet"])
@pytest.mark.parametrize("stiffness", [5.0, 15.0, 60.0])
def test_a_leash_is_no_friction(bench, noises, world, stiffness):
    found = slid(bench, noises[world], pull=leash(stiffness))
    assert is_right(found)


def test_a_leash_on_a_slide_one_way(bench, noises):
    found = slid(bench, noises["lab"], pull=leash(15.0), there_and_back=False)
    assert is_right(found)


@pytest.mark.parametrize("seed", range(4))
def test_friction_of_a_slide_one_way_is_within_its_interval(bench, noises, seed):
    found = slid(bench, noises["datasheet"], seed=seed, there_and_back=False)
    assert is_right(found)


@pytest.mark.parametrize("force", [2.0, 12.0])
def test_a_magnet_presses_without_changing_the_friction(bench, noises, force):
    found = slid(bench, noises["lab"], attraction=force)
    assert abs(found.z_score(DYNAMIC)) < 3
    assert (found.verdict == "contradicted") == (force > 10)


def test_a_magnet_is_detected_where_the_pressure_hardly_changes(bench, noises):
    found = slid(bench, noises["lab"], press=(0.006, 0.0065, 0.006), attraction=12.0)
    assert found.verdict == "contradicted"


def test_a_force_on_the_object_in_the_air_contradicts_its_friction(bench, noises):
    """The drags are measured against the object hanging free."""
    trace = drag(bench, noises["lab"], 1)
    samples = trace.samples
    held = samples.width < 0.06
    pull = 30.0 * (samples.pose_world_tcp[:, 2] - GRASP[2]) * held
    wrench = samples.wrench + np.outer(pull, np.eye(6)[2])
    found = estimate_friction(
        replace(trace, samples=replace(samples, wrench=wrench)), PARAMETER, None
    )
    assert found.verdict == "contradicted"
    assert "along the lift" in {test.name for test in found.tests if not test.passed}


def test_two_zones_are_not_one_friction(bench, noises):
    found = slid(bench, noises["lab"], dynamic=zones(0.2, 0.5))
    assert found.verdict == "contradicted"
    assert "differs along the way" in found.contradiction


def test_two_axes_that_differ_are_not_one_friction(bench, noises):
    along, across = (0.6, 0.1, 0.2), (0.6, 0.2, 0.2)
    b = grasped(bench, noises["lab"])
    for place, dynamic in ((along, 0.25), (across, 0.5), (along, 0.5), (GRASP, 0.25)):
        slide(b, place, PRESSED, dynamic=dynamic)
    found = estimate_friction(released(b), PARAMETER, None)
    assert found.verdict == "contradicted"
    assert "between axes" in found.contradiction


CORNER = (0.55, 0.15, 0.2)


def triangle(bench, noise, seed=0, frictions=(DYNAMIC,) * 3, fast=1.0):
    """A plan's slides: along one axis and back aside, each slow, then twice as fast, where friction is
    `fast` times what it is."""
    return estimate_friction(
        slid_in_a_triangle(bench, noise, seed, frictions, fast), PARAMETER, None
    )


def slid_in_a_triangle(bench, noise, seed=0, frictions=(DYNAMIC,) * 3, fast=1.0):
    b = grasped(bench, noise, seed)
    for place, dynamic in zip((GOAL, CORNER, GRASP), frictions, strict=True):
        middle = (np.array(b.position) + place) / 2
        b.drag("middle", middle, STATIC, dynamic, PRESSED[:2])
        b.drag("place", place, STATIC, fast * dynamic, PRESSED[1:], speed=0.04)
    return released(b)


@pytest.mark.parametrize("world", ["lab", pytest.param("datasheet", marks=pytest.mark.long)])
def test_uniform_friction_in_a_triangle_is_precise(bench, noises, world):
    found = [triangle(bench, noises[world], seed) for seed in range(6)]
    assert all(is_right(each) for each in found)
    errors = np.array([each.values[0] - DYNAMIC for each in found])
    assert np.sqrt(np.mean(errors**2)) < 0.008


@pytest.mark.parametrize("frictions", [(0.25, 0.4, 0.4), (0.5, 0.4, 0.4)])
def test_a_triangle_shows_friction_that_differs_between_axes(bench, noises, frictions):
    found = triangle(bench, noises["lab"], frictions=frictions)
    assert found.verdict == "contradicted"
    assert "between axes" in found.contradiction


def test_friction_differences_of_a_few_per_cent_are_in_the_interval(bench, noises):
    alike = triangle(bench, noises["lab"])
    found = triangle(bench, noises["lab"], frictions=(0.36, 0.33, 0.33))
    assert found.verdict == "identified"
    assert found.stds[0] > alike.stds[0]
    assert found.intervals[0, 0] < 0.345 < found.intervals[0, 1]


def test_friction_that_changes_with_the_speed_is_contradicted(bench, noises):
    found = triangle(bench, noises["lab"], fast=0.7)
    assert found.verdict == "contradicted"
    assert "twice as fast" in found.contradiction


def test_a_steep_support_is_met_both_ways(bench, noises):
    steep = 0.017
    b = grasped(bench, noises["lab"])
    slide(b, GOAL, PRESSED, dynamic=DYNAMIC + steep)
    slide(b, GRASP, PRESSED, dynamic=DYNAMIC - steep)
    assert is_right(estimate_friction(released(b), PARAMETER, None))


def test_an_object_slipping_in_the_fingers_has_no_friction(bench, noises):
    """What the fingers hold back is the same however hard they press."""
    b = grasped(bench, noises["lab"])
    for place in (GOAL, GRASP):
        slide(b, place, PRESSED, static=0.01, dynamic=0.01, attraction=300.0)
    found = estimate_friction(released(b), PARAMETER, None)
    assert found.verdict != "identified"


def test_a_hand_that_is_held_back_measures_no_friction(bench, noises):
    """An object that sticks and slips: the hand stands still, and jumps."""
    trace = drag(bench, noises["lab"])
    samples = trace.samples
    sticks = (np.floor(samples.t / 0.1) % 2 == 0)[:, None]
    jerky = replace(samples, twist=np.where(sticks, 0.2, 1.8) * samples.twist)
    found = estimate_friction(replace(trace, samples=jerky), PARAMETER, None)
    assert found.verdict == "contradicted"
    assert "sticks and slips" in found.contradiction


def chattering(trace, parts):
    """With the force of so many of its drags swinging by 1 N at 15 Hz."""
    samples, wrench = trace.samples, trace.samples.wrench.copy()
    slides = [
        recording for recording in trace.recordings if recording.context.activity == "sliding"
    ]
    for slide in slides[:parts]:
        rows = (samples.t > slide.start) & (samples.t < slide.end)
        wrench[rows, 0] += np.sin(2.0 * np.pi * 15.0 * samples.t[rows])
    return replace(trace, samples=replace(samples, wrench=wrench))


def test_drags_that_chatter_are_left_out_and_nothing_else_is_not_enough(bench, noises):
    trace = drag(bench, noises["lab"])
    some = estimate_friction(chattering(trace, 2), PARAMETER, None)
    assert is_right(some)
    assert "2 drags" in some.method
    every = estimate_friction(chattering(trace, 4), PARAMETER, None)
    assert every.verdict == "contradicted"
    assert "chatters" in every.contradiction


@pytest.mark.parametrize("seed", range(2))
def test_a_six_axis_sensor_measures_friction_without_the_joints(bench, noises, seed):
    """The external wrench is the sensor's: no friction of the joints, and its own gain and cross-talk."""
    trace = slid_in_a_triangle(bench, noises["none"])
    random, samples = np.random.default_rng(seed), trace.samples
    wrench = samples.wrench + random.normal(size=samples.wrench.shape) * [*[0.15] * 3, *[0.01] * 3]
    crossed = np.eye(6)
    crossed[:2, 2] = 0.005 * random.normal(size=2)  # a part of the normal force along the others
    sensor = WrenchSensor("test", (0.0, 0.0, -0.1, 1.0, 0.0, 0.0, 0.0), gain=0.005)
    sensed = replace(
        trace,
        samples=replace(samples, wrench=wrench @ crossed.T, wrench_sensor=wrench),
        hand=replace(trace.hand, wrench_sensor=sensor, torque_gain=0.03),
    )
    assert observe_wrench(sensed).sensed
    found = estimate_friction(sensed, PARAMETER, None)
    assert found.verdict == "identified"
    assert found.stds[0] < 0.006
    assert abs(found.values[0] - DYNAMIC) < 3.0 * found.stds[0]
