"""Export of a twin for other simulators: MJCF, URDF or USD, each read back."""

from __future__ import annotations

import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

import mujoco
import numpy as np
from lxml import etree

from palpate.common.errors import InputError, PalpateError
from palpate.common.parameter import Parameter
from palpate.common.pose import Pose
from palpate.common.redaction import redact
from palpate.estimation.estimate import Estimate
from palpate.estimation.quantities.catalogue import Catalogue
from palpate.mjcf.document import Document, Element, Texts, parse_xml, tokens
from palpate.mjcf.edits import TextChange, apply_changes, scan, set_attribute
from palpate.mjcf.inertial import mass_of
from palpate.mjcf.reading import reparse
from palpate.scene.describe import Description, describe
from palpate.scene.poses import Poses
from palpate.twin.export_check import SHOWN_BY, Finding, add_probes, check_export, require_readers
from palpate.twin.export_facts import SCENE, file_meshes, prepare, state_inertia
from palpate.twin.export_readers import bodies_of, read_spec
from palpate.twin.export_urdf import write_urdf
from palpate.twin.export_usd import iter_left_out, require_usd, write_usd
from palpate.twin.files import pack
from palpate.twin.randomisation import write_randomisation
from palpate.twin.twin import Twin, twin_estimates

Format = Literal["mjcf", "urdf", "usd", "randomisation"]
FORMATS: tuple[Format, ...] = get_args(Format)

ONLY_NUMBERS = ("stiffness", "velocity", "momentum")
"""Quantities without an attribute in any model."""
NO_FRICTION = (
    "URDF has no friction: each simulator takes its own, except Drake and Bullet, which read that of "
    "each object with its support from elements of theirs"
)
NOT_IN_URDF = ("friction", "spring")
COMBINED = (
    "the friction of a pair acts where `mjc:priority` is read; other simulators combine the frictions "
    "of two materials in their own way"
)
TWICE = (
    "the spring of the joint '{}' is stated as mjc:stiffness and as a drive, which Newton adds up with "
    "SchemaResolverMjc: set joint_target_ke to 0 there"
)
NO_PRIORITY = (
    "frictions of pairs act by `priority`, on all that the object touches: give the pads of a gripper a "
    "higher one, so that theirs act; Drake ignores `priority` and takes the harmonic mean of two geoms: "
    "give it the URDF"
)
CLOSE = 1e-5
"""Relative tolerance: single precision of USD and of meshes, six digits of MuJoCo's own MJCF."""
PORTABLE = "portable.xml"
"""MJCF for readers other than MuJoCo, next to the scene."""
PASSIVE = frozenset({"mass", "com", "com_3d", "inertia", "damping", "frictionloss"})
"""Quantities that `require_same` compares."""
FIELDS = {
    "friction": ("geom_friction", "geom_priority", "geom_condim", "pair_friction"),
    "contact_damping": ("geom_solref", "geom_solimp", "geom_solmix", "pair_solref", "pair_solimp"),
    "size": ("geom_size", "geom_type"),
    "position": ("body_pos", "geom_pos"),
    "height": ("body_pos", "geom_pos", "geom_size"),
    "range": ("jnt_range", "jnt_limited"),
    "spring": ("jnt_stiffness", "qpos_spring"),
}
"""Fields of a compiled model in which a quantity acts: `require_same_fields` compares them."""
READ_BACK = {"mjcf": PASSIVE | FIELDS.keys(), "urdf": PASSIVE}
"""Quantities that MuJoCo reads back from every export of a format, and that are compared."""


@dataclass(frozen=True, slots=True)
class Export:
    """Export of a twin.

    Attributes:
        format: one of `FORMATS`.
        file: the main file, in its folder.
        kept: measured parameters in the file.
        lost: measured parameters that the format cannot state.
        notes: other differences from the twin, and what is assumed, a line each.
        findings: by the check in the readers; empty without it.
    """

    format: Format
    file: Path
    kept: tuple[Parameter, ...]
    lost: tuple[Parameter, ...]
    notes: tuple[str, ...]
    findings: tuple[Finding, ...] = ()

    def acts_in(self, parameter: Parameter) -> tuple[str, ...]:
        """Readers in which a kept parameter acts as in the twin.

        Without a check it is the one that read the file back, if it compared the quantity.
        """
        if parameter not in self.kept:
            return ()
        if not self.findings:
            return ("mujoco",) if parameter.quantity in READ_BACK.get(self.format, ()) else ()
        shown = SHOWN_BY.get(parameter.quantity)
        acting = [f for f in self.findings if f.quantity == shown and f.verdict == "acts"]
        return tuple(finding.reader for finding in acting)


