"""Trial of a planner: request a plan, compile its first answer, execute the plan, judge trace and
twin.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, cast

from palpate.common.errors import InputError
from palpate.planning.model.answer import read_answer
from palpate.planning.model.prompt import check_style
from palpate.planning.model.settings import ModelSettings
from palpate.planning.plan import Plan
from palpate.planning.planner import Observant, PlannerSettings
from palpate.planning.registry import planners
from palpate.primitives.base import Blackboard
from palpate.primitives.registry import vocabulary
from palpate.primitives.state import SymbolicState
from palpate.robots.noise_levels import DEFAULT_LEVEL
from palpate.runs import pipeline
from palpate.runs.run import Run
from palpate.runs.workplace import pictures_of
from palpate.scene.poses import Poses, read_poses
from palpate.scene.scene import Scene
from palpate.studies.judgement import is_valid, rule
from palpate.studies.scenarios.catalogue import Scenario, scenario
from palpate.studies.trials import MeasuredValue, PlannerTrial, TrialRecord


@dataclass(frozen=True, slots=True)
class Conditions:
    """Conditions that all trials of a study share."""

    images: tuple[Path, ...] = ()  # pictures of the workspace, instead of the scenario's own
    noise: str = DEFAULT_LEVEL  # noise model of the simulated robot
    # Of the requests to models; the paper gives no feedback.
    model_settings: ModelSettings = field(default_factory=lambda: ModelSettings(rounds=0))
    # File in whose folder pictures of simulated worlds are saved; None for no pictures.
    records_file: Path | None = None


# Requests overlap. Simulations run one at a time, because they would only slow each other down.
_executing = threading.Lock()


def attempt(trial: PlannerTrial, without: frozenset[str], conditions: Conditions) -> TrialRecord:
    """Carry out a trial `without` some modules of the prompt.

    Raises:
        InputError: unknown scenario or planner.
        Unavailable: the provider.
    """
    # Settings of the trial: no comments of the scenario, because they may state the answer.
    task = scenario(trial.scenario)
    planner = planners().make(trial.planner, PlannerSettings())
    looks = isinstance(planner, Observant) and planner.looks
    asking = replace(
        conditions.model_settings,
        without=without,
        prompt=check_style(trial.prompt),
        comments=False,  # comments in a scenario's MJCF may state the answer
    )
    settings = task.settings(
        noise=conditions.noise, seed=trial.number, planner=trial.planner, model_settings=asking
    ).check_values()
    # Without a scene or a picture no plan is possible: the refusal is right.
    if settings.scene is None and not looks:
        reason = "there is no scene but a picture, and this planner does not look"
        return TrialRecord(trial, True, True, True, reason, outcome="refused rightly")
    if looks:
        settings = replace(settings, images=workspace_images(task, conditions))
    try:
        run = pipeline.plan(settings, pipeline.load(settings))
    except InputError as error:
        # A planner without pictures cannot know the name of an object that only a picture shows.
        if looks or not task.only_seen:
            raise
        return TrialRecord(trial, True, True, True, str(error), outcome="refused rightly")
    # Figures of the requests to a model.
    syntax, valid = has_valid_syntax(run), is_valid(run)
    figures: dict[str, Any] = {}
    if run.conversation is not None:
        answers = [asked.answer.text for asked in run.conversation.rounds]
        figures = run.conversation.summary()["model"] | {"answers": answers}
    if "text" in without:  # without the request, no answer is right or wrong
        return TrialRecord(trial, syntax, valid, None, figures=figures)
    # Execute and judge.
    if run.ready:
        with _executing:
            run = pipeline.measure(run)
        # Add the twin, without its validation in simulation: the study knows the truth.
        run = pipeline.build_twin(run)
    ruling = rule(run, task, looks)
    return TrialRecord(
        trial,
        syntax,
        valid,
        ruling.success,
        ruling.reason,
        figures=figures,
        outcome=ruling.outcome,
        found=found_values(run),
        actions=run.execution.actions if run.execution else 0,
        robot_seconds=run.execution.robot_seconds if run.execution else 0.0,
    )


def workspace_images(task: Scenario, conditions: Conditions) -> tuple[Path, ...]:
    """Pictures for a model: those given, else the scenario's own, else renderings of its world.

    Renderings are made once. There are none without OpenGL.
    """
    given = conditions.images or task.images
    if given or conditions.records_file is None:
        return given
    # Render once for each scenario, next to the results.
    first = conditions.records_file.with_suffix(f".{task.name.replace('/', '-')}.png")
    further = first.with_stem(f"{first.stem}.closer")
    with _executing:
        if not first.exists():
            settings = task.settings()
            poses = read_poses(settings.poses) if settings.poses else Poses()
            pictures, _ = pictures_of(settings, pipeline.load(settings), poses)
            for path, content in zip((first, further), pictures, strict=False):
                path.write_bytes(content)
    return tuple(path for path in (first, further) if path.exists())


def found_values(run: Run) -> dict[str, MeasuredValue]:
    """Estimates and true values by parameter."""
    values: dict[str, MeasuredValue] = {}
    for estimate in run.estimates:
        values[str(estimate.parameter)] = MeasuredValue(
            tuple(estimate.values.tolist()) if estimate.has_value else (),
            tuple(estimate.stds.tolist()) if estimate.has_value else (),
            run.truth.get(estimate.parameter, ()),
            estimate.unit,
            estimate.verdict,
        )
    return values


def has_valid_syntax(run: Run) -> bool:
    """True if the first answer, before any feedback, is a plan that compiles."""
    if run.conversation is None:
        return compiles(run.plan, run.scene)
    # Ignore later rounds: the check corrected them by feedback, which the paper does not give.
    first = run.conversation.rounds[0].answer.text
    try:
        return compiles(read_answer(first).plan, run.scene)
    except InputError:
        return False


def compiles(plan: Plan, scene: Scene) -> bool:
    """True if py_trees accepts the plan's tree, or if the plan has none."""
    from palpate.execution.leaf import build

    if plan.tree is None:
        return True
    absent = cast("Any", None)  # a tree that is never ticked needs neither robot nor recorder
    blackboard = Blackboard(absent, SymbolicState(scene), absent)
    try:
        build(plan.tree, vocabulary(), blackboard)
    except InputError:
        return False
    return True
