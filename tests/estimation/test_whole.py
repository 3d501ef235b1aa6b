"""A load from all that an arm did in free air: a recorded lift and a hammer held in three grasps, at `lab`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from palpate.common.parameter import Parameter
from palpate.estimation.holds import find_holds
from palpate.estimation.load_blocks import free_rows
from palpate.estimation.load_fit import fit_load, fit_whole
from palpate.estimation.weighing import weigh
from palpate.execution.simulated_cell import simulated_cell
from palpate.runs import pipeline
from palpate.runs.settings import Settings
from palpate.scene.load import parse_scene
from palpate.studies.scenarios.catalogue import scenario

TRUTH = 0.187
"""kg."""
DESK = """<mujoco><worldbody><site name="robot_base"/>
<body name="table" pos="0.5 0 {top}"><geom type="box" size="0.5 0.6 0.02" friction="0.3"/></body>
<body name="mug" pos="0.5 0.1 0.045"><freejoint/><geom type="cylinder" size="0.035 0.045" {mug}/></body>
</worldbody></mujoco>"""


def recorded(name: str):
    settings = scenario(name).settings(noise="lab", seed=501).check_values()
    return pipeline.measure(pipeline.plan(settings, pipeline.load(settings)))


@pytest.fixture(scope="module")
def trace():
    return recorded("one_missing_mass").trace


@pytest.fixture(scope="module")
def hammer():
    return recorded("hammer")


def test_the_fit_is_narrower_than_the_contrast_along_the_path_and_calibrated(trace):
    weight = weigh(trace, trace.recordings[-1])
    assert weight.whole is not None
    assert abs(weight.mass - TRUTH) < 3.0 * weight.std
    assert weight.std < 0.75e-3


def test_the_weight_is_between_the_contrast_and_the_fit_and_no_wider_than_the_fit(trace):
    weight = weigh(trace, trace.recordings[-1])
    alone = fit_whole(trace, "green_bottle", weight.weighings[0].noise, weight.load.force)
    assert alone is not None
    low, high = sorted((alone.force, weight.load.force))
    assert low < weight.best.force < high
    assert weight.best.force_std == alone.force_std
    # A gain moves the weight by its mean effect on both.
    gains = [{one.cause: one.effect[0] for one in each.shared} for each in (alone, weight.load)]
    mixed = {one.cause: one.effect[0] * trace.gravity for one in weight.shared}
    share = (weight.best.force - alone.force) / (weight.load.force - alone.force)
    for cause, effect in gains[1].items():
        assert mixed[cause] == pytest.approx(gains[0][cause] * (1.0 - share) + effect * share)


def test_a_part_that_ends_in_motion_weighs_as_well(trace):
    """Smoothing that counts rows beyond the end as zeros made the contrast 30 times as wide."""
    samples, last = trace.samples, trace.recordings[-1]
    moving = (samples.t > last.end + 4.5) & (np.abs(samples.dq[:, 1]) > 0.15)
    part = trace.during(0.0, float(samples.t[moving][0]))
    whole, cut = weigh(trace, last), weigh(part, last)
    assert cut.load.force_std < 1.2 * whole.load.force_std
    assert cut.std < 1.2 * whole.std
    assert abs(cut.mass - TRUTH) < 3.0 * cut.std


def spoilt_by(trace, torque: np.ndarray):
    """The load of `trace` before and after a further `torque` (n,), N m, in joint 2."""
    samples = trace.samples
    external = samples.tau_ext.copy()
    external[:, 1] += torque
    spoilt = replace(trace, samples=replace(samples, tau_ext=external))
    before = weigh(trace, trace.recordings[-1]).whole
    weight = weigh(spoilt, spoilt.recordings[-1])
    whole = fit_whole(spoilt, "green_bottle", weight.weighings[0].noise, 1.8)
    assert before is not None
    assert whole is not None
    assert abs(whole.force / spoilt.gravity - TRUTH) < 3.0 * whole.force_std / spoilt.gravity
    assert float(np.mean(whole.posterior.residual**2)) < 1.2
    return whole.force_std / before.force_std


def test_unexplained_residuals_widen_the_fit(trace):
    assert spoilt_by(trace, 0.1 * np.sin(3.0 * trace.samples.t)) > 1.5


def test_residuals_that_repeat_with_the_angle_widen_the_fit_less(trace):
    """Ripple is the same with and without the load, and most of it cancels."""
    q = trace.samples.q[:, 1]
    assert spoilt_by(trace, 0.1 * np.sin(30.0 * q)) < 1.5


@pytest.fixture(scope="module")
def in_one_go():
    """Height, mass and friction, at the default noise."""
    asked = ("table.height", "mug.mass", "mug.friction")
    settings = Settings(measure=asked, noise="measured", seed=1).check_values(at_hand=True)
    scene = parse_scene(DESK.format(top="?", mug='mass="?" friction="?"'))
    world = parse_scene(DESK.format(top="-0.02", mug='mass="0.3" friction="0.5"'))
    cell = simulated_cell(scene, world, noise="measured", seed=1)
    return pipeline.execute(pipeline.plan(settings, scene), cell).trace


def test_a_slow_descent_before_the_lift_does_not_widen_the_mass(in_one_go):
    lift = in_one_go.converted(Parameter("mug", "mass"))
    probed = in_one_go.converted(Parameter("table", "height"))
    assert probed.end < lift.start
    together = weigh(in_one_go, lift)
    alone = weigh(in_one_go.during(probed.end + 1.0, np.inf), lift)
    assert together.std < 1.25 * alone.std
    assert abs(together.mass - 0.3) < 2.0 * together.std


def test_the_way_back_after_a_drag_counts_as_without_one(in_one_go):
    drags = [one for one in in_one_go.recordings if one.context.activity == "sliding"]
    rows = free_rows(in_one_go, "mug", surely=True)
    after = [part for part in rows if in_one_go.t[part[0]] > drags[-1].end]
    assert len(after) >= 10


def test_a_tilted_load_is_free_when_its_far_end_is(hammer):
    body = hammer.scene.bodies["hammer"]
    found = find_holds(hammer.trace, body)
    assert found is not None
    whole = fit_whole(hammer.trace, "hammer", found.weighings[0].noise, found.load.force)
    assert whole is not None
    assert abs(whole.force - found.load.force) < 3.0 * found.load.force_std


def test_moments_of_a_long_object_are_narrower_than_from_its_holds_and_agree(hammer):
    found = find_holds(hammer.trace, hammer.scene.bodies["hammer"])
    assert found is not None
    assert found.by_all_motion
    contrast = fit_load(found.weighings, hammer.trace.gravity, hammer.trace.hand)
    std, wider = (np.sqrt(np.diag(load.covariance)) for load in (found.load, contrast))
    assert np.all(std < 0.9 * wider)
    assert np.all(np.abs(found.load.value - contrast.value) < 3.0 * wider)


def test_errors_of_links_and_gains_are_in_the_deviation_of_moments(hammer):
    found = find_holds(hammer.trace, hammer.scene.bodies["hammer"])
    assert found is not None
    shared = np.array([one.effect for one in found.load.shared]).T
    assert np.all((shared**2).sum(axis=1) < np.diag(found.load.covariance))
