"""Requests whose meaning is known because they are made of parts, and what one word more does."""

from __future__ import annotations

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from request_scenes import scene

from palpate.common.errors import InputError
from palpate.common.parameter import PlanRejected
from palpate.planning.request.grounding import ground
from palpate.planning.request.query import Grounded

THINGS = {
    "the mug": {"mug"},
    "my mug": {"mug"},
    "the red box": {"red_box"},
    "both boxes": {"red_box", "blue_box"},
    "the two boxes": {"red_box", "blue_box"},
    "the bottle and the mug": {"bottle", "mug"},
    "the bottle on the table": {"bottle"},
    "all objects except the boxes": {"bottle", "mug"},
    "everything but the bottle": {"mug", "red_box", "blue_box"},
    "the box closest to the mug": {"blue_box"},
}
QUANTITIES = {
    "the mass": {"mass"},
    "the weight": {"mass"},
    "the coefficient of friction": {"friction"},
    "the centre of gravity": {"com"},
    "the mass and the friction": {"mass", "friction"},
}
OF = (
    "{q} of {t}",
    "I need {q} of {t}",
    "Could you please measure {q} of {t}?",
    "We don't know {q} of {t}",
    "What is {q} of {t}?",
    "I would like to know {q} of {t}, please",
    "My simulator asks for {q} of {t}",
    "Hello, tell me {q} of {t}, thanks",
    "{q} of {t} is missing",
    "For my thesis I want to find out {q} of {t}",
)
WEIGHINGS = (
    "weigh {t}",
    "what does {t} weigh?",
    "how much does {t} weigh in grams?",
    "I want to know how heavy {t} is",
    "have you any idea how heavy {t} is?",
    "please tell us what {t} weighs",
    "{t} should be weighed",
)
ASIDE = ("", "", "Please, ", "For our simulation, ")


@st.composite
def requests(draw: st.DrawFn) -> tuple[str, frozenset[str]]:
    """A sentence and what it asks for."""
    thing = draw(st.sampled_from(list(THINGS)))
    quantity = draw(st.sampled_from(list(QUANTITIES)))
    pattern = draw(st.sampled_from([*OF, *WEIGHINGS[:4], *WEIGHINGS[5:]]))
    quantities = QUANTITIES[quantity] if pattern in OF else {"mass"}
    said = draw(st.sampled_from(ASIDE)) + pattern.format(q=quantity, t=thing)
    return said, frozenset(f"{name}.{id}" for name in THINGS[thing] for id in quantities)


def asked(found: Grounded) -> frozenset[str]:
    return frozenset(map(str, found.asked))


def read(request: str) -> Grounded | None:
    """The sure reading; None where it is refused or proposed."""
    try:
        return ground(request, scene("kitchen"))
    except (InputError, PlanRejected):
        return None


def meaning(request: str) -> frozenset[str]:
    """The parameters of a sure reading or of a proposal."""
    try:
        return asked(ground(request, scene("kitchen")))
    except PlanRejected as rejection:
        return frozenset(map(str, rejection.proposal))


@given(requests())
@settings(max_examples=60, deadline=None, derandomize=True)
def test_parts_that_are_understood_are_understood_together(made: tuple[str, frozenset[str]]):
    request, meant = made
    assert meaning(request) == meant


@given(requests(), st.integers(0, 30))
@settings(max_examples=60, deadline=None, derandomize=True)
def test_an_unknown_word_is_never_skipped(made: tuple[str, frozenset[str]], place: int):
    words = made[0].split()
    words.insert(place % (len(words) + 1), "zorblax")
    found = read(" ".join(words))
    assert found is None or any("zorblax" in remark for remark in found.remarks)


@given(
    requests(),
    st.integers(0, 30),
    st.sampled_from(["not", "never", "unless", "if", "instead", "than", "or", "nor"]),
)
@settings(max_examples=80, deadline=None, derandomize=True)
def test_a_word_that_turns_what_is_said_is_never_passed_over(
    made: tuple[str, frozenset[str]], place: int, turning: str
):
    words = made[0].split()
    words.insert(place % (len(words) + 1), turning)
    assume("but not" not in " ".join(words))  # "everything but not the bottle" is the same
    found = read(" ".join(words))
    assert found is None or asked(found) != made[1]


@pytest.mark.parametrize(
    "request_",
    [
        "Weigh the mug or the bottle.",
        "If the mug is empty, weigh it.",
        "Weigh the mug unless it is hot.",
        "How heavy was the mug yesterday?",
        "How heavy will the mug be?",
        "He said 'weigh the mug'.",
        "Weigh the top of the mug.",
        "mass of the mug minus the mass of the bottle",
        "What is mass?",
        "Set the mass of the mug to 300 g.",
        "Weigh three boxes.",
        "Weigh the mug the bottle.",
        "The mass of the mug the friction of the bottle.",
        "My friend brought something. How heavy is it?",
        "The mug belongs to my aunt. Weigh everything.",
    ],
)
def test_a_sentence_that_is_no_plain_wish_is_refused(request_: str):
    assert read(request_) is None


@pytest.mark.parametrize(
    ("request_", "meant"),
    [
        ("Measure both the mass and the friction of the mug.", "mug.mass mug.friction"),
        ("I know neither the mass nor the friction of the mug.", "mug.mass mug.friction"),
        ("J'ai besoin de la masse et du frottement de la tasse.", "mug.mass mug.friction"),
        ("Identify the inertial parameters of the mug.", "mug.mass mug.com mug.inertia"),
        ("How heavy is the mug? What about the bottle?", "mug.mass bottle.mass"),
        ("Weigh the mug. Also the bottle.", "mug.mass bottle.mass"),
        ("Run a mass estimation on the mug.", "mug.mass"),
        ("- mass of the mug\n- height of the table", "mug.mass table.height"),
    ],
)
def test_objects_named_together_are_asked_for_together(request_: str, meant: str):
    assert meaning(request_) == frozenset(meant.split())


@pytest.mark.parametrize(
    "request_",
    [
        "I need the mass, but not the friction of the mug.",
        "We know the mass of the mug. Also the bottle.",
        "Do not weigh the mug. And the bottle.",
        "Weigh the box which I bought yesterday.",
        "Weigh everything that belongs to my aunt.",
        "Weigh the mug, which you should not touch.",
        "Weigh everything because I am busy except those on the left.",
        "Weigh the mug after it has cooled.",
    ],
)
def test_words_that_may_change_a_wish_are_refused(request_: str):
    assert read(request_) is None


@pytest.mark.parametrize(
    "request_",
    [
        "Weigh everything but not the mug and not the bottle.",
        "all masses, not the mug and not the bottle",
        "Weigh all objects, not the mug, not the bottle.",
        "masses of all objects, but not the mug and not the bottle",
    ],
)
def test_each_of_several_exceptions_is_left_out(request_: str):
    assert meaning(request_) == {"red_box.mass", "blue_box.mass"}


@pytest.mark.parametrize(
    ("request_", "meant"),
    [
        (
            "The friction of the mug and the bottle and mass of the red box",
            "mug.friction bottle.friction red_box.mass",
        ),
        ("I know the mass of the mug and the friction of the bottle.", ""),
        ("Weigh the lighter box", "red_box.mass blue_box.mass"),
    ],
)
def test_lists_and_comparatives_keep_their_meaning(request_: str, meant: str):
    assert meaning(request_) == frozenset(meant.split())


def test_a_statement_that_compares_is_not_sure():
    assert read("The mug is heavier than the bottle.") is None
