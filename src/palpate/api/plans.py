"""A checked plan, and the run that it begins."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from palpate import pipeline
from palpate.api.given import Widths, contents_of, is_text, known_keywords
from palpate.api.runs import Run, run_of
from palpate.callbacks import Confirm, Progress, RunCallbacks, quiet, unasked
from palpate.cells.cell import Cell
from palpate.display import table
from palpate.errors import InputError
from palpate.execution.recovery import OnFailure
from palpate.planning.check.check import Finding
from palpate.planning.plan import Plan as InnerPlan
from palpate.planning.planner import Planner
from palpate.robots.owner.arm import own_arm
from palpate.robots.simulated.noise import DEFAULT_LEVEL
from palpate.runs.run import Run as InnerRun
from palpate.scene.load import parse_scene
from palpate.scene.scene import Scene as InnerScene
from palpate.scene.scene import with_real_arm
from palpate.settings import Settings
from palpate.threads import single_threaded_blas

if TYPE_CHECKING:
    from palpate.execution.runner import Observer
    from palpate.seeing.look import Seen


@dataclass(frozen=True, repr=False)
class Plan(InnerPlan):
    """A plan: parameters, explanation and behavior tree.

    `Scene.plan` returns a checked one, which can be run. A planner of one's own may construct one.
    """

    begun: InnerRun | None = field(default=None, kw_only=True, compare=False)
    """The run so far: settings, scene, this plan and its findings; None before the check."""

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Findings of the check; a plan with findings is not executed."""
        return self.made.findings

    @property
    def made(self) -> InnerRun:
        """The run so far.

        Raises:
            InputError: the plan was not checked against a scene.
        """
        if self.begun is None:
            raise InputError("this plan is not checked against a scene yet: Scene.plan does that")
        return self.begun

    @known_keywords
    def run(
        self,
        cell: Cell | None = None,
        *,
        world: str | Path | InnerScene | None = None,
        robot: str | None = None,
        noise: str = DEFAULT_LEVEL,
        seed: int = 0,
        on_failure: OnFailure = "stop",
        rehearse: bool | None = None,
        within: Widths | None = None,
        fast: bool = False,
        confirm: Confirm = unasked,
        observer: Observer | None = None,
        progress: Progress = quiet,
        out: str | Path | None = None,
    ) -> Run:
        """Execute the plan, estimate, and build the twin.

        Args:
            cell: the workplace; None makes the one that the next arguments describe.
            world: MJCF of the hidden simulated world (a file, its text, or a scene); None simulates
                the plan's scene with its unknowns drawn from priors.
            robot: URL of a real robot.
            noise: how the simulated robot differs from its model, a name or a FILE.yaml.
            seed: of everything random in it.
            on_failure: `stop`, `skip` or `replan`: what to do when an action fails.
            rehearse: execute in simulation first; None means before a real robot moves, and for plans
                of models, files and own planners. False is for the embedded arm only.
            within: half widths of 95 % intervals to reach; None keeps those that were planned for.
            fast: leave out film and replay in the twin, which take longest and measure nothing.
            confirm: shown the run before a real robot moves; whether it may.
            observer: watches every tick.
            progress: called with the name of each stage, e.g. `print`.
            out: folder to write the run to, while it grows; must not exist.

        Returns:
            The finished run. Where the plan has no tree, or findings, nothing moves and its status
            is `rejected`. What failed once something had moved, and where a Ctrl-C ended it, it
            says itself (`shortfalls`, `interrupted`).

        Raises:
            InputError: bad input.
            Unavailable: no such robot.
            ExecutionAborted: not confirmed, or interrupted before anything moved.
        """
        begun = self.made
        world = hidden_world(world, begun.settings)
        if isinstance(world, InnerScene):
            from palpate.cells.simulated import simulated_cell

            cell = simulated_cell(begun.scene, world, noise=noise, seed=seed)
            world = world.path
        settings = begun.settings.having(
            world=world,
            robot=robot,
            noise=noise,
            seed=seed,
            on_failure=on_failure,
            rehearse=rehearse,
            within=begun.settings.within if within is None else within,
            fast=fast,
            out=out,
        ).checked(at_hand=True)
        made = replace(begun, settings=settings)
        if robot is not None:
            pipeline.preflight(settings)
            made = replace(made, scene=with_real_arm(made.scene))
        callbacks = RunCallbacks(observer, progress, confirm)
        with single_threaded_blas():
            return run_of(pipeline.carry_out(made, callbacks, cell, settings.out))

    def _repr_html_(self) -> str:
        rows = [(line,) for line in str(self).splitlines()[1:]]
        return table(repr(self), ("tree",), rows)


def hidden_world(
    world: str | Path | InnerScene | None, settings: Settings
) -> Path | InnerScene | None:
    """A simulated world as it was given, MJCF text read."""
    if is_text(world):
        return parse_scene(str(world), arm=own_arm(settings.arm, settings.cautious, None))
    return Path(world) if isinstance(world, str) else world


def plan_of(
    asked: Settings,
    scene: InnerScene | None,
    planner: str | Planner,
    seen: Seen | None = None,
) -> Plan:
    """Ask the planner that the settings name, or one at hand, and check its plan.

    Raises:
        InputError: it touches what was not among the `seen`, where a camera looked.
    """
    made = pipeline.plan(asked, scene, None if isinstance(planner, str) else planner)
    made = pipeline.require_seen(made, seen)
    return Plan(**contents_of(made.plan, InnerPlan), begun=made)
