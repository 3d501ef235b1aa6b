"""Comparison of an export with the twin in each simulator that reads it, by experiments.

`export_readers` runs the same experiments on the twin's MJCF in MuJoCo and on the exported file in
each reader: rest for a second, the slide of free bodies, the swing of joints, and the depth of
pressed bodies.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from palpate.common.errors import Unavailable
from palpate.twin.export_facts import is_free
from palpate.twin.export_readers import run_job, short

SECONDS = 1.0
"""s: duration of each experiment."""
SLIDING = 0.3
"""m/s: initial speed of a free body."""
SWINGING = {mujoco.mjtJoint.mjJNT_HINGE: 2.0, mujoco.mjtJoint.mjJNT_SLIDE: 0.3}
"""rad/s or m/s: initial speed of a joint."""
PRESSING = 5.0
"""Weights of a body with which it is pressed down."""
TOLERANCE = {
    "mass": (1e-3, 1e-9),
    "com": (0.0, 1e-4),
    "inertia": (1e-3, 1e-12),
    "pose": (0.0, 2e-3),
    "slide": (0.05, 1e-3),
    "swing": (0.02, 1e-3),
    "press": (0.1, 2e-4),
}
"""Relative and absolute tolerance, kg, m, kg m^2, and rad or m for a swing, by quantity."""
UNITS = {"mass": "kg", "inertia": "kg m²", "swing": "rad or m"}
"""Units other than m, by quantity."""
SHOWN_BY = {
    "mass": "mass",
    "com": "com",
    "com_3d": "com",
    "inertia": "inertia",
    "friction": "slide",
    "frictionloss": "swing",
    "damping": "swing",
    "spring": "swing",
    "range": "swing",
    "position": "pose",
    "height": "pose",
    "stiffness": "press",
    "contact_damping": "press",
}
"""Experiment in which a measured quantity acts."""


@dataclass(frozen=True, slots=True)
class Reader:
    """A way to load an export.

    Attributes:
        name: as printed.
        script: its name in `export_readers`.
        packages: distributions that it needs.
        formats: formats that it reads.
        remedy: true if it loads with more than the defaults.
    """

    name: str
    script: str
    packages: tuple[str, ...]
    formats: tuple[str, ...]
    remedy: bool = False


READERS = (
    Reader("mujoco", "mujoco", ("mujoco",), ("mjcf", "urdf")),
    Reader("mujoco-usd", "mujoco", ("mujoco-usd",), ("usd",)),
    Reader("mujoco-warp", "mujoco_warp", ("mujoco-warp",), ("mjcf",)),
    Reader("newton", "newton", ("newton",), ("mjcf", "urdf", "usd")),
    Reader("newton with remedy", "newton", ("newton",), ("mjcf", "urdf", "usd"), remedy=True),
    Reader("drake", "drake", ("drake",), ("mjcf", "urdf")),
    Reader("drake with remedy", "drake", ("drake",), ("mjcf", "urdf"), remedy=True),
    Reader("pinocchio", "pinocchio", ("pin",), ("mjcf", "urdf")),
    Reader("pybullet", "pybullet", ("pybullet",), ("mjcf", "urdf")),
)


@dataclass(frozen=True, slots=True)
class Finding:
    """A quantity of an export in a reader.

    Attributes:
        reader: name, with its version.
        quantity: one of `TOLERANCE`, or "file" if the reader does not load it.
        verdict: "acts", "differs" or "lost".
        detail: the largest difference, or the reason.
    """

    reader: str
    quantity: str
    verdict: str
    detail: str = ""


def check_export(
    model: mujoco.MjModel, source: Path, file: Path, chosen: str, python: str = sys.executable
) -> list[Finding]:
    """Compare an export with its source in each reader that is installed.

    Args:
        model: compiled source.
        source: MJCF of the twin.
        file: exported main file.
        chosen: its format.
        python: interpreter whose installed readers are used.
    """
    placement = file.with_name("placement.json")
    job = {
        "gravity": model.opt.gravity.tolist(),
        "step": float(model.opt.timestep),
        "seconds": SECONDS,
        "experiments": experiments_for(model),
        "placement": {},
        "remedy": False,
    }
    twin = run_job({**job, "reader": "mujoco", "file": str(source)})
    if placement.exists():
        job["placement"] = json.loads(placement.read_text("utf-8"))
    found: list[Finding] = []
    for reader in READERS:
        if chosen in reader.formats and is_installed(reader, python):
            given = {**job, "reader": reader.script, "file": str(file), "remedy": reader.remedy}
            found += compare(reader.name, model, twin, run_reader(given, python))
    return found


def is_installed(reader: Reader, python: str) -> bool:
    """True if an interpreter has all packages of a reader."""
    if python == sys.executable:
        try:
            for package in reader.packages:
                distribution(package)
            return True
        except PackageNotFoundError:
            return False
    asked = "import sys, importlib.metadata as m; [m.version(name) for name in sys.argv[1:]]"
    command = [python, "-c", asked, *reader.packages]
    return subprocess.run(command, capture_output=True, check=False).returncode == 0


def experiments_for(model: mujoco.MjModel) -> dict[str, dict[str, dict[str, Any]]]:
    """Experiments with all free bodies, and with all joints that no actuator drives."""
    driven = set(model.actuator_trnid[model.actuator_trntype == 0, 0].tolist())
    gravity = model.opt.gravity
    velocity: dict[str, list[float]] = {}
    force: dict[str, list[float]] = {}
    rate: dict[str, float] = {}
    for body in range(1, model.nbody):
        if is_free(model, body):
            name = short(model.body(body).name)
            velocity[name] = [SLIDING, 0.0, 0.0]
            force[name] = (PRESSING * model.body_subtreemass[body] * gravity).tolist()
    for joint in range(model.njnt):
        speed = SWINGING.get(mujoco.mjtJoint(model.jnt_type[joint]))
        if speed is not None and joint not in driven:
            # Away from the nearer limit.
            low, high = model.jnt_range[joint] - model.qpos0[model.jnt_qposadr[joint]]
            is_backward = bool(model.jnt_limited[joint]) and high < -low
            rate[short(model.joint(joint).name)] = -speed if is_backward else speed
    found: dict[str, dict[str, dict[str, Any]]] = {"rest": {}}
    if velocity:
        found |= {"slide": {"velocity": velocity}, "press": {"force": force}}
    if rate:
        found["swing"] = {"rate": rate}
    return found


def run_reader(job: Mapping[str, Any], python: str) -> dict[str, Any]:
    """Run a job in a process of its own.

    Returns:
        The result, or an `error` of one line.
    """
    script = Path(__file__).with_name("export_readers.py")
    made = subprocess.run(
        [python, str(script)], input=json.dumps(job), capture_output=True, text=True, check=False
    )
    if made.returncode == 0:
        return json.loads(made.stdout)
    lines = [line for line in made.stderr.splitlines() if line.strip()]
    return {"error": lines[-1][:300] if lines else f"exit status {made.returncode}"}


def compare(
    reader: str, model: mujoco.MjModel, twin: Mapping[str, Any], other: Mapping[str, Any]
) -> Iterator[Finding]:
    """Compare what a reader found with the twin, by quantity."""
    if "error" in other:
        yield Finding(reader, "file", "lost", other["error"])
        return
    name = f"{reader} {other['version']}"
    mine, its = measured(model, twin), measured(model, other)
    for quantity, values in mine.items():
        yield judge(name, quantity, values, its.get(quantity, {}))


def measured(model: mujoco.MjModel, result: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Values by quantity and by body or joint. Only moving bodies and undriven joints count."""
    runs, found = result["runs"], dict[str, dict[str, Any]]()
    # Bodies that move and weigh something; simulators leave out others.
    counted = np.flatnonzero((model.body_weldid > 0) & (model.body_mass > 0.0)).tolist()
    moving = {short(model.body(b).name) for b in counted}
    for quantity in ("mass", "com", "inertia"):
        told = result["bodies"].items()
        found[quantity] = {n: np.array(v[quantity]) for n, v in told if n in moving and n}
    free = {short(model.body(b).name) for b in range(1, model.nbody) if is_free(model, b)}
    rest = {n: np.array(at) for n, at in runs["rest"]["com"].items() if n in free}
    found["pose"] = rest
    for quantity in ("slide", "press"):
        if quantity in runs:
            after = runs[quantity]["com"]
            found[quantity] = {n: np.array(after[n]) - at for n, at in rest.items()}
    if "swing" in runs:
        # A joint without a name in the source cannot be found elsewhere.
        before = runs["rest"]["joints"]
        swung = runs["swing"]["joints"].items()
        found["swing"] = {n: np.array([angle - before[n]]) for n, angle in swung if n}
    return found


