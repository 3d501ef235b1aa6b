"""The finished twin: the user's own MJCF with the estimates in it, its marks and its diff."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from dataclasses import dataclass

from palpate.errors import PalpateError
from palpate.estimation.estimate import Estimate
from palpate.scene.scene import Scene, scene_from_text
from palpate.trace import Trace
from palpate.twin.inject import complete
from palpate.twin.validate import Replay, Validation, validate


@dataclass(frozen=True, slots=True, eq=False)
class Twin:
    """The digital twin M = ⟨G, P⟩.

    Attributes:
        text: MJCF. diff: unified diff from the user's file.
        notes: remarks, e.g. which unknowns nobody asked for and hence hold a prior.
        validation: None when the twin could not be simulated; `notes` then says why.
    """

    text: str
    diff: str
    notes: tuple[str, ...]
    validation: Validation | None


def build_twin(scene: Scene, estimates: Sequence[Estimate], trace: Trace, replay: Replay) -> Twin:
    """Inject what was identified, then check that the result behaves as recorded."""
    identified = [e for e in estimates if e.verdict != "not identified"]
    text, notes = complete(scene, identified)
    diff = "".join(difflib.unified_diff(scene.text.splitlines(keepends=True), text.splitlines(keepends=True),
                                        "scene.xml", "twin.xml"))
    try:
        marks = validate(scene_from_text(text, scene), scene, trace, replay)
    except PalpateError as error:
        return Twin(text, diff, (*notes, f"the twin was not simulated: {error}"), None)
    return Twin(text, diff, tuple(notes), marks)
