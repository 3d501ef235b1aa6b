"""Tables of the instruments, on the terminal."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict

from rich.markup import escape
from rich.text import Text

from bench import mishaps
from bench.arms import ArmRow
from bench.bounds.efficiency import OverBound
from bench.campaign import ledger
from bench.campaign.page import counts
from bench.deceptions.page import Coverage, by_world, coverage, worst
from bench.fixtures import Group
from bench.mishaps import Ending
from bench.peers.study import Line
from palpate.cli.console import out, print_json
from palpate.cli.show_layout import TableColumn, print_rows

MISHAPS = (
    TableColumn("mishap"),
    TableColumn("ended", words=True),
    TableColumn("as it should", right=True),
    TableColumn("dropped", right=True),
    TableColumn("still held", right=True),
)
CAMPAIGN = (
    TableColumn("kind"),
    TableColumn("cases", right=True),
    TableColumn("crashes", right=True),
    TableColumn("beyond", right=True),
    TableColumn("ended", words=True),
)
WORLDS = (
    TableColumn("world", words=True),
    TableColumn("kind"),
    TableColumn("answers", words=True),
    TableColumn("worst std", right=True),
)
COVERAGE = (
    TableColumn("identified"),
    TableColumn("values", right=True),
    TableColumn("in 95 %", right=True),
    TableColumn("in 50 %", right=True),
    TableColumn("stated / actual", right=True),
    TableColumn("worst", right=True),
)


BOUNDS = (
    TableColumn("scenario"),
    TableColumn("parameter"),
    TableColumn("values", right=True),
    TableColumn("RMSE / bound", right=True),
    TableColumn("95 % interval", right=True),
)


FIXTURES = (
    TableColumn("scenario"),
    TableColumn("noise"),
    TableColumn("quantity"),
    TableColumn("complete", right=True),
    TableColumn("identified, hold", right=True),
    TableColumn("rms z", right=True),
    TableColumn("median std", right=True),
    TableColumn("peak N", right=True),
)


def show_fixtures(rows: Sequence[Group], as_json: bool) -> None:
    """Coverage and width of the intervals of fixtures' joints."""
    if as_json:
        print_json({"rows": [asdict(row) for row in rows]})
        return
    cells: list[list[str]] = []
    for row in rows:
        counts = [f"{row.complete}/{row.worlds}", f"{row.identified}, {row.held}"]
        figures = [f"{row.z:.2f}", f"{100.0 * row.width:.1f} %", f"{row.peak:.0f}"]
        cells.append([row.scenario, row.noise, row.quantity, *counts, *figures])
    print_rows(FIXTURES, cells)


ARMS = (
    TableColumn("request"),
    TableColumn("arm"),
    TableColumn("tree"),
    TableColumn("ended"),
    TableColumn("values ± std, error in std", words=True),
)


def show_arms(rows: Iterable[ArmRow], as_json: bool) -> None:
    """Trees and values of requests, by arm."""
    if as_json:
        print_json({"rows": [asdict(row) for row in rows]})
        return
    cells: list[list[str]] = []
    for row in rows:
        values = [
            f"{name} {value:.4g} ± {std:.2g} ({(value - truth) / std:+.1f})"
            for name, value, std, truth in row.values
        ]
        cells.append([row.request, row.arm, row.tree, row.status, "; ".join(values)])
    print_rows(ARMS, cells)


PEERS = (
    TableColumn("quantity"),
    TableColumn("noise"),
    TableColumn("load"),
    TableColumn("method", words=True),
    TableColumn("values", right=True),
    TableColumn("rms error", right=True),
    TableColumn("stated", right=True),
    TableColumn("z", right=True),
    TableColumn("in 95 %", right=True),
    TableColumn("processor", right=True),
)
UNITS = {"mass": (1e3, "g"), "com": (1e3, "mm"), "inertia": (1e6, "kg·mm²")}
"""Factor to the unit of a quantity in the table of peers, and that unit."""


