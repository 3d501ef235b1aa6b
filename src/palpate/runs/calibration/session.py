"""Session of a calibration: repeated visits to one arm, each corrected by the findings before it.

The embedded arm is on a bench: a plate with a weight or gauge blocks. The scene of the bench states
nominal sizes. Its hidden world draws the true sizes within their limits.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from palpate.common.errors import ExecutionAborted, InputError
from palpate.execution.cell import Cell
from palpate.execution.runner import Observer
from palpate.execution.simulated_cell import SimulatedCell
from palpate.planning.check.check import check
from palpate.planning.check.finding import Finding
from palpate.planning.plan import Plan
from palpate.robots.description import RobotDescription
from palpate.robots.owner import apply_calibration
from palpate.robots.robot_config import RobotConfig
from palpate.runs import pipeline
from palpate.runs.calibration.gains import StatedSize
from palpate.runs.callbacks import SILENT, RunCallbacks
from palpate.runs.report.live_terminal import Observers
from palpate.runs.run import Run
from palpate.runs.settings import Settings
from palpate.runs.workplace import cell_for
from palpate.scene.load import parse_scene
from palpate.scene.scene import Scene
from palpate.trace.samples import STANDARD_GRAVITY, Trace

BLOCK = "block"  # Name of the weight, a block of 40 x 40 x 80 mm for any mass
# m: distances from the base to the weight, one for each visit. The joints share its weight
# differently at each place, so that the gains hold between and around these places.
PLACES = (0.45, 0.60, 0.35)
# m: positions of the gauge blocks on the plate. Their spread shows a tilt of the arm's frame.
GAUGES = ((0.50, -0.18), (0.50, 0.18), (0.66, -0.18), (0.66, 0.18), (0.58, 0.0))
GAUGE_NAMES = tuple(f"gauge_{i}" for i in range(1, len(GAUGES) + 1))

PLATE = """<mujoco model="calibration bench">
  <option timestep="0.002" gravity="0 0 {gravity}"/>
  <worldbody>
    <light pos="0.4 -0.6 2" dir="0 0.2 -1"/>
    <site name="robot_base"/>
    <body name="plate" pos="0.4 0 -0.01">
      <geom type="box" size=".6 .5 .01" rgba=".7 .7 .72 1" friction="0.6 0.005 0.0001"/>
    </body>
{bodies}
  </worldbody>
