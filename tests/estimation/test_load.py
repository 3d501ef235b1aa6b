"""What hangs on the hand: joints, noise, and what else may act on it.

The joints are those of a real arm's kinematics; loads, springs and noise are made from the physics.
"""

import re
from dataclasses import replace

import numpy as np
import pytest

from palpate.common.parameter import Parameter
from palpate.common.pose import Pose
from palpate.estimation.load_equations import FORCE_Z
from palpate.estimation.load_fit import fit_load
from palpate.estimation.load_noise import block_noise
from palpate.estimation.quantities.mass import estimate_mass
from palpate.estimation.segments import weighings
from palpate.estimation.wrench_observation import crosstalk, observe
from palpate.robots.nominal import NominalArm
from palpate.robots.owner import load_description
from palpate.trace.samples import STANDARD_GRAVITY

ARM = load_description("fr3")
MASS, BOTTLE = 0.35, Parameter("bottle", "mass")
WEIGHT = MASS * STANDARD_GRAVITY
TURNED = Pose.of((0.0, 0.0, 0.0), (np.cos(0.2), 0.0, 0.0, np.sin(0.2)))
"""The base in the world."""


def jointed(trace, seed=0, white=0.03, gain=(0.0,) * 7, extra=None):
    """The same recording felt by an arm's joints: their angles lie along the path, their torques are
    J^T of the wrench (and of `extra`, a function of the samples), each with its own noise and gain."""
    samples, rng = trace.samples, np.random.default_rng(seed)
    height = samples.pose_world_tcp[:, 2] - samples.pose_world_tcp[:, 2].min()
    # A line in joint space stands for the lift; the wrench is what is looked at.
    q = ARM.home + np.outer(height, [0.0, -1.2, 0.0, -0.4, 0.0, 0.9, 0.0])
    chain = NominalArm(ARM, TURNED, np.array([0.0, 0.0, -STANDARD_GRAVITY])).kinematics(q)
    wrench = samples.wrench if extra is None else samples.wrench + extra(samples)
    torque = np.einsum("nij,ni->nj", chain.jacobian, wrench)
    torque = torque * (1.0 + np.array(gain)) + white * rng.standard_normal(torque.shape)
    orientation = np.tile(chain.pose_world_tcp[0, 3:], (len(q), 1))
    pose = np.column_stack([samples.pose_world_tcp[:, :3], orientation])
    observed = replace(samples, q=q, tau_ext=torque, wrench=wrench, pose_world_tcp=pose)
    # What moved is a point's mass, not the links of that arm.
    chain = replace(ARM.nominal.chain, links=())
    return replace(trace, samples=observed, hand=replace(ARM.nominal, chain=chain))


@pytest.fixture
def lifted(weighing, noises):
    """A bottle lifted, held and put back, felt by joints."""

    def made(seed=0, **more):
        return jointed(weighing(MASS, noises["none"], seed), seed, **more)

    return made


def test_joints_tell_of_the_wrench_in_world_axes(lifted):
    trace = lifted(white=0.0)
    observed = observe(trace)
    assert observed.signals.shape[1] == 7
    maps = observed.maps(trace.samples.q[:5])
    for row, signals, wrench in zip(maps, observed.signals, trace.wrench, strict=False):
        assert np.linalg.pinv(row) @ signals == pytest.approx(wrench, abs=1e-6)


@pytest.mark.parametrize(
    "chain", [None, replace(ARM.nominal.chain, axes=ARM.nominal.chain.axes[::-1])]
)
def test_joints_that_do_not_explain_the_wrench_are_not_believed(lifted, chain):
    trace = lifted()
    observed = observe(replace(trace, hand=replace(trace.hand, chain=chain)))
    assert observed.signals is trace.samples.wrench
    assert observed.maps(trace.samples.q[:2]).shape == (2, 6, 6)


@pytest.mark.long
def test_a_load_is_weighed_by_joints(lifted):
    found = [estimate_mass(lifted(seed), BOTTLE, None) for seed in range(20)]
    errors = np.array([(one.values[0] - MASS) / one.stds[0] for one in found])
    assert np.abs(errors).max() < 3.5
    assert all(one.identified for one in found)
    assert max(one.stds[0] for one in found) < 0.015 * MASS


