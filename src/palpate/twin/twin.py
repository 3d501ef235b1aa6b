"""The finished twin: the user's own MJCF with the estimates in it, its validation and its diff."""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from palpate.common.display import table
from palpate.common.errors import InputError, PalpateError
from palpate.common.parameter import Parameter
from palpate.common.pose import Pose
from palpate.estimation.estimate import Estimate
from palpate.mjcf.contacts import surface_friction
from palpate.mjcf.document import Document, Texts
from palpate.mjcf.reading import reparse
from palpate.scene.load import at_heights, scene_from_text
from palpate.scene.scene import Scene
from palpate.trace.samples import Trace
from palpate.twin.files import TWIN, one_text, pack, write_files
from palpate.twin.inject import complete
from palpate.twin.text import as_text
from palpate.twin.validate import (
    Replay,
    ReplayResult,
    Validation,
    compare_touch,
    press_notes,
    validate,
)

if TYPE_CHECKING:
    from mujoco import MjModel


@dataclass(frozen=True, eq=False, repr=False)
class Twin:
    """The digital twin M = ⟨G, P⟩.

    Attributes:
        xml: MJCF in one text, with the content of included files if a value was written into one.
        diff: unified diff from the user's files.
        notes: remarks, e.g. which unknowns were not measured and hold a prior.
        validation: None if the twin could not be simulated; `notes` states the reason.
        scene: the twin read back, with the poses that came with the user's scene; None if it could
            not be simulated.
        unwritten: measured parameters of objects and surfaces that are not in it; `notes` state the
            reasons.
        document: the user's files.
        texts: those of them that have changed.
    """

    xml: str
    diff: str
    notes: tuple[str, ...]
    validation: Validation | None
    scene: Scene | None = None
    unwritten: tuple[Parameter, ...] = ()
    document: Document | None = None
    texts: Texts | None = None

    @cached_property
    def mjmodel(self) -> MjModel:
        """The twin compiled, without any robot.

        Raises InputError: the twin cannot be simulated; the message states the reason.
        """
        if self.scene is None:
            raise InputError("; ".join(self.notes) or "the twin was not simulated")
        return self.scene.spec().compile()

    def save(self, path: str | Path) -> tuple[Path, ...]:
        """Write the MJCF to `path`, with its includes, meshes and pictures.

        Every byte of the texts except the measured values stays. In the folder of the user's scene,
        only changed files are written, with the twin's name before their own. Nothing is
        overwritten.

        Returns:
            Every file written, `path` first.

        Raises:
            InputError: a file that exists, or cannot be written.
        """
        return write_files(self.texts or Texts(self.xml), self.document, Path(path))

    def packed(self, folder: Path) -> dict[str, str]:
        """Copy the meshes, pictures and height fields that the twin names into `folder`.

        Returns:
            The texts that load there, by name: `twin.xml`, and attached models.

        Raises:
            InputError: a file of the user's scene is missing.
            OSError: a file cannot be copied.
        """
        # A scene without files is complete as one text.
        if self.document is None or not self.document.files:
            return {TWIN: self.xml}
        return pack(reparse(self.texts or Texts(self.xml), self.document), folder)

    def __repr__(self) -> str:
        if self.validation is None:
            return "<Twin: not simulated>"
        rest = "comes to rest" if self.validation.settled else "does not come to rest"
        return f"<Twin: {len(self._changes())} lines changed, {rest}>"

    def _repr_html_(self) -> str:
        return table(repr(self), ("changed lines",), [(line,) for line in self._changes()])

    def _changes(self) -> list[str]:
        """The added lines of the diff."""
        lines = self.diff.splitlines()
        added = [line for line in lines if line.startswith("+") and not line.startswith("+++ ")]
        return [line[1:].strip() for line in added]


def build_twin(
    scene: Scene,
    estimates: Sequence[Estimate],
    trace: Trace | None = None,
    replay: Replay | None = None,
    on_the_way: Sequence[Estimate] = (),
) -> Twin:
    """Inject the measured values, then test that the result comes to rest.

    With a `trace` and a `replay`, and if any value was measured, the twin must also behave as
    recorded. Sizes in `on_the_way` were measured without a request. They are written, with a
    remark.
    """
    # Write the values, and note the contradicted and the uncertain ones.
    written = [*twin_estimates(estimates), *on_the_way]
    completed = complete(scene, written, {estimate.parameter for estimate in estimates})
    notes: list[str] = []
    for estimate in estimates:
        if estimate.verdict == "contradicted":
            notes.append(f"{estimate.parameter} is not in the twin: {estimate.contradiction}")
        if estimate.verdict == "prior-dominated":
            note = f"{estimate.parameter} is prior-dominated: {estimate.doubt}"
            if (stated := estimate.physical) is not estimate:
                note += f"; the twin holds {as_text(stated.values)} {stated.unit}, the mean of the possible values"
            notes.append(note)
    notes += pair_notes(scene, written)
    notes += [size_note(scene, estimate) for estimate in on_the_way]
    notes += completed.notes
    # The twin is complete without a simulation, if that fails.
    document = scene.resolved.document
    xml, diff = one_text(document, completed.texts), diff_of(document, completed.texts)
    twin = Twin(xml, diff, tuple(notes), None, None, completed.unwritten, document, completed.texts)
    try:
        read = scene_from_text(completed.texts, scene, measured_places(scene, written))
        validation = validate(read, scene, trace, replay if written else None)
        notes += press_notes(read, written)
    except PalpateError as error:
        return replace(twin, notes=(*notes, f"the twin was not simulated: {error}"))
    return replace(twin, notes=tuple(notes), validation=validation, scene=read)