</mujoco>
"""
WEIGHT = """    <body name="{name}" pos="{x} 0 0.04">
      <freejoint/>
      <geom type="box" size="0.02 0.02 0.04" mass="{mass!r}" rgba=".75 .7 .5 1"
        friction="0.7 0.005 0.0001"/>
    </body>"""
GAUGE = """    <body name="{name}" pos="{x} {y} {half!r}">
      <geom type="box" size=".08 .08 {half!r}" rgba=".6 .65 .7 1" friction="0.6 0.005 0.0001"/>
    </body>"""


CAMERA = """    <camera name="workspace" pos="1.5 -0.4 0.9" fovy="45"
      xyaxes="0.356 0.934 0 -0.349 0.133 0.928"/>"""


def truth(stated: StatedSize, seed: int, name: str) -> float:
    """Draw a true size, uniform within the stated limits; deterministic for a seed and a name."""
    random = np.random.default_rng([seed, *name.encode()])
    return stated.value + stated.limit * random.uniform(-1.0, 1.0)


@dataclass(slots=True)
class CalibrationSession:
    """Visits to one arm."""

    settings: Settings  # name the arm
    config: RobotConfig  # findings so far; the next visit is corrected by them
    callbacks: RunCallbacks = SILENT  # progress, and the question before a real arm moves
    visits: int = 0  # number of visits, earlier sessions included
    seconds: float = 0.0  # duration of all motions, s of robot time
    cell: Cell | None = None  # workplace of the last visit

    @property
    def arm(self) -> RobotDescription:
        """Description of the arm, corrected by the calibration so far."""
        uncorrected = replace(self.settings, robot_config=None).described_arm()
        return apply_calibration(uncorrected, self.config)

    def empty_bench(self) -> Scene:
        """Bench with nothing on it."""
        return self._bench("")

    def bench_with_weight(self, mass: float, x: float) -> Scene:
        """Bench with a weight of `mass`, kg, at `x`, m from the base."""
        return self._bench(WEIGHT.format(name=BLOCK, x=x, mass=mass))

    def bench_with_gauges(self, height: float) -> Scene:
        """Bench with gauge blocks. Their tops are `height`, m, above the plane of the arm's base."""
        blocks: list[str] = []
        for name, (x, y) in zip(GAUGE_NAMES, GAUGES, strict=True):
            blocks.append(GAUGE.format(name=name, x=x, y=y, half=height / 2))
        return self._bench("\n".join(blocks))

    def bench_with_camera(self) -> Scene:
        """Bench with a camera that sees it."""
        return self._bench(CAMERA)

    def _bench(self, bodies: str) -> Scene:
        text = PLATE.format(gravity=-STANDARD_GRAVITY, bodies=bodies)
        return parse_scene(text, arm=self.arm)

    def findings(self, scene: Scene, plan: Plan) -> tuple[Finding, ...]:
        """Check a plan for findings that forbid it.

        The rule `redundant` does not apply: a calibration needs recordings that no parameter of the
        plan uses.
        """
        findings = check(plan, scene, remeasure=True)
        return tuple(finding for finding in findings if finding.rule != "redundant")

    def perform(
        self, scene: Scene, plan: Plan, world: Scene | None = None, observer: Observer | None = None
    ) -> Trace:
        """Execute a plan in `scene` and return its trace.

        The arm is in the simulated `world`, or else in the workplace that the settings name. The `observer` is
        called in addition to that of the callbacks.

        Raises:
            InputError: the plan cannot be executed there.
            Unavailable: the robot.
            ExecutionAborted: not confirmed, or stopped before its end.
        """
        # Check and rehearse before anything moves.
        self.visits += 1
        # Rehearse the plan; a finding of the rehearsal refuses the calibration before any motion.
        findings = self.findings(scene, plan)
        run = pipeline.rehearse(Run(self.settings, scene, plan, findings), self.callbacks)
        if run.findings:
            # Leave out the violation's advice, which addresses authors of plans.
            finding, count = run.findings[0].message.partition(";")[0], len(run.findings)
            often = "" if count == 1 else f" ({count} motions of the calibration are refused)"
            raise InputError(
                f"nothing is calibrated there: {finding}{often}; nothing moved: take away what is in the "
                "way and leave it out of the scene, or give a scene in which the arm has room, and the "
                "weight or the gauges are in reach"
            )
        # Each visit to the embedded arm draws its errors of one run again.
        if world is None:
            cell = cell_for(self.settings, scene)
            if isinstance(cell, SimulatedCell):
                cell.visit = self.visits
        else:
            noise, seed = self.settings.noise, self.settings.seed
            cell = SimulatedCell(world, noise=noise, seed=seed, scene=scene, visit=self.visits)
        self.cell, callbacks = cell, self.callbacks
        pipeline.confirm(run, callbacks, cell)
        if observer is not None:
            every = [o for o in (observer, callbacks.observer) if o is not None]
            callbacks = replace(callbacks, observer=Observers(*every))
        # Execute; an incomplete execution gives no calibration.
        run = pipeline.measure(run, callbacks, cell)
        assert run.execution is not None
        if run.execution.stopped_by is not None:
            reason = run.execution.stopped_by
            raise ExecutionAborted(f"the calibration was cut short: {reason}; nothing is written")
        assert run.trace_if_any is not None
        self.seconds += run.execution.robot_seconds
        return run.trace_if_any
