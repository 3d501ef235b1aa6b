"""Verdicts in deceptive and innocent worlds, against the truth.

An identified value must be within `FAR` of its stated standard deviations of the truth; a deceptive
world may also be contradicted or not identified, an innocent one may not.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from bench.campaign.ledger import Ledger, Row
from bench.deceptions.world import Deception, Jump, deception, task
from palpate.common.parameter import Parameter
from palpate.estimation.estimate import Estimate
from palpate.estimation.wrench_observation import observe
from palpate.execution.simulated_cell import SimulatedCell, simulated_cell
from palpate.robots.simulated.noise.models import noise_models
from palpate.runs import pipeline
from palpate.runs.executing import end_execution
from palpate.runs.run import Run
from palpate.runs.settings import Settings
from palpate.scene.load import parse_scene
from palpate.trace.mcap import read_mcap, write_mcap
from palpate.trace.samples import Trace

KIND = "deceptions"
FAR = 4.0
"""Stated standard deviations beyond which an identified value is wrong."""
NOISES = Path(__file__).with_name("noises")
"""Noise models of other installations, on which no estimator was tuned."""


@dataclass(frozen=True, slots=True)
class Case:
    """A world at a noise model, with a seed."""

    world: str
    noise: str
    seed: int

    @property
    def name(self) -> str:
        return f"{self.world} / {self.noise} / {self.seed}"

    def blank(self) -> Row:
        command = f"python -m bench deceptions '{self.world}' --noise {self.noise} --seed {self.seed} --seeds 1"
        return Row(KIND, self.name, deception(self.world).story, command)


@dataclass(frozen=True, slots=True)
class Scored:
    """Component of an estimate and its true values, in the quantity's SI unit.

    Attributes:
        component: index into a vector quantity.
        low, high: its 95 % interval.
        truth: all values that are equally true.
        z: |error| in stated standard deviations, the largest of all true values.
        covered: the interval holds all true values.
    """

    parameter: str
    component: int
    verdict: str
    value: float
    std: float
    low: float
    high: float
    truth: tuple[float, ...]
    z: float
    covered: bool


def own_noises() -> dict[str, Path]:
    """The study's noise models by name."""
    return {file.stem: file for file in sorted(NOISES.glob("*.yaml"))}


def cases(worlds: Iterable[str], noises: Iterable[str], seeds: Iterable[int]) -> list[Case]:
    """All combinations of worlds, noise models and seeds.

    Raises:
        InputError: no such world, or no such noise model.
    """
    found: list[Case] = []
    for noise, world, seed in product(noises, worlds, seeds):
        found.append(Case(deception(world).name, noise, seed))
        noise_models().load(_path(noise))
    return found


def deceive(
    asked: Sequence[Case],
    out: Path,
    workers: int = 1,
    traces: Path | None = None,
    say: Callable[[str], None] = lambda _: None,
) -> list[Row]:
    """Execute the cases that have no row in the folder `out` yet, and write the page of all rows.

    Args:
        asked: the cases.
        out: folder of rows and page.
        workers: processes.
        traces: folder of traces: a case whose trace is there is estimated again, not executed.
        say: receives progress.
    """
    from bench.deceptions.page import page

    ledger = Ledger(out / f"{KIND}.jsonl")
    rows = ledger.complete(asked, partial(judge, traces=traces), workers, say)
    (out / f"{KIND}.html").write_text(page(ledger.rows()), encoding="utf-8")
    return rows


def judge(case: Case, blank: Row, traces: Path | None = None) -> Row:
    """Measure in a world, and judge the verdicts by the truth."""
    world = deception(case.world)
    run = measured(case, traces)
    scores = scored(run, world)
    far = [score for score in scores if score.verdict == "identified" and score.z > FAR]
    said = tuple(f"{estimate!r} {estimate.contradiction}".strip() for estimate in run.estimates)
    beyond = () if world.kind == "not observable" else tuple(map(_violation, far))
    figures = {
        "world": case.world,
        "kind": world.kind,
        "noise": case.noise,
        "seed": case.seed,
        "status": run.status,
        "scores": [asdict(score) for score in scores],
        "verdicts": {str(estimate.parameter): estimate.verdict for estimate in run.estimates},
    }
    outcome = _outcome(world, run.estimates, bool(far))
    return replace(blank, outcome=outcome, said=said, beyond=beyond, figures=figures)


def _outcome(world: Deception, estimates: Sequence[Estimate], far: bool) -> str:
    if world.kind == "not observable":
        return "not judged"
    if far:
        return "fooled"
    identified = [estimate.identified for estimate in estimates]
    if world.kind == "innocent":
        return "identified" if identified and all(identified) else "false alarm"
    return "right" if any(identified) else "refused"


