"""Export of a twin for other simulators: MJCF that loads anywhere, URDF, or USD. Every file is read back
and compared, body by body, before it is handed out. Ranges for domain randomisation go beside them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

import mujoco

from palpate.errors import InputError, PalpateError
from palpate.estimation.estimate import Estimate
from palpate.mjcf.document import Texts
from palpate.mjcf.reading import reparsed
from palpate.parameter import Parameter
from palpate.redaction import redact
from palpate.scene.describe import Description, describe
from palpate.scene.poses import Poses
from palpate.twin.export.facts import Facts, differences, facts_of, unnamed
from palpate.twin.export.portable import SCENE, ready
from palpate.twin.export.randomisation import write_randomisation
from palpate.twin.export.urdf import read_urdf, write_urdf
from palpate.twin.export.usd import left_behind, read_usd, require_usd, write_usd
from palpate.twin.files import pack
from palpate.twin.twin import Twin, held_by_twin

Format = Literal["mjcf", "urdf", "usd", "randomisation"]
FORMATS: tuple[Format, ...] = get_args(Format)

ONLY_NUMBERS = ("stiffness", "velocity", "momentum")
"""Quantities without an attribute in any model."""
NO_FRICTION = "URDF has no friction: each simulator takes its own"
COMBINED = "how the friction of two things is combined is up to each simulator of USD"


@dataclass(frozen=True, slots=True)
class Export:
    """Export of a twin.

    Attributes:
        file: the main file, in its folder.
        held: measured parameters that it states, as read back.
        lost: measured parameters that the format cannot state.
        notes: other differences from the twin, a line each.
    """

    format: Format
    file: Path
    held: tuple[Parameter, ...]
    lost: tuple[Parameter, ...]
    notes: tuple[str, ...]


def require_format(name: str) -> Format:
    """The format of that name, whose writer is installed.

    Raises:
        InputError: there is none.
        Unavailable: its writer is not installed.
    """
    for known in FORMATS:
        if name == known:
            if known == "usd":
                require_usd()
            return known
    raise InputError(f"unknown format '{name[:40]}'; valid: {', '.join(FORMATS)}")


def export_twin(
    twin: Twin, estimates: Sequence[Estimate], chosen: Format, folder: Path, scratch: Path
) -> Export:
    """Write a twin into the empty `folder`, with intermediate files in the empty `scratch`.

    Raises:
        InputError: the twin cannot be simulated, so that it could not be compared.
        PalpateError: what was written differs from the twin.
    """
    if chosen == "randomisation":
        written = [each for each in held_by_twin(estimates) if each.parameter not in twin.unwritten]
        file, notes = write_randomisation(written, folder)
        return Export(chosen, file, tuple(each.parameter for each in written), (), tuple(notes))
    if twin.scene is None:
        raise InputError(f"there is no twin to export: {'; '.join(twin.notes) or 'nothing moved'}")
    document = reparsed(twin.texts or Texts(twin.xml), twin.scene.resolved.document)
    description = describe(document, Poses(), twin.scene.catalogue, settled=False)
    for name, text in pack(document, scratch, SCENE).items():
        # Keys of the environment reach no file that is handed on.
        (scratch / name).write_text(redact(text), encoding="utf-8", newline="")
    scene = scratch / SCENE
    try:
        packed = mujoco.MjModel.from_xml_path(str(scene))
        facts, model = facts_of(description.shapes.model), description.shapes.model
        if model.nbody != packed.nbody:
            # The description is without robots: numbers of unnamed bodies are ambiguous.
            for body in range(model.nbody):
                facts.pop(unnamed(body), None)
        require_same(facts, facts_of(packed))
        file, notes = WRITERS[chosen](scene, folder)
    except (ValueError, RuntimeError, mujoco.FatalError) as error:
        reason = " ".join(str(error).split())[:600]
        raise PalpateError(f"the twin cannot be exported as {chosen}: {reason}") from error
    held: list[Parameter] = []
    lost: list[Parameter] = []
    for estimate in estimates:
        parameter = estimate.parameter
        is_in_twin = estimate.verdict in ("identified", "prior-dominated")
        if is_in_twin and parameter not in twin.unwritten:
            (held if can_state(chosen, description, parameter) else lost).append(parameter)
    return Export(chosen, file, tuple(held), tuple(lost), tuple(notes))


def can_state(chosen: Format, description: Description, parameter: Parameter) -> bool:
    """Test if a format can state a parameter."""
    if chosen == "mjcf":
        return True  # `<custom>` has a place for everything
    if chosen == "urdf" and parameter.quantity == "friction":
        return False
    return parameter.object in description.bodies and parameter.quantity not in ONLY_NUMBERS


def _mjcf(scene: Path, folder: Path) -> tuple[Path, list[str]]:
    for path in scene.parent.iterdir():
        path.rename(folder / path.name)
    return folder / scene.name, []


def _urdf(scene: Path, folder: Path) -> tuple[Path, list[str]]:
    spec, notes = ready(scene)
    model = spec.compile()
    file = folder / "scene.urdf"
    written = write_urdf(model, file)
    require_same(facts_of(model, colliding=True), read_urdf(file, written), friction=False)
    return file, [NO_FRICTION, *notes, *written.notes]


def _usd(scene: Path, folder: Path) -> tuple[Path, list[str]]:
    spec, notes = ready(scene)
    spec.modelname = scene.stem
    twin = facts_of(spec.compile())
    file = write_usd(spec, scene.with_name("ready.xml"), folder)
    require_same(twin, read_usd(file))
    return file, [COMBINED, *notes, *left_behind(spec)]


WRITERS: Mapping[Format, Callable[[Path, Path], tuple[Path, list[str]]]] = {
    "mjcf": _mjcf,
    "urdf": _urdf,
    "usd": _usd,
}
"""Each writes the contained scene into a folder and returns the main file, with notes."""


def require_same(
    twin: Mapping[str, Facts], made: Mapping[str, Facts], friction: bool = True
) -> None:
    for name, difference in differences(twin, made, friction):
        raise PalpateError(
            f"the twin's '{name}' is not the same when it is read back: {difference}"
        )