def require_format(name: str) -> Format:
    """Return the format with that name, whose writer is installed.

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
    twin: Twin,
    estimates: Sequence[Estimate],
    chosen: Format,
    folder: Path,
    scratch: Path,
    check: bool = False,
) -> Export:
    """Write a twin into the empty `folder`, with intermediate files in the empty `scratch`.

    With `check` it is compared by experiments in every reader that is installed.

    Raises:
        InputError: the twin cannot be simulated, so that it could not be compared.
        PalpateError: the written file differs from the twin.
        Unavailable: a check, and no reader of the format is installed.
    """
    # Ranges need no model.
    if chosen == "randomisation":
        if check:
            raise InputError("ranges are no model: a check is for mjcf, urdf and usd")
        written = [
            each for each in twin_estimates(estimates) if each.parameter not in twin.unwritten
        ]
        file, notes = write_randomisation(written, folder)
        return Export(chosen, file, tuple(each.parameter for each in written), (), tuple(notes))
    if twin.scene is None:
        raise InputError(f"there is no twin to export: {'; '.join(twin.notes) or 'nothing moved'}")
    # Pack the twin with all its files.
    document = reparse(twin.texts or Texts(twin.xml), twin.scene.resolved.document)
    description = describe(document, Poses(), twin.scene.catalogue, settled=False)
    document = reparse(with_names(document, description), document)
    for name, text in pack(document, scratch, SCENE).items():
        # Redact keys of the environment in every exported file.
        (scratch / name).write_text(redact(text), encoding="utf-8", newline="")
    scene = scratch / SCENE
    # Compare the packed twin with the original, then write and compare the format.
    try:
        packed = mujoco.MjModel.from_xml_path(str(scene))
        require_same(description.shapes.model, packed)
        require_same_fields(description.shapes.model, packed)
        file, notes = WRITERS[chosen](scene, folder, static_frictions(estimates))
    except (ValueError, RuntimeError, mujoco.FatalError) as error:
        reason = " ".join(str(error).split())[:600]
        raise PalpateError(f"the twin cannot be exported as {chosen}: {reason}") from error
    findings: list[Finding] = []
    if check:
        findings = check_written(scene, file, chosen, estimates)
        require_readers(findings, chosen)
    notes += assumptions(description, twin.scene.catalogue)
    # List the parameters that the format can state, and the others.
    kept: list[Parameter] = []
    lost: list[Parameter] = []
    for estimate in estimates:
        parameter = estimate.parameter
        is_in_twin = estimate.verdict in ("identified", "prior-dominated")
        if is_in_twin and parameter not in twin.unwritten:
            (kept if can_state(chosen, description, parameter) else lost).append(parameter)
    return Export(chosen, file, tuple(kept), tuple(lost), tuple(notes), tuple(findings))


def check_written(
    scene: Path,
    file: Path,
    chosen: Format,
    estimates: Sequence[Estimate],
    python: str = sys.executable,
) -> list[Finding]:
    """Compare an export with its source in each reader that is installed for `python`.

    If the stiffness of fixed surfaces was measured, a second export with a ball on each is compared.
    """
    model = mujoco.MjModel.from_xml_path(str(scene))
    stiff = [e.parameter.object for e in estimates if e.parameter.quantity == "stiffness"]
    surfaces = [name for name in stiff if not model.body_weldid[model.body(name).id]]
    if not surfaces:
        return check_export(model, scene, file, chosen, python)
    probed = add_probes(scene, surfaces)
    with tempfile.TemporaryDirectory() as folder:
        model = mujoco.MjModel.from_xml_path(str(probed))
        file, _ = WRITERS[chosen](probed, Path(folder), static_frictions(estimates))
        return check_export(model, probed, file, chosen, python)


def with_names(document: Document, description: Description) -> Texts:
    """Name the objects that have no name in the text: readers find them by name."""
    changes: dict[Path | None, list[TextChange]] = {None: []}
    texts = {None: document.text, **document.texts}
    for name, body in description.bodies.items():
        element, place = body.elements.element, document.index[body.elements.element]
        # Copies and attached models give their bodies other names.
        copied = any(above.tag == "replicate" for above in element.iterancestors())
        attached = place.file is not None and place.file not in document.includes.values()
        tag = scan(texts[place.file])[place.number]
        if tag.name == "body" and "name" not in tag.attributes and not copied and not attached:
            changes.setdefault(place.file, []).append(set_attribute(tag, "name", name))
    parts = {file: apply_changes(texts[file], named) for file, named in changes.items()}
    return Texts(parts.pop(None), {file: text for file, text in parts.items() if file is not None})


def static_frictions(estimates: Sequence[Estimate]) -> dict[str, float]:
    """Measured static friction by object."""
    frictions: dict[str, float] = {}
    for estimate in estimates:
        if estimate.parameter.quantity == "friction" and "static" in estimate.parts:
            frictions[estimate.parameter.object] = float(estimate.parts["static"].value)
    return frictions


def assumptions(description: Description, quantities: Catalogue) -> Iterator[str]:
    """Note values of an export that are neither measured nor stated."""
    inferred: dict[str, list[str]] = {}
    for name, body in description.bodies.items():
        for quantity in quantities.of(body.role):
            status = quantity.status(body)
            if status == "missing" and quantity.id in ("mass", "friction"):
                # Without a statement MuJoCo takes 1000 kg/m^3, and friction 1.
                is_mass = quantity.id == "mass"
                value = f"{mass_of(body):.4g} kg" if is_mass else f"{quantity.known(body)[0]:.4g}"
                yield f"{name}.{quantity.id} is unknown: the export has MuJoCo's default, {value}"
            elif status == "assumed" and quantity.id in ("com", "inertia"):
                inferred.setdefault(quantity.id, []).append(name)
    for what, names in inferred.items():
        yield f"{what} follows from shapes of uniform density: {', '.join(names)}"


def can_state(chosen: Format, description: Description, parameter: Parameter) -> bool:
    """True if a format can state a parameter."""
    if chosen == "mjcf":
        return True  # `<custom>` has a place for everything
    if chosen == "urdf" and parameter.quantity in NOT_IN_URDF:
        return False
    return parameter.object in description.bodies and parameter.quantity not in ONLY_NUMBERS


def _mjcf(scene: Path, folder: Path, _: Mapping[str, float]) -> tuple[Path, list[str]]:
    # The same model for readers that compute no masses, and know neither frames nor includes.
    spec = mujoco.MjSpec.from_file(str(scene))
    model = spec.compile()
    state_inertia(spec, model)
    file_meshes(spec, scene.parent)
    spec.compile()
    shutil.copytree(scene.parent, folder, dirs_exist_ok=True)
    portable = folder / PORTABLE
    portable.write_text(without_frames(spec.to_xml()), encoding="utf-8")
    read = mujoco.MjModel.from_xml_path(str(portable))
    require_same(model, read)
    require_same_fields(model, read)
    notes = [f"{PORTABLE} has every mass stated, without frames and includes, to six digits"]
    if model.geom_priority.any():
        notes.append(NO_PRIORITY)
    return folder / scene.name, notes


def without_frames(xml: str) -> str:
    """Replace each `<frame>` by its content, in the frame's place, and drop the records."""
    root = parse_xml(xml, PORTABLE)
    # The records stay in the scene itself; MuJoCo writes long ones as character data.
    etree.strip_elements(root, "custom")

    def pose_of(element: Element) -> Pose:
        position = [float(part) for part in tokens(element.get("pos") or "0 0 0")]
        return Pose.of(position, [float(p) for p in tokens(element.get("quat") or "1 0 0 0")])

    for frame in reversed(list(root.iter("frame"))):
        # Inner frames come first, so that only bodies and their parts are left.
        pose, below = pose_of(frame), frame.get("childclass")
        for child in frame:
            placed = pose @ pose_of(child)
            numbers = {"pos": placed.position, "quat": placed.quaternion}
            if child.tag == "light":
                direction = [float(part) for part in tokens(child.get("dir") or "0 0 -1")]
                numbers = {"pos": placed.position, "dir": pose.rotation @ direction}
            for name, values in numbers.items():
                child.set(name, " ".join(f"{value:.9g}" for value in values))
            kind = "childclass" if child.tag in ("body", "frame") else "class"
            if below and not child.get(kind):
                child.set(kind, below)
            frame.addprevious(child)
        parent = frame.getparent()
        if parent is not None:
            parent.remove(frame)
    return etree.tostring(root, encoding="unicode")


