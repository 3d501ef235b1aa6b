from collections import Counter

import pytest

from palpate.estimation.quantities.catalogue import PURPOSES, catalogue, quantities_by_verb
from palpate.planning.model.prompt import fill_module, system_prompt
from palpate.planning.request.words import languages
from palpate.primitives.registry import vocabulary


def test_a_verb_stands_in_one_row_and_its_quantities_in_the_catalogue() -> None:
    verbs = Counter(verb for purpose in PURPOSES for verb in purpose.verbs)
    assert verbs.most_common(1)[0][1] == 1
    assert {id for purpose in PURPOSES for id in purpose.quantities} <= set(catalogue())


@pytest.mark.parametrize("verb", ["topple", "tip", "tilt", "pour"])
def test_purposes_with_tilting_need_all_axes_of_the_centre_of_mass(verb: str) -> None:
    assert "com_3d" in quantities_by_verb()[verb]


@pytest.mark.parametrize(
    "verb", ["slide", "push", "throw", "pour", "topple", "tilt", "stack", "drop", "grasp"]
)
def test_the_common_purposes_are_in_the_prompts(verb: str) -> None:
    for text in (
        system_prompt(vocabulary()),
        fill_module("critic.md", vocabulary(), "full"),
    ):
        assert any(verb in str(p) and str(p) in text for p in PURPOSES)


def test_actions_of_requests_have_a_purpose() -> None:
    entries = [each for one in languages().values() for row in one.entries.values() for each in row]
    verbs = {value for _, name, value in entries if name == "DEED" and value}
    assert verbs <= quantities_by_verb().keys()
    assert len(verbs) > 5