@pytest.mark.long
def test_gains_are_carried_through_the_jacobian(lifted):
    rng = np.random.default_rng(3)
    scores, stated = [], []
    for seed in range(20):
        gain = ARM.nominal.torque_gain * rng.uniform(-1.0, 1.0, 7)
        found = estimate_mass(lifted(seed, gain=gain, white=1e-4), BOTTLE, None)
        assert found.identified, found.contradiction
        scores.append((found.values[0] - MASS) / found.stds[0])
        stated.append(found.stds[0])
    assert 0.5 < np.std(scores) < 1.3
    # One joint's gain error is 0.6 % of what it bears; several bear a load.
    assert 0.002 * MASS < np.mean(stated) < 0.01 * MASS


def test_gains_that_are_known_for_certain_add_nothing(lifted):
    trace = lifted()
    certain = replace(trace, hand=replace(trace.hand, torque_gain=0.0))
    told, unsure = (estimate_mass(one, BOTTLE, None) for one in (certain, trace))
    assert told.identified
    assert abs(told.values[0] - MASS) < 3.5 * told.stds[0]
    assert told.stds[0] < unsure.stds[0]


def test_a_sensor_reads_some_of_the_torques_in_the_other_joints(lifted):
    """As much in a joint as one standard deviation of it moves the mass by the effect that is stated."""
    trace = lifted(white=1e-4)
    read = crosstalk(trace.hand, trace.samples.tau_ext)
    told = estimate_mass(trace, BOTTLE, None)
    effects = {one.cause: one.effect[0] for one in told.shared}
    moved: list[float] = []
    for joint in (1, 3, 5):
        tau_ext = trace.samples.tau_ext + read * np.eye(7)[joint]
        crossed = replace(trace, samples=replace(trace.samples, tau_ext=tau_ext))
        moved.append(float(estimate_mass(crossed, BOTTLE, None).values[0] - told.values[0]))
    stated = [effects[f"cross-talk in joint {joint + 1}"] for joint in (1, 3, 5)]
    assert np.abs(moved) == pytest.approx(np.abs(stated), rel=0.2)
    assert 0.0005 * MASS < np.linalg.norm(stated) < told.stds[0]


def upward(force):
    """A vertical force (n,) as a wrench."""
    return np.outer(force, np.eye(6)[FORCE_Z])


def held(samples):
    return (samples.width < 0.06).astype(float)


def height(samples):
    return samples.pose_world_tcp[:, 2] - 0.2


def staying(seed):
    """What each rest leaves in the joints until the next one, of the size that a datasheet allows."""

    def forces(samples):
        rests = np.linalg.norm(samples.twist[:, :3], axis=1) < 1e-4
        begins = np.diff(rests.astype(int), prepend=0) > 0
        drawn = np.random.default_rng(seed).normal(0.0, 0.15, (1 + begins.sum(), 3))
        return np.hstack([drawn, np.zeros_like(drawn)])[np.cumsum(begins)]

    return forces


@pytest.mark.parametrize(("force", "verdict"), [(0.25, "identified"), (1.5, "contradicted")])
def test_a_rest_may_be_off_by_what_approaches_leave(lifted, force, verdict):
    """Which the datasheet says is 0.15 N, with the load and without."""

    def at_rest(samples):
        return np.linalg.norm(samples.twist[:, :3], axis=1) < 1e-4

    trace = lifted(extra=lambda samples: upward(force * held(samples) * at_rest(samples)))
    found = estimate_mass(trace, BOTTLE, None)
    assert found.verdict == verdict
    assert abs(found.values[0] - MASS) < 3.0 * found.stds[0]


def test_lasting_jumps_at_a_rest_widen_the_mass(lifted):
    found = [estimate_mass(lifted(seed, extra=staying(seed)), BOTTLE, None) for seed in range(12)]
    errors = np.array([one.values[0] - MASS for one in found])
    stated = np.array([one.stds[0] for one in found])
    assert 0.8 < np.sqrt(np.mean(stated**2) / np.mean(errors**2)) < 1.5
    assert np.mean([one.intervals[0, 0] < MASS < one.intervals[0, 1] for one in found]) >= 0.9


def test_rests_that_agree_tell_that_nothing_stays(lifted):
    kept = estimate_mass(lifted(extra=staying(0)), BOTTLE, None).stds[0]
    assert estimate_mass(lifted(), BOTTLE, None).stds[0] < 0.3 * kept


