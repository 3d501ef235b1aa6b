"""Execute a plan in a simulated world under a `Witness`, and judge its harm.

The plan is not checked before: only the leaves' own checks at run time apply.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from bench.harm.judge import UNSEEN, Harm, harm
from palpate.execution.harm import SHOWN, Figures
from palpate.execution.recovery import OnFailure
from palpate.execution.rehearsal import AFTERWARDS, named_objects
from palpate.execution.simulated_cell import SimulatedCell, simulated_cell
from palpate.execution.witness import Witness
from palpate.planning.plan import Plan
from palpate.robots.owner import owner_arm
from palpate.robots.simulated.noise.models import noise_models
from palpate.runs import executing
from palpate.runs.callbacks import RunCallbacks
from palpate.scene.scene import Scene

if TYPE_CHECKING:
    from palpate.execution.runner import Execution, Observer


@dataclass(frozen=True, slots=True, eq=False)
class Probed:
    """Palpate's record of a run, and its harm, judged independently of that."""

    execution: Execution
    harm: Harm


def probed_run(
    plan: Plan,
    scene: Scene,
    world: Path | Scene | None = None,
    noise: str = "lab",
    seed: int = 0,
    *,
    cell: SimulatedCell | None = None,
    observer: Observer | None = None,
    on_failure: OnFailure = "stop",
    unseen: Collection[str] = (),
    shown: Figures = SHOWN,
    hidden: Figures = UNSEEN,
) -> Probed:
    """Execute a plan, and judge it by MuJoCo's state.

    Args:
        plan: with a tree.
        scene: that the plan was made for.
        world: MJCF of the hidden world; by default the scene itself, its unknowns drawn from priors.
        noise, seed: of the simulated robot, whose owner knows the noise model's datasheet.
        cell: instead of `world`, `noise` and `seed`.
        observer: of the tree's ticks.
        on_failure: policy after a failure.
        unseen: names of bodies of the world that the scene does not show, with the limits `hidden`.
        shown, hidden: limits of contact forces.

    Raises:
        InputError: the plan has no tree, or world and scene do not match.
    """
    if cell is None:
        sheet = noise_models().load(noise, scene.arm).datasheet
        scene = replace(scene, arm=owner_arm(scene.arm, sheet))
        cell = simulated_cell(scene, world, noise=noise, seed=seed)
    robot = cell.robot()
    witness = Witness.of(robot.world)
    execution = executing.perform(plan, scene, robot, RunCallbacks(observer), on_failure)
    robot.advance(AFTERWARDS)
    return Probed(execution, harm(witness, named_objects(plan, scene), unseen, shown, hidden))
