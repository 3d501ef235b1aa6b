"""Export of a run's results: its twin for simulators, its load for controllers; proof of the twin."""

from __future__ import annotations

import json
import math
import re
import tempfile
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import TypeAdapter

from palpate.common.display import to_json
from palpate.common.errors import InputError, unknown_name
from palpate.common.extensions import Registry
from palpate.common.files import writing
from palpate.common.parameter import Parameter
from palpate.common.pose import Array, Pose, tensor_of
from palpate.common.version import __version__
from palpate.estimation.carried import HAND
from palpate.estimation.estimate import Estimate, round_to_std
from palpate.estimation.holds import pose_in_hand
from palpate.runs.folder import new_folder, read_json, write_json
from palpate.runs.proof import Proof
from palpate.runs.result import parameter_json
from palpate.runs.run import Run
from palpate.trace.recording import Recording
from palpate.trace.samples import STANDARD_GRAVITY
from palpate.twin.export import Export, export_twin, require_format


def export_run(run: Run, to: str, folder: Path | None = None, check: bool = False) -> Export:
    """Write the run's twin into a new folder, by default `export-FORMAT` in the run's own folder.

    With `check` it is compared by experiments in every reader that is installed.

    Raises:
        InputError: the run has no twin, there is no such format, or the folder exists or cannot be
            made.
        Unavailable: the library that writes the format is not installed, or for a check no reader.
        PalpateError: the written file differs from the twin.
    """
    # Write into a scratch folder: the export appears completely or not at all.
    chosen = require_format(to)
    if run.finished is None:
        raise InputError("this run has no twin to export: nothing was measured")
    folder = folder or (run.folder or Path()) / f"export-{chosen}"
    with writing(folder), new_folder(folder) as new, tempfile.TemporaryDirectory() as scratch:
        export = export_twin(run.finished, run.estimates, chosen, new, Path(scratch), check)
        export = replace(export, file=folder / export.file.relative_to(new))
        write_json(new / "export.json", export_json(run, export))
    return export


def export_json(run: Run, export: Export) -> dict[str, Any]:
    """Content of `export.json`; `read_back` is true if the export contains an estimate's value."""
    return {
        "palpate": __version__,
        "format": export.format,
        "file": export.file.name,
        "simulated": run.simulated,
        "parameters": [_row_of(export, estimate) for estimate in run.estimates],
        "check": [asdict(finding) for finding in export.findings],
        "notes": list(export.notes),
    }


def _row_of(export: Export, estimate: Estimate) -> dict[str, Any]:
    """Estimate with the readers in which its value acts."""
    readers = list(export.acts_in(estimate.parameter))
    states = {"written": estimate.parameter in export.kept, "read_back": bool(readers)}
    return parameter_json(estimate) | states | {"acts_in": readers}


# Proof of a run's twin, kept as `proof.json` in the run folder.

PROOF = "proof.json"  # File of a proof in a run folder


def proof_json(proof: Proof) -> dict[str, Any]:
    """Content of `proof.json`; null means an object that tips over or falls."""
    rows = [asdict(row) | {"promise95": row.promise, "depends": row.depends} for row in proof.rows]
    return to_json({"judge": proof.judge, "tasks": rows, "left_out": proof.left_out})


def read_proof(folder: Path) -> Proof | None:
    """Read the proof in a run folder, if any. Raises InputError: the file is not a proof."""
    file = folder / PROOF
    if not file.exists():
        return None
    document = read_json(file)
    try:
        # Null means an infinite error.
        for row in document["tasks"]:
            for name in ("prior", "twin", "drawn"):
                row[name] = [math.inf if error is None else error for error in row[name]]
        return TypeAdapter(Proof).validate_python(document | {"rows": document["tasks"]})
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"'{file}' is no proof: {type(error).__name__}: {error}") from None


# Measured load as data for the robot's own controller.


@dataclass(frozen=True, slots=True, eq=False)
class LoadData:
    """Load on a flange, or on a six-axis sensor."""

    name: str
    frame: Literal["flange", "sensor"]  # of `centre` and `inertia`
    mass: float  # kg
    centre: Array  # (3,) m
    inertia: Array | None  # (3, 3) kg m² about the centre of mass; None where not identified
    gravity: float  # m/s²
    figures: tuple[str, ...]  # each value with its standard deviation, in words

    @property
    def tensor(self) -> Array:
        """(3, 3) inertia, zero where not identified."""
        return np.zeros((3, 3)) if self.inertia is None else self.inertia

    def comments(self, mark: str) -> str:
        """Lines that state units, frame and uncertainty, each after a comment `mark`."""
        # A name of the user's file may have line breaks, which would end the comment.
        return "".join(f"{mark} {' '.join(line.split())}\n" for line in self.figures)