def _urdf(scene: Path, folder: Path, _: Mapping[str, float]) -> tuple[Path, list[str]]:
    spec, notes = prepare(scene)
    model = spec.compile()
    file = folder / "scene.urdf"
    written = write_urdf(model, file)
    # Links between two joints are lighter than MuJoCo allows.
    spec = read_spec(mujoco, str(file), written.placement)
    spec.compiler.boundmass = spec.compiler.boundinertia = 1e-12
    read = spec.compile()
    require_same(model, read)
    return file, [NO_FRICTION, *notes, *written.notes]


def _usd(scene: Path, folder: Path, static: Mapping[str, float]) -> tuple[Path, list[str]]:
    spec, notes = prepare(scene)
    spec.modelname = scene.stem
    model = spec.compile()
    file = write_usd(spec, scene.with_name("ready.xml"), folder, static)
    springs = [TWICE.format(spec.joints[j].name) for j in np.flatnonzero(model.jnt_stiffness)]
    return file, [COMBINED, *notes, *springs, *iter_left_out(spec)]


WRITERS: Mapping[Format, Callable[[Path, Path, Mapping[str, float]], tuple[Path, list[str]]]] = {
    "mjcf": _mjcf,
    "urdf": _urdf,
    "usd": _usd,
}
"""Writers: each writes the contained scene into a folder and returns the main file, with notes."""