def judge(reader: str, quantity: str, mine: Mapping[str, Any], its: Mapping[str, Any]) -> Finding:
    """Compare a quantity of all bodies, and name the one that differs most."""
    if missing := [name for name in mine if name not in its]:
        return Finding(reader, quantity, "lost", f"of {', '.join(missing)}"[:200])
    relative, absolute = TOLERANCE[quantity]
    worst, detail = 1.0, ""
    for name, value in mine.items():
        size, apart = float(np.linalg.norm(value)), float(np.linalg.norm(its[name] - value))
        share = apart / (relative * size + absolute)
        if not share <= worst:
            worst, unit = share, UNITS.get(quantity, "m")
            detail = f"{name}: {float(np.linalg.norm(its[name])):.4g} for {size:.4g} {unit}"
            if quantity in ("com", "pose"):
                detail = f"{name}: by {apart:.3g} m"
    return Finding(reader, quantity, "differs" if detail else "acts", detail)


def require_readers(findings: Sequence[Finding], chosen: str) -> None:
    """Require that at least one reader of a format is installed.

    Raises:
        Unavailable: none is.
    """
    if not findings:
        names = ", ".join(p for r in READERS if chosen in r.formats for p in r.packages)
        raise Unavailable(
            f"no reader of {chosen} is installed to check the export; any of: {names}"
        )