def show_peers(lines: Sequence[Line], as_json: bool) -> None:
    """Errors of palpate and of published estimators."""
    if as_json:
        print_json({"rows": [asdict(line) for line in lines]})
        return
    cells: list[list[str]] = []
    for line in lines:
        factor, unit = UNITS[line.quantity]
        sizes = [f"{factor * size:.3g} {unit}" for size in (line.rms, line.stated)]
        shares = [f"{line.z:.2f}", f"{line.coverage:.0%}", f"{line.seconds:.2f} s"]
        names = [line.quantity, escape(line.noise), line.load, line.method, str(line.values)]
        cells.append([*names, *sizes, *shares])
    print_rows(PEERS, cells)


def show_bounds(rows: Sequence[OverBound], as_json: bool) -> None:
    """Errors over their Cramér-Rao bounds."""
    if as_json:
        print_json({"rows": [asdict(row) for row in rows]})
        return
    cells: list[list[str]] = []
    for row in rows:
        interval = f"{row.ratio.low:.2f} … {row.ratio.high:.2f}"
        ratio = f"{row.ratio.value:.2f}"
        cells.append([escape(row.scenario), row.component, str(row.values), ratio, interval])
    print_rows(BOUNDS, cells)


def show_endings(endings: Sequence[Ending], as_json: bool) -> None:
    """Endings of the mishaps, with the reasons."""
    if as_json:
        print_json({"runs": [asdict(ending) for ending in endings]})
        return
    rows: list[list[str]] = []
    reasons: list[Text] = []
    for row in mishaps.table(endings):
        ended = ", ".join(f"{status} {count}" for status, count in row.endings.items())
        as_expected = f"{row.as_expected}/{row.runs}"
        counts = [as_expected, str(row.dropped), str(row.holding)]
        rows.append([escape(row.scenario), ended, *counts])
        reasons.append(Text(f"{row.scenario}: {row.reason[:200]}", "dim"))
    print_rows(MISHAPS, rows)
    out.print(*reasons, sep="\n")


def show_campaign(rows: Mapping[str, Sequence[ledger.Row]], as_json: bool) -> None:
    """Counts of every kind, and cases beyond the limits."""
    if as_json:
        print_json({kind: [asdict(row) for row in found] for kind, found in rows.items()})
        return
    lines = [[kind, *map(str, counts(of).values()), _outcomes(of)] for kind, of in rows.items()]
    print_rows(CAMPAIGN, lines)
    for found in rows.values():
        _show_beyond(found)


def show_deceptions(rows: Sequence[ledger.Row], as_json: bool) -> None:
    """Verdicts in every world, and coverage of the intervals."""
    found = coverage(rows)
    if as_json:
        print_json({"coverage": [asdict(row) for row in found], "rows": [asdict(r) for r in rows]})
        return
    worlds: list[list[str]] = []
    for name, group in by_world(rows).items():
        off = worst(group)
        shown = "–" if off is None else f"{off:.1f}"
        kind = str(group[0].figures["kind"])
        worlds.append([escape(name), kind, _outcomes(group), shown])
    print_rows(WORLDS, worlds)
    print_rows(COVERAGE, [_coverage_cells(row) for row in found])
    _show_beyond(rows)


def _show_beyond(rows: Sequence[ledger.Row]) -> None:
    """A line for each case beyond the limits, or crashed."""
    for row in rows:
        if row.beyond or row.crash:
            reason = "; ".join(row.beyond) or row.crash.strip().splitlines()[-1]
            out.print(Text(f"{row.command}: {reason}", "dim"), soft_wrap=True)


def _coverage_cells(row: Coverage) -> list[str]:
    parts = f"{row.covered95:.1%}", f"{row.covered50:.1%}", f"{row.stated:.2f}"
    return [row.quantity, str(row.values), *parts, f"{row.worst:.1f}"]


def _outcomes(rows: Sequence[ledger.Row]) -> str:
    """Outcomes of cases, the most frequent first."""
    endings = Counter(row.outcome for row in rows)
    return ", ".join(f"{outcome} {count}" for outcome, count in endings.most_common())


def show_case(row: ledger.Row, as_json: bool) -> None:
    """Result of one case."""
    if as_json:
        print_json(asdict(row))
        return
    lines = [f"{row.what}: {row.outcome}", *row.said, *row.beyond, row.crash]
    out.print(Text("\n".join(line for line in lines if line)))
