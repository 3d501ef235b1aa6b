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
from itertools import product
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from palpate.common.errors import Unavailable
from palpate.common.pose import Array
from palpate.twin.export_facts import is_free
from palpate.twin.export_readers import run_job, shorten

SECONDS = 1.0
"""s: duration of each experiment."""
SLIDING = 0.3
"""m/s: initial speed of a free body."""
SWINGING = {mujoco.mjtJoint.mjJNT_HINGE: 2.0, mujoco.mjtJoint.mjJNT_SLIDE: 0.3}
"""rad/s or m/s: initial speed of a joint."""
PRESSING = 5.0
"""Weights of a body with which it is pressed down."""
PROBE = "palpate_probe_"
"""Start of the names of balls that press on fixed surfaces."""
PROBE_RADIUS, PROBE_MASS = 0.01, 0.033
"""m, kg: a ball of steel"""
ABOVE = 10.0
"""m: height above a surface at which rays towards it begin."""
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
    findings: list[Finding] = []
    for reader in READERS:
        if chosen in reader.formats and is_installed(reader, python):
            given = {**job, "reader": reader.script, "file": str(file), "remedy": reader.remedy}
            findings += compare(reader.name, model, twin, run_reader(given, python))
    return findings


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
            name = shorten(model.body(body).name)
            # A ball would roll, by each simulator's own law.
            if not name.startswith(PROBE):
                velocity[name] = [SLIDING, 0.0, 0.0]
            # Apply the force to the heaviest of the rigidly connected bodies.
            parts = np.flatnonzero(model.body_weldid == body)
            heaviest = int(parts[np.argmax(model.body_mass[parts])])
            pressed = shorten(model.body(heaviest).name)
            force[pressed] = (PRESSING * model.body_subtreemass[body] * gravity).tolist()
    for joint in range(model.njnt):
        speed = SWINGING.get(mujoco.mjtJoint(model.jnt_type[joint]))
        if speed is not None and joint not in driven:
            # Away from the nearer limit.
            low, high = model.jnt_range[joint] - model.qpos0[model.jnt_qposadr[joint]]
            is_backward = bool(model.jnt_limited[joint]) and high < -low
            rate[shorten(model.joint(joint).name)] = -speed if is_backward else speed
    experiments: dict[str, dict[str, dict[str, Any]]] = {"rest": {}}
    if velocity:
        experiments["slide"] = {"velocity": velocity}
    if force:
        experiments["press"] = {"force": force}
    if rate:
        experiments["swing"] = {"rate": rate}
    return experiments


def run_reader(job: Mapping[str, Any], python: str) -> dict[str, Any]:
    """Run a job in a separate process.

    Returns:
        The result, or an `error` of one line.
    """
    script = Path(__file__).with_name("export_readers.py")
    process = subprocess.run(
        [python, str(script)], input=json.dumps(job), capture_output=True, text=True, check=False
    )
    if process.returncode == 0:
        return json.loads(process.stdout)
    lines = [line for line in process.stderr.splitlines() if line.strip()]
    return {"error": lines[-1][:300] if lines else f"exit status {process.returncode}"}


def compare(
    reader: str, model: mujoco.MjModel, twin: Mapping[str, Any], other: Mapping[str, Any]
) -> Iterator[Finding]:
    """Compare what a reader found with the twin, by quantity."""
    if "error" in other:
        yield Finding(reader, "file", "lost", other["error"])
        return
    name = f"{reader} {other['version']}"
    expected, read = collect_quantities(model, twin), collect_quantities(model, other)
    for quantity, values in expected.items():
        yield judge(name, quantity, values, read.get(quantity, {}))


def collect_quantities(
    model: mujoco.MjModel, result: Mapping[str, Any]
) -> dict[str, dict[str, Any]]:
    """Values by quantity and by body or joint. Only moving bodies and undriven joints count.

    Bodies that are rigidly connected count as one, since some readers merge them.
    """
    runs, values = result["runs"], dict[str, dict[str, Any]]()
    bodies = result["bodies"]
    parts: dict[str, list[str]] = {}
    for body in np.flatnonzero(model.body_weldid > 0).tolist():
        name = shorten(model.body(body).name)
        if name and name in bodies:
            whole = model.body(int(model.body_weldid[body])).name
            parts.setdefault(shorten(whole), []).append(name)
    wholes = {name: merge([bodies[part] for part in of]) for name, of in parts.items()}
    for quantity in ("mass", "com", "inertia"):
        values[quantity] = {
            n: whole[quantity] for n, whole in wholes.items() if whole["mass"] > 0.0
        }
    free = [shorten(model.body(b).name) for b in range(1, model.nbody) if is_free(model, b)]

    def centres_after(experiment: str) -> dict[str, Any]:
        com = runs[experiment]["com"]
        masses = {n: [bodies[part]["mass"] for part in parts[n]] for n in free if n in parts}
        return {
            n: np.average([com[part] for part in parts[n]], axis=0, weights=weights)
            for n, weights in masses.items()
            if sum(weights) > 0.0 and com.keys() >= set(parts[n])
        }

    rest = centres_after("rest")
    values["pose"] = {n: at for n, at in rest.items() if not n.startswith(PROBE)}
    # A ball sinks into a soft surface by its own weight: its depth counts from the first touch.
    before = {n: wholes[n]["com"] if n.startswith(PROBE) else at for n, at in rest.items()}
    for quantity, counted in (("slide", values["pose"]), ("press", before)):
        if quantity in runs:
            after = centres_after(quantity).items()
            values[quantity] = {n: at - before[n] for n, at in after if n in counted}
    if "swing" in runs:
        # A joint without a name in the source cannot be found elsewhere.
        still = runs["rest"]["joints"]
        swung = runs["swing"]["joints"].items()
        values["swing"] = {n: np.array([angle - still[n]]) for n, angle in swung if n}
    return values


