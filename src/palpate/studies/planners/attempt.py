"""Trial of a planner: ask it, compile its first answer, execute its plan, judge trace and twin."""

from __future__ import annotations

import threading
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, cast

from palpate import pipeline
from palpate.errors import InputError
from palpate.planning.model.answer import read_answer
from palpate.planning.model.prompt.compose import checked_style
from palpate.planning.model.settings import ModelSettings
from palpate.planning.plan import Plan
from palpate.planning.planner import Observant, PlannerSettings
from palpate.planning.registry import planners
from palpate.runs.run import Run
from palpate.scenarios.catalogue import Scenario, scenario
from palpate.scene.poses import Poses, read_poses
from palpate.scene.scene import Scene
from palpate.settings import Settings
from palpate.stages.workplace import pictures_of
from palpate.studies.planners.judgement import Ruling, is_valid, rule
from palpate.studies.planners.trials import Found, Record, Trial
from palpate.twin.twin import build_twin
from palpate.vocabulary.base import Blackboard
from palpate.vocabulary.registry import vocabulary
from palpate.vocabulary.state import SymbolicState


@dataclass(frozen=True, slots=True)
class Conditions:
    """Conditions that all trials of a study share.

    Attributes:
        images: pictures of the workspace, instead of the scenario's own.
        noise: noise model of the simulated robot.
        model_settings: how models are asked; the paper gives no feedback.
        beside: a file; pictures that are taken of simulated worlds are kept beside it. None: none
            are.
    """

    images: tuple[Path, ...] = ()
    noise: str = "lab"
    model_settings: ModelSettings = field(default_factory=lambda: ModelSettings(rounds=0))
    beside: Path | None = None


_executing = threading.Lock()
"""Requests overlap, simulations do not: they would only slow each other down."""


def attempt(trial: Trial, without: frozenset[str], conditions: Conditions) -> Record:
    """The record of a trial, asked without some modules of the prompt.

    Raises:
        InputError: unknown scenario or planner.
        Unavailable: the provider.
    """
    task = scenario(trial.scenario)
    looks = _looks(trial.planner)
    settings = _settings(task, trial, without, conditions)
    if settings.scene is None and not looks:
        reason = "there is no scene but a picture, and this planner does not look"
        return Record(trial, True, True, True, reason, outcome="refused rightly")
    if looks:
        settings = replace(settings, images=_images(task, conditions))
    try:
        run = pipeline.plan(settings, pipeline.load(settings))
    except InputError as error:
        # What the scene does not know by that name nobody can ask for who does not look.
        if looks or not task.only_seen:
            raise
        return Record(trial, True, True, True, str(error), outcome="refused rightly")
    syntax, valid, figures = _syntax(run), is_valid(run), _figures(run)
    if "text" in without:  # nothing was asked: there is no right answer
        return Record(trial, syntax, valid, None, figures=figures)
    run, ruling = _judged(run, task, looks)
    return Record(
        trial,
        syntax,
        valid,
        ruling.success,
        ruling.reason,
        figures,
        ruling.outcome,
        _found(run),
        run.execution.actions if run.execution else 0,
        run.execution.robot_seconds if run.execution else 0.0,
    )


def _looks(planner: str) -> bool:
    """True for a planner that sees pictures.

    Raises:
        InputError: there is no such planner.
    """
    made = planners().make(planner, PlannerSettings())
    return isinstance(made, Observant) and made.looks


def _settings(
    task: Scenario, trial: Trial, without: frozenset[str], conditions: Conditions
) -> Settings:
    # What an author noted beside a body gives the answer away.
    asking = replace(
        conditions.model_settings,
        without=without,
        prompt=checked_style(trial.prompt),
        comments=False,
    )
    return task.settings(
        noise=conditions.noise, seed=trial.number, planner=trial.planner, model_settings=asking
    ).checked()


def _images(task: Scenario, conditions: Conditions) -> tuple[Path, ...]:
    """Pictures for a model: those given, else the scenario's own, else renderings of its world,
    made once. Empty without a usable OpenGL."""
    given = conditions.images or task.images
    if given or conditions.beside is None:
        return given
    first = conditions.beside.with_suffix(f".{task.name.replace('/', '-')}.png")
    further = first.with_stem(f"{first.stem}.closer")
    with _executing:
        if not first.exists():
            for path, content in zip((first, further), _pictures(task), strict=False):
                path.write_bytes(content)
    return tuple(path for path in (first, further) if path.exists())


def _pictures(task: Scenario) -> tuple[bytes, ...]:
    """PNGs of the simulated workspace of a scenario."""
    settings = task.settings()
    poses = read_poses(settings.poses) if settings.poses else Poses()
    return pictures_of(settings, pipeline.load(settings), poses)


def _judged(run: Run, task: Scenario, looks: bool) -> tuple[Run, Ruling]:
    """The run, with all that is made of it where there is something to execute, and what it came
    to."""
    if run.ready:
        with _executing:
            run = _with_twin(pipeline.measure(run))
    return run, rule(run, task, looks)


def _with_twin(run: Run) -> Run:
    """With the twin of what was estimated. Nobody touches it: here the truth itself can be asked."""
    scene = run.scene
    if run.seen is not None and run.final_state is not None:
        scene = run.final_state.scene
    return replace(run, finished=build_twin(scene, run.estimates))


def _found(run: Run) -> dict[str, Found]:
    """Estimates and true values by parameter."""
    found: dict[str, Found] = {}
    for estimate in run.estimates:
        found[str(estimate.parameter)] = Found(
            tuple(estimate.values.tolist()) if estimate.has_value else (),
            tuple(estimate.stds.tolist()) if estimate.has_value else (),
            run.truth.get(estimate.parameter, ()),
            estimate.unit,
            estimate.verdict,
        )
    return found


def _figures(run: Run) -> dict[str, Any]:
    """Tokens, cost, duration and answers of a model's conversation."""
    if run.conversation is None:
        return {}
    answers = [asked.answer.text for asked in run.conversation.rounds]
    return run.conversation.summary()["model"] | {"answers": answers}


def _syntax(run: Run) -> bool:
    """The unmodified first answer is a plan that compiles."""
    if run.conversation is None:
        return _compiles(run.plan, run.scene)
    first = run.conversation.rounds[0].answer.text
    try:
        return _compiles(read_answer(first).plan, run.scene)
    except InputError:
        return False


def _compiles(plan: Plan, scene: Scene) -> bool:
    """py_trees accepts the plan's tree; a plan without one needs none."""
    from palpate.execution.build import build

    if plan.tree is None:
        return True
    nobody = cast("Any", None)  # a tree that is never ticked needs neither robot nor recorder
    blackboard = Blackboard(nobody, SymbolicState(scene), nobody)
    try:
        build(plan.tree, vocabulary(), blackboard)
    except InputError:
        return False
    return True
