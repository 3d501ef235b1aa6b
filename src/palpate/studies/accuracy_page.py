"""HTML page of an accuracy study: a table and plots for each scenario at each noise model."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from statistics import fmean

from palpate.common.redaction import redact
from palpate.common.version import __version__
from palpate.runs.figures import significant
from palpate.runs.report.charts import SMALL, with_unit
from palpate.runs.report.page import plotly, policy, script, template
from palpate.runs.report.plots import Figure
from palpate.studies import plots
from palpate.studies.accuracy import CRASHED, ScoredEstimate, SeedRun
from palpate.studies.efficiency import Line, RangedValue, TableCell
from palpate.studies.summary import Group, Key, Runs, Scores, Summary, group_runs, read, summarise

AXES = "xyz"
# Target ranges. A figure whose 95 % interval is outside is marked. Too high is only a warning: the
# intervals are wider than necessary.
TARGETS = {"coverage95": (0.92, 0.98), "coverage50": (0.42, 0.58), "stated": plots.GOOD}
REASONS = 4  # Largest count of listed reasons for components without a value


@dataclass(frozen=True, slots=True)
class ParameterCard:
    """Section of a parameter: ids of its figures and their captions."""

    name: str
    text: str
    figures: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class ScenarioSection:
    """A scenario at a noise model."""

    name: str
    noise: str
    facts: Mapping[str, str]
    lines: Sequence[Line]
    cards: Sequence[ParameterCard]
    wide: Sequence[tuple[str, str]]
    reasons: Sequence[tuple[str, int]]
    crashes: Sequence[tuple[int, str]]


def write_page(folder: Path) -> Path | None:
    """Write the page of all rows of a folder; None if it has none."""
    runs = group_runs(read(folder))
    if not runs:
        return None
    path = folder / "index.html"
    path.write_text(redact(render(runs)), encoding="utf-8")
    return path


def render(runs: Runs) -> str:
    """Render the page's HTML."""
    figures: dict[str, Figure] = {}
    sections = [scenario_section(group, trials, figures) for group, trials in runs.items()]
    overall = overall_tables(runs, figures)
    library, _ = plotly()
    return template("palpate.studies", "accuracy_page.html").render(
        version=__version__,
        count=sum(map(len, runs.values())),
        sections=sections,
        overall=overall,
        figures=figures,
        policy=policy(),
        plotly=library,
        script=script(),
    )


def overall_tables(runs: Runs, figures: dict[str, Figure]) -> Sequence[tuple[str, Sequence[Line]]]:
    """Coverage and calibration over all scenarios, by noise model and by quantity."""
    points: dict[str, list[tuple[str, float, float]]] = {}
    pooled: dict[str, dict[str, list[ScoredEstimate]]] = {}
    # Pool the estimates by noise model and quantity, and collect stated and actual errors.
    for group, trials in runs.items():
        for each in identified_estimates(trials):
            of_noise = pooled.setdefault(group.noise, {})
            of_noise.setdefault(each.parameter.quantity, []).append(each)
        rows = summarise(trials)
        names = component_names(rows)
        for row in rows:
            if row.claimed and row.rmse:
                name = f"{names[row.key]}, {group.scenario}"
                points.setdefault(group.noise, []).append((name, row.claimed, row.rmse))
    if points:
        figures["scatter"] = plots.scatter(points)
    everything = {noise: list(chain(*of_noise.values())) for noise, of_noise in pooled.items()}
    if everything:
        figures["coverage"] = plots.coverage(everything)
    # One table for each noise model: quantities, then all together.
    tables: list[tuple[str, Sequence[Line]]] = []
    for noise, quantities in pooled.items():
        rows = list(quantities.items())
        if len(rows) > 1:
            rows.append(("all", everything[noise]))
        scores = [(name, Scores.of(group)) for name, group in rows]
        tables.append((noise, [(n, (TableCell(str(s.runs)), *score_cells(s))) for n, s in scores]))
    return tables