def load_data_of(run: Run, name: str | None = None) -> LoadData:
    """Collect the load `name`, by default the only one, from the estimates of a run.

    Raises InputError: no load, or several, were measured; or mass or centre of mass is not identified.
    """
    estimates = {estimate.parameter: estimate for estimate in run.estimates}
    loads = [p.object for p in estimates if p.quantity == "mass" and p.object != HAND]
    if name is not None and name not in loads:
        raise unknown_name("load", name, loads)
    if name is None and len(loads) != 1:
        raise InputError(
            f"load data need one load: object=NAME, of {', '.join(loads) or 'a run that weighed something'}"
        )
    chosen = name or loads[0]
    mass, centre = (_require(estimates, chosen, quantity) for quantity in ("mass", "com"))
    inertia = estimates.get(Parameter(chosen, "inertia"))
    is_known = inertia is not None and inertia.identified and not inertia.unseen
    # Pose of the object's frame in the frame of the load data.
    pose, frame = _frame(run, chosen)
    tensor = None
    if inertia is not None and is_known:
        tensor = pose.rotation @ tensor_of(inertia.values.tolist()) @ pose.rotation.T
    where = pose.apply(centre.values)
    # Deviations in the turned axes, of independent components.
    stds = np.sqrt(pose.rotation**2 @ centre.stds**2)
    value, std = round_to_std(float(mass.values[0]), float(mass.stds[0]))
    axes = "flange" if frame == "flange" else "sensor"
    places = [
        " ± ".join(round_to_std(1e3 * x, 1e3 * s))
        for x, s in zip(where.tolist(), stds.tolist(), strict=True)
    ]
    figures = (
        f"{chosen}: mass {value} ± {std} kg (1 standard deviation){', simulated' * run.simulated}",
        f"centre of mass in the axes of the {axes}, from its origin, mm: {', '.join(places)}"
        + f" (the recordings hardly observe {', '.join(centre.doubtful_axes)} of the object)"
        * bool(centre.unseen),
        _inertia_in_words(inertia if is_known else None),
        f"It is the load alone: add what else is mounted on the {axes}.",
    )
    gravity = run.trace.gravity if run.recorded is not None else STANDARD_GRAVITY
    return LoadData(chosen, frame, float(mass.values[0]), where, tensor, gravity, figures)


def _require(estimates: dict[Parameter, Estimate], name: str, quantity: str) -> Estimate:
    """Return an identified estimate; raise InputError without one."""
    estimate = estimates.get(Parameter(name, quantity))
    if estimate is None or not estimate.identified:
        verdict = "was not measured" if estimate is None else f"is {estimate.verdict}"
        raise InputError(
            f"load data need mass and centre of mass: {name}.{quantity} {verdict}; measure it, or turn the load in "
            "more poses"
        )
    return estimate


def _inertia_in_words(inertia: Estimate | None) -> str:
    """State the deviations of the moments of inertia."""
    if inertia is None:
        return "inertia not identified: written as 0 (a point mass)"
    pairs = zip(inertia.values[:3].tolist(), inertia.stds[:3].tolist(), strict=True)
    moments = ", ".join(" ± ".join(round_to_std(*pair)) for pair in pairs)
    return f"inertia about the centre of mass; own moments xx, yy, zz, kg m²: {moments}"


def _frame(run: Run, name: str) -> tuple[Pose, Literal["flange", "sensor"]]:
    """Pose of the object's frame in the frame of the flange, or of the sensor that weighed it."""
    trace = run.trace
    carried = [recording for recording in trace.recordings if recording.context.holding == name]
    in_tool = _pose_in_tool(run, name, carried[0]) if carried else Pose.of((0.0, 0.0, 0.0))
    if trace.hand.wrench_sensor is not None and not trace.hand.joints:
        return in_tool, "sensor"
    return run.scene.arm.pose_flange_tcp @ in_tool, "flange"


def _pose_in_tool(run: Run, name: str, recording: Recording) -> Pose:
    """Pose of the object's frame in the tool: stated for a recording, else from the grasp."""
    if run.is_recorded:
        stated = [float(word) for word in (recording.context.grasp or "").split()]
        return Pose.of(stated[:3], stated[3:]) if stated else Pose.of((0.0, 0.0, 0.0))
    return pose_in_hand(run.trace, recording, run.scene.bodies[name])


# Formats of controllers.


@dataclass(frozen=True, slots=True)
class LoadFormat:
    """Format of one controller's load data."""

    write: Callable[[LoadData], str]
    use: str  # what to do with the text, for help and documentation


class LoadFormats(Registry[LoadFormat]):
    """Formats of load data by name."""

    kind = "format of load data"


def _numbers(values: Array) -> list[float]:
    """Numbers with nine digits, without negative zeros."""
    return [float(f"{value:.9g}") + 0.0 for value in values.ravel().tolist()]


def _listed(values: Array) -> str:
    return ", ".join(f"{value:.9g}" for value in _numbers(values))


