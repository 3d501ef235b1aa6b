"""An estimate: what it holds, and how it reads."""

import math
from dataclasses import replace

import numpy as np
import pytest

from palpate.common.parameter import Parameter
from palpate.estimation.estimate import (
    Estimate,
    FitTest,
    FurtherValue,
    Shared,
    chi_squared,
    interval95,
    not_identified,
    round_to_std,
)
from palpate.estimation.fusion import Source, fuse

MUG = Parameter("mug", "mass")
HAMMER = Parameter("hammer", "com")


@pytest.fixture
def weighed():
    return Estimate.normal(
        MUG, "kg", 0.34182, 0.00138, "weighed", parts={"rests": FurtherValue(0.34, 0.01)}
    )


@pytest.fixture
def balanced():
    return Estimate.normal(HAMMER, "m", (0.0621, -0.004, 0.0), (0.0024, 0.0007, 0.01), "balanced")


def test_an_estimate_has_a_repr_of_one_line(weighed, balanced):
    assert repr(weighed) == "<mug.mass = 0.3418 ± 0.0014 kg, 95 % [0.3391, 0.3445], identified>"
    assert (
        repr(balanced)
        == "<hammer.com = (0.0621, -0.0040, 0.000) ± (0.0024, 0.0007, 0.010) m, identified>"
    )
    assert repr(not_identified(MUG, "kg", "It slipped.")) == "<mug.mass: not identified>"
    unitless = Estimate.normal(Parameter("mug", "friction"), "1", 0.34, 0.011, "dragged")
    assert repr(unitless).startswith("<mug.friction = 0.340 ± 0.011, 95 % [")


def test_a_notebook_shows_a_table_with_a_row_a_component(balanced):
    html = balanced._repr_html_()
    assert html.count("<td>") == 9
    assert "hammer.com: identified" in html
    assert "value m" in html


def test_names_in_a_table_are_text():
    hostile = Parameter("<script>", "mass")
    for found in (
        Estimate.normal(hostile, "<b>", 1.0, 0.1, "weighed"),
        not_identified(hostile, "kg", "<script>"),
    ):
        assert "<script>" not in found._repr_html_()
        assert "<b>" not in found._repr_html_()


def test_z_score_is_the_error_in_standard_deviations(weighed, balanced):
    assert weighed.z_score(0.34182 - 0.00276) == pytest.approx(2.0)
    assert balanced.z_score((0.0621, -0.0047, 0.0)) == pytest.approx([0.0, 1.0, 0.0])


def test_the_interval_of_a_normal_is_one_rule(weighed):
    assert weighed.intervals.shape == (1, 2)
    assert weighed.intervals[0] == pytest.approx(
        (0.34182 - 1.96 * 0.00138, 0.34182 + 1.96 * 0.00138)
    )
    assert interval95((0.1, 1.0), (0.1, 0.1))[:, 0] == pytest.approx((-0.096, 0.804))
    # Four degrees of freedom widen it (Student's table: 2.776).
    assert interval95(0.0, 1.0, 4.0)[0] == pytest.approx((-2.776, 2.776), abs=1e-3)


def test_a_value_at_a_bound_is_no_measurement_but_a_limit():
    """A door whose damping is 0.9: what was `0.00 ± 0.52, identified`."""
    door = Estimate.normal(Parameter("door", "damping"), "N·m·s/rad", -0.11, 0.52, "passes")
    assert door.identified
    found = door.bounded((0.0, math.inf))
    assert (found.verdict, found.identified, found.is_evidence) == ("prior-dominated", False, True)
    # Value and interval stay the unconstrained ones, which are fused, compared and scored.
    assert (found.value, found.std, found.ci95) == (door.value, door.std, door.ci95)
    assert found.z_score(0.9) == pytest.approx(-1.942, abs=1e-3)
    assert "at most 0.95 (95 %), prior-dominated" in repr(found)
    assert found.cells()[2] == "at most 0.95"
    assert (
        found.doubt == "at most 0.95 N·m·s/rad (95 %): the 95 % interval reaches a physical bound"
    )
    # The twin has the mean of the possible values.
    held = found.physical
    assert 0.3 < float(held) < 0.5
    assert held.ci95 == pytest.approx((0.0, found.limits[0]))
    assert found.verdict == held.verdict
    assert found.physical.physical == held


