"""One trial: ask a planner, compile its first answer, execute its plan, judge the trace."""

from __future__ import annotations

import threading
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, cast

from palpate import pipeline, stages
from palpate.errors import InputError
from palpate.planning.model.answer import read_answer
from palpate.planning.model.session import ModelSettings
from palpate.planning.plan import Plan
from palpate.runs.run import Run
from palpate.scenarios.catalogue import Scenario, scenario
from palpate.scene.poses import Poses, read_poses
from palpate.scene.scene import Scene
from palpate.settings import Settings
from palpate.studies.judgement import Judgement, judge
from palpate.studies.trials import Record, Trial
from palpate.vocabulary.base import Blackboard
from palpate.vocabulary.registry import vocabulary
from palpate.vocabulary.state import SymbolicState


@dataclass(frozen=True, slots=True)
class Conditions:
    """What all trials of a study share.

    Attributes:
        images: pictures of the workspace. noise: noise model of the simulated robot.
        model_settings: how models are asked; the paper gives no feedback.
    """

    images: tuple[Path, ...] = ()
    noise: str = "lab"
    model_settings: ModelSettings = field(default_factory=lambda: ModelSettings(rounds=0))


_executing = threading.Lock()
"""Requests overlap, simulations do not: they would only slow each other down."""


def with_image(name: str, conditions: Conditions, file: Path) -> Conditions:
    """The conditions with a picture of the scenario's world, kept beside the results, unless they
    have one.

    Without a usable OpenGL there is none.
    """
    if conditions.images:
        return conditions
    path = file.with_suffix(".png")
    if not path.exists():
        content = _picture(name)
        if content is None:
            return conditions
        path.write_bytes(content)
    return replace(conditions, images=(path,))


def _picture(name: str) -> bytes | None:
    """PNG of the simulated workspace of a scenario."""
    settings = scenario(name).settings()
    poses = read_poses(settings.poses) if settings.poses else Poses()
    return stages.picture_of(settings, pipeline.load(settings), poses)


def attempt(trial: Trial, without: frozenset[str], conditions: Conditions) -> Record:
    """The record of a trial, asked without some modules of the prompt.

    Raises:
        InputError: unknown scenario or planner. Unavailable: the provider.
    """
    task = scenario(trial.scenario)
    settings = _settings(task, trial, without, conditions)
    run = pipeline.plan(settings, pipeline.load(settings))
    syntax, valid, figures = _syntax(run), _is_valid(run), _figures(run)
    if "text" in without:  # nothing was asked: there is no right answer
        return Record(trial, syntax, valid, None, figures=figures)
    judgement = _judged(run, task)
    return Record(trial, syntax, valid, judgement.success, judgement.reason, figures)


def _settings(
    task: Scenario, trial: Trial, without: frozenset[str], conditions: Conditions
) -> Settings:
    return task.settings(
        images=conditions.images,
        noise=conditions.noise,
        seed=trial.number,
        planner=trial.planner,
        model_settings=replace(conditions.model_settings, without=without),
    ).checked()


def _judged(run: Run, task: Scenario) -> Judgement:
    """Whether the plan, executed where there is something to execute, did what the task asks."""
    explanation = run.plan.explanation
    if not _is_valid(run):
        findings = [finding.message for finding in run.findings[:3]]
        return Judgement(False, ("; ".join(findings) or explanation)[:500])
    if run.plan.tree is None:
        if task.expects:
            return Judgement(False, f"no tree: {explanation[:300]}")
        return Judgement(True)
    with _executing:
        trace = pipeline.measure(run).trace
    assert trace is not None
    return judge(trace, task.expects)


def _is_valid(run: Run) -> bool:
    """Whether the plan, or the explanation why there is none, passed the check."""
    if run.findings:
        return False
    if run.conversation is None or not run.conversation.rounds:
        return True
    return not run.conversation.rounds[-1].findings


def _figures(run: Run) -> dict[str, Any]:
    """What asking a model took, and what it said."""
    if run.conversation is None:
        return {}
    answers = [asked.answer.text for asked in run.conversation.rounds]
    return run.conversation.summary()["model"] | {"answers": answers}


def _syntax(run: Run) -> bool:
    """Whether the first answer is a plan that compiles, as it came."""
    if run.conversation is None:
        return _compiles(run.plan, run.scene)
    first = run.conversation.rounds[0].answer.text
    try:
        return _compiles(read_answer(first).plan, run.scene)
    except InputError:
        return False


def _compiles(plan: Plan, scene: Scene) -> bool:
    """Whether py_trees takes the plan's tree; an idle plan needs none."""
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
