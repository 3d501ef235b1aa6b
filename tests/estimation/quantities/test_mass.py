"""Mass: the bias goes, the interval means what it says."""

from dataclasses import replace

import numpy as np
import pytest

from palpate.common.parameter import Parameter
from palpate.estimation.quantities.estimators import estimate_all
from palpate.estimation.quantities.mass import estimate_mass

MASS = 0.254
SEEDS = range(20)


def weighed(trace):
    return estimate_mass(trace, Parameter("bottle", "mass"), None)


def errors(weighing, noise, mass=MASS):
    """Error, standard deviation, whether the interval covers, error of the single shot; per seed,
    kg."""
    rows = []
    for seed in SEEDS:
        found = weighed(weighing(mass, noise, seed))
        low, high = found.intervals[0]
        rows.append(
            (
                found.values[0] - mass,
                found.stds[0],
                low <= mass <= high,
                found.parts["single-shot"].value - mass,
            )
        )
    return np.array(rows).T


def test_perfect_sensors_give_the_mass(weighing, noises):
    found = weighed(weighing(MASS, noises["none"]))
    assert found.values[0] == pytest.approx(MASS, rel=3e-3)
    assert found.verdict == "identified"
    assert str(found.parameter) == "bottle.mass"


def test_mass_is_free_of_laboratory_noise_and_bias(weighing, noises):
    error, std, covers, single = errors(weighing, noises["lab"])
    assert abs(error.mean()) < 5e-4
    assert error.std() < 1.5e-3
    assert single.std() > 10 * error.std()
    assert covers.sum() >= 17
    assert std.max() < 5e-3


@pytest.mark.parametrize("told", [-0.45, 0.45])
def test_a_wrong_stated_end_effector_cancels(weighing, noises, told):
    """kg that Desk has too much or too little: far more than a datasheet's bias."""
    for seed in range(3):
        trace = weighing(MASS, noises["lab"], seed)
        wrench = trace.samples.wrench.copy()
        wrench[:, 2] += 9.81 * told
        biased = replace(trace, samples=replace(trace.samples, wrench=wrench))
        right, found = weighed(trace), weighed(biased)
        assert found.values[0] == pytest.approx(right.values[0], abs=1e-4)
        assert found.stds[0] == pytest.approx(right.stds[0], rel=0.1)


@pytest.mark.long
def test_residual_of_every_approach_does_not_reach_the_mass(weighing, noises):
    error, std, covers, single = errors(weighing, noises["datasheet"])
    assert error.std() < 5e-3
    assert single.std() > 0.012
    assert covers.sum() >= 17
    assert std.max() < 0.01


@pytest.mark.long
@pytest.mark.parametrize("mass", [0.016, 1.5])
def test_the_mass_of_light_and_heavy_objects_is_within_its_interval(weighing, noises, mass):
    error, _, covers, _ = errors(weighing, noises["lab"], mass)
    assert np.abs(error).max() < max(3e-3, 0.01 * mass)
    assert covers.sum() >= 17


def test_passes_at_another_speed_count_for_less(bench, noises):
    b = bench(noises["datasheet"], 1)
    above, grasp = (0.5, 0.1, 0.32), (0.5, 0.1, 0.2)
    b.go("bottle_pose + z_offset", above, 0.25)
    b.go("bottle_pose", grasp, 0.25)
    b.close("bottle", MASS)
    b.go("bottle_pose + z_offset", above, 0.12)
    b.convert("Force2Mass", "bottle", "mass", b.measure())
    b.go("bottle_pose", grasp, 0.12)
    b.open()
    b.go("bottle_pose + z_offset", above, 0.25)
    found = weighed(b.trace())
    assert abs(found.values[0] - MASS) < 2 * found.stds[0]
    assert found.stds[0] > 4e-3


def test_mass_before_the_release_is_provisional(weighing, noises):
    trace = weighing(MASS, noises["lab"], 3)
    early = weighed(trace.until(trace.conversions[0].time))
    late = weighed(trace)
    assert early.stds[0] > 2 * late.stds[0]
    assert abs(early.values[0] - MASS) < 3 * early.stds[0]


def test_mass_without_a_reference_contains_the_bias_of_the_datasheet(bench, noises):
    b = bench(noises["lab"], 2)
    b.close("bottle", MASS)
    b.go("elsewhere", (0.5, 0.2, 0.6))
    b.convert("Force2Mass", "bottle", "mass", b.measure())
    found = weighed(b.trace())
    assert found.stds[0] > 0.03
    assert found.intervals[0][0] <= MASS <= found.intervals[0][1]
    assert "no unloaded" in found.method
    assert found.verdict == "prior-dominated"


def test_a_mass_near_zero_is_a_limit(weighing, noises):
    """The datum is unconstrained, and may be negative; what a twin holds may not."""
    trace = weighing(1e-4, replace(noises["datasheet"], white=0.8), 5)
    (found,) = estimate_all([Parameter("bottle", "mass")], trace, {})
    assert found.values[0] < 0.0
    assert abs(found.z_score(1e-4)) < 2.0
    assert found.verdict == "prior-dominated"
    assert found.doubt.startswith("at most 0.0")
    assert 0.0 < float(found.physical) < found.limits[0]
    # The chart's fit is the card's value.
    assert found.views[0].predicted[0] == pytest.approx(found.values[0])


def test_z_of_an_empty_hand_is_standard_normal(weighing, noises):
    noise = replace(noises["lab"], white=0.4)
    parameter = Parameter("bottle", "mass")
    found = [estimate_all([parameter], weighing(1e-6, noise, seed), {})[0] for seed in range(12)]
    z = np.array([one.z_score(0.0) for one in found])
    assert min(z) < -0.3
    assert max(z) > 0.3
    assert 0.4 < np.sqrt(np.mean(z**2)) < 1.6


def test_another_object_in_the_hand_is_not_a_reference(bench, noises):
    b = bench(noises["none"])
    above, grasp = (0.5, 0.1, 0.32), (0.5, 0.1, 0.2)
    for name, mass in (("can", 0.5), ("bottle", MASS)):
        b.go("a", above)
        b.go("b", grasp)
        b.close(name, mass)
        b.go("a", above)
        recording = b.measure()
        b.go("b", grasp)
        b.open()
    b.go("a", above)
    b.convert("Force2Mass", "bottle", "mass", recording)
    found = weighed(b.trace())
    assert found.values[0] == pytest.approx(MASS, rel=3e-3)


def test_mass_of_the_same_trace_is_the_same(weighing, noises):
    first, second = (weighed(weighing(MASS, noises["lab"], 7)) for _ in range(2))
    assert first == second
