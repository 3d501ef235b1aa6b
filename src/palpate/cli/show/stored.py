"""Output for stored runs: report in the browser, fusion, export."""

from __future__ import annotations

import webbrowser
from pathlib import Path
from typing import TYPE_CHECKING

from palpate.cli.console import escape, out, print_json, say
from palpate.cli.show.estimates import COLUMNS, estimate_rows, show_objection
from palpate.cli.show.layout import Column, print_rows
from palpate.errors import InputError

if TYPE_CHECKING:
    from palpate.runs.run import Run
    from palpate.runs.several.fuse import Fusion
    from palpate.twin.export.export import Export
    from palpate.twin.tasks.proof import Proof

PAGE = "report.html"


def show_report(folder: Path) -> None:
    """Open the report in the browser and print its path, which also serves without a browser.

    Raises:
        InputError: there is no such page.
    """
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
    """Write a motion that excites a load, and print what to record with it.

    Raises:
        InputError: there is no such arm, or the file exists or cannot be written.
    """
    from palpate.tools import write_excitation

    file = out_file or Path(f"excitation-{Path(arm).name}.csv")
    for line in write_excitation(arm, file):
        out.prose(escape(line))


def show_fusion(fusion: Fusion, as_json: bool) -> None:
    """Print the estimates of each run, and the fused ones."""
    from palpate.runs.several.fuse import fusion_json

    if as_json:
        print_json(fusion_json(fusion, fusion.folder))
        return
    rows: list[list[str]] = []
    for estimate in fusion.estimates:
        for name, run in zip(fusion.names, fusion.runs, strict=True):
            for one in run.estimates:
                if one.parameter == estimate.parameter:
                    rows += [[*row, escape(name)] for row in estimate_rows(one)]
        rows += [[*row, "[bold]together[/]"] for row in estimate_rows(estimate)]
    print_rows([*COLUMNS, Column("by", words=True)], rows)
    for estimate in fusion.estimates:
        show_objection(estimate)
    for line in fusion.left_out:
        out.prose(f"[yellow]left out[/] {escape(line)}")
    for note in fusion.twin.notes:
        out.prose(f"[dim]note[/] {escape(note)}")
    if fusion.folder is not None:
        out.print(f"[dim]twin[/] {fusion.folder / 'twin.xml'}", soft_wrap=True)


def show_export(run: Run, export: Export, as_json: bool) -> None:
    """Print the place of each estimate in the export, and other changes."""
    from palpate.runs.export import export_json

    if as_json:
        print_json(export_json(run, export) | {"file": str(export.file)})
        return
    rows: list[list[str]] = []
    for estimate in run.estimates:
        if estimate.parameter in export.held:
            rows += [[*row, "[green]read back[/]"] for row in estimate_rows(estimate)]
        elif estimate.parameter in export.lost:
            lost = f"[yellow]not in {export.format}[/]"
            rows += [[*row, lost] for row in estimate_rows(estimate)]
    if rows:
        print_rows([*COLUMNS, Column("in the file")], rows)
    else:
        out.print("no value was measured: nothing of this run had to be written")
    for note in export.notes:
        out.prose(f"[dim]note[/] {escape(note)}")
    out.print(f"[dim]{export.format}[/] {export.file}", soft_wrap=True)


def show_proof(proof: Proof, as_json: bool) -> None:
    """Print how far from its goal each task ends."""
    from palpate.runs.prove import proof_json

    if as_json:
        print_json(proof_json(proof))
        return
    headings = [Column(name, words=True) for name in proof.columns]
    print_rows(headings, [[escape(cell) for cell in row.cells()] for row in proof.rows])
    for said in dict.fromkeys(f"{row.task}: {row.says}" for row in proof.rows):
        out.prose(f"[dim]{escape(said)}[/]")
    for line in proof.left_out:
        out.prose(f"[yellow]left out[/] {escape(line)}")
    judges = {
        "truth": "Carried out in the scene with the true values of the simulation.",
        "draws": "The truth is not known: carried out in worlds drawn from the twin's intervals.",
    }
    out.prose(judges[proof.judge])
