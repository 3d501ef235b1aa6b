"""A photo and a rendering of one scene: the same prompt, the same parameters, the same tree."""

from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image

from palpate.perception.renderer import gl_available
from palpate.planning.model.prompt import Prompt, compose
from palpate.planning.registry import load_proposal
from palpate.primitives.registry import vocabulary
from palpate.runs import pipeline
from palpate.runs.settings import Settings
from palpate.studies.scenarios.catalogue import scenario

PHOTO, RENDERING = scenario("synthetic_and_real"), scenario("synthetic_and_real/rendering")


def prompt(settings: Settings) -> Prompt:
    return compose(vocabulary(), settings.request or "", pipeline.load(settings), settings.images)


def test_the_two_requests_differ_only_in_the_picture() -> None:
    photo, rendering = prompt(PHOTO.settings()), prompt(RENDERING.settings())
    assert photo.system.encode() == rendering.system.encode()
    assert photo.user == rendering.user
    (item,), (other,) = photo.images, rendering.images
    assert item.read_bytes() != other.read_bytes()


def test_the_answers_agree_on_parameters_and_tree_in_words_of_their_own() -> None:
    photo, rendering = (
        load_proposal(PHOTO.plans["model"]).plan,
        load_proposal(RENDERING.plans["model"]).plan,
    )
    assert photo.parameters == rendering.parameters == PHOTO.expects
    assert photo.tree == rendering.tree
    assert photo.explanation != rendering.explanation


@pytest.mark.skipif(not gl_available()[0], reason="no OpenGL")
def test_the_pictures_are_those_that_the_renderer_makes() -> None:
    from bench.pictures import photo, rendering

    for kept, result in ((PHOTO.images[0], photo()), (RENDERING.images[0], rendering())):
        difference = np.abs(pixels(kept.read_bytes()) - pixels(result))
        assert difference.mean() < 6.0, kept.name
    assert np.abs(pixels(photo()) - pixels(rendering())).mean() > 30.0


def pixels(content: bytes) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(content)).convert("RGB"), dtype=float)
