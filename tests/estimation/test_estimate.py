"""An estimate: what it holds, and how it reads."""

from dataclasses import replace

import numpy as np
import pytest

from palpate.estimation.agreement import FitTest, chi_squared
from palpate.estimation.estimate import Estimate, Part, interval95, not_identified, rounded
from palpate.parameter import Parameter

MUG = Parameter("mug", "mass")
HAMMER = Parameter("hammer", "com")


@pytest.fixture
def weighed():
    return Estimate.normal(
        MUG, "kg", 0.34182, 0.00138, "weighed", parts={"rests": Part(0.34, 0.01)}
    )


@pytest.fixture
def balanced():
    return Estimate.normal(HAMMER, "m", (0.0621, -0.004, 0.0), (0.0024, 0.0007, 0.01), "balanced")


def test_it_prints_itself_in_one_line(weighed, balanced):
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
    assert interval95((0.1, 1.0), (0.1, 0.1), least=0.0)[:, 0] == pytest.approx((0.0, 0.804))


def test_what_is_not_identified_has_no_value():
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


def test_what_is_no_number_does_not_agree():
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


def test_it_is_a_value(weighed):
    again = Estimate.normal(
        MUG, "kg", 0.34182, 0.00138, "weighed", parts={"rests": Part(0.34, 0.01)}
    )
    assert weighed == again
    assert weighed != Estimate.normal(MUG, "kg", 0.34182, 0.00139, "weighed", parts=weighed.parts)
    assert weighed != "an estimate"
    with pytest.raises(ValueError, match="read-only"):
        weighed.values[0] = 1.0
    with pytest.raises(AttributeError):
        weighed.unit = "g"


def test_it_keeps_its_own_numbers():
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
    assert rounded(value, std) == shown


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
