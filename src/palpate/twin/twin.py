"""The finished twin: the user's own MJCF with the estimates in it, its marks and its diff."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from dataclasses import dataclass

from palpate.errors import PalpateError
from palpate.estimation.estimate import Estimate
from palpate.geometry.pose import Pose
from palpate.scene.load import scene_from_text
from palpate.scene.scene import Scene
from palpate.trace.samples import Trace
from palpate.twin.inject import complete
from palpate.twin.validate import Replay, Validation, validate


@dataclass(frozen=True, slots=True, eq=False)
class Twin:
    """The digital twin M = ⟨G, P⟩.

    Attributes:
        text: MJCF. diff: unified diff from the user's file.
        notes: remarks, e.g. which unknowns nobody asked for and hence hold a prior.
        validation: None when the twin could not be simulated; `notes` then says why.
        scene: the twin read back, with the poses that came with the user's scene; None likewise.
    """

    text: str
    diff: str
    notes: tuple[str, ...]
    validation: Validation | None
    scene: Scene | None = None


def build_twin(scene: Scene, estimates: Sequence[Estimate], trace: Trace, replay: Replay) -> Twin:
    """Inject what was identified, then check that the result behaves as recorded."""
    identified = [e for e in estimates if e.verdict != "not identified"]
    text, notes = complete(scene, identified)
    diff = "".join(
        difflib.unified_diff(
            scene.text.splitlines(keepends=True),
            text.splitlines(keepends=True),
            "scene.xml",
            "twin.xml",
        )
    )
    try:
        twin = scene_from_text(text, scene, _measured_places(scene, identified))
        marks = validate(twin, scene, trace, replay)
    except PalpateError as error:
        return Twin(text, diff, (*notes, f"the twin was not simulated: {error}"), None)
    return Twin(text, diff, tuple(notes), marks, twin)


def _measured_places(scene: Scene, estimates: Sequence[Estimate]) -> dict[str, Pose]:
    """Where objects were found to be: the poses that came with the scene overrule the MJCF, but not
    what was measured."""
    found: dict[str, Pose] = {}
    for estimate in estimates:
        if estimate.parameter.quantity == "position":
            name = estimate.parameter.object
            pose_world = scene.body(name).pose_world
            position = (*estimate.value.tolist(), pose_world.position[2])
            found[name] = Pose.of(position, pose_world.quaternion)
    return found
