"""Plans of others than the symbolic planner, beside what the request seems to name."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pytest
from workbench import BOTTLE, bench, plan, sequence, weigh

from palpate.planning.plan import Plan
from palpate.runs import planning
from palpate.runs.settings import Settings
from palpate.scene.scene import Scene

WEIGHED = plan(sequence(*weigh("bottle")), "bottle.mass")


class Author:
    """A planner of one's own, with a plan that is the same for any request."""

    name = "author"

    def plan(self, request: str | None, scene: Scene | None, images: Sequence[Path] = ()) -> Plan:
        return WEIGHED


@pytest.mark.parametrize(
    ("request_", "noted"),
    [
        ("How heavy is the bottle?", False),
        ("Where is the centre of mass of the bottle?", True),
        ("My sister's bottle, whatever it weighs.", False),  # not read surely
    ],
)
def test_a_quantity_hinted_at_in_a_request_is_noted_and_overrules_nothing(
    request_: str, noted: bool
):
    settings = Settings(scene=Path("desk.xml"), request=request_, planner="openai:m")
    result = planning.plan(settings, bench(BOTTLE), Author())
    assert result.plan.parameters == WEIGHED.parameters
    text = "By its words the request asks for bottle.com"
    assert any(note.startswith(text) for note in result.plan.notes) == noted
