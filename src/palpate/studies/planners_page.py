"""HTML page of a study of planners: its results next to the paper's tables."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean, stdev

from palpate.common.redaction import redact
from palpate.common.version import __version__
from palpate.runs.report.page import template
from palpate.studies.ablation import ABLATION, CONFIGURATIONS, REPEATABILITY
from palpate.studies.efficiency import PAPER as EFFORT
from palpate.studies.efficiency import Line, Rate, TableCell
from palpate.studies.trials import (
    MeasuredValue,
    TrialRecord,
    group_records,
    read_records,
    success_rate,
    table,
)

REASON = 280  # Characters of a reason that are shown
SELECTIVE = "one_missing_mass"  # Scenario of the paper's comparison of both planners


@dataclass(frozen=True, slots=True)
class Published:
    """Row of the paper's table of results, with the corresponding scenario and parameter here."""

    name: str
    scenario: str
    parameter: str
    estimated: str
    truth: str


# Real-world estimates across scenarios: table IV of the paper, mean ± SD.
RESULTS = (
    Published(
        "Mass of the bottle", "bottle_and_table", "bottle.mass", "0.257 ± 0.022 kg", "0.254 kg"
    ),
    Published(
        "Height of the table", "bottle_and_table", "table.height", "0.7642 ± 0.00004 m", "0.765 m"
    ),
    Published("Friction, dynamic", "friction", "bottle.friction", "0.34 ± 0.20", "–"),
    Published(
        "Mass of the hidden box", "occlusion", "light_blue_box.mass", "0.022 ± 0.015 kg", "0.016 kg"
    ),
)


@dataclass(frozen=True, slots=True)
class Table:
    """Table of the page. The first `published` columns are the paper's."""

    title: str
    lead: str
    heads: Sequence[str]
    lines: Sequence[Line]
    published: int = 0


def write_page(results: Path) -> Path | None:
    """Write the page of a results file into its folder; None if the file is empty or missing."""
    records = read_records(results)
    if not records:
        return None
    path = results.with_suffix(".html")
    path.write_text(redact(render(records)), encoding="utf-8")
    return path


def render(records: Sequence[TrialRecord]) -> str:
    """Render the page's HTML."""
    # Sections in the order of the paper; empty ones are left out.
    tables = [scenario_table(records), ablation_table(records), repeatability_table(records)]
    tables += [results_table(records), effort_table(records)]
    failures = Counter(
        f"{record.trial}: {record.outcome}: {record.reason[:REASON]}"
        for record in records
        if record.success is False
    )
    return template("palpate.studies", "planners_page.html").render(
        version=__version__,
        count=len(records),
        planners=len({record.trial.planner for record in records}),
        scenarios=len({record.trial.scenario for record in records}),
        outcomes=Counter(record.outcome for record in records).most_common(),
        tables=[each for each in tables if each is not None and each.lines],
        reasons=failures.most_common(),
    )


def scenario_table(records: Iterable[TrialRecord]) -> Table:
    """Success rates, with scenarios in rows and planners in columns."""
    # Only trials of the whole prompt are comparable between planners.
    whole = group_records(
        (record for record in records if record.trial.configuration == "full"),
        lambda record: (record.trial.scenario, record.trial.asked),
    )
    # One column for each planner, one row for each scenario.
    planners = list(dict.fromkeys(asker for _, asker in whole))
    lines: list[Line] = []
    for name in dict.fromkeys(scenario for scenario, _ in whole):
        cells: list[TableCell] = []
        for asker in planners:
            trials = whole.get((name, asker), [])
            outcomes = Counter(record.outcome for record in trials).most_common()
            cells.append(
                rate_cell(success_rate(trials), ", ".join(outcome for outcome, _ in outcomes))
            )
        lines.append((name, cells))
    lead = (
        "A trial succeeds when the trace shows the right sensing on the right objects and no other, "
        "nothing is stopped, and every value in the twin is within four of its stated standard "
        "deviations of the truth. Where nothing can be measured, a refusal is the success."
    )
    return Table("Success by scenario", lead, planners, lines)


def rate_cell(rate: Rate | None, below: str = "") -> TableCell:
    """Cell of a rate with its interval, or with `below`, in small print."""
    if rate is None:
        return TableCell("–")
    low, high = rate.interval
    mark = "warn"
    if rate.hits in (0, rate.trials):
        mark = "good" if rate.hits else "bad"
    return TableCell(f"{rate.hits}/{rate.trials}", below or f"{low:.2f} … {high:.2f}", mark)


