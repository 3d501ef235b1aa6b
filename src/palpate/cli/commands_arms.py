"""Commands about the arm and this machine."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.options import MODEL, AsJson, Fields, SceneFile, Yes, settings
from palpate.runs.settings import References, settings_of

OF_ARM = ("poses", "world", "arm", "robot", "robot_config", "noise", "seed", "cautious")
SECONDS = f"{MODEL}.budget.seconds"


def calibrate(
    *,
    wanted: References,
    out: Annotated[
        Path, typer.Option("--out", help="robot.yaml to write; its other figures stay.")
    ] = Path("robot.yaml"),
    scene: Annotated[
        Path | None,
        typer.Option("--scene", help="MJCF that states the weight's mass, the gauges' height."),
    ] = None,
    given: Annotated[Fields, settings(*OF_ARM)],
    as_json: AsJson = False,
    yes: Yes = False,
) -> None:
    """Calibrate an arm with known masses and heights, and its camera with a tag, and write robot.yaml."""
    from palpate.cli.show_arms import show_calibration
    from palpate.cli.show_run import confirm_plan, live_view, show_plan_early, unless
    from palpate.runs.calibration.calibrate import calibrate as carry_out_calibration
    from palpate.runs.callbacks import RunCallbacks, ignore

    with live_view() as (observer, say):
        callbacks = RunCallbacks(
            observer, say, unless(yes, confirm_plan), planned=ignore if yes else show_plan_early
        )
        done = carry_out_calibration(settings_of(scene=scene, **given), wanted, out, callbacks)
    show_calibration(done, as_json)


def dynamics(
    recording: Annotated[
        Path, typer.Argument(metavar="LOG", help="Recording of the arm in free motion.")
    ],
    *,
    given: Annotated[Fields, settings("arm")],
    hand: Annotated[
        str,
        typer.Option(
            "--hand", metavar="found|KG", help="Mass on the flange: to be found, or known; 0: bare."
        ),
    ] = "found",
    columns: Annotated[
        Path | None, typer.Option("--columns", help="YAML that maps the log's columns.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", metavar="FILE", help="MJCF of the arm to write.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Identify an arm's joint friction, links and hand from a recording of its motion."""
    import palpate as pp
    from palpate.cli.show_arms import mass_of, show_dynamics

    fitted = pp.dynamics(recording, given["arm"], hand=mass_of(hand), columns=columns)
    written = fitted.save(out) if out is not None and not fitted.contradictions else ()
    show_dynamics(fitted, written, as_json)
    raise typer.Exit(1 if fitted.contradictions else 0)


def noise(
    recording: Annotated[
        Path, typer.Argument(metavar="LOG", help="Recording of the arm in free motion: a minute.")
    ],
    *,
    given: Annotated[Fields, settings("arm")],
    columns: Annotated[
        Path | None, typer.Option("--columns", help="YAML that maps the log's columns.")
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="FILE", help="Noise model to write, for --noise."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Measure the noise of an arm in a recording, and compare it with the noise models."""
    import palpate as pp
    from palpate.cli.show_arms import show_noise

    measured = pp.noise(recording, given["arm"], columns=columns)
    show_noise(measured, None if out is None else measured.save(out), as_json)


def teach(
    scene: SceneFile,
    *,
    given: Annotated[Fields, settings("robot", "poses", "root", "arm")],
    out: Annotated[Path, typer.Option("--out", help="poses.yaml to write.")] = Path("poses.yaml"),
) -> None:
    """Record poses in poses.yaml: guide the robot's hand to each object, or type ruler measurements."""
    from palpate.cli.teach import give_lesson

    give_lesson(settings_of(scene=scene, **given), out)


def doctor(
    *,
    given: Annotated[
        Fields,
        settings(
            "robot", "arm", "robot_config", f"{MODEL}.base_url", SECONDS, defaults={SECONDS: 60}
        ),
    ],
    yes: Yes = False,
    planner: Annotated[
        str | None, typer.Option("--planner", help="A model's server to ask: PROVIDER[:MODEL].")
    ] = None,
) -> None:
    """Check what is available on this machine, at a real robot, or at a model's server."""
    from palpate.cli.doctor import examine, print_checks
    from palpate.runs.tools import examine_planner, examine_real_robot

    asked = settings_of(**given)
    model = asked.model_settings
    if planner is not None:
        checks = examine_planner(planner, model.base_url, model.budget.seconds)
        raise typer.Exit(print_checks(checks))
    if asked.robot is None:
        raise typer.Exit(examine())

    def may_hold() -> bool:
        return yes or typer.confirm("Let the arm hold itself for 5 s, to count cycles?", err=True)

    raise typer.Exit(print_checks(examine_real_robot(asked, may_hold)))
