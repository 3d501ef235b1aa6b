"""Estimates from what is recorded already: a stored run, or another program's recording of an arm."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from palpate.cli.options import AsJson, EstimatorNames, Given, by_quantity, settings
from palpate.errors import InputError


def _of_log(flag: str, metavar: str | None, text: str, *others: str) -> Any:
    """Option for recordings by other programs."""
    return typer.Option(flag, *others, metavar=metavar, help=text, rich_help_panel="Recording")


def estimate(
    source: Annotated[
        Path | None,
        typer.Argument(
            metavar="RUN|LOG",
            help="A run folder, or anybody's recording of an arm: CSV, NPZ, MCAP, rosbag2, Parquet.",
            show_default=False,
        ),
    ] = None,
    *,
    estimator: EstimatorNames = None,
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
        str | None,
        _of_log("--in-hand", "'X Y Z QW QX QY QZ'", "Pose of the object in the hand."),
    ] = None,
    columns: Annotated[
        Path | None, _of_log("--columns", "MAP.yaml", "Which columns of the recording are what.")
    ] = None,
    how: Annotated[
        bool,
        _of_log("--how", None, "Say what to record, and write a motion that excites a load."),
    ] = False,
    out: Annotated[
        Path | None,
        _of_log("--out", "DIR", "Run folder to make, or with --how the motion's file.", "-o"),
    ] = None,
    given: Annotated[Given, settings("scene", "arm", "robot_config")],
    as_json: AsJson = False,
) -> None:
    """Estimate again from a stored trace, or from anybody's recording of an arm what it carried.

    A run folder is not changed. What a recording needs is told by --how.
    """
    import palpate as pp
    from palpate.cli.show.run import live_view, show_run
    from palpate.cli.show.stored import show_how

    if how:
        show_how(given.get("arm", "fr3"), out)
        return
    if source is None:
        raise InputError("give a run folder or a recording, or --how for what to record")
    if (source / "result.json").exists():
        found = pp.open(source).estimate(by_quantity("estimator", estimator or ()))
    else:
        with live_view() as (_, progress):
            found = pp.estimate(
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
            found = found.save(out)
    show_run(found, as_json)
    asked = [one for one in found.estimates if one.parameter in found.plan.parameters]
    raise typer.Exit(0 if all(one.identified for one in asked) else 1)


def _window(text: str) -> tuple[float, float]:
    """Seconds of `12.0-18.5`.

    Raises:
        InputError: not of that form.
    """
    start, _, stop = text.partition("-")
    try:
        return float(start), float(stop)
    except ValueError:
        raise InputError(
            f"--loaded takes seconds A-B, as in 12.0-18.5, not '{text[:40]}'"
        ) from None


def _hand(text: str | None) -> float | Literal["found"] | None:
    """Kilograms, or `found`.

    Raises:
        InputError: neither.
    """
    if text is None or text == "found":
        return text
    try:
        return float(text)
    except ValueError:
        raise InputError(f"--hand takes kilograms or 'found', not '{text[:40]}'") from None
