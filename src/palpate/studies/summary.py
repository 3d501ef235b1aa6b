"""Runs of a campaign, kept one by one, and their statistics."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from statistics import fmean, stdev

import numpy as np
from scipy.special import stdtr, stdtrit

from palpate.common.errors import InputError
from palpate.common.parameter import Parameter
from palpate.common.pose import Array
from palpate.robots.simulated.noise.models import noise_models
from palpate.runs.settings import Settings, request_json
from palpate.studies.accuracy import (
    MissingComponent,
    Question,
    ScoredEstimate,
    SeedRun,
    StudyCase,
    crashed_run,
    run_case,
)
from palpate.studies.efficiency import RangedValue
from palpate.studies.workers import Crew, Lines, Progress, WorkerLost

FILE = "rows.jsonl"
# Settings that name a file. The content of the file identifies a run, not its path.
FILES = ("scene", "poses", "world", "robot_config")
# Placement of objects. Rows without this entry are from worlds with all objects exactly at their
# stated poses.
PLACES = "drawn by their accuracy"
APART = ("seed", "palpate", "images")  # Keys of `request.json` that do not describe the run


@dataclass(frozen=True, slots=True)
class Group:
    """A scenario with a noise model, by its title."""

    scenario: str
    noise: str


@dataclass(frozen=True, slots=True)
class SeedRow:
    """Seed of a group. `about` has all other settings of its run in `group_settings`, by name."""

    group: Group
    about: dict[str, str]
    run: SeedRun

    @property
    def key(self) -> tuple[Group, int]:
        return self.group, self.run.seed


Runs = dict[Group, list[SeedRun]]


def measure(
    questions: Iterable[Question],
    seeds: Sequence[int],
    crew: Crew,
    folder: Path | None = None,
    say: Callable[[str], None] = lambda _: None,
) -> Runs:
    """Return the runs of every question with every seed.

    Runs in `folder` are reused. `crew` makes the others, and they are appended. `say` receives the
    progress.
    """
    # Find the runs that the folder lacks.
    known = {row.key: row for row in read(folder)} if folder else {}
    asked: dict[Group, dict[str, str]] = {}
    todo: list[tuple[Group, StudyCase]] = []
    wanted: list[tuple[Group, int]] = []
    for question in questions:
        settings = question.settings.check_values()
        group = Group(question.scenario, noise_models().title(settings.noise))
        asked[group] = group_settings(settings)
        wanted += [(group, seed) for seed in seeds]
        todo += [(group, StudyCase(question, seed)) for seed in seeds if (group, seed) not in known]
    refuse_other_settings(known.values(), asked)
    lines = Lines(folder / FILE) if folder else None
    if lines is not None:
        lines.add()  # fails before anything is computed, if the file cannot be written
    # Make and append them one by one: a killed campaign loses only runs in progress.
    progress = Progress(len(wanted), len(wanted) - len(todo))
    say(str(progress))
    for place, answer in crew.each(run_case, [case for _, case in todo]):
        group, case = todo[place]
        run = crashed_run(case.seed, str(answer)) if isinstance(answer, WorkerLost) else answer
        row = SeedRow(group, asked[group], run)
        if lines is not None:
            lines.add(asdict(row))
        known[row.key] = row
        say(progress.step())
    return group_runs(known[key] for key in wanted)


def group_settings(settings: Settings) -> dict[str, str]:
    """Settings that identify a group, without the seed. Files are represented by their digests."""
    asked = {name: value for name, value in request_json(settings).items() if name not in APART}
    for name in FILES:
        path: Path | None = getattr(settings, name)
        asked[name] = short_digest(path.read_bytes()) if path else None
    # Use the content of the noise model: a file of the same name may differ.
    asked["noise"] = short_digest(repr(noise_models().load(settings.noise)).encode())
    asked["places"] = PLACES
    return {name: str(value) for name, value in asked.items() if value is not None}


def read(folder: Path) -> list[SeedRow]:
    """Read all rows of a folder."""
    return Lines(folder / FILE).read_as(SeedRow)


def group_runs(rows: Iterable[SeedRow]) -> Runs:
    """Group the runs, in order of first appearance."""
    runs: Runs = {}
    for row in rows:
        runs.setdefault(row.group, []).append(row.run)
    return runs


def refuse_other_settings(rows: Iterable[SeedRow], asked: dict[Group, dict[str, str]]) -> None:
    """Require that a group's kept rows have the requested settings. Raises InputError: they differ."""
    for row in rows:
        now = asked.get(row.group, row.about)
        # Compare all settings by name; a missing one differs as well.
        other = [name for name in {**row.about, **now} if row.about.get(name) != now.get(name)]
        if other:
            raise InputError(
                f"the folder holds runs of {row.group.scenario} at {row.group.noise} with another "
                f"{' and '.join(sorted(other))}; choose another out="
            )


def short_digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:12]


# Statistics of estimates over many seeds: bias, scatter, stated standard deviations, coverage.

Key = tuple[Parameter, int]  # Parameter and index of its component
# Degrees of freedom in the table that is interpolated for an interval.
FREEDOMS = np.geomspace(1.0, 1e6, 2000)
# Half widths of the 95 % intervals of Student's t with these degrees of freedom, in standard
# deviations.
QUANTILES = stdtrit(FREEDOMS, 0.975)


