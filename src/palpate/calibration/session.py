"""An arm that is visited again and again, and what is known of it by now."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from palpate import pipeline
from palpate.callbacks import SILENT, RunCallbacks
from palpate.cells.cell import Cell
from palpate.cells.simulated import SimulatedCell
from palpate.errors import ExecutionAborted, InputError
from palpate.planning.check.check import Finding, check
from palpate.planning.plan import Plan
from palpate.robots.owner.arm import calibrated
from palpate.robots.owner.config import RobotConfig
from palpate.runs.run import Run
from palpate.scene.scene import Scene
from palpate.settings import Settings
from palpate.stages.workplace import cell_for

if TYPE_CHECKING:
    from palpate.robots.description import RobotDescription


@dataclass(slots=True)
class Session:
    """Visits to one arm.

    Attributes:
        settings: which arm.
        config: what is known of it by now; corrected in the next visit.
        callbacks: progress, and the question before a real arm moves.
        visits: how often it was visited.
        seconds: of robot time.
    """

    settings: Settings
    config: RobotConfig
    callbacks: RunCallbacks = SILENT
    visits: int = 0
    seconds: float = 0.0

    @property
    def arm(self) -> RobotDescription:
        """Description of the arm with the calibration so far."""
        told = replace(self.settings, robot_config=None).described_arm()
        return calibrated(told, self.config)

    def perform(self, scene: Scene, plan: Plan, world: Scene | None = None) -> Run:
        """Execute a plan in `scene`, whose simulation is `world` unless the settings name another
        one, and estimate what it measures.

        Raises:
            InputError: the plan cannot be executed there, or was not to its end.
            Unavailable: the robot.
            ExecutionAborted: not confirmed.
        """
        self.visits += 1
        made = Run(self.settings, scene, plan, _findings(plan, scene))
        made = pipeline.rehearse(made, self.callbacks)
        if made.findings:
            raise InputError(_in_the_way(made.findings))
        cell = self._cell(scene, world)
        pipeline.confirm(made, self.callbacks, cell)
        made = pipeline.measure(made, self.callbacks, cell)
        assert made.execution is not None
        if made.execution.stopped_by is not None:
            raise ExecutionAborted(
                f"the calibration was cut short: {made.execution.stopped_by}; nothing is written"
            )
        self.seconds += made.execution.robot_seconds
        return made

    def _cell(self, scene: Scene, world: Scene | None) -> Cell:
        """Return the cell of the next run; each visit to the embedded arm redraws its per-run errors."""
        settings = self.settings
        if world is not None:
            return SimulatedCell(
                world, noise=settings.noise, seed=settings.seed, scene=scene, visit=self.visits
            )
        cell = cell_for(settings, scene)
        if isinstance(cell, SimulatedCell):
            cell.visit = self.visits
        return cell


def _in_the_way(findings: Sequence[Finding]) -> str:
    """Word the first finding as an error, without its advice for authors of plans."""
    what = findings[0].violation.finding
    often = (
        "" if len(findings) == 1 else f" ({len(findings)} motions of the calibration are refused)"
    )
    return (
        f"nothing is calibrated there: {what}{often}; nothing moved: take away what is in the way and leave it "
        "out of the scene, or give a scene in which the arm has room, and the weight or the gauges are in reach"
    )


def _findings(plan: Plan, scene: Scene) -> tuple[Finding, ...]:
    """Check the plan, ignoring `redundant`: a calibration needs recordings that no parameter uses."""
    found = check(plan, scene, remeasure=True)
    return tuple(finding for finding in found if finding.rule != "redundant")