def ablation_table(records: Sequence[TrialRecord]) -> Table | None:
    """Compare with the paper's table II, if any part of a prompt was left out."""
    rows = {(row.configuration, row.asked): row for row in table(records)}
    planners = list(dict.fromkeys(asker for _, asker in rows))
    # Only configurations that were run.
    done = [name for name in CONFIGURATIONS if any((name, asker) in rows for asker in planners)]
    if len(done) < 2:
        return None
    # Two columns of the paper, then two for each planner.
    heads = ["paper: syntax", "paper: success"]
    for asker in planners:
        heads += [f"{asker}: syntax", f"{asker}: success"]
    lines: list[Line] = []
    for name in done:
        syntax, success = ABLATION[name]
        cells = [TableCell(f"{syntax}/10"), TableCell("–" if success is None else f"{success}/10")]
        for asker in planners:
            row = rows.get((name, asker))
            cells += (
                [rate_cell(row.syntax), rate_cell(row.success)] if row else [TableCell("–")] * 2
            )
        lines.append((name, cells))
    lead = (
        "Table II: each part of the prompt is left out in turn. The paper's figures are those of "
        "Gemini 1.5 Pro; below ours stand 95 % Wilson intervals, over all scenarios together."
    )
    return Table("Ablation of the prompt", lead, heads, lines, published=2)


def repeatability_table(records: Iterable[TrialRecord]) -> Table:
    """Compare with the paper's table III."""
    lines: list[Line] = []
    # The paper's rows, then ours.
    for name, (syntax, success) in REPEATABILITY.items():
        rates = (f"{syntax}/20", "–", f"{success}/20", "–", "–")
        lines.append((f"{name} (paper)", list(map(TableCell, rates))))
    for row in table(record for record in records if record.trial.configuration == "full"):
        cells = [rate_cell(row.syntax), rate_cell(row.valid), rate_cell(row.success)]
        cells.append(TableCell(f"{row.tokens:.0f}" if row.tokens else "–"))
        cells.append(TableCell("–" if row.cost is None else f"${row.cost:.2f}"))
        lines.append((row.asked, cells))
    heads = ["syntax of the first answer", "passes the check", "success", "tokens a plan", "cost"]
    return Table("Repeatability", "Table III: repeated trials with the whole prompt.", heads, lines)


def results_table(records: Sequence[TrialRecord]) -> Table:
    """Compare with the paper's table IV."""
    lines: list[Line] = []
    for line in RESULTS:
        runs: dict[tuple[float, float], MeasuredValue] = {}
        for record in records:
            measured = record.found.get(line.parameter)
            if record.trial.scenario == line.scenario and record.success and measured is not None:
                # Count the same plan with the same seed once: it is the same run.
                runs.setdefault((measured.value[0], measured.std[0]), measured)
        if not runs:
            continue
        # Mean and scatter over the runs, against their mean stated deviation.
        values, stds = zip(*runs, strict=True)
        truths = [measured.truth[0] for measured in runs.values()]
        unit = next(iter(runs.values())).unit
        unit = "" if unit == "1" else unit
        spread = f" ± {stdev(values):.2g}" if len(values) > 1 else ""
        published = [TableCell(line.estimated), TableCell(line.truth)]
        measured_cell = TableCell(f"{fmean(values):.5g}{spread} {unit}", f"of {len(values)}")
        figures = [f"{fmean(stds):.2g} {unit}", f"{fmean(truths):.5g} {unit}"]
        lines.append((line.name, [*published, measured_cell, *map(TableCell, figures)]))
    heads = ["paper", "paper: truth", "ours, mean ± SD of runs", "stated SD", "truth"]
    lead = (
        "Table IV: estimates of all successful trials. The paper's are of real objects; ours are of "
        "a simulated world that neither planner nor estimator can see."
    )
    return Table("Estimates", lead, heads, lines, published=2)


def effort_table(records: Iterable[TrialRecord]) -> Table:
    """Compare with the paper's effort of measuring everything."""
    # Mean effort of each planner, below the paper's pair.
    done = [r for r in records if r.trial.scenario == SELECTIVE and r.robot_seconds > 0.0]
    efforts: dict[str, tuple[float, float]] = {}
    if done:
        efforts["everything (paper)"] = (EFFORT.exhaustive_actions, EFFORT.exhaustive_seconds)
        efforts["by intent (paper)"] = (EFFORT.intent_actions, EFFORT.intent_seconds)
    for asker, group in group_records(done, lambda record: record.trial.asked).items():
        seconds = fmean(record.robot_seconds for record in group)
        efforts[asker] = (fmean(record.actions for record in group), seconds)
    lines: list[Line] = [
        (name, [TableCell(f"{actions:.0f}"), TableCell(f"{seconds:.0f} s")])
        for name, (actions, seconds) in efforts.items()
    ]
    lead = "Section VI-B: one missing mass among three objects."
    return Table("Effort", lead, ["actions", "robot time"], lines)