def pair_notes(scene: Scene, estimates: Sequence[Estimate]) -> Iterator[str]:
    """Note each friction whose pair with the support determines it.

    MuJoCo uses the larger friction of a pair, so the object's own may be smaller.
    """
    for estimate in estimates:
        if estimate.parameter.quantity != "friction":
            continue
        # Compare the interval with the friction that the support states.
        supports = {recording.context.support or "" for recording in estimate.evidence}
        ((low, high),) = estimate.intervals.tolist()
        for name in sorted(supports & set(scene.surfaces)):
            stated = surface_friction(scene.resolved.description.bodies[name])
            if low <= stated <= high:
                yield (
                    f"{estimate.parameter} is that of the pair with {name}, as in the twin; {name} states "
                    f"{stated:g}, and MuJoCo uses the larger friction: {estimate.parameter.object}'s own may be smaller"
                )


def size_note(scene: Scene, size: Estimate) -> str:
    """Note a size that was measured without a request, and the scene's size."""
    before = scene.body(size.parameter.object).size
    measured = [i for i in range(len(size.values)) if i not in size.unseen]
    parts = [
        f"{1e3 * size.values[i]:.1f} ± {1e3 * size.stds[i]:.1f} mm along {'xyz'[i]} for {1e3 * before[i]:.1f}"
        for i in measured
    ]
    return f"{size.parameter} was measured in the run: {', '.join(parts)}; it is in the twin"


def touch(
    twin: Twin, template: Scene, trace: Trace, replay: Replay, given: ReplayResult | None = None
) -> Twin:
    """Add the residuals of replays in the twin and in the `template`; `given` is the latter's if it was started."""
    if twin.validation is None or twin.scene is None:
        return twin
    validation = compare_touch(twin.validation, twin.scene, template, trace, replay, given)
    return replace(twin, validation=validation)


def read_twin(
    xml: str,
    scene: Scene,
    estimates: Sequence[Estimate],
    notes: Sequence[str],
    validation: Validation | None,
    unwritten: Sequence[Parameter] = (),
) -> Twin:
    """Read the twin of `scene` that was built before, with its validation.

    Raises InputError: the MJCF does not belong to the scene.
    """
    written = twin_estimates(estimates)
    document = scene.resolved.document
    texts = Texts(xml)
    # A run's folder has all files under other names: make the user's own ones again.
    if document.files:
        texts = complete(scene, written, {estimate.parameter for estimate in estimates}).texts
        xml = one_text(document, texts)
    # Read the twin back only if it was simulated before.
    read = None
    if validation is not None and scene.bodies:
        read = scene_from_text(texts, scene, measured_places(scene, written))
    diff = diff_of(document, texts)
    return Twin(xml, diff, tuple(notes), validation, read, tuple(unwritten), document, texts)


def twin_estimates(estimates: Sequence[Estimate]) -> list[Estimate]:
    """Select the estimates that the twin holds, limited to physically possible values."""
    return [e.physical for e in estimates if e.verdict in ("identified", "prior-dominated")]


def diff_of(document: Document, texts: Texts) -> str:
    """Make a unified diff of the main text and of every included file that has changed."""
    # The main text and each changed include, as one diff.
    pairs = [(document.text, texts.main, "scene.xml", "twin.xml")]
    for path, text in texts.parts.items():
        pairs.append((document.texts[path], text, path.name, path.name))
    diff = ""
    for before, after, name, new_name in pairs:
        lines, new = before.splitlines(keepends=True), after.splitlines(keepends=True)
        diff += "".join(difflib.unified_diff(lines, new, name, new_name))
    return diff


def measured_places(scene: Scene, estimates: Sequence[Estimate]) -> dict[str, Pose]:
    """Poses of the objects whose position, or whose support's height, was measured.

    Poses that came with the scene overrule the MJCF. Measured ones overrule both.
    """
    # Raise the objects with their supports, then place those whose position was measured.
    values = {estimate.parameter: tuple(estimate.values.tolist()) for estimate in estimates}
    scene = at_heights(scene, values)
    poses: dict[str, Pose] = {}
    for name in scene.rises:
        if scene.resolved.description.bodies[name].given is not None:
            poses[name] = scene.bodies[name].pose_world
    for parameter, value in values.items():
        body = scene.bodies.get(parameter.object)
        quantity = scene.catalogue.get(parameter.quantity)
        pose = quantity.places(body, value) if body is not None and quantity is not None else None
        if body is not None and pose is not None:
            poses[body.name] = pose
    return poses
