"""Commands about run folders, finished or interrupted."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.options import AsJson, RunFolder
from palpate.interrupt import interrupts


def report(
    folder: RunFolder,
    *,
    film: Annotated[
        bool, typer.Option("--film", help="Film a replay of the trace if there is no film.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Finish an interrupted or --fast run, and write its report again."""
    from palpate.api.runs import finish
    from palpate.cli.show.run import live_view, show_ended

    with interrupts() as signals, signals.deferred():
        with live_view() as (_, say):
            done = finish(folder, say, film)
        raise typer.Exit(show_ended(done, as_json))


def fuse(
    folders: Annotated[
        list[Path], typer.Argument(metavar="RUN RUN…", help="Run folders of one scene.")
    ],
    *,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="DIR", help="Folder for result.json and twin.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Fuse the estimates of several runs; errors that they share are not averaged away."""
    import palpate as pp
    from palpate.cli.show.stored import show_fusion

    fusion = pp.fuse(folders)
    if out is not None:
        fusion = fusion.save(out)
    show_fusion(fusion, as_json)
    raise typer.Exit(0 if fusion.identified else 1)


def compare(
    folders: Annotated[
        list[Path], typer.Argument(metavar="RUN RUN…", help="Run folders of the same things.")
    ],
    *,
    as_json: AsJson = False,
) -> None:
    """Compare the estimates of several runs, with differences in standard deviations."""
    import palpate as pp
    from palpate.cli.show.comparison import show_comparison

    show_comparison(pp.compare(folders), as_json)


def open_report(
    folder: RunFolder,
    *,
    live: Annotated[bool, typer.Option("--live", help="Replay the run on a page instead.")] = False,
) -> None:
    """Open a run's report in the browser."""
    import palpate as pp
    from palpate.cli.show.run import live_page, play_again
    from palpate.cli.show.stored import show_report

    if not live:
        show_report(folder)
        return
    with interrupts() as signals, signals.deferred(), live_page(live) as page:
        assert page is not None
        play_again(page, pp.open(folder), signals)


def export(
    folder: RunFolder,
    *,
    to: Annotated[
        str, typer.Option("--to", metavar="FORMAT", help="mjcf | urdf | usd | randomisation")
    ],
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="DIR", help="Folder to make (default: RUN/export-FORMAT)."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Export a run's twin to another simulator; read it back and compare."""
    import palpate as pp
    from palpate.cli.show.stored import show_export

    run = pp.open(folder)
    show_export(run, run.export(to, out), as_json)


def prove(folder: RunFolder, *, as_json: AsJson = False) -> None:
    """Show what a run's twin is good for: a push, a topple and a throw, or an opening, planned with prior and twin."""
    import palpate as pp
    from palpate.cli.show.stored import show_proof

    show_proof(pp.open(folder).prove(), as_json)