def merge(parts: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Mass, centre of mass and inertia about it, in world axes, of rigidly connected bodies."""
    masses = np.array([part["mass"] for part in parts])
    centres = np.array([part["com"] for part in parts])
    com = masses @ centres / max(masses.sum(), 1e-300)
    # Parallel axes: each inertia moves from its own centre to the common one.
    inertia = np.zeros((3, 3))
    for part, mass, centre in zip(parts, masses, centres - com, strict=True):
        away = centre @ centre * np.eye(3) - np.outer(centre, centre)
        inertia += np.reshape(part["inertia"], (3, 3)) + mass * away
    return {"mass": masses.sum(), "com": com, "inertia": inertia}


def add_probes(scene: Path, surfaces: Sequence[str]) -> Path:
    """Write a copy of a scene, next to it, with a free ball on each fixed surface.

    A surface that something covers everywhere gets none.
    """
    spec = mujoco.MjSpec.from_file(str(scene))
    model = spec.compile()
    for name in surfaces:
        if (at := probe_centre(model, int(model.body(name).id))) is not None:
            ball = spec.worldbody.add_body(name=PROBE + name, pos=at)
            ball.add_freejoint()
            kind, size = mujoco.mjtGeom.mjGEOM_SPHERE, [PROBE_RADIUS, 0.0, 0.0]
            ball.add_geom(type=kind, size=size, mass=PROBE_MASS)
    spec.compile()
    probed = scene.with_name("probed.xml")
    probed.write_text(spec.to_xml(), encoding="utf-8")
    return probed


def probe_centre(model: mujoco.MjModel, body: int) -> Array | None:
    """Centre (3,) of a ball that touches a body from above in the scene's initial state, or None."""
    mj: Any = mujoco  # its type stubs have no rays
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    hit, down = np.array([-1], dtype=np.int32), np.array([0.0, 0.0, -1.0])
    for geom in np.flatnonzero(model.geom_bodyid == body):
        # Vertical rays around the centre.
        spread = model.geom_rbound[geom] * np.linspace(-0.4, 0.4, 5)
        for x, y in product(spread, spread):
            start = data.geom_xpos[geom] + [x, y, ABOVE]
            away: float = mj.mj_ray(model, data, start, down, None, 1, -1, hit)
            if hit[0] == geom:
                return start + (away - PROBE_RADIUS) * down
    return None


def judge(
    reader: str, quantity: str, expected: Mapping[str, Any], read: Mapping[str, Any]
) -> Finding:
    """Compare a quantity of all bodies, and name the one that differs most."""
    if missing := [name for name in expected if name not in read]:
        return Finding(reader, quantity, "lost", f"of {', '.join(missing)}"[:200])
    relative, absolute = TOLERANCE[quantity]
    worst, detail = 1.0, ""
    for name, value in expected.items():
        size, difference = float(np.linalg.norm(value)), float(np.linalg.norm(read[name] - value))
        share = difference / (relative * size + absolute)
        if not share <= worst:
            worst, unit = share, UNITS.get(quantity, "m")
            detail = f"{name}: {float(np.linalg.norm(read[name])):.4g} for {size:.4g} {unit}"
            if quantity in ("com", "pose"):
                detail = f"{name}: by {difference:.3g} m"
    return Finding(reader, quantity, "differs" if detail else "acts", detail)


def require_readers(findings: Sequence[Finding], chosen: str) -> None:
    """Require that at least one reader of a format is installed. Raises Unavailable: none is."""
    if not findings:
        names = ", ".join(p for r in READERS if chosen in r.formats for p in r.packages)
        raise Unavailable(
            f"no reader of {chosen} is installed to check the export; any of: {names}"
        )
