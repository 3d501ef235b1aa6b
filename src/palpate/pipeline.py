"""The whole story on one page: a sentence, or an incomplete scene, becomes a digital twin.

request + scene + image ─► gap ─► plan ─► (check) ─► tree ─ticks─► trace ─► estimates ─► twin +
report
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from palpate import thinking
from palpate.cells.simulated import SimulatedCell, simulated_cell
from palpate.errors import ExecutionAborted
from palpate.estimation.estimate import Estimate
from palpate.execution.recovery import OnFailure
from palpate.pictures.footage import Footage
from palpate.planning.check.check import Finding
from palpate.planning.plan import Plan
from palpate.quantities.estimators import estimate_all
from palpate.runs.folder import default_folder, new_folder
from palpate.scene.camera import load_image
from palpate.scene.load import load_scene
from palpate.scene.scene import Scene
from palpate.settings import Job
from palpate.twin.twin import Twin, build_twin

if TYPE_CHECKING:
    from mujoco import MjSpec

    from palpate.execution.rehearsal import Rehearsal
    from palpate.execution.runner import Execution, Observer
    from palpate.planning.model.conversation import Conversation
    from palpate.robots.robot import Robot
    from palpate.scene.from_picture import DetectedScene
    from palpate.trace.samples import Trace

Status = Literal["complete", "rejected", "aborted", "failed"]
Say = Callable[[str], None]
Confirm = Callable[["Outcome"], bool]
"""Shown a plan before a real robot moves; whether it may."""
EXIT = {"complete": 0, "failed": 1, "rejected": 3, "aborted": 4}


def silent(_: str) -> None:
    """Tell nobody which stage is under way."""


def unasked(_: Outcome) -> bool:
    """Let the robot move without asking anybody."""
    return True


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """All that a run made. What did not come to be is None or empty."""

    job: Job
    scene: Scene
    plan: Plan
    findings: tuple[Finding, ...] = ()
    conversation: Conversation | None = None
    seen: DetectedScene | None = None
    picture: bytes | None = None
    rehearsal: Rehearsal | None = None
    cell: SimulatedCell | None = None
    execution: Execution | None = None
    footage: Footage | None = None
    estimates: tuple[Estimate, ...] = ()
    twin: Twin | None = None
    folder: Path | None = None

    @property
    def status(self) -> Status:
        """`complete` when every promised parameter is estimated, or nothing is missing."""
        if self.execution is None:
            return "complete" if self.plan.satisfied else "rejected"
        if self.execution.status == "stopped":
            return "aborted"
        found = {e.parameter for e in self.estimates if e.verdict != "not identified"}
        return "complete" if found >= set(self.plan.parameters) else "failed"


def run(
    job: Job, observer: Observer | None = None, say: Say = silent, confirm: Confirm = unasked
) -> Outcome:
    """From a job to a finished run folder.

    Raises:
        InputError: bad input. Unavailable: planner or robot out of reach. ExecutionAborted: not
            confirmed.
    """
    job = job.checked()
    scene = look(job)
    say("planning")
    outcome = practise(think(job, scene), say)
    agree(outcome, confirm)
    outcome = complete(measure(outcome, observer, say), say)
    say("writing the report")
    return write(outcome)


def look(job: Job) -> Scene | None:
    """D and the poses that came with it, or None without D; the pictures are checked on the way."""
    for image in job.images:
        load_image(image)
    return load_scene(job.scene, job.poses) if job.scene else None


def think(job: Job, scene: Scene | None) -> Outcome:
    """A plan and what the check finds wrong with it; a plan without a tree is an honest rejection.

    Without D the scene is made of what the model saw in the picture.
    """
    t = thinking.think(job, scene)
    return Outcome(job, t.scene, t.plan, t.findings, t.conversation, t.seen, t.picture)


def practise(outcome: Outcome, say: Say = silent) -> Outcome:
    """A rehearsal where the job wants one; a failure in it is a finding, and a plan with findings
    is not executed."""
    wanted = (
        outcome.job.rehearse if outcome.job.rehearse is not None else outcome.job.robot is not None
    )
    if not wanted or outcome.plan.tree is None or outcome.findings:
        return outcome
    from palpate.execution.rehearsal import rehearse

    say("rehearsing in simulation")
    rehearsal = rehearse(outcome.plan, outcome.scene)
    say(f"rehearsal: {rehearsal}")
    failed = (Finding("tree", "rehearsal", f"in simulation the plan fails: {rehearsal.failure}"),)
    return replace(outcome, rehearsal=rehearsal, findings=failed if rehearsal.failure else ())


def agree(outcome: Outcome, confirm: Confirm) -> None:
    """Ask before a real robot moves; a simulation needs no confirmation.

    Raises:
        ExecutionAborted: the plan was not confirmed.
    """
    moves = outcome.job.robot is not None and outcome.plan.tree is not None and not outcome.findings
    if moves and not confirm(outcome):
        raise ExecutionAborted("the plan was not confirmed; nothing has moved")


def measure(outcome: Outcome, observer: Observer | None = None, say: Say = silent) -> Outcome:
    """From a checked plan to estimates. A plan with findings, or without a tree, is rejected:
    nothing moves."""
    job, scene, plan = outcome.job, outcome.scene, outcome.plan
    if plan.tree is None or outcome.findings:
        return outcome
    cell = simulated_cell(job, scene)
    say("touching")
    robot = cell.robot(job)
    execution = touch(plan, scene, robot, observer, job.on_failure)
    footage = Footage(robot.world.model, tuple(robot.world.frames))
    say("estimating")
    estimates = estimate_all(plan.parameters, execution.trace, scene.bodies)
    return replace(outcome, cell=cell, execution=execution, footage=footage, estimates=estimates)


def complete(outcome: Outcome, say: Say = silent) -> Outcome:
    """From estimates to a twin of the scene as it was believed in the end."""
    if outcome.execution is None:
        return outcome
    say("building the twin, and touching it in simulation")
    replay = partial(_replay, outcome.scene, outcome.plan)
    scene = outcome.execution.final_state.scene if outcome.seen else outcome.scene
    twin = build_twin(scene, outcome.estimates, outcome.execution.trace, replay)
    return replace(outcome, scene=scene, twin=twin)


def touch(
    plan: Plan,
    scene: Scene,
    robot: Robot,
    observer: Observer | None = None,
    on_failure: OnFailure = "stop",
) -> Execution:
    """Run the tree on the robot, and go on after a failure as far as the policy allows; the robot
    is let go in any case."""
    from palpate.execution.recovery import recover
    from palpate.execution.runner import run as run_tree

    attempt = partial(run_tree, observer=observer)
    with closing(robot):
        return recover(attempt(plan, scene, robot), plan, scene, robot, on_failure, attempt)


def _replay(scene: Scene, plan: Plan, world: MjSpec) -> Trace:
    """What a perfect robot feels when the plan is executed in `world`."""
    from palpate.robots.simulated.robot import MujocoRobot

    return touch(plan, scene, MujocoRobot(world, scene.pose_world_base, scene.arm)).trace


def write(outcome: Outcome) -> Outcome:
    """The run folder: request, plan, tree, trace, result, twin, report and images."""
    from palpate.report.contents import write_outcome

    folder = outcome.job.out or default_folder(
        outcome.job.scene.resolve().parent.name if outcome.job.scene else ""
    )
    with new_folder(folder) as scratch:
        write_outcome(outcome, scratch, folder)
    return replace(outcome, folder=folder)
