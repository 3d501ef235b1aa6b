"""Estimates, comparisons and stored runs on the terminal."""

from __future__ import annotations

import webbrowser
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from palpate.cli.console import escape, in_flags, out, print_json, say
from palpate.cli.show_layout import TableColumn, print_rows
from palpate.common.errors import InputError
from palpate.runs.figures import figures, rounded_columns

if TYPE_CHECKING:
    from palpate.common.parameter import Parameter
    from palpate.estimation.estimate import Estimate
    from palpate.runs.compare import ComparedEstimate, Comparison
    from palpate.runs.fuse import Fusion
    from palpate.runs.proof import Proof
    from palpate.runs.run import Run
    from palpate.twin.export import Export


COLUMNS = (
    TableColumn("parameter"),
    TableColumn("value ± std"),
    TableColumn("95 % interval"),
    TableColumn("verdict"),
)
# Colours of verdicts. All others are red.
STYLES = {"identified": "green", "prior-dominated": "yellow"}


def show_estimates(
    estimates: Iterable[Estimate], truth: Mapping[Parameter, Sequence[float]] | None = None
) -> None:
    """Print the table, and below it contradictions and the reasons for missing values.

    A column has the truth if it is known.
    """
    estimates = tuple(estimates)
    # One row for each component.
    columns, rows = (list(COLUMNS), [row for e in estimates for row in estimate_rows(e)])
    if truth:
        columns.append(TableColumn("truth", style="dim"))
        truths = [cell for e in estimates for cell in _truth_cells(e, truth.get(e.parameter, ()))]
        rows = [[*row, cell] for row, cell in zip(rows, truths, strict=True)]
    print_rows(columns, rows)
    for e in estimates:
        show_objection(e)


def show_objection(estimate: Estimate) -> None:
    """Print the contradiction of an estimate, or the reason for a missing or prior-dominated value, with the axes."""
    name = escape(str(estimate.parameter))
    if estimate.contradiction:
        out.prose(f"[bold red]contradicted[/] {name}: {escape(in_flags(estimate.contradiction))}")
    elif not estimate.has_value:
        out.prose(f"[bold red]not identified[/] {name}: {escape(estimate.method)}")
    elif estimate.reason:
        reason = escape(estimate.doubt)
        if estimate.identified:
            name += f" {' and '.join(estimate.doubtful_axes)}"
            reason += ", and as a whole it is not identified"
        out.prose(f"[yellow]prior-dominated[/] {name}: {reason}")


def estimate_rows(estimate: Estimate) -> list[list[str]]:
    """Return the cells of `COLUMNS`, a row for each component."""
    name, unit = escape(str(estimate.parameter)), estimate.unit.removesuffix("1")
    rows: list[list[str]] = []
    for figure in figures(estimate):
        value = f"[bold]{figure.value}[/] ± {figure.std} {unit}".rstrip()
        interval = figure.limit or f"{figure.low} … {figure.high}"
        rows.append([f"{name} {figure.axis}".rstrip(), value, interval, _verdict(figure.verdict)])
    return rows or [[name, "–", "", _verdict(estimate.verdict)]]


def _verdict(verdict: str) -> str:
    return f"[{STYLES.get(verdict, 'bold red')}]{verdict}[/]"


def _truth_cells(estimate: Estimate, truth: Sequence[float]) -> list[str]:
    """Cells of the truth of an estimate, one for each of its rows."""
    count = max(len(estimate.values), 1)
    # A truth of another size, as without a value, is put into the first row.
    if len(truth) == count:
        return [f"{value:.5g}" for value in truth]
    together = " ".join(f"{value:.5g}" for value in truth)
    return [together or "–", *[""] * (count - 1)]


# Comparison of several runs on the terminal.

NAME, VALUE, _, VERDICT = COLUMNS
COMPARED = (
    NAME,
    TableColumn("run", words=True),
    VALUE,
    TableColumn("difference ± std"),
    TableColumn("in stds", right=True),
    VERDICT,
)
# Standard deviations: chance exceeds it in 5 % of differences. Larger ones are highlighted.
FAR = 1.96


def show_comparison(comparison: Comparison, as_json: bool) -> None:
    """Print a row for every run and component, with its difference from the first run."""
    from palpate.runs.compare import comparison_json

    if as_json:
        print_json(comparison_json(comparison))
        return
    every = [row for of in comparison.rows.values() for row in of]
    rows = [cells for row in every for cells in _cells(row)]
    if not rows:
        out.print("none of these runs made an estimate")
    # Leave out the verdicts if all are identified.
    elif all(row.estimate is None or row.estimate.identified for row in every):
        print_rows(COMPARED[:-1], [row[:-1] for row in rows])
    else:
        print_rows(COMPARED, rows)
    if any(row.z is not None for row in every):
        out.print(
            "[dim]Differences are from the first run; what runs share is not in their std.[/]"
        )
    for remark in comparison.remarks:
        out.prose(f"[yellow]note[/] {escape(remark)}")


def _cells(row: ComparedEstimate) -> list[list[str]]:
    if row.estimate is None:
        return []
    differences = _format_differences(row)
    cells: list[list[str]] = []
    for place, (name, value, _, verdict) in enumerate(estimate_rows(row.estimate)):
        cells.append([name, escape(row.run), value, *differences.get(place, ("", "")), verdict])
    return cells


