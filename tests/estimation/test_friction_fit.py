"""A friction from all that an arm did around its drags, on one recorded slide at `lab`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bench.bounds.loads import of_friction
from palpate.estimation.drags import steady_drags
from palpate.estimation.friction_fit import fit_sliding, fit_whole
from palpate.estimation.joint_friction import dahl
from palpate.estimation.wrench_observation import observe
from palpate.robots.simulated.noise.model import NoiseModel
from palpate.runs import pipeline
from palpate.studies.scenarios.catalogue import scenario

TRUTH, MASS = 0.34, 0.32


@pytest.fixture(scope="module")
def run():
    settings = scenario("friction").settings(noise="lab", seed=501).check_values()
    return pipeline.measure(pipeline.plan(settings, pipeline.load(settings)))


def fitted(trace):
    observed = observe(trace)
    drags = steady_drags(trace, "bottle", observed)
    found = fit_sliding(drags, observed, trace.hand).friction
    return found, fit_whole(trace, "bottle", drags, observed, found[0])


def bound(run, **noise):
    return of(run, {"torque": {"white": 0.1} | noise})


def of_lean(run, **model):
    return of(run, {"torque": {"white": 0.1}, "model": model})


def of(run, noise):
    standing = run.scene.bodies["bottle"].pose_world.rotation
    model = NoiseModel.model_validate(noise)
    about = MASS, TRUTH
    return of_friction(run.trace, "bottle", standing, about, run.scene.arm, model)


def test_the_fit_is_narrower_than_a_regression_on_pressure_and_calibrated(run):
    (_, std), whole = fitted(run.trace)
    assert whole.explains
    assert whole.std < 0.5 * std
    assert abs(whole.friction - TRUTH) < 3.0 * whole.std
    assert any(cause.cause.startswith("lean of support") for cause in whole.shared)


def test_the_coefficient_does_not_depend_on_where_the_fit_begins(run):
    observed = observe(run.trace)
    drags = steady_drags(run.trace, "bottle", observed)
    begins = [share * TRUTH for share in (0.8, 1.2)]
    low, high = (fit_whole(run.trace, "bottle", drags, observed, about) for about in begins)
    assert abs(low.friction - high.friction) < 0.1 * low.std
    # Errors in common with other runs are parts of the deviation.
    shared = np.array([one.effect[0] for one in low.shared])
    assert float(shared @ shared) < low.std**2


def test_residuals_of_the_arm_model_widen_the_friction(run):
    _, whole = fitted(run.trace)
    samples, before = run.trace.samples, whole.std
    for size in (0.03, 0.15):
        torques = samples.tau_ext.copy()
        torques[:, 1] += size * np.sin(30.0 * samples.q[:, 1])
        rippled = replace(run.trace, samples=replace(samples, tau_ext=torques))
        _, spoilt = fitted(rippled)
        assert spoilt.std > before
        assert abs(spoilt.friction - TRUTH) < 3.0 * spoilt.std
        before = spoilt.std


def test_friction_of_a_joint_is_none_of_the_support(run):
    """Half a newton metre more in the elbow, where it turned last while the object hangs and while it slides."""
    samples, observed = run.trace.samples, observe(run.trace)
    steps = np.diff(samples.q, axis=0, prepend=samples.q[:1])
    rubs = 0.5 * dahl(steps, np.array([2e-3]))[0][:, :, 0] * np.eye(7)[3]
    wrench = np.einsum("nij,nj->ni", np.linalg.pinv(observed.maps(samples.q)), rubs)
    torques, wrench = samples.tau_ext + rubs, samples.wrench + wrench
    rubbing = replace(run.trace, samples=replace(samples, tau_ext=torques, wrench=wrench))
    friction, std = fit_sliding(
        steady_drags(rubbing, "bottle", observed), observed, rubbing.hand
    ).friction
    assert friction == pytest.approx(TRUTH, abs=0.005)
    assert std < 0.01


def test_zeros_that_jump_in_the_drags_are_seen(run):
    samples, observed = run.trace.samples, observe(run.trace)
    drags = steady_drags(run.trace, "bottle", observed)
    later = samples.t > drags[2].t[0]
    torques, wrench = samples.tau_ext.copy(), samples.wrench.copy()
    torques[later] += observed.maps(samples.q[later])[:, :, 1]
    wrench[later, 1] += 1.0
    jumped = replace(run.trace, samples=replace(samples, tau_ext=torques, wrench=wrench))
    assert not fitted(jumped)[1].explains


def test_an_arm_with_unknown_links_gives_no_better_friction(run):
    hand = run.trace.hand
    unknown = replace(run.trace, hand=replace(hand, chain=replace(hand.chain, links=())))
    assert fitted(unknown)[1] is None


def test_sliding_before_the_steady_state_counts(run):
    drags = steady_drags(run.trace, "bottle", observe(run.trace))
    assert sum(len(drag.slid) for drag in drags) > 1.2 * sum(len(drag.blocks) for drag in drags)


@pytest.mark.parametrize("stiffness", [0.0, 20.0])
def test_a_pull_that_depends_on_the_place_is_detected(run, stiffness):
    samples, observed = run.trace.samples, observe(run.trace)
    torques, wrench = samples.tau_ext.copy(), samples.wrench.copy()
    for drag in steady_drags(run.trace, "bottle", observed):
        rows = (samples.t >= drag.t[0]) & (samples.t <= drag.t[-1])
        pull = stiffness * (samples.pose_world_tcp[rows, 1] - 0.07)
        torques[rows] += pull[:, None] * observed.maps(samples.q[rows])[:, :, 1]
        wrench[rows, 1] += pull
    pulled = replace(run.trace, samples=replace(samples, tau_ext=torques, wrench=wrench))
    _, whole = fitted(pulled)
    assert abs(whole.friction - TRUTH) < 3.0 * whole.std
    _, level = fitted(run.trace)
    assert (whole.std > 1.1 * level.std) == (stiffness > 0.0)


def test_the_tilt_of_the_arms_frame_is_in_the_bound(run):
    assert bound(run) < of_lean(run, base_tilt=5e-3)
    assert bound(run) < of_lean(run, joint_offset=5e-3)


def test_gains_act_on_what_a_support_does_in_the_bound(run):
    assert bound(run) < 1e-3
    assert bound(run, gain_max=0.01) > 2.0 * bound(run)