def scenario_section(
    group: Group, runs: Sequence[SeedRun], figures: dict[str, Figure]
) -> ScenarioSection:
    rows = summarise(runs)
    place = f"f{len(figures)}"
    names = component_names(rows)
    # Group the estimates by quantity and by component.
    by_quantity: dict[str, list[ScoredEstimate]] = {}
    by_parameter: dict[Key, list[ScoredEstimate]] = {}
    for each in identified_estimates(runs):
        by_quantity.setdefault(each.parameter.quantity, []).append(each)
        by_parameter.setdefault((each.parameter, each.component), []).append(each)
    # Two figures for the whole scenario: coverage and calibration.
    wide: list[tuple[str, str]] = []
    scored = [(row, row.scores) for row in rows if row.scores is not None]
    if scored:
        figures[f"{place}-coverage"] = plots.coverage(by_quantity)
        wide.append(("Coverage: intervals that hold the truth, by level", f"{place}-coverage"))
        stated = [(names[row.key], scores.stated) for row, scores in scored]
        figures[f"{place}-ratios"] = plots.ratios(stated)
        wide.append(("Stated over actual error", f"{place}-ratios"))
    # Two figures for each parameter: the distribution of the errors, and their quantiles.
    cards: list[ParameterCard] = []
    for number, (row, _) in enumerate(scored):
        unit, scale = SMALL.get(row.unit, (row.unit, 1.0))
        ids = (f"{place}-{number}-errors", f"{place}-{number}-quantiles")
        figures[ids[0]] = plots.errors(by_parameter[row.key], scale, unit)
        figures[ids[1]] = plots.quantiles(by_parameter[row.key])
        truth = with_unit(significant(scale * row.truth, 4), unit)
        cards.append(ParameterCard(names[row.key], f"truth {truth}, {row.runs} values", ids))
    # Most frequent reasons for missing values.
    reasons = Counter(f"{each.parameter}: {each.reason}" for run in runs for each in run.unmeasured)
    return ScenarioSection(
        name=group.scenario,
        noise=group.noise,
        facts=run_facts(runs),
        lines=[summary_line(names[row.key], row) for row in rows],
        cards=cards,
        wide=wide,
        reasons=reasons.most_common(REASONS),
        crashes=[(run.seed, run.crash.strip().splitlines()[-1]) for run in runs if run.crash],
    )


def run_facts(runs: Sequence[SeedRun]) -> dict[str, str]:
    """Summary figures over all seeds, by label."""
    seeds = sorted(run.seed for run in runs)
    endings = Counter(run.status for run in runs).most_common()
    # Crashed runs have no times.
    whole = [run for run in runs if run.status != CRASHED] or runs
    robot = fmean(run.robot_seconds for run in whole)
    processor = fmean(run.cpu_seconds for run in whole)
    return {
        "Seeds": f"{len(seeds)}: {seeds[0]} … {seeds[-1]}",
        "Ended": ", ".join(f"{count} {status}" for status, count in endings),
        "Robot time": f"{robot:.1f} s",
        "Processor time": f"{processor:.1f} s",
    }


def summary_line(name: str, row: Summary) -> Line:
    # Components that were not identified, by verdict.
    others = ", ".join(f"{n} {v}" for v, n in row.verdicts.items() if v != "identified")
    measured = TableCell(f"{row.runs}/{row.asked}", others)
    scores = row.scores
    if scores is None or row.bias is None or row.sd is None:
        return name, (measured, *[TableCell("–")] * 8)
    unit, scale = SMALL.get(row.unit, (row.unit, 1.0))

    def format_cell(value: float | None, below: str = "", sign: str = "") -> TableCell:
        if value is None:
            return TableCell("–")
        return TableCell(with_unit(significant(scale * value, 2, sign), unit), below)

    # Standard error of the mean of n errors: sd/√n.
    error = significant(scale * row.sd / row.runs**0.5, 2)
    figures = (
        format_cell(row.bias, f"± {error}", "+"),
        *map(format_cell, (row.sd, row.rmse, row.claimed)),
    )
    return name, (measured, *figures, *score_cells(scores))


def score_cells(scores: Scores) -> Iterator[TableCell]:
    yield ranged_cell("stated", scores.stated)
    yield ranged_cell("coverage95", scores.coverage95, percent=True)
    yield ranged_cell("coverage50", scores.coverage50, percent=True)
    yield TableCell(f"{scores.worst:.1f}")


def ranged_cell(name: str, figure: RangedValue, percent: bool = False) -> TableCell:
    low, high = TARGETS[name]
    # Mark only if the whole interval is outside: otherwise it may be chance.
    mark = ""
    if figure.high < low:
        mark = "bad"
    elif figure.low > high:
        mark = "warn"
    if percent:
        ends = f"{100 * figure.low:.1f} … {100 * figure.high:.1f}"
        return TableCell(f"{100 * figure.value:.1f} %", ends, mark)
    return TableCell(f"{figure.value:.2f}", f"{figure.low:.2f} … {figure.high:.2f}", mark)


def identified_estimates(runs: Sequence[SeedRun]) -> Iterator[ScoredEstimate]:
    for run in runs:
        yield from run.estimates


def component_names(rows: Sequence[Summary]) -> dict[Key, str]:
    """Name the components, with the axis where there are several."""
    several = {row.parameter for row in rows if row.component}
    names: dict[Key, str] = {}
    for row in rows:
        name = str(row.parameter)
        if row.parameter in several:
            name += f" {AXES[row.component]}" if row.component < len(AXES) else f"[{row.component}]"
        names[row.key] = name
    return names