def _format_differences(row: ComparedEstimate) -> dict[int, tuple[str, str]]:
    """Format the difference, and the difference in standard deviations, by component."""
    if row.difference is None or row.std is None or row.z is None:
        return {}
    values, stds = rounded_columns(row.difference, row.std)
    cells: dict[int, tuple[str, str]] = {}
    for place, z in enumerate(row.z.tolist()):
        sign = "" if values[place].startswith("-") else "+"
        far = f"[bold yellow]{z:+.1f}[/]" if abs(z) > FAR else f"{z:+.1f}"
        cells[place] = (f"{sign}{values[place]} ± {stds[place]}", far)
    return cells


# Output for stored runs: report in the browser, fusion, export.

PAGE = "report.html"


def show_report(folder: Path) -> None:
    """Open the report in the browser, and print its path for use without a browser.
    Raises InputError: there is no such page."""
    # Distinguish a wrong folder from a run without a report.
    page = folder / PAGE
    if not folder.is_dir():
        raise InputError(f"'{folder}' is no folder: give that of a run")
    if not (folder / "result.json").exists():
        raise InputError(f"'{folder}' is not a run's folder: it has no result.json")
    if not page.exists():
        raise InputError(f"'{folder}' has no {PAGE} yet: `palpate report {folder}` writes it")
    out.print(escape(str(page.absolute())), soft_wrap=True)
    try:
        opened = webbrowser.open(page.absolute().as_uri())
    except webbrowser.Error:
        opened = False
    if not opened:
        say("no browser was found here: open the file above in one")


def show_how(arm: str, out_file: Path | None) -> None:
    """Write a motion that excites a load, and print the instructions for its recording."""
    from palpate.runs.tools import write_excitation

    file = out_file or Path(f"excitation-{Path(arm).name}.csv")
    for line in write_excitation(arm, file):
        out.prose(escape(line))


def show_load_data(written: Iterable[tuple[str, Path | None]]) -> None:
    """Print load data, or the file into which they were written."""
    for text, file in written:
        line = text.rstrip() if file is None else f"load data written to {file}"
        out.print(line, markup=False, soft_wrap=True)


def show_fusion(fusion: Fusion, as_json: bool) -> None:
    """Print the estimates of each run, and the fused ones."""
    from palpate.runs.fuse import fusion_json

    if as_json:
        print_json(fusion_json(fusion, fusion.folder))
        return
    rows: list[list[str]] = []
    # For each parameter: the estimates of the runs, then the fused one.
    for estimate in fusion.estimates:
        for name, run in zip(fusion.names, fusion.runs, strict=True):
            for other in run.estimates:
                if other.parameter == estimate.parameter:
                    rows += [[*row, escape(name)] for row in estimate_rows(other)]
        rows += [[*row, "[bold]together[/]"] for row in estimate_rows(estimate)]
    print_rows([*COLUMNS, TableColumn("by", words=True)], rows)
    for estimate in fusion.estimates:
        show_objection(estimate)
    for line in fusion.left_out:
        out.prose(f"[yellow]left out[/] {escape(line)}")
    for note in fusion.twin.notes:
        out.prose(f"[dim]note[/] {escape(note)}")
    if fusion.folder is not None:
        out.print(f"[dim]twin[/] {fusion.folder / 'twin.xml'}", soft_wrap=True)


def show_export(run: Run, export: Export, as_json: bool) -> None:
    """Print which estimates the export contains, and other changes."""
    from palpate.runs.export import export_json

    if as_json:
        print_json(export_json(run, export) | {"file": str(export.file)})
        return
    rows: list[list[str]] = []
    for estimate in run.estimates:
        if estimate.parameter in export.kept:
            readers = export.acts_in(estimate.parameter)
            where = f" by {', '.join(readers)}" if export.findings else ""
            state = f"[green]read back{where}[/]" if readers else "written"
            rows += [[*row, state] for row in estimate_rows(estimate)]
        elif estimate.parameter in export.lost:
            lost = f"[yellow]not in {export.format}[/]"
            rows += [[*row, lost] for row in estimate_rows(estimate)]
    if rows:
        print_rows([*COLUMNS, TableColumn("in the file")], rows)
    else:
        out.print("no value was measured: nothing of this run had to be written")
    for finding in export.findings:
        line = f"{finding.reader}: {finding.quantity} {finding.verdict} {finding.detail}".strip()
        out.prose(f"[dim]check[/] {escape(line)}")
    for note in export.notes:
        out.prose(f"[dim]note[/] {escape(note)}")
    out.print(f"[dim]{export.format}[/] {export.file}", soft_wrap=True)


def show_proof(proof: Proof, as_json: bool) -> None:
    """Print the final distance of each task from its goal."""
    from palpate.runs.export import proof_json

    if as_json:
        print_json(proof_json(proof))
        return
    headings = [TableColumn(name, words=True) for name in proof.columns]
    print_rows(headings, [[escape(cell) for cell in row.cells()] for row in proof.rows])
    for sentence in dict.fromkeys(f"{row.task}: {row.says}" for row in proof.rows):
        out.prose(f"[dim]{escape(sentence)}[/]")
    for line in proof.left_out:
        out.prose(f"[yellow]left out[/] {escape(line)}")
    judges = {
        "truth": "Carried out in the scene with the true values of the simulation.",
        "draws": "The truth is not known: carried out in worlds drawn from the twin's intervals.",
    }
    out.prose(judges[proof.judge])
