"""The finished twin: the user's own MJCF with the estimates in it, its marks and its diff."""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from palpate.display import table
from palpate.errors import InputError, PalpateError
from palpate.estimation.estimate import Estimate
from palpate.geometry.pose import Pose
from palpate.mjcf.document import Document, Texts
from palpate.parameter import Parameter
from palpate.scene.load import scene_from_text
from palpate.scene.raised import at_heights
from palpate.scene.scene import Scene
from palpate.trace.samples import Trace
from palpate.twin.inject import complete
from palpate.twin.one_text import in_one
from palpate.twin.tree import write_tree
from palpate.twin.validate import Replay, Replayed, Validation, touched, validate

if TYPE_CHECKING:
    from mujoco import MjModel


@dataclass(frozen=True, eq=False, repr=False)
class Twin:
    """The digital twin M = ⟨G, P⟩.

    Attributes:
        xml: MJCF in one text, into which included files are put where something was measured in one.
        diff: unified diff from the user's files.
        notes: remarks, e.g. which unknowns nobody asked for and hence hold a prior.
        validation: None when the twin could not be simulated; `notes` then says why.
        scene: the twin read back, with the poses that came with the user's scene; None likewise.
        unwritten: what was measured of objects and surfaces and is not in it; `notes` say why.
        document: the user's files.
        texts: those of them that have changed.
        beside: by name, the texts that belong into the folder of `xml`: attached models in which
            something was measured.
    """

    xml: str
    diff: str
    notes: tuple[str, ...]
    validation: Validation | None
    scene: Scene | None = None
    unwritten: tuple[Parameter, ...] = ()
    document: Document | None = None
    texts: Texts | None = None
    beside: Mapping[str, str] = field(default_factory=dict[str, str])

    @cached_property
    def mjmodel(self) -> MjModel:
        """The twin compiled, without any robot.

        Raises:
            InputError: the twin cannot be simulated; the message says why.
        """
        if self.scene is None:
            raise InputError("; ".join(self.notes) or "the twin was not simulated")
        return self.scene.spec().compile()

    def save(self, path: str | Path) -> tuple[Path, ...]:
        """Write the MJCF to `path`, with what it needs there: its own text and its includes, byte for
        byte but for what was measured, and their meshes and pictures.

        Beside the user's scene, only files that have changed are written, with the twin's name before
        their own; nothing is overwritten.

        Returns:
            Every file written, `path` first.

        Raises:
            InputError: a file that exists, or cannot be written.
        """
        return write_tree(self.texts or Texts(self.xml), self.document, Path(path))

    def __repr__(self) -> str:
        if self.validation is None:
            return "<Twin: not simulated>"
        rest = "comes to rest" if self.validation.settled else "does not come to rest"
        return f"<Twin: {len(self._changes())} lines changed, {rest}>"

    def _repr_html_(self) -> str:
        return table(repr(self), ("changed lines",), [(line,) for line in self._changes()])

    def _changes(self) -> list[str]:
        """The lines that the user's file does not have."""
        lines = self.diff.splitlines()
        added = [line for line in lines if line.startswith("+") and not line.startswith("+++ ")]
        return [line[1:].strip() for line in added]


def build_twin(
    scene: Scene,
    estimates: Sequence[Estimate],
    trace: Trace | None = None,
    replay: Replay | None = None,
) -> Twin:
    """Inject what was measured, then check that the result rests and, where there is a `trace` and a
    `replay`, that it behaves as recorded. Where nothing was measured, there is nothing to compare."""
    written = _written(estimates)
    made = complete(scene, written, {estimate.parameter for estimate in estimates})
    notes = (*_remarks(estimates), *made.notes)
    document = scene.resolved.document
    one = in_one(document, made.texts)
    unmarked = Twin(
        one.main,
        _diff(document, made.texts),
        notes,
        None,
        unwritten=made.unwritten,
        document=document,
        texts=made.texts,
        beside=one.beside,
    )
    try:
        twin = scene_from_text(made.texts, scene, _measured_places(scene, written))
        marks = validate(twin, scene, trace, replay if written else None)
    except PalpateError as error:
        return replace(unmarked, notes=(*notes, f"the twin was not simulated: {error}"))
    return replace(unmarked, validation=marks, scene=twin)


def touch(
    twin: Twin, template: Scene, trace: Trace, replay: Replay, given: Replayed | None = None
) -> Twin:
    """The twin with marks of how it behaves where it was recorded, and of how `template` does, in
    which unknowns are at their priors. `given`: the template's replay, where that has begun
    elsewhere."""
    if twin.validation is None or twin.scene is None:
        return twin
    marks = touched(twin.validation, twin.scene, template, trace, replay, given)
    return replace(twin, validation=marks)


def read_twin(
    xml: str,
    scene: Scene,
    estimates: Sequence[Estimate],
    notes: Sequence[str],
    validation: Validation | None,
    unwritten: Sequence[Parameter] = (),
) -> Twin:
    """The twin of `scene` that was built before, with the marks it got then.

    Raises:
        InputError: the MJCF does not belong to the scene.
    """
    written = _written(estimates)
    document = scene.resolved.document
    texts = Texts(xml)
    if document.includes or document.models:
        texts = complete(scene, written, {estimate.parameter for estimate in estimates}).texts
    diff = _diff(document, texts)
    beside = in_one(document, texts).beside
    read = Twin(
        xml, diff, tuple(notes), validation, None, tuple(unwritten), document, texts, beside
    )
    if validation is None or not scene.bodies:
        return read
    return replace(read, scene=scene_from_text(texts, scene, _measured_places(scene, written)))


def _written(estimates: Sequence[Estimate]) -> list[Estimate]:
    """Parameters that the twin holds."""
    in_twin = ("identified", "prior-dominated")
    return [estimate for estimate in estimates if estimate.verdict in in_twin]


def _remarks(estimates: Sequence[Estimate]) -> Iterator[str]:
    """Remarks on values that do not count as measured."""
    for estimate in estimates:
        if estimate.verdict == "contradicted":
            yield f"{estimate.parameter} is not in the twin: {estimate.contradiction}"
        if estimate.verdict == "prior-dominated":
            yield f"{estimate.parameter} is prior-dominated: what was believed before says as much"


def _diff(document: Document, texts: Texts) -> str:
    """Of the main text, and of every included file that has changed."""
    found = _unified(document.text, texts.main, "scene.xml", "twin.xml")
    for path, text in texts.parts.items():
        found += _unified(document.texts[path], text, path.name, path.name)
    return found


def _unified(before: str, after: str, name: str, new_name: str) -> str:
    lines, new = before.splitlines(keepends=True), after.splitlines(keepends=True)
    return "".join(difflib.unified_diff(lines, new, name, new_name))


def _measured_places(scene: Scene, estimates: Sequence[Estimate]) -> dict[str, Pose]:
    """Measured places of objects: the poses that came with the scene overrule the MJCF, but not
    measurements of them or of their supports."""
    values = {one.parameter: tuple(one.values.tolist()) for one in estimates}
    scene = at_heights(scene, values)
    found: dict[str, Pose] = {}
    for name in scene.rises:
        if scene.resolved.description.bodies[name].given is not None:
            found[name] = scene.bodies[name].pose_world
    for parameter, value in values.items():
        body = scene.bodies.get(parameter.object)
        quantity = scene.catalogue.get(parameter.quantity)
        if body is not None and quantity is not None:
            pose = quantity.places(body, value)
            if pose is not None:
                found[body.name] = pose
    return found
