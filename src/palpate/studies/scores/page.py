"""A campaign as one HTML page: a table and plots for each scenario at each noise model."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from statistics import fmean

from palpate import __version__
from palpate.redaction import redact
from palpate.report.assets import plotly, policy, script, template
from palpate.report.numbers import SMALL, with_unit
from palpate.report.plots import Figure
from palpate.runs.figures import significant
from palpate.studies.accuracy import CRASHED, ScoredEstimate, SeedRun
from palpate.studies.scores import plots
from palpate.studies.scores.kept import Group, Runs, grouped, read
from palpate.studies.scores.summary import Key, Ranged, Scores, Summary, summarise

FILE = "index.html"
AXES = "xyz"
AIMS = {
    "coverage95": (0.92, 0.98),
    "coverage50": (0.42, 0.58),
    "stated": plots.GOOD,
}
"""Within which a figure is aimed at; one whose 95 % interval lies outside is marked."""
TIMID_ABOVE = {"coverage95", "coverage50", "stated"}
"""Figures that are large where intervals are wider than need be."""
REASONS = 4
"""Most reasons that are listed for what was not measured."""


@dataclass(frozen=True, slots=True)
class Cell:
    """A figure as shown: its interval below it, and a mark: `bad`, `warn` or nothing."""

    text: str
    interval: str = ""
    mark: str = ""


@dataclass(frozen=True, slots=True)
class Line:
    """A row of a table."""

    name: str
    cells: tuple[Cell, ...]


@dataclass(frozen=True, slots=True)
class Card:
    """Section of a parameter: ids of its figures and their captions."""

    name: str
    said: str
    figures: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Section:
    """A scenario at a noise model."""

    name: str
    noise: str
    facts: Mapping[str, str]
    lines: Sequence[Line]
    cards: Sequence[Card]
    wide: Sequence[tuple[str, str]]
    reasons: Sequence[tuple[str, int]]
    crashes: Sequence[tuple[int, str]]


def write_page(folder: Path) -> Path | None:
    """The page of all rows that lie in a folder; None where there are none.

    Raises:
        InputError: they are something else.
    """
    runs = grouped(read(folder))
    if not runs:
        return None
    path = folder / FILE
    path.write_text(redact(render(runs)), encoding="utf-8")
    return path


def render(runs: Runs) -> str:
    """The page's HTML."""
    figures: dict[str, Figure] = {}
    sections = [_section(group, found, figures) for group, found in runs.items()]
    overall = _overall(runs, figures)
    library, _ = plotly()
    return template("palpate.studies.scores", "page.html").render(
        version=__version__,
        count=sum(map(len, runs.values())),
        sections=sections,
        overall=overall,
        figures=figures,
        policy=policy(),
        plotly=library,
        script=script(),
    )


def _overall(runs: Runs, figures: dict[str, Figure]) -> Sequence[tuple[str, Sequence[Line]]]:
    """Coverage and calibration over all scenarios, by noise model and by quantity."""
    points: dict[str, list[tuple[str, float, float]]] = {}
    pooled: dict[str, dict[str, list[ScoredEstimate]]] = {}
    for group, found in runs.items():
        for each in _identified(found):
            of_noise = pooled.setdefault(group.noise, {})
            of_noise.setdefault(each.parameter.quantity, []).append(each)
        rows = summarise(found)
        names = _names(rows)
        for row in rows:
            if row.claimed and row.rmse:
                name = f"{names[row.key]}, {group.scenario}"
                points.setdefault(group.noise, []).append((name, row.claimed, row.rmse))
    if points:
        figures["scatter"] = plots.scatter(points)
    tables: list[tuple[str, Sequence[Line]]] = []
    everything = {noise: list(chain(*of_noise.values())) for noise, of_noise in pooled.items()}
    if everything:
        figures["coverage"] = plots.coverage(everything)
    for noise, quantities in pooled.items():
        lines = [_pooled_line(name, group) for name, group in quantities.items()]
        if len(lines) > 1:
            lines.append(_pooled_line("all", everything[noise]))
        tables.append((noise, lines))
    return tables


def _pooled_line(name: str, group: Sequence[ScoredEstimate]) -> Line:
    scores = Scores.of(group)
    return Line(name, (Cell(str(scores.runs)), *_score_cells(scores)))


