"""Recordings of free motion at 1 kHz: of the simulated arm, and of real ones."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np

from palpate.common.pose import Array, Pose
from palpate.estimation.logs.columns import ColumnMap, clean_signals
from palpate.robots.owner import load_description
from palpate.robots.simulated.robot import MujocoRobot
from palpate.robots.simulated.timing import BLOCK, PERIOD, TIMESTEP
from palpate.trace.recording import ArmLog
from palpate.trace.samples import Samples

REACH: Array = np.array([0.4, 0.35, 0.4, 0.5, 0.5, 0.4, 0.8])  # rad about the home pose
TICK = 0.05
REST = 0.3  # s at each goal
STEPS = {"q": 1e-6, "dq": 1e-5, "tau": 1e-4, "tau_ext": 1e-3}  # as the recordings' read.py says


def free_motion(noise: str, seed: int, seconds: float = 30.0, arm: str = "fr3") -> ArmLog:
    """Record the simulated arm between random goals about its home pose, at 1 kHz."""
    described = load_description(arm)
    robot = MujocoRobot(mujoco.MjSpec(), Pose.of([0, 0, 0]), described, noise=noise, seed=seed)
    line = robot._sensors.line  # pyright: ignore[reportPrivateUsage]
    line.kept = ()
    random, runs = np.random.default_rng(seed), list[Samples]()
    while robot.state.t < seconds:
        goal = described.home + REACH * random.uniform(-1, 1, 7)
        robot.move_joints(goal, float(random.uniform(0.4, 1.0)))
        while robot.state.moving:
            robot.advance(TICK)
        robot.advance(REST)
        runs.append(robot.drain())
    samples = Samples.concatenate(runs)
    tau = np.concatenate(line.kept)
    # A logged sample is the mean of a period.
    middle = np.round(samples.t / PERIOD) * PERIOD - (BLOCK - 1) / 2 * TIMESTEP
    t = TIMESTEP * np.arange(1.0, len(tau) + 1)
    q, dq = (
        np.stack([np.interp(t, middle, column) for column in values.T], axis=1)
        for values in (samples.q, samples.dq)
    )
    return ArmLog(t, q, dq, tau, None, f"{noise}, seed {seed}")


def real(path: Path) -> ArmLog:
    """Read a recording that is packed as the differences of whole steps, or as plain arrays."""
    data = np.load(path)
    if "dt_us" in data:
        signals = {
            name: np.cumsum(data[f"{name}_steps"], axis=0) * size for name, size in STEPS.items()
        }
        signals["t"] = np.cumsum(data["dt_us"].astype(float)) * 1e-6
    else:
        signals = {name: data[name].astype(float) for name in data.files}
    found, notes = clean_signals(signals, ColumnMap(), path.name)
    return ArmLog(found["t"], found["q"], found["dq"], found["tau"], None, path.name, notes)
