"""Answers to requests that compare, from a run's estimates."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

import palpate as pp
from palpate.estimation.estimate import Shared, not_identified
from palpate.runs.answer import answer

SHELF = """<mujoco><worldbody>
  <geom name="shelf" type="box" size=".3 .4 .1" pos=".5 0 .1"/>
  <body name="novel" pos=".5 .15 .23"><freejoint/><geom type="box" size=".03 .03 .03"/></body>
  <body name="glass" pos=".5 -.15 .25"><freejoint/><geom type="cylinder" size=".03 .05"/></body>
  <body name="red_can" pos=".6 .2 .23"><freejoint/><geom type="box" size=".03 .03 .03"/></body>
  <body name="green_can" pos=".6 -.2 .23"><freejoint/><geom type="box" size=".03 .03 .03"/></body>
  <body name="block" pos=".6 0 .23"><freejoint/><geom type="box" size=".03 .03 .03" mass=".4"/></body>
  <body name="brick" pos=".4 0 .23"><freejoint/><geom type="box" size=".03 .03 .03" mass=".5"/></body>
</worldbody></mujoco>"""


def run_with(request: str, **masses: float | None) -> pp.Run:
    """A run that measured these masses, kg, to 1 g; None is one without a value."""
    result = pp.load(SHELF).plan("the mass of the novel and the glass").run_so_far
    estimates: list[pp.Estimate] = []
    for name, mass in masses.items():
        parameter = pp.Parameter(name, "mass")
        if mass is None:
            estimates.append(not_identified(parameter, "kg", "It slipped."))
        else:
            estimates.append(pp.Estimate.normal(parameter, "kg", mass, 0.001, "weighed"))
    settings = replace(result.settings, request=request)
    return replace(result, settings=settings, estimates=tuple(estimates))  # type: ignore[return-value]


@pytest.mark.parametrize(
    ("request_", "said"),
    [
        ("Is the novel heavier than the glass?", "yes: novel 0.1660 ± 0.0010 against glass"),
        ("Is the glass heavier than the novel?", "no: novel 0.1660 ± 0.0010 against glass"),
        ("Is the glass lighter than the novel?", "yes: glass 0.1510 ± 0.0010 against novel"),
        ("Which is the heaviest?", "novel: novel 0.1660"),
        ("Is the novel heavier than the brick?", "no: brick 0.5 against novel 0.1660"),
    ],
)
def test_a_comparison_is_answered_with_its_figures(request_: str, said: str) -> None:
    masses = {"novel": 0.166} if "brick" in request_ else {"novel": 0.166, "glass": 0.151}
    reply = answer(run_with(request_, **masses))
    assert reply is not None
    assert reply.startswith(said)
    assert "kg (p < 1e-06)" in reply


def test_a_comparison_of_close_or_unidentified_values_stays_open() -> None:
    request = "Is the novel heavier than the glass?"
    assert "too close to tell" in str(answer(run_with(request, novel=0.1511, glass=0.151)))
    reply = answer(run_with(request, novel=0.166, glass=None))
    assert reply == "open: the mass of glass is not identified"


def test_a_value_at_its_bound_is_compared_without_it() -> None:
    """A feather's mass is not identified, but it is surely less than that of the other."""
    run = run_with("Is the novel heavier than the glass?", novel=0.166, glass=-0.0003)
    limited = [item.bounded((0.0, math.inf)) for item in run.estimates]
    assert [item.verdict for item in limited] == ["identified", "prior-dominated"]
    reply = answer(replace(run, estimates=tuple(limited)))
    assert reply is not None
    assert reply.startswith("yes: novel 0.1660 ± 0.0010 against glass -0.0003 ± 0.0010 kg")


def test_a_request_that_compares_nothing_has_no_answer() -> None:
    assert answer(run_with("the masses", novel=0.166, glass=0.151)) is None
    assert answer(run_with("The mass of the novel once more.", novel=0.166)) is None
    assert answer(run_with("Weigh the novel, and the same for the glass.", novel=0.166)) is None


@pytest.mark.parametrize(
    ("request_", "said"),
    [
        ("Is the red can heavier than the green can?", "no: green_can"),
        ("Is the green can heavier than the red can?", "yes: green_can"),
        ("Is it heavier than the red can?", "green_can: green_can"),
        ("I need the mass of the heavier can", "green_can: green_can"),
    ],
)
def test_questions_that_name_both_sides_get_yes_or_no(request_: str, said: str) -> None:
    reply = answer(run_with(request_, red_can=0.2, green_can=0.3))
    assert reply is not None
    assert reply.startswith(said)