def test_a_value_away_from_its_bound_is_what_it_was(weighed):
    found = weighed.bounded((0.0, math.inf))
    assert found.identified
    assert found.limits == (None,)
    assert found.physical is found
    assert (found.reason, found.doubt) == ("", "")
    assert weighed.bounded((-math.inf, math.inf)) is weighed


def test_a_value_far_beyond_its_bound_is_contradicted():
    found = Estimate.normal(MUG, "kg", -0.40, 0.05, "weighed").bounded((0.0, math.inf))
    assert found.verdict == "contradicted"
    assert "The mass comes out" in found.contradiction
    assert found.limits == (None,)
    assert not found.is_evidence
    # Few degrees of freedom: noise that was itself estimated explains more.
    unsure = Estimate.normal(MUG, "kg", -0.40, 0.05, "weighed", freedom=2.0)
    assert unsure.bounded((0.0, math.inf)).verdict == "prior-dominated"


def test_an_upper_bound_gives_a_lower_limit():
    bouncy = Estimate.normal(Parameter("mat", "restitution"), "1", 0.99, 0.05, "pressed")
    found = bouncy.bounded((0.0, 1.0))
    assert found.verdict == "prior-dominated"
    assert found.doubt.startswith("at least 0.895 (95 %)")
    assert 0.9 < float(found.physical) < 0.99


def test_each_component_has_its_own_bound():
    inertia = Estimate.normal(
        Parameter("mug", "inertia"), "kg·m²", (3e-3, 2e-4, 3e-3, 0.0, 0.0, 0.0), (3e-4,) * 6, ""
    ).bounded(((0.0, math.inf),) * 3 + ((-math.inf, math.inf),) * 3)
    assert inertia.identified
    assert inertia.whole == "prior-dominated"
    assert inertia.doubtful_axes == ("yy",)
    assert inertia.doubt.startswith("at most 0.000735 kg·m² (95 %)")
    # An inertia tensor belongs together: no component is moved alone.
    assert inertia.physical is inertia


def test_a_prior_dominated_value_has_a_reason(weighed):
    assert replace(weighed, verdict="prior-dominated").reason.startswith(
        "the recordings say no more"
    )
    alone = Estimate.normal(MUG, "kg", 0.001, 0.01, "", reason="nothing was compared")
    assert alone.verdict == "prior-dominated"
    bounded = alone.bounded((0.0, math.inf))
    assert bounded.doubt == "at most 0.0203 kg (95 %): nothing was compared"
    assert not bounded.is_evidence


def test_at_truth_zero_z_is_standard_normal_and_25_runs_cover():
    random = np.random.default_rng(11)
    for truth in (0.0, 0.004):
        z: list[float] = []
        covered = 0
        for _ in range(200):
            found = [
                replace(
                    Estimate.normal(MUG, "kg", truth + error, 0.008, "weighed"),
                    shared=(Shared("gain of joint 4", "arm", (0.0,)),),
                ).bounded((0.0, math.inf))
                for error in random.normal(0.0, 0.008, 25).tolist()
            ]
            kept = [one for one in found if one.is_evidence]
            z += [float(one.z_score(truth)) for one in kept]
            fused = fuse([Source(f"run {i}", "arm", one) for i, one in enumerate(kept)])
            covered += fused.ci95[0] <= truth <= fused.ci95[1]
        assert (np.mean(z), np.std(z)) == pytest.approx((0.0, 1.0), abs=0.05)
        assert 0.90 <= covered / 200 <= 0.99


