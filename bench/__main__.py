"""Command line of the instruments: `python -m bench --help`."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

# Threads of BLAS in processes side by side wait for each other; set before numpy is loaded.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import typer

from palpate.cli.command import command
from palpate.cli.console import print_dim
from palpate.cli.options import AsJson
from palpate.common.errors import InputError

CORES = os.cpu_count() or 1
Names = Annotated[list[str] | None, typer.Argument(metavar="[NAME]...")]
NoiseLevel = Annotated[str, typer.Option("--noise", metavar="NAME|FILE.yaml", help="Noise model.")]
Noises = Annotated[
    list[str], typer.Option("--noise", metavar="NAME|FILE.yaml", help="Noise; may be repeated.")
]
Seed = Annotated[int, typer.Option("--seed", min=0, help="First seed.")]
Seeds = Annotated[int, typer.Option("--seeds", min=1, help="Number of seeds.")]
Workers = Annotated[int, typer.Option("--workers", min=1, help="Processes.")]
Out = Annotated[Path | None, typer.Option("--out", help="Folder of rows and page; resumed.")]

app = typer.Typer(no_args_is_help=True, help=__doc__)


@command(app)
def speed(
    against: Annotated[
        str | None,
        typer.Option("--against", metavar="REVISION", help="Measured too, alternately."),
    ] = None,
    only: Annotated[str, typer.Option("--only", help="Part of the names of figures.")] = "",
) -> None:
    """Processor time of loop, help and planning, as ratios taken side by side."""
    from bench.speed import main

    main(against, only)


@command(app)
def mishaps(
    names: Names = None,
    *,
    noise: NoiseLevel = "lab",
    seeds: Seeds = 5,
    workers: Workers = CORES,
    as_json: AsJson = False,
) -> None:
    """Endings of the bundled mishaps: status, dropped and still held objects."""
    from bench import mishaps
    from bench.show import show_endings

    endings = mishaps.faults(names or mishaps.mishaps(), noise, range(seeds), workers)
    show_endings(endings, as_json)


@command(app)
def faults(
    *,
    kind: Annotated[
        str,
        typer.Option(
            "--kind",
            help="plans, nasty, physics, sensible, runtime, signals, stops, astray, poses, obstacles, cautious, light, "
            "inputs or schema.",
        ),
    ],
    count: Annotated[int | None, typer.Option("--count", min=1, help="Number of cases.")] = None,
    execute: Annotated[
        int, typer.Option("--execute", min=0, help="Of --kind plans: accepted plans to execute.")
    ] = 0,
    bypass_check: Annotated[
        bool, typer.Option("--bypass-check", help="Execute as many refused plans, too.")
    ] = False,
    seed: Annotated[
        int,
        typer.Option(
            "--seed", min=0, help="Of random cases; of the arm that executes written plans."
        ),
    ] = 0,
    case: Annotated[str | None, typer.Option("--case", help="Repeat one case by name.")] = None,
    out: Out = None,
    workers: Workers = CORES,
    as_json: AsJson = False,
) -> None:
    """Harm and crashes under corrupted plans, faults, signals, hidden obstacles and bad input.

    Forces come from MuJoCo's own state at every physics step.
    """
    from bench.campaign.kinds import Order, conduct, repeat
    from bench.show import show_campaign, show_case

    if case is not None:
        show_case(repeat(kind, case, seed), as_json)
        return
    if out is None:
        raise InputError("a campaign needs a folder for its rows and its page; add --out DIR")
    order = Order(out, count, execute, bypass_check, seed, workers)
    show_campaign(conduct(kind, order, print_dim), as_json)


@command(app)
def requests() -> None:
    """Readings of requests in five languages, by file and language."""
    from bench.requests import FOLDER, judge

    for file in sorted(path.name for path in FOLDER.glob("*.yaml")):
        for language, counts in judge(file).items():
            figures = ", ".join(f"{kind} {count}" for kind, count in sorted(counts.items()))
            typer.echo(f"{file} {language}: {figures}")


@command(app)
def noise(
    recordings: Annotated[
        list[Path], typer.Argument(metavar="LOG.npz...", help="Recordings of real arms.")
    ],
    *,
    levels: Noises = ["measured", "hardware", "datasheet", "lab"],  # noqa: B006
    seeds: Seeds = 4,
) -> None:
    """Noise of real arms in free motion, beside the simulated one's at each noise model."""
    from bench.realism import table

    typer.echo(table(recordings, levels, seeds))


@command(app)
def deceptions(
    names: Names = None,
    *,
    out: Annotated[Path, typer.Option("--out", help="Folder of rows and page; resumed.")],
    noise: Noises = ["lab"],  # noqa: B006 - typer's default of an option that may be repeated
    seed: Seed = 0,
    seeds: Seeds = 1,
    traces: Annotated[
        Path | None, typer.Option("--traces", help="Folder of traces; estimated again if there.")
    ] = None,
    workers: Workers = CORES,
    as_json: AsJson = False,
) -> None:
    """Verdicts in worlds that deceive (tethers, magnets, moving masses) and in innocent ones.

    An identified value must be within 4 of its standard deviations. A deceptive world may also
    be contradicted or not identified; an innocent one may not.
    """
    from bench.deceptions import study, world
    from bench.show import show_deceptions

    chosen = study.cases(names or world.deceptions(), noise, range(seed, seed + seeds))
    show_deceptions(study.deceive(chosen, out, workers, traces, print_dim), as_json)