def test_values_that_the_scene_states_are_compared_with_measured_ones_alone() -> None:
    request = "Is the brick heavier than the block, and how heavy is the novel?"
    assert str(answer(run_with(request, novel=0.1))).startswith(
        "brick: brick 0.5 against block 0.4"
    )
    assert answer(run_with("Is the brick heavier than the block?")) is None


@pytest.mark.parametrize(
    ("request_", "said"),
    [
        ("Is the novel heavier than 160 g?", "yes: novel 0.1660 ± 0.0010 against 0.16 kg (p < 1e"),
        ("Is the novel lighter than 0.16 kg?", "no: 0.16 against novel 0.1660 ± 0.0010 kg"),
        ("Does the novel weigh more than 400 g?", "no: 0.4 against novel"),
        ("Does the novel weigh less than half a kilo?", "yes: novel 0.1660 ± 0.0010 against 0.5"),
        ("Does the novel weigh at least 100 grams?", "yes: novel"),
        ("Does the novel weigh less than four grams?", "no: 0.004 against novel"),
        ("Does the novel weigh at most 0,1 kg?", "no: 0.1 against novel"),
        ("Does the novel weigh no more than 100 g?", "novel: novel 0.1660 ± 0.0010 against 0.1"),
        ("Is the novel heavier than 5 oz?", "open: unknown unit of mass 'oz'; valid: g, kg, mg"),
        ("Is the novel heavier than 166 g?", "open: novel 0.1660 ± 0.0010 against 0.166 kg, too"),
        ("Is the novel heavier than 5 cm?", "open: unknown unit of mass 'cm'"),
        ("Ist novel schwerer als 160 g?", "yes: novel 0.1660"),
    ],
)
def test_a_value_is_compared_with_an_amount(request_: str, said: str) -> None:
    assert str(answer(run_with(request_, novel=0.166))).startswith(said)


def test_each_object_is_compared_with_an_amount() -> None:
    reply = answer(run_with("Which objects weigh more than 160 g?", novel=0.166, glass=0.151))
    yes, no = str(reply).split("; ")
    assert yes.startswith("yes: novel 0.1660")
    assert no.startswith("no: 0.16 against glass 0.1510")


@pytest.mark.parametrize(
    "request_",
    [
        "What do the novel and the glass weigh together?",
        "What is the total mass of the novel and the glass?",
        "Was wiegen novel und glass zusammen?",
    ],
)
def test_a_sum_has_an_interval(request_: str) -> None:
    reply = answer(run_with(request_, novel=0.166, glass=0.151))
    assert reply == "together: novel and glass 0.3170 ± 0.0014 kg, 95 % [0.3142, 0.3198]"


def test_errors_that_the_parts_of_a_sum_share_add_up() -> None:
    run = run_with("What do the novel and the glass weigh together?", novel=0.166, glass=0.151)
    gain = Shared("gain", "arm", (0.001,))
    shared = replace(run, estimates=tuple(replace(item, shared=(gain,)) for item in run.estimates))
    assert "0.3170 ± 0.0020 kg" in str(answer(shared))


@pytest.mark.parametrize(
    ("request_", "said"),
    [
        ("Are the novel and the glass together heavier than 300 g?", "yes: novel and glass 0.3170"),
        (
            "Is the brick heavier than the novel and the glass together?",
            "yes: brick 0.5 against novel and glass 0.3170",
        ),
        (
            "Are the novel and the glass together heavier than the block?",
            "no: block 0.4 against novel and glass 0.3170",
        ),
    ],
)
def test_sums_are_compared(request_: str, said: str) -> None:
    assert str(answer(run_with(request_, novel=0.166, glass=0.151))).startswith(said)


@pytest.mark.parametrize(
    ("request_", "said"),
    [
        ("Are the novel and the glass equally heavy?", "no: novel 0.1660"),
        ("Is the novel as heavy as the glass?", "no: novel 0.1660"),
        ("Does the novel weigh as much as the glass?", "no: novel 0.1660"),
        ("Does the novel weigh more than the glass?", "yes: novel 0.1660"),
        ("Does the novel weigh less than the glass?", "no: glass 0.1510"),
        ("Which one weighs the least?", "glass: glass 0.1510"),
    ],
)
def test_a_question_without_a_comparative_is_compared(request_: str, said: str) -> None:
    assert str(answer(run_with(request_, novel=0.166, glass=0.151))).startswith(said)


def test_two_values_that_may_be_alike_and_one_without_another_stay_open() -> None:
    alike = answer(run_with("Are the novel and glass equally heavy?", novel=0.1512, glass=0.151))
    assert "too close to tell" in str(alike)
    alone = answer(run_with("Is the novel the heaviest?", novel=0.166))
    assert alone == "open: no other mass was measured than that of novel"