def _section(group: Group, runs: Sequence[SeedRun], figures: dict[str, Figure]) -> Section:
    rows = summarise(runs)
    place = f"f{len(figures)}"
    names = _names(rows)
    by_quantity: dict[str, list[ScoredEstimate]] = {}
    by_parameter: dict[Key, list[ScoredEstimate]] = {}
    for each in _identified(runs):
        by_quantity.setdefault(each.parameter.quantity, []).append(each)
        by_parameter.setdefault((each.parameter, each.component), []).append(each)
    wide: list[tuple[str, str]] = []
    scored = [(row, row.scores) for row in rows if row.scores is not None]
    if scored:
        figures[f"{place}-coverage"] = plots.coverage(by_quantity)
        wide.append(("Coverage: intervals that hold the truth, by level", f"{place}-coverage"))
        stated = [(names[row.key], scores.stated) for row, scores in scored]
        figures[f"{place}-ratios"] = plots.ratios(stated)
        wide.append(("Stated over actual error", f"{place}-ratios"))
    cards: list[Card] = []
    for number, (row, _) in enumerate(scored):
        card = _card(names[row.key], row, by_parameter[row.key], f"{place}-{number}", figures)
        cards.append(card)
    reasons = Counter(f"{each.parameter}: {each.reason}" for run in runs for each in run.unmeasured)
    return Section(
        group.scenario,
        group.noise,
        _facts(runs),
        [_line(names[row.key], row) for row in rows],
        cards,
        wide,
        reasons.most_common(REASONS),
        [(run.seed, run.crash.strip().splitlines()[-1]) for run in runs if run.crash],
    )


def _card(
    name: str, row: Summary, group: Sequence[ScoredEstimate], place: str, figures: dict[str, Figure]
) -> Card:
    unit, scale = SMALL.get(row.unit, (row.unit, 1.0))
    figures[f"{place}-errors"] = plots.errors(group, scale, unit)
    figures[f"{place}-quantiles"] = plots.quantiles(group)
    return Card(
        name,
        f"truth {with_unit(significant(scale * row.truth, 4), unit)}, {row.runs} values",
        (f"{place}-errors", f"{place}-quantiles"),
    )


def _facts(runs: Sequence[SeedRun]) -> dict[str, str]:
    """Summary figures over all seeds, by label."""
    seeds = sorted(run.seed for run in runs)
    endings = Counter(run.status for run in runs).most_common()
    ended = ", ".join(f"{count} {status}" for status, count in endings)
    whole = [run for run in runs if run.status != CRASHED] or runs
    robot = fmean(run.robot_seconds for run in whole)
    processor = fmean(run.cpu_seconds for run in whole)
    return {
        "Seeds": f"{len(seeds)}: {seeds[0]} … {seeds[-1]}",
        "Ended": ended,
        "Robot time": f"{robot:.1f} s",
        "Processor time": f"{processor:.1f} s",
    }


def _line(name: str, row: Summary) -> Line:
    others = ", ".join(f"{n} {v}" for v, n in row.verdicts.items() if v != "identified")
    measured = Cell(f"{row.runs}/{row.asked}", others)
    scores = row.scores
    if scores is None or row.bias is None or row.sd is None:
        return Line(name, (measured, *[Cell("–")] * 8))
    unit, scale = SMALL.get(row.unit, (row.unit, 1.0))

    def shown(value: float | None, sign: str = "") -> Cell:
        return Cell("–" if value is None else with_unit(significant(scale * value, 2, sign), unit))

    error = scale * row.sd / row.runs**0.5
    bias = Cell(shown(row.bias, "+").text, f"± {significant(error, 2)}")
    figures = (bias, shown(row.sd), shown(row.rmse), shown(row.claimed))
    return Line(name, (measured, *figures, *_score_cells(scores)))


def _score_cells(scores: Scores) -> Iterator[Cell]:
    yield _ranged("stated", scores.stated)
    yield _ranged("coverage95", scores.coverage95, percent=True)
    yield _ranged("coverage50", scores.coverage50, percent=True)
    yield Cell(f"{scores.worst:.1f}")


def _ranged(name: str, figure: Ranged, percent: bool = False) -> Cell:
    low, high = AIMS[name]
    mark = ""
    if figure.high < low:
        mark = "bad"
    elif figure.low > high:
        mark = "warn" if name in TIMID_ABOVE else "bad"
    if percent:
        ends = f"{100 * figure.low:.1f} … {100 * figure.high:.1f}"
        return Cell(f"{100 * figure.value:.1f} %", ends, mark)
    return Cell(f"{figure.value:.2f}", f"{figure.low:.2f} … {figure.high:.2f}", mark)


def _identified(runs: Sequence[SeedRun]) -> Iterator[ScoredEstimate]:
    for run in runs:
        yield from run.estimates


def _names(rows: Sequence[Summary]) -> dict[Key, str]:
    """Names of components: the axis where there are several."""
    several = {row.parameter for row in rows if row.component}
    found: dict[Key, str] = {}
    for row in rows:
        name = str(row.parameter)
        if row.parameter in several:
            name += f" {AXES[row.component]}" if row.component < len(AXES) else f"[{row.component}]"
        found[row.key] = name
    return found
