"""Swings of a load: what unit parameters make of the signals is what the signals show."""

from dataclasses import replace

import numpy as np
import pytest
from moving_arm import friction
from scipy.spatial.transform import Rotation

from palpate.common.pose import Pose
from palpate.estimation.grip import EXPECTED, LIKELY, SPREAD, Droop
from palpate.estimation.load_noise import SignalLevels
from palpate.estimation.rigid_bodies import tool_kinematics
from palpate.estimation.swings import contrast, swings
from palpate.robots.owner import load_description
from palpate.trace.recording import Context, NominalHand, Recording
from palpate.trace.samples import FORCES, Samples, Trace

QUIET = SignalLevels(white=np.zeros(6), flicker=np.zeros(6), freedom=np.inf)
HAND = NominalHand(0.0, 0.1, 0.0, 1e-4)
MASS, FIRST, TENSOR = 0.4, np.array([0.02, 0.0, 0.004]), np.diag([1e-3, 3e-3, 4e-3])


def turned(angle):
    """A tool that points down, turned about world y."""
    half = angle / 2.0
    about_y = Pose.of(np.zeros(3), (np.cos(half), 0.0, np.sin(half), 0.0))
    return about_y @ Pose.top_down((0.5, 0.0, 0.4), 0.0)


def swing(ringing):
    """A swing at 2 Hz that follows its command late, and at first rings as springs do."""
    t = np.arange(0.0, 4.0, 0.005)
    inside = (t > 0.5) & (t < 3.5)
    since = t - 0.5

    def along(time):
        envelope = np.clip(time / 0.5, 0.0, 1.0) * np.clip((3.0 - time) / 0.5, 0.0, 1.0)
        return 0.07 * envelope * np.sin(4.0 * np.pi * time)

    told = np.where(inside, along(since), 0.0)
    angle = 0.07 * np.sin(4.0 * np.pi * since)
    angle += ringing * np.exp(-2.0 * np.maximum(since, 0.0)) * np.cos(10.0 * np.pi * since)
    rate, change = (np.gradient(angle, t), np.gradient(np.gradient(angle, t), t))
    poses = [turned(one) for one in angle]
    wrench = []
    for pose, w, a in zip(poses, rate, change, strict=True):
        first, tensor = pose.rotation @ FIRST, pose.rotation @ TENSOR @ pose.rotation.T
        spin, gain, up = (np.array(v) for v in ((0, w, 0), (0, a, 0), (0, 0, 9.81)))
        force = MASS * up + np.cross(gain, first) + np.cross(spin, np.cross(spin, first))
        moment = np.cross(first, up) + tensor @ gain + np.cross(spin, tensor @ spin)
        wrench.append(np.concatenate([force, moment]))
    twist = np.zeros((len(t), 6))
    twist[:, 4] = rate
    samples = Samples(
        t,
        np.zeros((len(t), 7)),
        np.zeros((len(t), 7)),
        np.zeros((len(t), 7)),
        np.array(wrench),
        np.array([pose.vector for pose in poses]),
        twist,
        np.array([turned(one).vector for one in told]),
        np.full(len(t), 0.02),
    )
    recording = Recording(FORCES, 0.0, 4.0, Context("swinging", holding="thing"))
    return Trace(samples, (), (recording,), (), HAND), recording


@pytest.mark.parametrize("ringing", [0.0, 0.01])
def test_the_inertia_is_found_for_any_lag_of_the_hand(ringing):
    trace, recording = swing(ringing)
    (found,) = swings(trace, recording, QUIET)
    theta = np.concatenate([[MASS], FIRST, np.diag(TENSOR), np.zeros(3)])
    assert found.rate == pytest.approx(4.0 * np.pi, rel=0.01)
    largest = np.abs(found.observed).max()
    assert found.load @ theta == pytest.approx(found.observed, abs=0.002 * largest)