def test_a_force_that_reverses_with_the_direction_cancels(lifted):
    """A quarter of a newton against the motion, with the load and without."""
    trace = lifted(extra=lambda samples: upward(0.25 * np.sign(samples.twist[:, 2])))
    found = estimate_mass(trace, BOTTLE, None)
    assert abs(found.values[0] - MASS) < 3.0 * found.stds[0]
    assert found.stds[0] < 1.3 * estimate_mass(lifted(), BOTTLE, None).stds[0]


DECEPTIONS = {
    "along the lift": lambda s: upward(30.0 * height(s) * held(s)),
    "sideways": lambda s: np.outer(0.6 * held(s), np.eye(6)[1]),
    "up against down": lambda s: upward(0.3 * held(s) * np.sign(s.twist[:, 2])),
    "jump": lambda s: upward(1.5 * (s.t > 0.5 * s.t[-1])),
}


@pytest.mark.parametrize("kind", DECEPTIONS)
def test_another_force_on_a_load_contradicts_it(lifted, kind):
    found = estimate_mass(lifted(extra=DECEPTIONS[kind]), BOTTLE, None)
    assert found.verdict == "contradicted"
    if kind != "jump":
        assert kind in {test.name for test in found.tests if not test.passed}


@pytest.mark.parametrize("force", [0.8, -1.5])
def test_a_zero_that_jumps_as_the_hand_opens_contradicts_the_load(lifted, force):
    def jump(samples):
        return upward(force * (samples.t > samples.t[held(samples) > 0.0][-1]))

    found = estimate_mass(lifted(extra=jump), BOTTLE, None)
    assert found.verdict == "contradicted"
    after = next(test for test in found.tests if test.name == "before against after")
    assert not after.passed
    told = re.search(r"([0-9.]+) N (more|less)", after.finding)
    assert told
    assert told[2] == ("more" if force > 0.0 else "less")
    assert float(told[1]) == pytest.approx(abs(force), rel=0.05)


def test_a_spring_is_named_with_its_stiffness(lifted):
    found = estimate_mass(lifted(extra=DECEPTIONS["along the lift"]), BOTTLE, None)
    slope = next(test for test in found.tests if test.name == "along the lift")
    assert re.match("The force grows with the height, by (29|30|31) N/m", slope.finding)


def test_every_weighing_counts_and_one_that_disagrees_is_seen(bench, noises):
    def twice(second):
        b = bench(noises["lab"], 1)
        above, grasp = (0.5, 0.1, 0.32), (0.5, 0.1, 0.2)
        b.go("bottle_pose + z_offset", above)
        for mass in (MASS, second):
            b.go("bottle_pose", grasp)
            b.close("bottle", mass)
            b.go("bottle_pose + z_offset", above)
            b.convert("Force2Mass", "bottle", "mass", b.measure())
            b.go("bottle_pose", grasp)
            b.open()
            b.go("bottle_pose + z_offset", above)
        return b.trace()

    again = twice(MASS)
    load = fit_load(weighings(again, again.recordings[0]), STANDARD_GRAVITY, again.hand)
    assert len(load.grasps) == 2
    assert estimate_mass(again, BOTTLE, None).identified
    found = estimate_mass(twice(MASS + 0.05), BOTTLE, None)
    assert re.search(r"The weighings disagree: 3\.4\d, 3\.9\d N\.", found.contradiction)


def test_a_contradictory_weighing_does_not_count(bench, noises):
    b = bench(noises["none"], 1)
    for y in (0.1, 0.3):
        above, grasp = (0.5, y, 0.32), (0.5, y, 0.2)
        b.go("bottle_pose + z_offset", above)
        b.go("bottle_pose", grasp)
        b.close("bottle", MASS)
        b.go("bottle_pose + z_offset", above)
        b.convert("Force2Mass", "bottle", "mass", b.measure())
        b.go("bottle_pose", grasp)
        b.open()
        b.go("bottle_pose + z_offset", above)

    def caught(samples):
        # At the second place it hangs on to something: half of it is borne, and it is pulled.
        held_there = held(samples) * (samples.pose_world_tcp[:, 1] > 0.2)
        return np.outer(held_there, [0.0, 2.0, -WEIGHT / 2, 0.0, 0.0, 0.0])

    found = estimate_mass(jointed(b.trace(), extra=caught), BOTTLE, None)
    assert found.verdict == "contradicted"
    assert "sideways with 2" in found.contradiction
    assert abs(found.values[0] - MASS) < 3 * found.stds[0]