def _franka_desk(load: LoadData) -> str:
    """Write `endeffector-config.json` of the Franka UI: kg, m and kg m², matrices column by column.

    Source: Franka RIDE CLI documentation 1.1.1, End effector commissioning.
    """
    # The file has no comments: the deviations stand in the displayed name.
    identifier = re.sub("[^a-z0-9]+", "-", load.name.lower()).strip("-") or "load"
    content = {
        "id": f"palpate-{identifier}",
        "name": load.figures[0],
        "color": "#3066be",
        "mass": float(f"{load.mass:.9g}"),
        "centerOfMass": _numbers(load.centre),
        "transformation": _numbers(np.eye(4).T),
        "inertia": _numbers(load.tensor.T),
    }
    return json.dumps(content, indent=2, ensure_ascii=False) + "\n"


def _franka_load(load: LoadData) -> str:
    """Write the call of libfranka's `Robot::setLoad`: kg, m in the flange frame, kg m² column by column.

    Source: libfranka 0.15, `franka::Robot::setLoad(load_mass, F_x_Cload, load_inertia)`.
    """
    return (
        f"{load.comments('//')}robot.setLoad({load.mass:.9g}, {{{{{_listed(load.centre)}}}}}, "
        f"{{{{{_listed(load.tensor.T)}}}}});\n"
    )


def _ur(load: LoadData) -> str:
    """Write URScript's `set_target_payload`: kg, m from the tool mount, Ixx, Iyy, Izz, Ixy, Ixz, Iyz in kg m².

    The inertia is about the centre of gravity, in the axes of the tool flange. `set_payload` is deprecated.
    Source: Universal Robots, Script Manual, PolyScope X 10.6.
    """
    i = load.tensor
    six = np.array([i[0, 0], i[1, 1], i[2, 2], i[0, 1], i[0, 2], i[1, 2]])
    return (
        f"{load.comments('#')}# It must hold the whole payload, gripper included, and zeroes the force sensor.\n"
        f"set_target_payload({load.mass:.9g}, [{_listed(load.centre)}], [{_listed(six)}])\n"
    )


def _kuka(load: LoadData) -> str:
    """Write a KRL `LOAD`: kg, mm in FLANGE, principal axes as Z-Y'-X'' angles in degrees, kg m².

    Source: KUKA, Assembly instructions KR IONTEC V4, 2021, section 4.2, Load center of gravity and mass moment of
    inertia; KUKA.LoadDataDetermination 7.1.
    """
    from scipy.spatial.transform import Rotation  # slow to import

    # Principal axes as a right-handed frame.
    moments, axes = np.linalg.eigh(load.tensor)
    axes = axes * np.sign(np.linalg.det(axes))
    turn = np.zeros(3)
    if load.inertia is not None:
        turn = Rotation.from_matrix(axes).as_euler("ZYX", degrees=True)
    frame = np.concatenate([1e3 * load.centre, turn])
    centre = ",".join(
        f"{letter} {x:.9g}" for letter, x in zip("XYZABC", _numbers(frame), strict=True)
    )
    about = ",".join(
        f"{letter} {x:.9g}" for letter, x in zip("XYZ", _numbers(moments), strict=True)
    )
    return (
        f"{load.comments(';')}; In $CONFIG.DAT, with the number of the tool.\n"
        f"LOAD_DATA[1]={{M {load.mass:.9g},CM {{{centre}}},J {{{about}}}}}\n"
    )


def _ros(load: LoadData) -> str:
    """Write the parameters of `control_filters/GravityCompensationWrench` of ros2_control.

    Source: ros-controls/control_toolbox, gravity_compensation_filter_parameters.yaml.
    """
    return (
        f"{load.comments('#')}# State the names of your frames of tf.\n"
        "world_frame: world\n"
        f"sensor_frame: {'ft_sensor' if load.frame == 'sensor' else 'flange'}\n"
        "tool:\n"
        f"  CoG: [{_listed(load.centre)}]\n"
        f"  gravity_field: [0.0, 0.0, {-load.gravity:.9g}]\n"
        f"  mass: {load.mass:.9g}\n"
    )


FORMATS = LoadFormats(
    {
        "franka-desk": LoadFormat(
            _franka_desk, "endeffector-config.json of an end effector archive"
        ),
        "franka": LoadFormat(_franka_load, "the call setLoad of libfranka"),
        "ur": LoadFormat(_ur, "a line of URScript"),
        "kuka": LoadFormat(_kuka, "a line of $CONFIG.DAT"),
        "ros": LoadFormat(_ros, "parameters of ros2_control's gravity compensation"),
    }
)


def write_load_data(run: Run, to: str, name: str | None = None) -> str:
    """Write the load of a run in the format `to`. Raises InputError: there is no such format, or no such load."""
    return FORMATS.named(to).write(load_data_of(run, name))
