"""A study of planners as one HTML page: the paper's tables, and ours beside them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean, stdev

from palpate import __version__
from palpate.redaction import redact
from palpate.report.assets import template
from palpate.studies.efficiency import PAPER as EFFORT
from palpate.studies.planners import ablation, repeatability
from palpate.studies.planners.table import table
from palpate.studies.planners.trials import Record, read_records
from palpate.studies.rate import Rate

REASON = 280
"""Characters of a reason that are shown."""
SELECTIVE = "one_missing_mass"
"""The scenario of the paper's comparison with measuring everything."""


@dataclass(frozen=True, slots=True)
class Published:
    """A line of the paper's table of results: which parameter of which scenario it is here."""

    name: str
    scenario: str
    parameter: str
    estimated: str
    truth: str


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
"""Real-world estimates across scenarios: table IV of the paper, mean ± SD."""


@dataclass(frozen=True, slots=True)
class Cell:
    """A figure as shown: what stands small below it, and a mark: `good`, `warn`, `bad` or nothing."""

    text: str
    below: str = ""
    mark: str = ""


Line = tuple[str, Sequence[Cell]]
"""A row of a table: its name and its figures."""


@dataclass(frozen=True, slots=True)
class Table:
    """A table of the page; the first `published` columns are the paper's."""

    title: str
    lead: str
    heads: Sequence[str]
    lines: Sequence[Line]
    published: int = 0


def write_page(results: Path) -> Path | None:
    """The page of all that a file of results holds, beside it; None where there is nothing.

    Raises:
        InputError: it is another file.
    """
    records = read_records(results)
    if not records:
        return None
    path = results.with_suffix(".html")
    path.write_text(redact(render(records)), encoding="utf-8")
    return path


def render(records: Sequence[Record]) -> str:
    """The page's HTML."""
    found = [_scenarios(records), _ablation(records), _repeated(records)]
    found += [_results(records), _effort(records)]
    return template("palpate.studies.planners", "page.html").render(
        version=__version__,
        count=len(records),
        planners=len({record.trial.planner for record in records}),
        scenarios=len({record.trial.scenario for record in records}),
        outcomes=Counter(record.outcome for record in records).most_common(),
        tables=[each for each in found if each is not None and each.lines],
        reasons=_reasons(records),
    )


def _scenarios(records: Sequence[Record]) -> Table:
    """Every scenario in a row, every planner in a column."""
    whole = _grouped(records, lambda record: record.trial.configuration == "full")
    askers = list(dict.fromkeys(asker for _, asker in whole))
    lines: list[Line] = []
    for name in dict.fromkeys(scenario for scenario, _ in whole):
        cells = [_outcome(whole.get((name, asker), [])) for asker in askers]
        lines.append((name, cells))
    lead = (
        "A trial succeeds when the trace shows the right sensing on the right objects and nothing "
        "besides, nothing is stopped, and every value in the twin is within four of its stated "
        "standard deviations of what is so. Where nothing can be measured, a refusal is the success."
    )
    return Table("Scenario by scenario", lead, askers, lines)


def _grouped(
    records: Iterable[Record], wanted: Callable[[Record], bool]
) -> dict[tuple[str, str], list[Record]]:
    """Select the wanted records, grouped by scenario and planner."""
    found: dict[tuple[str, str], list[Record]] = {}
    for record in filter(wanted, records):
        found.setdefault((record.trial.scenario, record.trial.asked), []).append(record)
    return found


def _outcome(records: Sequence[Record]) -> Cell:
    if not records:
        return Cell("–")
    counted = Counter(record.outcome for record in records).most_common()
    return _rate(_successes(records), ", ".join(outcome for outcome, _ in counted))


def _successes(records: Sequence[Record]) -> Rate | None:
    judged = [record.success for record in records if record.success is not None]
    return Rate.of(judged) if judged else None


def _rate(rate: Rate | None, below: str = "") -> Cell:
    """A rate, by default with its interval."""
    if rate is None:
        return Cell("–")
    low, high = rate.interval
    mark = "warn"
    if rate.hits in (0, rate.trials):
        mark = "good" if rate.hits else "bad"
    return Cell(f"{rate.hits}/{rate.trials}", below or f"{low:.2f} … {high:.2f}", mark)


def _ablation(records: Sequence[Record]) -> Table | None:
    """The paper's table II, where anything was left out of a prompt."""
    rows = {(row.configuration, row.asked): row for row in table(records)}
    askers = list(dict.fromkeys(asker for _, asker in rows))
    done = [name for name in ablation.CONFIGURATIONS if any((name, one) in rows for one in askers)]
    if len(done) < 2:
        return None
    heads = ["paper: syntax", "paper: success"]
    for asker in askers:
        heads += [f"{asker}: syntax", f"{asker}: success"]
    lines: list[Line] = []
    for name in done:
        syntax, success = ablation.PAPER[name]
        cells = [Cell(f"{syntax}/10"), Cell("–" if success is None else f"{success}/10")]
        for asker in askers:
            row = rows.get((name, asker))
            cells += [_rate(row.syntax), _rate(row.success)] if row else [Cell("–")] * 2
        lines.append((name, cells))
    lead = (
        "Table II: each part of the prompt is left out in turn. The paper's figures are those of "
        "Gemini 1.5 Pro; below ours stand 95 % Wilson intervals, over all scenarios together."
    )
    return Table("What each part of the prompt is worth", lead, heads, lines, published=2)


