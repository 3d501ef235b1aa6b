"""Commands about the arm itself, and what is at hand."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.commands.asking import unless
from palpate.cli.options.model import BaseUrl, Seconds
from palpate.cli.options.motion import ArmOptions, RobotConfig, RobotUrl, Yes
from palpate.cli.options.results import AsJson
from palpate.cli.options.scene import DEFAULT_ARM, Arm, Poses, Root


def calibrate(
    *,
    weight: Annotated[
        str | None,
        typer.Option("--weight", metavar="[OBJECT=]MASS", help="Known mass: 0.5kg±0.1g"),
    ] = None,
    gauge: Annotated[
        str | None,
        typer.Option("--gauge", metavar="[SURFACE=]HEIGHT", help="Known height: 50mm±0.01mm"),
    ] = None,
    own_weight: Annotated[
        bool, typer.Option("--own-weight", help="Let the arm weigh itself.")
    ] = False,
    out: Annotated[
        Path, typer.Option("--out", help="robot.yaml to write; its other figures stay.")
    ] = Path("robot.yaml"),
    which: ArmOptions,
    as_json: AsJson = False,
    yes: Yes = False,
) -> None:
    """Measure one very arm with what is known, and write robot.yaml."""
    from palpate.calibration.calibrate import calibrate as carry_out_calibration
    from palpate.calibration.calibrate import wanted
    from palpate.callbacks import RunCallbacks
    from palpate.cli.show.calibration import show_calibration
    from palpate.cli.show.run import confirm_plan, live_view

    asked = wanted(weight, gauge, own_weight)
    with live_view() as (observer, say):
        callbacks = RunCallbacks(observer, say, unless(yes, confirm_plan))
        done = carry_out_calibration(which.settings(), asked, out, callbacks)
    show_calibration(done, as_json)


def teach(
    scene: Annotated[Path, typer.Argument(help="Your MJCF.")],
    *,
    robot: RobotUrl = None,
    poses: Poses = None,
    root: Root = None,
    arm: Arm = DEFAULT_ARM,
    out: Annotated[Path, typer.Option("--out", help="poses.yaml to write.")] = Path("poses.yaml"),
) -> None:
    """Say where things are: lead a robot's hand to them, or measure them with a ruler."""
    from palpate.cli.teach import give_lesson

    give_lesson(scene, robot, poses, root, arm, out)


def doctor(
    *,
    robot: RobotUrl = None,
    arm: Arm = DEFAULT_ARM,
    robot_config: RobotConfig = None,
    yes: Yes = False,
    planner: Annotated[
        str | None, typer.Option("--planner", help="A model's server to ask: PROVIDER[:MODEL].")
    ] = None,
    base_url: BaseUrl = None,
    budget_seconds: Seconds = 60,
) -> None:
    """Explain what is and what is not available on this machine, at a real robot, or at a model's server."""
    from palpate.cli.doctor import examine, examine_planner, examine_robot

    if planner is not None:
        raise typer.Exit(examine_planner(planner, base_url, budget_seconds))
    if robot is None:
        raise typer.Exit(examine())

    def may_hold() -> bool:
        return yes or typer.confirm("Let the arm hold itself for 5 s, to count cycles?", err=True)

    raise typer.Exit(examine_robot(robot, arm, robot_config, may_hold))