@command(app)
def variety(
    *,
    noise: NoiseLevel = "lab",
    seed: Seed = 0,
    drawn: Annotated[
        int, typer.Option("--drawn", min=0, help="Number of drawn scenes, in place of the ten.")
    ] = 0,
    workers: Workers = CORES,
    as_json: AsJson = False,
) -> None:
    """Ten scenes of other objects, heights and gaps, or drawn ones and requests, one run each."""
    from bench.variety import run_all
    from palpate.cli.show_studies import show_seed_runs

    runs = {name: [run] for name, run in run_all(noise, seed, workers, drawn).items()}
    show_seed_runs(runs, f"--noise {noise}", as_json)


@command(app)
def arms(
    names: Names = None,
    *,
    arm: Annotated[list[str] | None, typer.Option("--arm", help="Name; may be repeated.")] = None,
    noise: NoiseLevel = "measured",
    seed: Seed = 0,
    seeds: Seeds = 1,
    out: Annotated[
        Path | None, typer.Option("--out", help="File of rows of runs; resumed. Without: plans.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Requests on several arms: one tree for all, and the values with their deviations."""
    from bench.arms import ARMS, REQUESTS, compare
    from bench.show import show_arms

    seeded = range(seed, seed + seeds)
    show_arms(compare(names or REQUESTS, arm or ARMS, noise, seeded, out), as_json)


@command(app)
def fixtures(
    names: Names = None,
    *,
    out: Annotated[Path, typer.Option("--out", help="File of rows; resumed.")],
    noise: Noises = ["measured"],  # noqa: B006 - typer's default of an option that may be repeated
    seed: Seed = 0,
    seeds: Seeds = 40,
    spring: Annotated[
        bool, typer.Option("--spring", help="Joints with an unknown spring.")
    ] = False,
    traces: Annotated[
        Path | None, typer.Option("--traces", help="Folder of traces; estimated again if there.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Joints of hidden drawers and doors of other mass, friction, damping, place and solver."""
    from functools import partial

    from bench.fixtures import Case, groups, judge, study
    from bench.show import show_fixtures

    chosen = names or ["drawer", "drawer/door"]
    seeded = range(seed, seed + seeds)
    cases = [Case(each, level, i, spring) for each in chosen for level in noise for i in seeded]
    show_fixtures(groups(study(cases, out, partial(judge, traces=traces))), as_json)


@command(app)
def cups(
    *,
    out: Annotated[Path, typer.Option("--out", help="File of rows; resumed.")],
    noise: Noises = ["measured"],  # noqa: B006 - typer's default of an option that may be repeated
    seed: Seed = 0,
    seeds: Seeds = 40,
    traces: Annotated[
        Path | None, typer.Option("--traces", help="Folder of traces; estimated again if there.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Friction of hidden cups of other radius, height, mass, friction and place."""
    from functools import partial

    from bench.cups import judge
    from bench.fixtures import Case, groups, study
    from bench.show import show_fixtures

    cases = [Case("cup", level, i) for level in noise for i in range(seed, seed + seeds)]
    show_fixtures(groups(study(cases, out, partial(judge, traces=traces))), as_json)


@command(app)
def mats(
    *,
    out: Annotated[Path, typer.Option("--out", help="File of rows; resumed.")],
    noise: Noises = ["measured"],  # noqa: B006 - typer's default of an option that may be repeated
    seed: Seed = 0,
    seeds: Seeds = 40,
    as_json: AsJson = False,
) -> None:
    """Stiffness, damping and restitution of hidden mats of other worlds."""
    from bench.fixtures import Case, groups, study
    from bench.mats import judge
    from bench.show import show_fixtures

    cases = [Case("soft_mat", level, i) for level in noise for i in range(seed, seed + seeds)]
    show_fixtures(groups(study(cases, out, judge)), as_json)


@command(app)
def bounds(
    names: Names = None,
    *,
    noise: NoiseLevel = "lab",
    seed: Seed = 0,
    seeds: Seeds = 20,
    workers: Workers = CORES,
    as_json: AsJson = False,
) -> None:
    """RMS error over the Cramér-Rao bound of the same recordings, a line a parameter."""
    from bench.bounds.efficiency import over_bounds
    from bench.show import show_bounds

    found = over_bounds(names or ["bottle_and_table"], noise, range(seed, seed + seeds), workers)
    show_bounds(found, as_json)


@command(app)
def peers(
    *,
    noise: Noises = ["measured"],  # noqa: B006 - typer's default of an option that may be repeated
    seed: Seed = 0,
    seeds: Seeds = 5,
    masses: Annotated[
        list[float], typer.Option("--mass", min=0.0, max=3.0, help="kg; may be repeated.")
    ] = [0.25, 0.5, 1.0, 2.0],  # noqa: B006 - likewise
    recordings: Annotated[
        Path | None, typer.Option("--recordings", help="Folder of recordings; read if there.")
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", help="File of rows, appended.")] = None,
    as_json: AsJson = False,
) -> None:
    """Error, stated deviation, z and coverage of palpate and of two published estimators.

    Each recording has 24 s of palpate's own motion with the empty hand, and 24 s with a load.
    """
    from bench.peers.recordings import cases
    from bench.peers.study import study, summary
    from bench.show import show_peers

    chosen = cases(noise, range(seed, seed + seeds), masses)
    show_peers(summary(study(chosen, recordings, out)), as_json)


if __name__ == "__main__":
    app()