def _repeated(records: Sequence[Record]) -> Table:
    """The paper's table III."""
    lines: list[Line] = []
    for name, (syntax, success) in repeatability.PAPER.items():
        cells = [Cell(f"{syntax}/20"), Cell("–"), Cell(f"{success}/20"), Cell("–"), Cell("–")]
        lines.append((f"{name} (paper)", cells))
    for row in table(record for record in records if record.trial.configuration == "full"):
        cells = [_rate(row.syntax), _rate(row.valid), _rate(row.success)]
        cells.append(Cell(f"{row.tokens:.0f}" if row.tokens else "–"))
        cells.append(Cell("–" if row.cost is None else f"${row.cost:.2f}"))
        lines.append((row.asked, cells))
    heads = ["syntax of the first answer", "passes the check", "success", "tokens a plan", "cost"]
    return Table("Over and over", "Table III: the whole prompt, again and again.", heads, lines)


def _results(records: Sequence[Record]) -> Table:
    """The paper's table IV."""
    lines: list[Line] = []
    for line in RESULTS:
        values, stds, truths, unit = _values(records, line)
        if not values:
            continue
        spread = f" ± {stdev(values):.2g}" if len(values) > 1 else ""
        cells = [Cell(line.estimated), Cell(line.truth)]
        cells.append(Cell(f"{fmean(values):.5g}{spread} {unit}", f"of {len(values)}"))
        cells.append(Cell(f"{fmean(stds):.2g} {unit}"))
        cells.append(Cell(f"{fmean(truths):.5g} {unit}"))
        lines.append((line.name, cells))
    heads = ["paper", "paper: truth", "ours, mean ± SD of runs", "stated SD", "truth"]
    lead = (
        "Table IV: what was measured, of all successful trials. The paper's are real objects; ours "
        "stand in a simulated world that neither planner nor estimator can see."
    )
    return Table("What was measured", lead, heads, lines, published=2)


def _values(
    records: Iterable[Record], line: Published
) -> tuple[list[float], list[float], list[float], str]:
    """Values, stated standard deviations and truths of a parameter in different runs, and their
    unit."""
    known: set[tuple[float, float]] = set()
    values: list[float] = []
    stds: list[float] = []
    truths: list[float] = []
    unit = ""
    for record in records:
        found = record.found.get(line.parameter)
        if record.trial.scenario != line.scenario or not record.success or found is None:
            continue
        if (found.value[0], found.std[0]) in known:
            continue  # the same plan with the same seed is the same run
        known.add((found.value[0], found.std[0]))
        values.append(found.value[0])
        stds.append(found.std[0])
        truths.append(found.truth[0])
        unit = "" if found.unit == "1" else found.unit
    return values, stds, truths, unit


def _effort(records: Sequence[Record]) -> Table:
    """The paper's comparison with measuring everything."""
    done = _grouped(records, lambda r: r.trial.scenario == SELECTIVE and r.robot_seconds > 0.0)
    lines: list[Line] = []
    for (_, asker), group in done.items():
        actions = fmean(record.actions for record in group)
        seconds = fmean(record.robot_seconds for record in group)
        lines.append((asker, [Cell(f"{actions:.0f}"), Cell(f"{seconds:.0f} s")]))
    if lines:
        paper: list[Line] = [
            ("everything (paper)", _spent(EFFORT.exhaustive_actions, EFFORT.exhaustive_seconds)),
            ("by intent (paper)", _spent(EFFORT.intent_actions, EFFORT.intent_seconds)),
        ]
        lines = paper + lines
    lead = "Section VI-B: one missing mass among three objects."
    return Table("What it takes", lead, ["actions", "robot time"], lines)


def _spent(actions: int, seconds: float) -> Sequence[Cell]:
    return [Cell(f"{actions}"), Cell(f"{seconds:.0f} s")]


def _reasons(records: Iterable[Record]) -> Sequence[tuple[str, int]]:
    """Reasons of failed trials, the most frequent first."""
    return Counter(_why(records)).most_common()


def _why(records: Iterable[Record]) -> Iterator[str]:
    for record in records:
        if record.success is False:
            asked = f"{record.trial.scenario}, {record.trial.configuration}, {record.trial.asked}"
            yield f"{asked}: {record.outcome}: {record.reason[:REASON]}"
