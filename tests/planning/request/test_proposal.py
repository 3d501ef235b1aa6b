"""Proposals: requests of which some words were not understood."""

from __future__ import annotations

import pytest
from request_scenes import scene

from palpate.common.parameter import PlanRejected
from palpate.planning.request.grounding import ground


def proposal(request: str, place: str = "kitchen") -> tuple[list[str], tuple[str, ...]]:
    with pytest.raises(PlanRejected) as rejection:
        ground(request, scene(place))
    return [str(one) for one in rejection.value.proposal], rejection.value.not_used


def meaning(request: str, place: str = "kitchen") -> list[str]:
    """The parameters of a sure reading or of a proposal."""
    try:
        return [str(one) for one in ground(request, scene(place)).asked]
    except PlanRejected as rejection:
        return [str(one) for one in rejection.proposal]


def test_unread_words_are_named_with_the_proposal():
    assert proposal("Find the mass of the mug for my zippy contraption.") == (
        ["mug.mass"],
        ("for my zippy contraption",),
    )


@pytest.mark.parametrize(
    ("request_", "not_used"),
    [
        ("The phone is ringing, so please weigh the mug.", ("the phone", "ringing")),
        ("Although it is late, could you weigh the mug?", ("although it", "late")),
        ("Please weigh the mug which we bought last week.", ("bought last week",)),
        ("Weigh the mug made of glass.", ("made of glass",)),
        ("I found the mass of the mug.", ("found",)),
        ("Weigh the mug with the bottle.", ("the bottle",)),
    ],
)
def test_remarks_in_a_sentence_that_asks_are_left_to_the_user(
    request_: str, not_used: tuple[str, ...]
):
    assert proposal(request_) == (["mug.mass"], not_used)


def test_a_quantity_of_two_bodies_is_proposed_for_both():
    asked = ground("Weigh the mug together with the bottle.", scene("kitchen")).asked
    assert set(map(str, asked)) == {"mug.mass", "bottle.mass"}


@pytest.mark.parametrize(
    "request_",
    [
        "How heavy is the lid of the mug?",
        "the mass of the mug's contents",
        "Weigh the mug and then throw it away.",
        "Never weigh the mug.",
        "half the mass of the mug",
    ],
)
def test_words_that_change_the_object_or_the_action_give_no_proposal(request_: str):
    assert proposal(request_)[0] == []


@pytest.mark.parametrize(
    "request_",
    [
        "The mass of the mug is right. How heavy is the bottle?",
        "I measured the mass of the mug; weigh the bottle.",
        "The mass of the mug is in the file. I need that of the bottle.",
    ],
)
def test_a_quantity_stated_as_known_is_not_proposed(request_: str):
    found = ground(request_, scene("kitchen"))
    assert [str(one) for one in found.asked] == ["bottle.mass"]


def test_denied_objects_are_left_out_of_the_proposal():
    found, _ = proposal("Frobnicate a bit: weigh the bottle, never mind whatsoever the mug.")
    assert "mug.mass" not in found


def test_a_quantity_alone_is_never_that_of_everything():
    found, _ = proposal("Wowzers, the zippy mass of that frobnicated thingamajig!")
    assert found == []


@pytest.mark.parametrize(
    ("background", "not_used"),
    [
        ("Everything else in my model is right.", ()),
        ("The rest of my model is right.", ()),
        ("It is for a grasping benchmark.", ("for a grasping benchmark",)),
    ],
)
def test_background_asks_for_nothing(background: str, not_used: tuple[str, ...]):
    request = f"How heavy is the mug? {background}"
    if not_used:
        assert proposal(request) == (["mug.mass"], not_used)
    else:
        assert [str(one) for one in ground(request, scene("kitchen")).asked] == ["mug.mass"]


def test_a_restriction_is_not_read_as_background():
    found = ground("Weigh the boxes. Do not touch the red box.", scene("kitchen"))
    assert [str(one) for one in found.asked] == ["blue_box.mass"]


@pytest.mark.parametrize(
    "wish",
    [
        "Make my scene simulation-ready.",
        "I just want a digital twin of this.",
        "Measure everything.",
    ],
)
def test_vague_wishes_mean_what_is_missing(wish: str):
    kitchen = scene("kitchen")
    assert set(ground(wish, kitchen).asked) == set(kitchen.missing)


def test_a_purpose_offers_what_the_scene_assumes():
    found = ground("I want to simulate throwing the mug.", scene("kitchen"))
    assert [str(one) for one in found.asked] == ["mug.mass"]
    assert any("add --measure mug.com,mug.inertia" in remark for remark in found.remarks)


