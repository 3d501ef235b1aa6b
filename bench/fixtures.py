"""Hidden drawers and doors: friction, damping and spring of their joints against the truth.

Each world is a bundled scenario with another joint, mass, place and solver, drawn by its seed; nothing else of it
is known to the estimators.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from palpate.execution.simulated_cell import SimulatedCell, simulated_cell
from palpate.robots.simulated.robot import MujocoRobot
from palpate.runs import pipeline
from palpate.runs.executing import end_execution
from palpate.runs.run import Run
from palpate.scene.load import parse_scene
from palpate.studies.scenarios.catalogue import scenario
from palpate.studies.workers import Lines
from palpate.trace.mcap import read_mcap, write_mcap
from palpate.trace.samples import Trace

STREAM = 39
"""Random stream of the hidden joints, independent of all others of a seed."""
DISPLACED = 0.0005
"""m (1 sigma) an axis: accuracy of a fixture's place."""
MASS = (0.3, 4.0)
"""kg: range of what moves, log-uniform."""
SLIDE = {"frictionloss": (1.0, 8.0), "damping": (2.0, 20.0), "stiffness": (5.0, 60.0)}
"""N, N s/m, N/m: ranges of a slide's joint, uniform."""
LEVER = 0.35
"""m: a hinge has the same forces at its handle."""
SOLVERS, CONES = (2, 1), (1, 0)
"""MuJoCo's Newton and CG; elliptic and pyramidal."""


@dataclass(frozen=True, slots=True)
class Case:
    """A hidden world: scenario, noise model and seed; `spring`: its joint has one, that is unknown, too."""

    scenario: str
    noise: str
    seed: int
    spring: bool = False

    @property
    def name(self) -> str:
        """Name of its trace."""
        spring = "-spring" if self.spring else ""
        return f"{self.scenario.replace('/', '_')}{spring}-{self.noise}-{self.seed}"


@dataclass(frozen=True, slots=True)
class Score:
    """An estimate and its truth, SI units."""

    quantity: str
    verdict: str
    truth: float
    value: float
    std: float
    low: float
    high: float

    @property
    def z(self) -> float:
        """Error in stated deviations."""
        return (self.value - self.truth) / self.std

    @property
    def held(self) -> bool:
        """The interval holds the truth."""
        return self.low <= self.truth <= self.high


@dataclass(frozen=True, slots=True)
class FixtureRun:
    """Result of a case.

    Attributes:
        status: of the run; reason: of a stop.
        peak: N, largest force at the handle, by the arm's own sensors.
        mass: kg of what moves.
        unmeasured: quantities without a value.
    """

    case: Case
    status: str
    reason: str
    peak: float = 0.0
    mass: float = 0.0
    scores: tuple[Score, ...] = ()
    unmeasured: tuple[str, ...] = ()


class OtherSolver(SimulatedCell):
    """Cell whose world is computed by a solver and a cone drawn by its seed."""

    def robot(self) -> MujocoRobot:
        robot = super().robot()
        random = np.random.default_rng([self.seed, STREAM, 1])
        option = robot.world.model.opt
        for name, values in (("solver", SOLVERS), ("cone", CONES)):
            setattr(option, name, int(random.choice(values)))
        return robot


def hidden(text: str, case: Case) -> tuple[str, float]:
    """MJCF of a scenario's world with the joint, mass and place of a case, and the mass, kg."""
    random = np.random.default_rng([case.seed, STREAM])
    root = ET.fromstring(text)
    cabinet = root.find("worldbody/body")
    assert cabinet is not None
    fixture = cabinet.find("body")
    assert fixture is not None
    joint = fixture.find("joint")
    assert joint is not None
    x, y, z = (float(part) for part in cabinet.get("pos", "0 0 0").split())
    dx, dy = DISPLACED * random.standard_normal(2)
    cabinet.set("pos", f"{x + dx:.6f} {y + dy:.6f} {z}")
    hinge = joint.get("type") == "hinge"
    for name, (low, high) in SLIDE.items():
        value = random.uniform(low, high)
        scale = 1.0 if not hinge else LEVER if name == "frictionloss" else LEVER**2
        if name != "stiffness" or case.spring:
            joint.set(name, f"{scale * value:.5g}")
    geoms = fixture.findall("geom")
    mass = float(np.exp(random.uniform(*np.log(MASS))))
    share = mass / sum(float(geom.get("mass", "0")) for geom in geoms)
    for geom in geoms:
        geom.set("mass", f"{share * float(geom.get('mass', '0')):.5g}")
    return ET.tostring(root, encoding="unicode"), mass


