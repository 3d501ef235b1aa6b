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


def test_unread_words_are_named_beside_the_proposal():
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
    ],
)
def test_remarks_in_a_sentence_that_asks_are_left_to_the_user(
    request_: str, not_used: tuple[str, ...]
):
    assert proposal(request_) == (["mug.mass"], not_used)


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
def test_what_makes_it_another_thing_or_deed_is_no_proposal(request_: str):
    assert proposal(request_)[0] == []


@pytest.mark.parametrize(
    "request_",
    [
        "The mass of the mug is right. How heavy is the bottle?",
        "I measured the mass of the mug; weigh the bottle.",
        "The mass of the mug is in the file. I need that of the bottle.",
    ],
)
def test_what_is_said_to_be_known_is_not_asked_for(request_: str):
    found = ground(request_, scene("kitchen"))
    assert [str(one) for one in found.asked] == ["bottle.mass"]


def test_denied_things_are_left_out_of_the_proposal():
    found, _ = proposal("Frobnicate a bit: weigh the bottle, never mind whatsoever the mug.")
    assert "mug.mass" not in found


def test_a_quantity_alone_is_never_that_of_everything():
    found, _ = proposal("Wowzers, the zippy mass of that frobnicated thingamajig!")
    assert found == []


@pytest.mark.parametrize(
    "background",
    [
        "Everything else in my model is right.",
        "The rest of my model is right.",
        "It is for a grasping benchmark.",
    ],
)
def test_background_is_set_aside_and_named(background: str):
    found = ground(f"How heavy is the mug? {background}", scene("kitchen"))
    assert [str(one) for one in found.asked] == ["mug.mass"]
    assert any(remark.startswith("Set aside: ") for remark in found.remarks)


def test_what_restricts_is_no_background():
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
