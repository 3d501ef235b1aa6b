"""One trial: ask a planner, compile its first answer, execute its plan, judge the trace."""

from __future__ import annotations

import threading
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, cast

from palpate import pipeline
from palpate.cell import simulated_cell
from palpate.errors import InputError, PlanRejected
from palpate.job import Job
from palpate.planning.check import check
from palpate.planning.extract import read_answer
from palpate.planning.plan import Plan
from palpate.planning.planner import make_planner
from palpate.planning.provider import PROVIDERS
from palpate.planning.session import Budget
from palpate.planning.vlm import VlmPlanner
from palpate.scenarios.catalogue import Scenario, scenario
from palpate.scene.scene import Scene
from palpate.studies.judgement import Judgement, judge
from palpate.studies.trials import Record, Trial
from palpate.view import workspace_png
from palpate.vocabulary.primitive import Cell, vocabulary
from palpate.vocabulary.state import SymbolicState


@dataclass(frozen=True, slots=True)
class Settings:
    """What all trials of a study share.

    Attributes:
        images: I. noise: sensor world. base_url: of the provider. rounds: of feedback; the paper has none.
        native: structured output. budget: of one plan.
    """

    images: tuple[Path, ...] = ()
    noise: str = "lab"
    base_url: str | None = None
    rounds: int = 0
    native: bool = False
    budget: Budget = field(default_factory=Budget)


@dataclass(frozen=True, slots=True)
class Proposed:
    """What a planner came up with: the first answer's syntax, a plan that passed the check, or why there is none."""

    syntax: bool
    plan: Plan | None
    reason: str
    figures: dict[str, Any]


_executing = threading.Lock()
"""Requests overlap, simulations do not: they would only slow each other down."""


def with_image(name: str, settings: Settings, file: Path) -> Settings:
    """The settings with a picture of the scenario's world, kept beside the results, unless they have one.

    Without a usable OpenGL there is none.
    """
    if settings.images:
        return settings
    path = file.with_suffix(".png")
    if not path.exists():
        job = scenario(name).job()
        content = workspace_png(simulated_cell(job, pipeline.look(job)))
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
    job = task.job(images=settings.images, noise=settings.noise, seed=trial.number, planner=trial.planner).checked()
    scene = pipeline.look(job)
    if trial.planner.partition(":")[0] in PROVIDERS:
        proposed = _from_model(trial.planner, without, job, scene, settings)
    else:
        proposed = _from_planner(job, scene)
    judgement = None if "text" in without else _judged(proposed, job, scene, task)
    return Record(trial, proposed.syntax, proposed.plan is not None, judgement.success if judgement else None,
                  judgement.reason if judgement else "", proposed.figures)


def _from_model(name: str, without: frozenset[str], job: Job, scene: Scene, settings: Settings) -> Proposed:
    planner = VlmPlanner(name, base_url=settings.base_url, native=settings.native, without=without,
                         rounds=settings.rounds, budget=settings.budget)
    try:
        plan, reason = planner.plan(job.request, scene, job.images), ""
    except PlanRejected as rejection:
        plan, reason = None, str(rejection)
    assert planner.conversation is not None
    answers = [r.answer.text for r in planner.conversation.rounds]
    figures = planner.conversation.summary()["model"] | {"answers": answers}
    return Proposed(_syntax(answers[0], scene), plan, reason, figures)


def _from_planner(job: Job, scene: Scene) -> Proposed:
    try:
        plan = make_planner(job.planner).plan(job.request, scene, job.images)
    except PlanRejected as rejection:
        return Proposed(True, Plan((), None, str(rejection)), "", {})
    findings = () if plan.tree is None else check(plan, scene)
    return Proposed(_compiled(plan, scene), None if findings else plan, "; ".join(f.message for f in findings[:3]), {})


def _judged(proposed: Proposed, job: Job, scene: Scene, task: Scenario) -> Judgement:
    if proposed.plan is None:
        return Judgement(False, proposed.reason[:500])
    if proposed.plan.tree is None:
        return Judgement(not task.expects, "" if not task.expects else "no tree: " + proposed.plan.explanation[:300])
    with _executing:
        execution = pipeline.measure(pipeline.Outcome(job, scene, proposed.plan)).execution
    assert execution is not None
    return judge(execution.trace, task.expects)


def _syntax(answer: str, scene: Scene) -> bool:
    """Whether an answer is a plan that compiles, as it came."""
    try:
        return _compiled(read_answer(answer).plan, scene)
    except InputError:
        return False


def _compiled(plan: Plan, scene: Scene) -> bool:
    """Whether py_trees takes the plan's tree; an idle plan needs none."""
    from palpate.tree.build import build

    nobody = cast("Any", None)
    try:
        return plan.tree is None or bool(build(plan.tree, vocabulary(), Cell(nobody, SymbolicState(scene), nobody)))
    except InputError:
        return False