def test_white_and_slow_noise_are_separated():
    rng, t = np.random.default_rng(0), np.arange(0.0, 30.0, 0.005)
    slope = np.column_stack([t, t**2, np.sin(t / 20)])
    white = 0.04 * rng.standard_normal((len(t), 3))
    windows = [slice(k, k + 400) for k in range(0, len(t), 400)]
    calm = block_noise(slope + white, t, np.zeros(len(t)), windows)
    assert np.sqrt(calm.white) == pytest.approx(0.04, rel=0.1)
    assert np.sqrt(calm.flicker).max() < 0.005

    spectrum = np.fft.rfft(rng.standard_normal((len(t), 3)), axis=0)
    frequency = np.maximum(np.fft.rfftfreq(len(t), 0.005), 1 / 30)[:, None]
    # White noise of unit variance has the one-sided density 2 dt.
    pink = 0.02 * np.fft.irfft(spectrum / np.sqrt(frequency * 0.01), len(t), axis=0)
    slow = block_noise(slope + white + pink, t, np.zeros(len(t)), windows)
    assert np.sqrt(slow.flicker) == pytest.approx(0.02, rel=0.3)
    fewer = block_noise(slope + white + pink, t, np.zeros(len(t)), windows[:6])
    assert fewer.freedom < slow.freedom < calm.freedom


def test_noise_is_estimated_with_gaps_and_without_samples():
    t = np.concatenate([np.arange(0.0, 2.0, 0.005), np.arange(5.0, 7.0, 0.005)])
    steps = np.where(t < 3.0, 0.0, 50.0)[:, None] + np.zeros((1, 2))
    assert block_noise(steps, t, np.zeros(len(t)), [slice(0, len(t))]).white.max() < 1e-12
    assert block_noise(steps, t, np.zeros(len(t)), []).white.min() > 0.0


def test_stiction_in_slow_joints_is_not_part_of_the_load(lifted):
    """Their friction is what the last motion before left in them, and goes as they turn a little."""

    def with_friction(level):
        trace = lifted(white=0.003)
        samples = trace.samples
        q = samples.q.copy()
        # The load turns the wrist by half a millirad as it is taken up, and back again.
        sag = 5e-4 * np.clip(np.abs(samples.wrench[:, 2]) / WEIGHT, 0.0, 1.0)
        smooth = np.convolve(sag, np.ones(40) / 40, mode="same")
        q[:, 4] += smooth
        path = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(smooth)))])
        torque = samples.tau_ext.copy()
        torque[:, 4] += level * np.exp(-path / 2e-3)
        return replace(trace, samples=replace(samples, q=q, tau_ext=torque))

    def moment(trace):
        held = next(r for r in trace.recordings if r.context.holding == "bottle")
        return fit_load(weighings(trace, held), trace.gravity, trace.hand).value[1:]

    smooth, sticky = moment(with_friction(0.0)), moment(with_friction(0.3))
    assert sticky == pytest.approx(smooth, abs=0.01)


def bumps(samples):
    """What an uneven floor does to an object that is dragged over it: it wanders, in all directions."""
    wandering = np.random.default_rng(0).normal(0.0, 0.05, (len(samples), 6)).cumsum(axis=0)
    beside = samples.pose_world_tcp[:, 1] > 0.1005
    return np.where(beside[:, None], wandering, 0.0)


def test_ground_forces_on_a_dragged_object_are_not_noise_of_the_arm(bench, noises):
    b = bench(noises["none"], 1)
    above, grasp, there = (0.5, 0.1, 0.32), (0.5, 0.1, 0.2), (0.5, 0.18, 0.2)
    for _ in range(2):
        b.go("bottle_pose", grasp)
        b.go("bottle_pose + z_offset", above)
    b.go("bottle_pose", grasp)
    b.close("bottle", MASS)
    b.go("bottle_pose + z_offset", above)
    b.convert("Force2Mass", "bottle", "mass", b.measure())
    b.go("bottle_pose", grasp)
    for at, goal in (("bottle_pose + y_offset", there), ("bottle_pose", grasp)):
        b.drag(at, goal, 0.4, 0.3, (0.004, 0.004))
    trace = b.trace()
    even, uneven = (
        fit_load(weighings(one, one.recordings[0]), STANDARD_GRAVITY, one.hand)
        for one in (jointed(trace), jointed(trace, extra=bumps))
    )
    assert uneven.freedom > 0.8 * even.freedom
    assert uneven.force_std == pytest.approx(even.force_std, rel=0.05)
