"""One trial: ask a planner, compile its first answer, execute its plan, judge the trace."""

from __future__ import annotations

import threading
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, cast

from palpate import pipeline
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
        images: I. noise: sensor world. asking: how models are asked; the paper gives no feedback.
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
        settings = scenario(name).settings()
        poses = read_poses(settings.poses) if settings.poses else Poses()
        content = pipeline.picture_of(settings, pipeline.load(settings), poses)
        if content is None:
            return conditions
        path.write_bytes(content)
    return replace(conditions, images=(path,))


def attempt(trial: Trial, without: frozenset[str], conditions: Conditions) -> Record:
    """The record of a trial.

    Raises:
        InputError: unknown scenario or planner. Unavailable: the provider.
    """
    task = scenario(trial.scenario)
    settings = _settings(task, trial, without, conditions)
    run = pipeline.plan(settings, pipeline.load(settings))
    judgement = None if "text" in without else _judged(run, task)
    return Record(
        trial,
        _syntax(run),
        _is_valid(run),
        judgement.success if judgement else None,
        judgement.reason if judgement else "",
        _figures(run),
    )


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
    if not _is_valid(run):
        findings = "; ".join(f.message for f in run.findings[:3])
        return Judgement(False, (findings or run.plan.explanation)[:500])
    if run.plan.tree is None:
        return Judgement(
            not task.expects,
            "" if not task.expects else "no tree: " + run.plan.explanation[:300],
        )
    with _executing:
        trace = pipeline.measure(run).trace
    assert trace is not None
    return judge(trace, task.expects)


def _is_valid(run: Run) -> bool:
    """Whether the plan, or the explanation why there is none, passed the check."""
    rounds = run.conversation.rounds if run.conversation else []
    return not run.findings and (not rounds or not rounds[-1].findings)


def _figures(run: Run) -> dict[str, Any]:
    talk = run.conversation
    return (
        talk.summary()["model"] | {"answers": [r.answer.text for r in talk.rounds]} if talk else {}
    )


def _syntax(run: Run) -> bool:
    """Whether the first answer is a plan that compiles, as it came."""
    if run.conversation is None:
        return _compiled(run.plan, run.scene)
    try:
        return _compiled(read_answer(run.conversation.rounds[0].answer.text).plan, run.scene)
    except InputError:
        return False


def _compiled(plan: Plan, scene: Scene) -> bool:
    """Whether py_trees takes the plan's tree; an idle plan needs none."""
    from palpate.execution.build import build

    nobody = cast("Any", None)
    try:
        return plan.tree is None or bool(
            build(plan.tree, vocabulary(), Blackboard(nobody, SymbolicState(scene), nobody))
        )
    except InputError:
        return False
