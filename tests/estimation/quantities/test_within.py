"""How narrow intervals are asked to be: what may be said, and what came of it."""

from __future__ import annotations

import pytest

from palpate.common.errors import InputError
from palpate.common.parameter import Parameter
from palpate.estimation.estimate import Estimate, Shared, not_identified
from palpate.estimation.quantities.within import Within, format_width

BOTTLE = Parameter("bottle.mass")


@pytest.mark.parametrize(
    ("name", "value", "width"),
    [
        ("mass", "1g", 1e-3),
        ("mass", "0.001", 1e-3),
        ("mass", 0.001, 1e-3),
        ("mass", "2.5e2 mg", 2.5e-4),
        ("friction", "0.01", 0.01),
        ("com", "2mm", 2e-3),
        ("height", "0.3 mm", 3e-4),
        ("stiffness", "1.5kN/m", 1500.0),
        ("inertia", "1e-4 kg·m²", 1e-4),
    ],
)
def test_a_width_is_a_number_in_a_unit_of_its_quantity(name, value, width) -> None:
    assert Within.read({name: value}).of(Parameter("it", name)) == pytest.approx(width)


@pytest.mark.parametrize(
    ("name", "value", "says"),
    [
        (
            "weight",
            "1g",
            r"unknown quantity in within= 'weight'; did you mean 'mass'\? valid: com, .*mass",
        ),
        ("mass", "1mm", "unknown unit of mass 'mm'; valid: g, kg, mg"),
        ("height", "1g", "unknown unit of height 'g'; valid: cm, m, mm, um"),
        ("mass", "-1g", "give a positive number, with a unit of kg, g, mg"),
        ("mass", "0", "give a positive number"),
        ("mass", "1.2.3", "give a positive number"),
        ("mass", "narrow", "give a positive number"),
        ("mass", float("nan"), "give a positive number"),
    ],
)
def test_text_that_is_no_width_is_refused_with_the_valid_forms(name, value, says) -> None:
    with pytest.raises(InputError, match=says):
        Within.read({name: value})


def test_a_parameter_s_own_width_goes_before_that_of_its_quantity() -> None:
    within = Within.read({"mass": "1g", "bottle.mass": "2g"})
    assert within.of(BOTTLE) == 0.002
    assert within.of(Parameter("cup.mass")) == 0.001
    assert within.of(Parameter("cup.friction")) is None
    within.check(["bottle", "cup"])
    with pytest.raises(InputError, match="unknown object in within= 'bottle'; valid: cup"):
        within.check(["cup"])


def estimate(std: float, gain: float = 0.0) -> Estimate:
    shared = (Shared("gain of joint 2", "arm", (gain,)),)
    return Estimate(
        BOTTLE, "kg", [0.3], [std], [[0.3 - 2 * std, 0.3 + 2 * std]], "Lifted.", shared=shared
    )


@pytest.mark.parametrize(
    ("std", "gain", "outcome", "said"),
    [
        (0.0004, 0.0, "reached", "Within 1 g was asked: 0.8 g is reached."),
        (0.001, 0.0005, "rounds used up", "2 g is reached, and more work would narrow it."),
        (0.001, 0.00099, "floor", "at the floor of 1.9 g (gain of the joints); calibrate the arm"),
    ],
)
def test_an_interval_is_reached_at_its_floor_or_could_be_narrower(std, gain, outcome, said) -> None:
    within, found = Within.read({"mass": "1g"}), estimate(std, gain)
    precision = within.precision(found)
    assert precision is not None
    assert precision.outcome == outcome
    assert said in within.told(found).method
    assert within.told(found).method.startswith("Lifted. ")


def test_an_estimate_without_a_request_or_a_value_stays_unchanged() -> None:
    assert Within.read({"height": "1mm"}).precision(estimate(0.001)) is None
    missed = not_identified(BOTTLE, "kg", "It slipped.")
    within = Within.read({"mass": "1g"})
    assert within.told(missed) is missed
    precision = within.precision(missed)
    assert precision is not None
    assert precision.outcome == "rounds used up"


@pytest.mark.parametrize(
    ("width", "unit", "text"),
    [(9e-4, "kg", "0.9 g"), (0.0123, "m", "1.2 cm"), (0.01, "1", "0.01"), (1e-9, "m", "0.001 um")],
)
def test_widths_are_shown_in_a_unit_that_suits_them(width, unit, text) -> None:
    assert format_width(width, unit) == text


@pytest.mark.parametrize(("std", "so_far", "more"), [(0.0006, 1, 1), (0.001, 1, 4), (0.001, 2, 8)])
def test_noise_determines_the_number_of_further_repetitions(std, so_far, more) -> None:
    """The noise of a mean falls with the root of their number; some of it is kept in reserve."""
    precision = Within.read({"mass": "1g"}).precision(estimate(std))
    assert precision is not None
    assert precision.further(so_far) == more


def test_a_component_without_evidence_does_not_count_for_the_width() -> None:
    std = [0.5e-3, 0.8e-3, 9e-3]
    com = Estimate.normal(
        Parameter("hammer", "com"), "m", [0.06, 0.0, 0.0], std, "three grasps", unseen=(2,)
    )
    precision = Within.read({"com": "2mm"}).precision(com)
    assert precision is not None
    assert precision.outcome == "reached"
    assert precision.reached == pytest.approx(1.96 * 0.8e-3, rel=1e-3)


def near_zero(*shared: Shared) -> Estimate:
    """Mass of which the 95 % interval reaches 0."""
    estimate = Estimate.normal(BOTTLE, "kg", 0.015, 0.008, "a weighing", (), shared=shared)
    return estimate.bounded((0.0, float("inf")))


def test_a_value_at_a_bound_comes_with_the_width_that_would_separate_it() -> None:
    told = Within().told(near_zero())
    assert told.verdict == "prior-dominated"
    assert told.is_evidence
    assert "about 4 times the work tells it from there (--within bottle.mass=9.4g)" in told.doubt
    width = Within.read({"bottle.mass": "9.4g"}).of(BOTTLE)
    assert width == pytest.approx(told.limits[0] / 3.0, rel=0.01)


def test_a_value_at_a_bound_that_no_repetition_separates_names_the_cause() -> None:
    told = Within().told(near_zero(Shared("gain of joint 2", "arm", (0.007,))))
    assert "--within" not in told.doubt
    assert "± 14g remain (gain of the joints); calibrate the arm to go below" in told.doubt


def test_a_value_apart_from_its_bounds_needs_no_advice() -> None:
    estimate = Estimate.normal(BOTTLE, "kg", 0.3, 0.008, "a weighing", ())
    assert Within().told(estimate.bounded((0.0, float("inf")))).reason == ""
