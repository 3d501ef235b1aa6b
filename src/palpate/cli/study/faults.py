"""Studies of what goes wrong, and of worlds that deceive."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.console import aside
from palpate.cli.options.motion import NoiseLevel
from palpate.cli.options.results import AsJson
from palpate.cli.study.options import CORES, FaultOptions, Names, Seeds, Workers


def faults(
    names: Names = None,
    *,
    noise: NoiseLevel = "lab",
    seeds: Seeds = 5,
    workers: Workers = CORES,
    campaign: FaultOptions,
    as_json: AsJson = False,
) -> None:
    """What goes wrong on purpose: how it ends, and whether anything is hit, dropped or lost.

    Mishaps are bundled scenarios. Every other --kind is a campaign: its cases are appended to the
    folder --out, where a page shows them; run again to go on. Forces come from MuJoCo's own state
    at every physics step.
    """
    from palpate.cli.show.studies.faults import show_campaign, show_case, show_endings
    from palpate.studies import faults
    from palpate.studies.campaign.campaign import conduct, repeat

    if campaign.case is not None:
        show_case(repeat(campaign.kind, campaign.case, campaign.seed), as_json)
        return
    if campaign.kind == "mishaps":
        endings = faults.faults(names or faults.mishaps(), noise, range(seeds), workers)
        show_endings(endings, as_json)
        return
    show_campaign(conduct(campaign.kind, campaign.order(workers), aside), as_json)


def deceptions(
    names: Annotated[list[str] | None, typer.Argument(metavar="[WORLD]...")] = None,
    *,
    out: Annotated[Path, typer.Option("--out", help="Folder of the rows and the page.")],
    noise: Annotated[
        list[str],
        typer.Option(
            "--noise",
            metavar="NAME|FILE.yaml",
            help="none | lab | datasheet | hardware | FILE.yaml | one of the study's own; may be repeated.",
        ),
    ] = ["lab"],  # noqa: B006 - typer's default of an option that may be repeated
    seed: Annotated[int, typer.Option("--seed", help="The first one.", min=0)] = 0,
    seeds: Seeds = 1,
    traces: Annotated[
        Path | None,
        typer.Option("--traces", help="Folder of traces: estimated anew where they lie there."),
    ] = None,
    workers: Workers = CORES,
    as_json: AsJson = False,
) -> None:
    """Worlds that deceive (tethers, magnets, mats, moving masses, jumps), innocent ones, and what
    cannot be told: what is answered, and whether it is right.

    An identified value must be within 4 of its standard deviations; a deceptive world may be
    contradicted or not identified just as well, an innocent one may not. Rows are appended to the
    folder --out, where a page shows them; run again to go on.
    """
    from palpate.cli.show.studies.faults import show_deceptions
    from palpate.studies.deceptions import study, world

    chosen = study.cases(names or world.deceptions(), noise, range(seed, seed + seeds))
    show_deceptions(study.deceive(chosen, out, workers, traces, aside), as_json)