def _violation(score: Scored) -> str:
    return (
        f"{score.parameter}[{score.component}] = {score.value:.4g} ± {score.std:.2g}, where "
        f"{' or '.join(f'{value:.4g}' for value in score.truth)} is true: {score.z:.1f} std"
    )


def measured(case: Case, traces: Path | None = None) -> Run:
    """Run a case up to its estimates and their truth; from its trace if that is kept in `traces`."""
    world = deception(case.world)
    with TemporaryDirectory() as folder:
        noise = _noise(world, case.noise, Path(folder))
        settings, scene_text, world_text = task(world)
        settings = replace(settings, noise=noise, seed=case.seed, world=None)
        made, cell = _planned(settings, scene_text, world_text)
        file = None if traces is None else traces / f"{_digest(case, world_text, world)}.mcap"
        if file is not None and file.exists():
            made = end_execution(replace(made, recorded=read_mcap(file)))
        else:
            made = pipeline.execute(made, cell)
            if file is not None:
                file.parent.mkdir(parents=True, exist_ok=True)
                write_mcap(file, made.trace)
    if world.jump is not None and made.trace_if_any is not None:
        made = replace(made, recorded=jumped(made.trace, world.jump))
    return pipeline.estimate(made, cell)


def _planned(
    settings: Settings, scene_text: str | None, world_text: str
) -> tuple[Run, SimulatedCell]:
    settings = settings.check_values(at_hand=True)
    arm, folder = settings.described_arm(), None
    if scene_text is not None:
        scene = parse_scene(scene_text, arm=arm)
    else:
        scene = pipeline.load(settings)
        folder = settings.scene.parent if settings.scene else None
    assert scene is not None
    hidden = parse_scene(world_text, folder, arm=arm)
    cell = simulated_cell(scene, hidden, noise=settings.noise, seed=settings.seed)
    return pipeline.plan(settings, scene), cell


def _noise(world: Deception, noise: str, folder: Path) -> str:
    """Name or file of the noise model, with the keys that the world overrides."""
    below = _path(noise)
    if not world.noise:
        return below
    if Path(below).suffix:
        below = str(Path(below).resolve())
    file = folder / "noise.yaml"
    content = {"palpate_noise": 1, "name": world.name, "extends": below, **world.noise}
    # JSON is YAML, except for infinity.
    file.write_text(json.dumps(content).replace("Infinity", ".inf"), encoding="utf-8")
    return str(file)


def _path(noise: str) -> str:
    return str(own_noises().get(noise, noise))


def _digest(case: Case, world_text: str, world: Deception) -> str:
    """File name of a trace, equal for equal executions."""
    content = [world.base, world.request, world_text, repr(world.noise), _path(case.noise)]
    digest = hashlib.sha256(json.dumps(content).encode()).hexdigest()[:16]
    return f"{digest}-{Path(case.noise).stem}-{case.seed}"


def jumped(trace: Trace, jump: Jump) -> Trace:
    """Add a jump of the sensors' zero to a trace, in joint torques and wrench."""
    samples = trace.samples
    observed = observe(trace)
    start, end = float(samples.t[0]), float(samples.t[-1])
    after = samples.t > start + jump.at * (end - start)
    load = np.array([*jump.force, 0.0, 0.0, 0.0])
    torque = np.where(after[:, None], observed.maps(samples.q) @ load, 0.0)
    wrench = np.where(after[:, None], load, 0.0)
    if observed.chain is None:
        torque = np.zeros_like(samples.tau_ext)
    spoilt = replace(samples, tau_ext=samples.tau_ext + torque, wrench=samples.wrench + wrench)
    return replace(trace, samples=spoilt)


def scored(run: Run, world: Deception) -> list[Scored]:
    """Score every component that has a value and a known truth."""
    found: list[Scored] = []
    for estimate in run.estimates:
        truths = _truths(run, world, estimate.parameter)
        if not truths or not estimate.has_value:
            continue
        for i, value in enumerate(estimate.values.tolist()):
            std, (low, high) = float(estimate.stds[i]), estimate.intervals[i].tolist()
            true = tuple(dict.fromkeys(truth[i] for truth in truths))
            z = max(abs(value - one) / std for one in true)
            covered = all(low <= one <= high for one in true)
            score = Scored(
                parameter=str(estimate.parameter),
                component=i,
                verdict=estimate.verdicts[i],
                value=value,
                std=std,
                low=low,
                high=high,
                truth=true,
                z=z,
                covered=covered,
            )
            found.append(score)
    return found


def _truths(run: Run, world: Deception, parameter: Parameter) -> Sequence[Sequence[float]]:
    if str(parameter) in world.truth:
        return world.truth[str(parameter)]
    true = run.truth.get(parameter)
    return () if true is None else (true,)
