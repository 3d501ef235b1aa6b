"""One trial: ask a planner, compile its first answer, execute its plan, judge the trace."""

from __future__ import annotations

import threading
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, cast

from palpate import pipeline
from palpate.cells.view import workspace_png
from palpate.errors import InputError
from palpate.pipeline import Outcome
from palpate.planning.model.answer import read_answer
from palpate.planning.model.session import ModelSettings
from palpate.planning.plan import Plan
from palpate.scenarios.catalogue import Scenario, scenario
from palpate.scene.poses import read_poses
from palpate.scene.scene import Scene
from palpate.settings import Job
from palpate.studies.judgement import Judgement, judge
from palpate.studies.trials import Record, Trial
from palpate.vocabulary.base import Blackboard
from palpate.vocabulary.registry import vocabulary
from palpate.vocabulary.state import SymbolicState


@dataclass(frozen=True, slots=True)
class Settings:
    """What all trials of a study share.

    Attributes:
        images: I. noise: sensor world. asking: how models are asked; the paper gives no feedback.
    """

    images: tuple[Path, ...] = ()
    noise: str = "lab"
    model_settings: ModelSettings = field(default_factory=lambda: ModelSettings(rounds=0))


_executing = threading.Lock()
"""Requests overlap, simulations do not: they would only slow each other down."""


def with_image(name: str, settings: Settings, file: Path) -> Settings:
    """The settings with a picture of the scenario's world, kept beside the results, unless they
    have one.

    Without a usable OpenGL there is none.
    """
    if settings.images:
        return settings
    path = file.with_suffix(".png")
    if not path.exists():
        job = scenario(name).job()
        content = workspace_png(
            job, pipeline.look(job), read_poses(job.poses).camera if job.poses else None
        )
        if content is None:
            return settings
        path.write_bytes(content)
    return replace(settings, images=(path,))


def attempt(trial: Trial, without: frozenset[str], settings: Settings) -> Record:
    """The record of a trial.

    Raises:
        InputError: unknown scenario or planner. Unavailable: the provider.
    """
    task = scenario(trial.scenario)
    job = _job(task, trial, without, settings)
    outcome = pipeline.think(job, pipeline.look(job))
    judgement = None if "text" in without else _judged(outcome, task)
    return Record(
        trial,
        _syntax(outcome),
        _is_valid(outcome),
        judgement.success if judgement else None,
        judgement.reason if judgement else "",
        _figures(outcome),
    )


def _job(task: Scenario, trial: Trial, without: frozenset[str], settings: Settings) -> Job:
    return task.job(
        images=settings.images,
        noise=settings.noise,
        seed=trial.number,
        planner=trial.planner,
        model_settings=replace(settings.model_settings, without=without),
    ).checked()


def _judged(outcome: Outcome, task: Scenario) -> Judgement:
    if not _is_valid(outcome):
        findings = "; ".join(f.message for f in outcome.findings[:3])
        return Judgement(False, (findings or outcome.plan.explanation)[:500])
    if outcome.plan.tree is None:
        return Judgement(
            not task.expects,
            "" if not task.expects else "no tree: " + outcome.plan.explanation[:300],
        )
    with _executing:
        execution = pipeline.measure(outcome).execution
    assert execution is not None
    return judge(execution.trace, task.expects)


def _is_valid(outcome: Outcome) -> bool:
    """Whether the plan, or the explanation why there is none, passed the check."""
    rounds = outcome.conversation.rounds if outcome.conversation else []
    return not outcome.findings and (not rounds or not rounds[-1].findings)


def _figures(outcome: Outcome) -> dict[str, Any]:
    talk = outcome.conversation
    return (
        talk.summary()["model"] | {"answers": [r.answer.text for r in talk.rounds]} if talk else {}
    )


def _syntax(outcome: Outcome) -> bool:
    """Whether the first answer is a plan that compiles, as it came."""
    if outcome.conversation is None:
        return _compiled(outcome.plan, outcome.scene)
    try:
        return _compiled(
            read_answer(outcome.conversation.rounds[0].answer.text).plan, outcome.scene
        )
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