@pytest.mark.parametrize(
    ("request_", "place", "proposed"),
    [
        ("Pesa tutto sul tavolo tranne la bottiglia.", "kitchen", "mug red_box blue_box"),
        ("Wiege alles, nur die Tasse nicht.", "kitchen", "bottle red_box blue_box"),
        ("Pèse les boîtes, mais pas la rouge.", "kitchen", "blue_box"),
        ("Pesa las cajas menos la roja.", "kitchen", "blue_box"),
        ("I already know the mug. Weigh the others.", "kitchen", "bottle red_box blue_box"),
        ("La tazza la conosco già, pesa la bottiglia.", "kitchen", "bottle"),
        ("How heavy is the red box? No, sorry, the blue one.", "kitchen", "blue_box"),
        ("Wiege die Tasse. Nein, die Flasche.", "kitchen", "bottle"),
        ("¿Cuánto pesa la taza? No, perdón, la botella.", "kitchen", "bottle"),
        ("Pèse la tasse, pardon, la bouteille.", "kitchen", "bottle"),
        ("Pèse la boîte rouge. Non, excuse-moi, la bleue.", "kitchen", "blue_box"),
        ("Todo menos la botella, por favor: masas", "kitchen", "mug red_box blue_box"),
        ("Never mind the mug. The bottle's weight is all I want.", "kitchen", "bottle"),
        ("Weigh the mug twice.", "kitchen", "mug"),
        ("weigh mug bottle", "kitchen", "bottle mug"),
        ("Combien de grammes fait la tasse ?", "kitchen", "mug"),
        ("Was bringt die Flasche auf die Waage?", "kitchen", "bottle"),
        ("¿Cuál de las cajas es más pesada?", "kitchen", "red_box blue_box"),
        (
            "Please weigh all objects with the exception of the mug.",
            "kitchen",
            "bottle red_box blue_box",
        ),
        (
            "La tasse, je connais déjà sa masse ; mesure plutôt celle de la bouteille.",
            "kitchen",
            "bottle",
        ),
        ("I know what the mug weighs, so only do the bottle.", "kitchen", "bottle"),
        ("Die Tasse kann warten: Wie schwer ist die Flasche?", "kitchen", "bottle"),
    ],
)
def test_scope_is_kept_in_five_languages(request_: str, place: str, proposed: str):
    found = meaning(request_, place)
    assert set(found) == {f"{name}.mass" for name in proposed.split()}


@pytest.mark.parametrize(
    ("request_", "proposed"),
    [
        ("Apart from the mug, everything is known.", "mug.mass"),
        ("Weigh the mug, the rest is known.", "mug.mass"),
        ("Die Kisten wiegen, den Rest kenne ich schon.", "red_box.mass blue_box.mass"),
        ("Everything's known but the mug. Weigh that one.", "mug.mass"),
        ("We need the weight of the box, no wait, the mug.", "mug.mass"),
        ("Weigh the boxes and the mug, but not the red ones.", "blue_box.mass mug.mass"),
        ("Weigh everything, namely the mug and the bottle.", "mug.mass bottle.mass"),
        ("Would the mug slide if I tilted the table?", "mug.friction"),
        ("Wie rutschig ist die Tasse, und was wiegt die Flasche?", "mug.friction bottle.mass"),
        (
            "mass of the mug, the bottle and the friction of the red box",
            "mug.mass bottle.mass red_box.friction",
        ),
        ("I think the mug is around 300 g. Please confirm.", "mug.mass"),
        ("How hard is it to slide the mug?", "mug.friction"),
        (
            "Masse der Kisten, Reibung nur von der roten Kiste",
            "red_box.mass blue_box.mass red_box.friction",
        ),
        ("¿Cuál de las dos cajas pesa menos?", "red_box.mass blue_box.mass"),
        ("J'ai déjà la masse de la tasse, donne-moi son centre de gravité.", "mug.com"),
        ("I don't know anything about the mug.", "mug.mass"),
        ("Weigh the mug and the red box, the rest can wait.", "mug.mass red_box.mass"),
        ("All but the mug and the bottle have to be weighed.", "red_box.mass blue_box.mass"),
        ("Don't bother with the mug. All other weights.", "bottle.mass red_box.mass blue_box.mass"),
        ("Don't weigh anything but the mug.", "mug.mass"),
        ("Nichts wiegen außer der Tasse.", "mug.mass"),
        ("The red box, not needed; the mug, weigh it.", "mug.mass"),
        ("Masse von allem außer den Kisten", "bottle.mass mug.mass"),
        ("Wie schwer sind die Kisten?", "red_box.mass blue_box.mass"),
        ("mass of the mug (nothing about the bottle)", "mug.mass"),
        ("La taza ya está pesada, ahora la botella.", "bottle.mass"),
        ("No need to weigh the mug or the bottle. Weigh the red box.", "red_box.mass"),
        ("The mug and the bottle: friction each.", "mug.friction bottle.friction"),
    ],
)
def test_named_bodies_have_priority_and_clauses_keep_their_quantities(request_: str, proposed: str):
    assert set(meaning(request_)) == set(proposed.split())


def test_a_known_quantity_is_left_out_of_a_proposal():
    found = meaning("Miss die Reibung der Tasse. Die Masse kenne ich schon.")
    assert found == ["mug.friction"]


@pytest.mark.parametrize(
    ("request_", "width"),
    [
        ("the mass of the mug ± 1 g", "1 g"),
        ("Weigh the mug to within 2 grams.", "2 g"),
        ("Wiege die Tasse auf 2 g genau.", "2 g"),
        ("La masse de la tasse à 3 g près", "3 g"),
        ("Pesa la taza con un error máximo de 4 gramos", "4 g"),
        ("Pesa la tazza con una precisione di 0,5 grammi", "0.5 g"),
    ],
)
def test_an_accuracy_is_a_width(request_: str, width: str):
    try:
        found = ground(request_, scene("kitchen")).within
    except PlanRejected as rejection:
        found = rejection.within
    assert found == (("mass", width),)


def test_an_amount_to_compare_with_is_no_width():
    assert ground("Is the mug heavier than 400 g?", scene("kitchen")).within == ()


def test_an_unknown_word_is_not_said_to_be_absent():
    with pytest.raises(PlanRejected, match="I did not understand 'frobnicator'") as rejection:
        ground("Weigh the frobnicator.", scene("kitchen"))
    assert "the scene has no" not in str(rejection.value)


def test_an_unknown_word_in_a_list_is_not_used():
    assert proposal("Weigh the frobnicator and the mug.") == (["mug.mass"], ("the frobnicator",))


@pytest.mark.parametrize("word", ["former", "come", "had"])
def test_an_ordinary_word_is_no_misspelt_quantity(word: str):
    found = meaning(f"What does the mug weigh, {word}?")
    assert found == ["mug.mass"]
