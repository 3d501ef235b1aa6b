"""Proposals: requests of which some words were not understood."""

from __future__ import annotations

import pytest
from request_scenes import scene

from palpate.errors import PlanRejected
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