@dataclass(frozen=True, slots=True)
class Scores:
    """Coverage and calibration of n estimates."""

    runs: int  # n
    # coverage95, coverage50: share of the 95 % and 50 % intervals that contain the truth.
    coverage95: RangedValue
    coverage50: RangedValue
    # 1 / RMS(z), z = error / stated standard deviation; 1 for calibrated estimates.
    stated: RangedValue
    worst: float  # largest |z|

    @classmethod
    def of(cls, estimates: Sequence[ScoredEstimate]) -> Scores:
        """Score at least one estimate."""
        z = errors_in_std(estimates)
        return cls(
            len(estimates),
            RangedValue.share(each.is_covered for each in estimates),
            RangedValue.share(bool(level <= 0.5) for level in levels(estimates)),
            RangedValue.rms(z).inverse,
            float(np.abs(z).max()),
        )


@dataclass(frozen=True, slots=True)
class Summary:
    """A parameter's component over all seeds, in its SI unit.

    The figures are those of the seeds that identified it, or that only a physical bound kept from
    it. They are None without any such seed.
    """

    parameter: Parameter
    component: int
    runs: int  # count of these seeds
    # truth, mean: mean true and estimated value of these.
    truth: float
    mean: float | None = None
    bias: float | None = None  # mean error
    sd: float | None = None  # standard deviation of the errors
    # Mean of the stated standard deviations; near `rmse` for calibrated estimates.
    claimed: float | None = None
    covered: int = 0  # count of 95 % intervals that contain the truth
    # As `sd`, of the naive mean of F_z/g; None for quantities without one.
    single_shot_sd: float | None = None
    unit: str = ""  # as printed
    asked: int = 0  # count of all seeds
    verdicts: dict[str, int] = field(default_factory=dict[str, int])  # count of seeds by verdict
    rmse: float | None = None  # root mean square of the errors
    scores: Scores | None = None

    @property
    def key(self) -> Key:
        return self.parameter, self.component


def summarise(runs: Sequence[SeedRun]) -> list[Summary]:
    """Summarise each component of each parameter, in order of first appearance."""
    # Group all components, with and without a value.
    components: dict[Key, list[ScoredEstimate | MissingComponent]] = {}
    for run in runs:
        for each in (*run.estimates, *run.doubted, *run.unmeasured):
            components.setdefault((each.parameter, each.component), []).append(each)
    return [component_summary(key, group, len(runs)) for key, group in components.items()]


def component_summary(
    key: Key, components: Sequence[ScoredEstimate | MissingComponent], asked: int
) -> Summary:
    # Statistics use only components that depend on the recordings.
    verdicts = Counter(each.verdict for each in components)
    identified = [each for each in components if isinstance(each, ScoredEstimate)]
    identified = [each for each in identified if each.is_evidence]
    summary = Summary(
        *key,
        runs=len(identified),
        truth=fmean(each.truth for each in identified or components),
        unit=components[0].unit,
        asked=asked,
        verdicts=dict(verdicts),
    )
    if not identified:
        return summary
    # The single-shot mass F_z/g of the same recording shows the gain by the estimator.
    errors = [each.error for each in identified]
    naive = [each.single_shot - each.truth for each in identified if each.single_shot is not None]
    return replace(
        summary,
        mean=fmean(each.value for each in identified),
        bias=fmean(errors),
        sd=sample_std(errors),
        claimed=fmean(each.std for each in identified),
        covered=sum(each.is_covered for each in identified),
        single_shot_sd=sample_std(naive) if naive else None,
        rmse=float(np.sqrt(np.mean(np.square(errors)))),
        scores=Scores.of(identified),
    )


def errors_in_std(estimates: Sequence[ScoredEstimate]) -> Array:
    """Errors (n,) in stated standard deviations."""
    return np.array([each.error / each.std for each in estimates])


def shares(estimates: Sequence[ScoredEstimate]) -> Array:
    """Probability integral transform (n,) of the errors: the stated distribution function at each error.

    It is uniform in 0…1 for calibrated estimates. The stated distribution is Student's t. Its
    degrees of freedom are those of the stated upper half of the 95 % interval.
    """
    # Half width over deviation is the 97.5 % quantile of Student's t: it gives the degrees of
    # freedom.
    halves = np.array([(each.high - each.value) / each.std for each in estimates])
    # np.interp needs increasing abscissae, and the quantile falls with the degrees of freedom:
    # negate both.
    freedom = np.interp(-halves, -QUANTILES, FREEDOMS)
    return stdtr(freedom, errors_in_std(estimates))


def levels(estimates: Sequence[ScoredEstimate]) -> Array:
    """Level (n,) of the narrowest central interval that contains the truth, |2 u - 1| with u of `shares`.

    It is uniform in 0…1 for calibrated estimates.
    """
    return np.abs(2.0 * shares(estimates) - 1.0)


def sample_std(values: Sequence[float]) -> float:
    return stdev(values) if len(values) > 1 else 0.0
