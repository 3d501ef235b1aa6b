"""Commands about recordings and run folders."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from palpate.cli.options import AsJson, Fields, RunFolder, settings
from palpate.common.errors import InputError
from palpate.common.processes import interrupts


def _of_log(flag: str, metavar: str | None, text: str, *others: str) -> Any:
    """Option for recordings by other programs."""
    return typer.Option(flag, *others, metavar=metavar, help=text, rich_help_panel="Recording")


def estimate(
    source: Annotated[
        Path | None,
        typer.Argument(
            metavar="RUN|LOG",
            help="A run folder, or a recording of any arm, or of a force/torque sensor with "
            "its pose: CSV, NPZ, MCAP, rosbag2, Parquet.",
            show_default=False,
        ),
    ] = None,
    *,
    estimator: Annotated[
        list[str] | None,
        typer.Option(
            "--estimator",
            metavar="QUANTITY=NAME",
            help="Estimator of a quantity, e.g. mass=single-shot; may be repeated.",
        ),
    ] = None,
    loaded: Annotated[
        list[str] | None,
        _of_log("--loaded", "A-B", "Seconds in which the load hung free; may be repeated."),
    ] = None,
    empty: Annotated[
        Path | None, _of_log("--empty", "LOG", "Another recording, of the empty hand.")
    ] = None,
    hand: Annotated[
        str | None,
        _of_log("--hand", "KG|found", "Mass on the flange (default: the arm's own hand)."),
    ] = None,
    name: Annotated[
        str | None, _of_log("--object", "NAME", "Name of the load, in the scene if one is given.")
    ] = None,
    in_hand: Annotated[
        str | None, _of_log("--in-hand", "'X Y Z QW QX QY QZ'", "Pose of the object in the hand.")
    ] = None,
    columns: Annotated[
        Path | None, _of_log("--columns", "MAP.yaml", "Which columns of the recording are what.")
    ] = None,
    how: Annotated[
        bool, _of_log("--how", None, "Say what to record, and write a motion that excites a load.")
    ] = False,
    out: Annotated[
        Path | None,
        _of_log("--out", "DIR", "Run folder to make, or with --how the motion's file.", "-o"),
    ] = None,
    load_data: Annotated[
        list[str] | None,
        typer.Option(
            "--load-data",
            metavar="FORMAT[=FILE]",
            help="Write the load for a controller: franka-desk, franka, ur, kuka, ros; without a "
            "file it is printed. May be repeated.",
        ),
    ] = None,
    given: Annotated[Fields, settings("scene", "arm", "robot_config", "remeasure")],
    as_json: AsJson = False,
) -> None:
    """Estimate again from a stored trace, or estimate the load in a recording of any arm.

    A run folder is not changed. --how explains what a recording needs.
    """
    import palpate as pp
    from palpate.cli.show_run import live_view, show_run
    from palpate.cli.show_stored import show_how, show_load_data
    from palpate.common.files import write_new

    if how:
        show_how(given.get("arm", "fr3"), out)
        return
    if source is None:
        raise InputError("give a run folder or a recording, or --how for what to record")
    asked_for = [_load_format(item, as_json) for item in load_data or ()]
    # A run folder is estimated again; everything else is a recording.
    if (source / "result.json").exists():
        run = pp.open(source).estimate(dict(map(_estimator, estimator or ())))
    else:
        with live_view() as (_, progress):
            run = pp.estimate(
                source,
                [_window(text) for text in loaded or ()],
                empty=empty,
                hand=_hand(hand),
                object=name,
                in_hand=in_hand,
                columns=columns,
                progress=progress,
                **given,
            )
        if out is not None:
            run = run.save(out)
    # Make all texts before the first file is written.
    written = [(run.load_data(to, name), file) for to, file in asked_for]
    for text, file in written:
        if file is not None:
            write_new(file, text)
    show_run(run, as_json)
    if not as_json:
        show_load_data(written)
    # Only requested parameters decide the exit status.
    asked = [item for item in run.estimates if item.parameter in run.plan.parameters]
    raise typer.Exit(0 if all(item.identified for item in asked) else 1)


def _estimator(text: str) -> tuple[str, str]:
    """Parse `QUANTITY=NAME`. Raises InputError: another form."""
    quantity, _, name = (part.strip() for part in text.partition("="))
    if not (quantity and name):
        raise InputError(f"--estimator takes QUANTITY=NAME, not '{text}'")
    return quantity, name


def _load_format(text: str, as_json: bool) -> tuple[str, Path | None]:
    """Parse `FORMAT[=FILE]`.

    Raises InputError: an unknown format, a file that exists, or no file where the output is JSON.
    """
    from palpate.runs.export import FORMATS

    to, _, file = (part.strip() for part in text.partition("="))
    FORMATS.named(to)
    if as_json and not file:
        raise InputError(f"--load-data {to} with --json needs a file: --load-data {to}=FILE")
    if file and Path(file).exists():
        raise InputError(f"'{file}' exists already: name another file for --load-data")
    return to, Path(file) if file else None


def _window(text: str) -> tuple[float, float]:
    """Parse `12.0-18.5`, s. Raises InputError: another form."""
    start, _, stop = text.partition("-")
    try:
        return float(start), float(stop)
    except ValueError:
        raise InputError(
            f"--loaded takes seconds A-B, as in 12.0-18.5, not '{text[:40]}'"
        ) from None


def _hand(text: str | None) -> float | Literal["found"] | None:
    """Parse a mass in kg, or `found`. Raises InputError: neither."""
    if text is None or text == "found":
        return text
    try:
        return float(text)
    except ValueError:
        raise InputError(f"--hand takes kilograms or 'found', not '{text[:40]}'") from None


# Commands about run folders, finished or interrupted.


def report(
    folder: RunFolder,
    *,
    film: Annotated[
        bool, typer.Option("--film", help="Film a replay of the trace if there is no film.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Finish an interrupted or --fast run, and write its report again."""
    from palpate.cli.show_run import live_view, show_result
    from palpate.runs.stored import finish

    with interrupts() as signals, signals.defer():
        with live_view() as (_, say):
            done = finish(folder, say, film)
        raise typer.Exit(show_result(done, as_json))


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
    from palpate.cli.show_stored import show_fusion

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
    from palpate.cli.show_stored import show_comparison

    show_comparison(pp.compare(folders), as_json)


def open_report(
    folder: RunFolder,
    *,
    live: Annotated[bool, typer.Option("--live", help="Replay the run on a page instead.")] = False,
) -> None:
    """Open a run's report in the browser."""
    import palpate as pp
    from palpate.cli.show_run import live_page, play_again
    from palpate.cli.show_stored import show_report

    if not live:
        show_report(folder)
        return
    with interrupts() as signals, signals.defer(), live_page(live) as page:
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
    check: Annotated[
        bool, typer.Option("--check", help="Compare by experiments in every installed simulator.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Export a run's twin to another simulator; read it back and compare."""
    import palpate as pp
    from palpate.cli.show_stored import show_export

    run = pp.open(folder)
    show_export(run, run.export(to, out, check), as_json)


def prove(folder: RunFolder, *, as_json: AsJson = False) -> None:
    """Show what a run's twin is good for: a push, a topple and a throw, or an opening, planned with prior and twin."""
    import palpate as pp
    from palpate.cli.show_stored import show_proof

    show_proof(pp.open(folder).prove(), as_json)
