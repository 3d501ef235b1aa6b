"""Rehearsal: execution of a plan in a simulation of the scene, its unknowns at their priors, before
the arm moves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate.execution.runner import run
from palpate.interrupt import interrupts
from palpate.planning.plan import Plan
from palpate.robots.owner.arm import as_measured
from palpate.robots.simulated.robot import MujocoRobot
from palpate.scene.scene import Scene


@dataclass(frozen=True, slots=True)
class Rehearsal:
    """Prediction of a run.

    Attributes:
        actions: number of leaves started.
        robot_seconds: s.
        peak_force: N, largest external force at the TCP.
        failure: reason why it would stop, or None.
    """

    actions: int
    robot_seconds: float
    peak_force: float
    failure: str | None

    def __str__(self) -> str:
        ending = f"would stop: {self.failure}" if self.failure else "no failure"
        return f"{self.actions} actions, {self.robot_seconds:.1f} s, at most {self.peak_force:.1f} N, {ending}"


def rehearse(plan: Plan, scene: Scene) -> Rehearsal:
    """Execute the plan with perfect sensors in a world made of the scene alone.

    Raises:
        Interrupted: by a signal.
    """
    robot = MujocoRobot(scene.spec(), scene.pose_world_base, as_measured(scene.arm))
    try:
        with interrupts() as signals, signals.raised():
            done = run(plan, scene, robot)
    finally:
        robot.close()
    force = np.linalg.norm(done.trace.samples.wrench[:, :3], axis=1)
    peak = float(force.max(initial=0.0))
    return Rehearsal(done.actions, done.robot_seconds, peak, done.stopped_by)