def require_same(twin: mujoco.MjModel, exported: mujoco.MjModel) -> None:
    """Require mass, centre of mass and inertia of all bodies, and the passive forces of all joints.

    Raises PalpateError: one differs.
    """
    bodies, joints = bodies_of(mujoco, exported), joints_of(exported)
    for name, expected in {**bodies_of(mujoco, twin), **joints_of(twin)}.items():
        # A body without mass is not compared: readers give it one.
        if not name or not expected.get("mass", 1.0):
            continue
        other = bodies.get(name, joints.get(name))
        for what, value in expected.items():
            read = None if other is None else np.array(other[what])
            # A small number in an array of large ones has their absolute precision.
            least = max(CLOSE * float(np.abs(value).max(initial=0.0)), 1e-15)
            if read is None or not np.allclose(read, value, CLOSE, least):
                content = "nothing" if read is None else f"{read.ravel()}"
                raise PalpateError(
                    f"the twin's '{name}' is not the same when it is read back: its {what} has "
                    f"{content} instead of {np.ravel(value)}"
                )


def require_same_fields(twin: mujoco.MjModel, exported: mujoco.MjModel) -> None:
    """Require the same contacts, shapes, places, limits and springs of two MJCF files, in order.

    Raises PalpateError: one differs.
    """
    for field in dict.fromkeys(field for fields in FIELDS.values() for field in fields):
        expected, read = np.asarray(getattr(twin, field)), np.asarray(getattr(exported, field))
        if expected.shape != read.shape or not np.allclose(read, expected, CLOSE, CLOSE):
            raise PalpateError(f"the twin is not the same when it is read back: {field} differs")


def joints_of(model: mujoco.MjModel) -> dict[str, dict[str, float]]:
    """Damping and friction of hinges and slides by name."""
    joints: dict[str, dict[str, float]] = {}
    for joint in range(model.njnt):
        if model.jnt_type[joint] >= int(mujoco.mjtJoint.mjJNT_SLIDE):
            dof = int(model.jnt_dofadr[joint])
            forces = {
                "damping": model.dof_damping[dof],
                "frictionloss": model.dof_frictionloss[dof],
            }
            joints[f"joint {model.joint(joint).name}"] = forces
    return joints