def test_a_load_droops_the_way_its_weight_pulls():
    """About the tool's y, the farther the longer: what hangs out along the tool's x goes down."""
    in_hand = Pose.of((0.07, 0.0, 0.0))
    # Held up about the closing axis: with the tool down, along its -x.
    held = Droop.since(10.0, 20.0, 0.2)
    at_once, later = (held.turned(in_hand, np.array(soft)) for soft in ((0.1, 0.0), (0.1, 0.02)))
    assert at_once.position[2] == pytest.approx(0.07 * np.sin(0.1 * 0.2), rel=1e-6)
    assert later.position[2] == pytest.approx(0.07 * np.sin((0.1 + 0.02 * 10.0) * 0.2), rel=1e-6)
    assert held.turned(in_hand, np.zeros(2)).position == pytest.approx(in_hand.position)


def test_a_load_is_expected_to_droop_and_never_to_rise():
    drawn = LIKELY * np.abs(np.random.default_rng(0).standard_normal((100_000, 2)))
    assert drawn.mean(axis=0) == pytest.approx(EXPECTED, rel=0.01)
    assert drawn.std(axis=0) == pytest.approx(SPREAD, rel=0.01)


def test_a_grasp_without_a_recorded_time_has_no_age():
    assert Droop.since(-np.inf, 20.0, 0.2).age == 0.0


def test_slow_noise_is_estimated_at_the_frequency_of_the_swing():
    trace, recording = swing(0.0)
    wandering = SignalLevels(np.zeros(6), np.full(6, 4e-4), np.inf)
    found = swings(trace, recording, wandering)[0]
    # h²/f over a second of it for each second that it lasts: two of the three are steady.
    assert found.variance == pytest.approx(4e-4 / 2.0 / 2.0, rel=0.02)
    assert not swings(trace, recording, QUIET)[0].variance.any()


ARM = load_description("fr3")


def rippling(lean: float, holding: str | None):
    """A swing of joint 2 by 5 mrad, about a pose that leans by some rad: its gear ripples, and rubs as Maxwell elements
    do. Links and load weigh nothing."""
    t = np.arange(0.0, 4.0, 0.005)
    envelope = np.clip((t - 0.5) / 0.5, 0.0, 1.0) * np.clip((3.5 - t) / 0.5, 0.0, 1.0)
    angle = envelope * np.sin(4.0 * np.pi * (t - 0.5))
    q, dq = np.tile(ARM.home, (len(t), 1)), np.zeros((len(t), 7))
    q[:, 1] += lean + 0.005 * angle
    dq[:, 1] = np.gradient(q[:, 1], t)
    torques = friction(q)
    torques[:, 1] += 0.12 * np.sin(240.0 * q[:, 1])
    position, rotation, jacobian = tool_kinematics(ARM.nominal.chain, q)
    quaternions = Rotation.from_matrix(rotation).as_quat(scalar_first=True)
    samples = Samples(
        t,
        q,
        dq,
        torques,
        np.einsum("nij,nj->ni", np.linalg.pinv(jacobian.transpose(0, 2, 1)), torques),
        np.hstack([position, quaternions]),
        np.einsum("nij,nj->ni", jacobian, dq),
        np.hstack([position, quaternions]),
        np.full(len(t), 0.02),
    )
    recording = Recording(FORCES, 0.0, 4.0, Context("swinging", holding=holding))
    chain = replace(ARM.nominal.chain, links=())
    return Trace(samples, (), (recording,), (), replace(ARM.nominal, chain=chain)), recording


def test_ripple_and_friction_of_gears_are_no_load():
    """Bent by 4 mrad by the load, the arm ripples and rubs otherwise than with the empty hand, by 0.1 N m: that is in
    the model of what the gears do, and not in the noise."""
    quiet = SignalLevels(white=np.full(7, 1e-6), flicker=np.zeros(7), freedom=np.inf)
    empty, loaded = (swings(*rippling(*how), quiet) for how in ((0.0, None), (0.004, "thing")))
    ((_, observed, variance, gears),) = contrast(loaded, empty)
    both = np.sqrt(variance + (gears**2).sum(axis=1))
    assert abs(observed[1]) == pytest.approx(0.1, abs=0.05)
    assert abs(observed[1]) > 5.0 * np.sqrt(variance[1])
    assert abs(observed[1]) < 2.0 * both[1]