def measured(case: Case, traces: Path | None = None) -> tuple[Run, float]:
    """Run of a case up to its estimates and their truth, from its trace if that is kept in `traces`; and the mass that
    moves, kg."""
    settings = scenario(case.scenario).settings(noise=case.noise, seed=case.seed)
    assert settings.scene is not None
    assert settings.world is not None
    known = settings.scene.read_text(encoding="utf-8")
    wanted = ["frictionloss", "damping"]
    if case.spring:
        known = known.replace('damping="?"', 'damping="?" stiffness="?"')
        wanted.append("spring")
    text, mass = hidden(settings.world.read_text(encoding="utf-8"), case)
    name = case.scenario.rpartition("/")[2]
    asked = tuple(f"{name}.{id}" for id in wanted)
    settings = replace(settings, world=None, request=None, measure=asked)
    settings = settings.check_values(at_hand=True)
    arm = settings.described_arm()
    scene, world = parse_scene(known, arm=arm), parse_scene(text, arm=arm)
    given = simulated_cell(scene, world, noise=case.noise, seed=case.seed)
    cell = OtherSolver(given.world, noise=case.noise, seed=case.seed, scene=scene)
    made = pipeline.plan(settings, scene)
    return pipeline.estimate(execute_or_read(made, cell, case, traces), cell), mass


def execute_or_read(made: Run, cell: SimulatedCell, case: Case, traces: Path | None) -> Run:
    """Execute a planned run of a case, or read its trace if the folder `traces` has it; keep the trace there."""
    file = None if traces is None else traces / f"{case.name}.mcap"
    if file is not None and file.exists():
        return end_execution(replace(made, recorded=read_mcap(file)))
    made = pipeline.execute(made, cell)
    if file is not None and made.trace_if_any is not None:
        file.parent.mkdir(parents=True, exist_ok=True)
        write_mcap(file, made.trace)
    return made


def judge(case: Case, traces: Path | None = None) -> FixtureRun:
    """Measure in the world of a case, and compare with its truth."""
    run, mass = measured(case, traces)
    trace = run.trace_if_any
    return replace(score(case, run), mass=mass, peak=0.0 if trace is None else peak(trace))


def score(case: Case, run: Run) -> FixtureRun:
    """Compare the estimates of a run with their truth."""
    done, scores, without = run.execution, list[Score](), list[str]()
    for found in run.estimates:
        quantity = found.parameter.quantity
        if not found.has_value:
            without.append(quantity)
            continue
        (truth,), (low, high) = run.truth[found.parameter], found.intervals[0].tolist()
        value, std = float(found.values[0]), float(found.stds[0])
        scores.append(Score(quantity, found.verdict, truth, value, std, low, high))
    reason = (done.stopped_by or "") if done is not None else ""
    return FixtureRun(case, run.status, reason, scores=tuple(scores), unmeasured=tuple(without))


def peak(trace: Trace) -> float:
    """Largest change of the force, N, since its recording began, with a handle in the hand."""
    found = [0.0]
    for recording in trace.recordings:
        if recording.context.activity in ("working", "limit") and recording.context.holding:
            force = trace.of(recording).wrench[:, :3]
            found.append(float(np.linalg.norm(force - force[:20].mean(axis=0), axis=1).max()))
    return max(found)


@dataclass(frozen=True, slots=True)
class Group:
    """Scores of one quantity of one scenario at one noise model.

    Attributes:
        worlds: executed; complete: number of complete ones.
        values: with a value; identified: of them.
        held: intervals of identified ones that hold; z: their rms error in stated deviations; worst: largest.
        width: median stated deviation over the truth.
        peak: N, largest force.
    """

    scenario: str
    noise: str
    quantity: str
    worlds: int
    complete: int
    values: int
    identified: int
    held: int
    z: float
    worst: float
    width: float
    peak: float


def groups(runs: Sequence[FixtureRun]) -> list[Group]:
    """A line for each quantity, scenario and noise model."""
    found: list[Group] = []
    keys = {
        (run.case.scenario, run.case.noise, score.quantity): None
        for run in runs
        for score in run.scores
    }
    for name, noise, quantity in keys:
        here = [run for run in runs if (run.case.scenario, run.case.noise) == (name, noise)]
        scores = [score for run in here for score in run.scores if score.quantity == quantity]
        sure = [score for score in scores if score.verdict == "identified"]
        z = np.array([score.z for score in sure]) if sure else np.array([np.nan])
        group = Group(
            name,
            noise,
            quantity,
            worlds=len(here),
            complete=sum(run.status == "complete" for run in here),
            values=len(scores),
            identified=len(sure),
            held=sum(score.held for score in sure),
            z=float(np.sqrt(np.mean(z**2))),
            worst=float(np.abs(z).max()),
            width=float(np.median([score.std / score.truth for score in scores])),
            peak=max(run.peak for run in here),
        )
        found.append(group)
    return found


def study(
    cases: Sequence[Case], out: Path, execute: Callable[[Case], FixtureRun]
) -> list[FixtureRun]:
    """Execute the cases that have no row in the file `out` yet; return all of theirs."""
    lines = Lines(out)
    rows = {run.case: run for run in lines.read_as(FixtureRun)}
    for case in [case for case in cases if case not in rows]:
        rows[case] = execute(case)
        lines.add(_row(rows[case]))
    return [rows[case] for case in cases]


def _row(run: FixtureRun) -> dict[str, Any]:
    return asdict(run)
