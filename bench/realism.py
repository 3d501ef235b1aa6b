"""Statistics of recordings of real arms beside those of the simulated one at each noise model."""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from bench.recorded import free_motion, real
from palpate.common.pose import Array, Pose
from palpate.estimation.logs.noise_model import statistics
from palpate.estimation.logs.torque_errors import resample
from palpate.robots.nominal import NominalArm, wrenches
from palpate.robots.owner import load_description
from palpate.trace.recording import ArmLog
from palpate.trace.samples import STANDARD_GRAVITY

ROWS = {
    "white": ("white noise at rest", 1.0),
    "quantisation": ("step of a sample", 1.0),
    "offset": ("offset", 1.0),
    "coulomb": ("Coulomb friction", 1.0),
    "presliding": ("presliding, mrad", 1e3),
    "position": ("friction over a turn, 1", 1.0),
    "residual": ("left below 5 Hz", 1.0),
    "ripple": ("ripple", 1.0),
    "second": ("second harmonic", 1.0),
    "cycles": ("cycles a turn", 1.0),
    "encoder_ripple": ("ripple of encoders, µrad", 1e6),
    "shaking": ("8 to 30 Hz", 1.0),
    "shaking_left": ("8 to 30 Hz less M ddq", 1.0),
}
"""Label of each figure, N m where nothing is said, and the factor to its unit."""
SIGNED = {"offset"}
"""Figures of any sign, of which arms have the root mean square."""
STRETCH, RATE = 0.5, 100.0  # s, Hz: of the mean forces


def table(recordings: Sequence[Path], noises: Sequence[str], seeds: int) -> str:
    """Measure recordings, and `seeds` free motions of the simulated arm at each noise model; return a
    table in Markdown."""
    logs = {path.stem: [real(path)] for path in recordings}
    logs |= {noise: [free_motion(noise, seed) for seed in range(seeds)] for noise in noises}
    arm = load_description()
    found = {name: [statistics(log, arm).figures() for log in some] for name, some in logs.items()}
    lines = ["| | of | joints 1 to 7 |", "|---|---|---|"]
    for key, (label, factor) in ROWS.items():
        for name, runs in found.items():
            values = np.array([run[key].value for run in runs])
            cells = " ".join(_cell(x * factor) for x in _pooled(values, key in SIGNED))
            lines.append(f"| {label} | `{name}` | {cells} |")
            label = ""
    label = "force of the empty hand, x y z, N: deviation of 0.5 s means"
    for name, some in logs.items():
        forces = np.sqrt(np.mean([hand_force(log) ** 2 for log in some], axis=0))
        lines.append(f"| {label} | `{name}` | {' '.join(_cell(x) for x in forces)} |")
        label = ""
    return "\n".join(lines)


def hand_force(log: ArmLog) -> Array:
    """Compute the standard deviations (3,), N, of mean forces at the TCP in free motion."""
    nominal = NominalArm(
        load_description(), Pose.of([0, 0, 0]), np.array([0, 0, -STANDARD_GRAVITY])
    )
    q, dq, tau = (resample(log.t, values, RATE)[1] for values in (log.q, log.dq, log.tau))
    here = nominal.kinematics(q, dq, np.gradient(dq, 1 / RATE, axis=0))
    left = tau - here.gravity_torque - here.inertia_torque
    force = wrenches(here.jacobian, left[:, :, None])[:, :3, 0]
    count = round(STRETCH * RATE)
    return force[: len(force) // count * count].reshape(-1, count, 3).mean(1).std(0)


def _pooled(values: Array, signed: bool) -> list[float]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # a joint that shows nothing
        if signed and len(values) > 1:
            return np.sqrt(np.nanmean(values**2, axis=0)).tolist()
        return np.nanmean(values, axis=0).tolist()


def _cell(value: float) -> str:
    if math.isnan(value):
        return "–"
    return f"{value:.0f}" if abs(value) >= 20 else f"{value:.2g}"