def test_an_unidentified_estimate_has_no_value():
    lost = not_identified(MUG, "kg", "It slipped.")
    assert not lost.has_value
    assert (lost.values.shape, lost.stds.shape, lost.intervals.shape) == ((0,), (0,), (0, 2))
    with pytest.raises(ValueError, match="not identified, with value"):
        Estimate.normal(MUG, "kg", 0.3, 0.1, "weighed", verdict="not identified")
    with pytest.raises(ValueError, match="identified, with value"):
        Estimate(MUG, "kg", (), (), (), "weighed")
    with pytest.raises(ValueError, match="differ in length"):
        Estimate(MUG, "kg", (0.3,), (), (), "weighed")


def test_a_test_of_fit_that_fails_contradicts_the_estimate(weighed):
    agrees = FitTest("rest against pass", 0.4, 3.9, "Rests and passes differ.")
    pulled = FitTest("along the lift", 30.0, 4.2, "Something <pulls> on it.")
    assert replace(weighed, tests=(agrees,)).identified
    found = replace(weighed, tests=(agrees, pulled), verdict="prior-dominated")
    assert (found.verdict, found.identified) == ("contradicted", False)
    assert found.contradiction == "Something <pulls> on it."
    assert repr(found).endswith("contradicted>")
    assert "Something &lt;pulls&gt; on it." in found._repr_html_()
    assert found != replace(weighed, tests=(agrees,))
    with pytest.raises(ValueError, match="no test of fit failed"):
        replace(weighed, verdict="contradicted")


def test_a_nan_statistic_does_not_agree():
    assert not FitTest("rest against pass", float("nan"), 3.9, "").passed


def test_chance_rarely_exceeds_the_limit_of_a_sum_of_squares():
    test = chi_squared("residuals", 12.0, 3, "They scatter.")
    drawn = np.random.default_rng(0).chisquare(3, 200_000)
    assert 0 < np.mean(drawn > test.limit) < 3e-4
    assert test.passed
    # Of a variance that was itself estimated, less is said.
    noise = np.random.default_rng(1).chisquare(8, 200_000) / 8
    unsure = chi_squared("residuals", 12.0, 3, "They scatter.", noise_freedom=8)
    assert 0 < np.mean(drawn / noise > unsure.limit) < 3e-4


def test_estimates_are_immutable_and_compared_by_value(weighed):
    again = Estimate.normal(
        MUG, "kg", 0.34182, 0.00138, "weighed", parts={"rests": FurtherValue(0.34, 0.01)}
    )
    assert weighed == again
    assert weighed != Estimate.normal(MUG, "kg", 0.34182, 0.00139, "weighed", parts=weighed.parts)
    assert weighed != "an estimate"
    with pytest.raises(ValueError, match="read-only"):
        weighed.values[0] = 1.0
    with pytest.raises(AttributeError):
        weighed.unit = "g"


def test_an_estimate_copies_its_arrays():
    numbers = np.array([0.3])
    found = Estimate.normal(MUG, "kg", numbers, numbers, "weighed")
    numbers[0] = 9.0
    assert found.values[0] == 0.3


@pytest.mark.parametrize(
    ("value", "std", "shown"),
    [
        (0.34182, 0.00138, ("0.3418", "0.0014")),
        (0.34182, 0.0031, ("0.342", "0.003")),
        (12.0, 0.0, ("12", "0")),
    ],
)
def test_digits_follow_the_standard_deviation(value, std, shown):
    assert round_to_std(value, std) == shown


def test_a_vector_with_an_unseen_component_is_not_identified_as_a_whole() -> None:
    com = Estimate.normal(HAMMER, "m", (0.06, 0.0, 0.0), (0.001,) * 3, "", unseen=(2,))
    assert com.verdict == "identified"
    assert com.whole == "prior-dominated"
    assert com.verdict_in_words == "x, y identified, z prior-dominated"
    assert com.cells()[3] == com.verdict_in_words
    assert repr(com).endswith(f"{com.verdict_in_words}>")
    assert f": {com.verdict_in_words}" in com._repr_html_()
    seen = replace(com, unseen=())
    assert (seen.whole, seen.verdict_in_words) == ("identified", "identified")
