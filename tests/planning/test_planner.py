"""Words of the command line to planners."""

from __future__ import annotations

import pytest

from palpate.errors import InputError
from palpate.planning.model.provider import PROVIDERS
from palpate.planning.registry import make_planner


@pytest.mark.parametrize(
    "spec", ["symbolic", "exhaustive", "replay:some/plan.json", "openai:gpt-4o"]
)
def test_a_planner_is_called_what_it_was_asked_for_as(spec: str):
    assert make_planner(spec).name == spec


@pytest.mark.parametrize("spec", ["", "magic", "replay:", "replay", "nobody:model"])
def test_unknown_planners_are_refused_with_the_known_ones(spec: str):
    with pytest.raises(InputError) as refusal:
        make_planner(spec)
    assert all(
        name in str(refusal.value) for name in ("symbolic", "exhaustive", "replay:FILE", *PROVIDERS)
    )
