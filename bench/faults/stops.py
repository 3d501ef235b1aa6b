"""Stops at random moments of sensible plans, on bundled scenarios and on scenes written by hand."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from bench.campaign.ledger import Drawn, Row, judged_run
from bench.faults.bases import bases
from bench.faults.nasty import SENSIBLE, small_scene
from bench.harm.judge import harm
from bench.harm.probe import Probed
from palpate.execution import runner
from palpate.execution.rehearsal import AFTERWARDS, named_objects
from palpate.execution.simulated_cell import simulated_cell
from palpate.execution.witness import Witness
from palpate.planning.check.check import check
from palpate.planning.plan import Plan
from palpate.robots.owner import owner_arm
from palpate.robots.simulated.noise.models import noise_models
from palpate.scene.scene import Scene

NOISE = "lab"
ACTION = 1.6
"""s of robot time of an action, about; the stop comes within a plan's actions."""
PUSHES = 0.3
"""Share of the stops that a push on the hand causes; a caller asks for the others."""
PUSH = 40.0  # N, sideways
AJAR = 0.004
"""m of a body's travel from where it was found, from which a released fixture is not back."""


@cache
def plans() -> tuple[tuple[str, Plan, Scene, Path | None], ...]:
    """Name, plan, scene and hidden world of all plans that the check accepts."""
    found = [(base.name, base.plan, base.scene, base.world) for base in bases() if base.light]
    for one in SENSIBLE:
        scene = small_scene(one.scene)
        if one.plan.tree is not None and not check(one.plan, scene):
            found.append((one.name, one.plan, scene, None))
    return tuple(found)


def stop(case: Drawn, blank: Row) -> Row:
    """Execute a plan until a stop, and judge the stop and a second after it."""
    random = case.random()
    name, plan, scene, world = plans()[int(random.integers(len(plans())))]
    when, pushes = float(random.uniform(0.0, ACTION * plan.actions)), random.random() < PUSHES
    sheet = noise_models().load(NOISE, scene.arm).datasheet
    scene = replace(scene, arm=owner_arm(scene.arm, sheet))
    robot = simulated_cell(scene, world, noise=NOISE, seed=case.number).robot()
    witness, begin = Witness.of(robot.world), robot.state.t
    found = robot.world.true_poses(scene.fixtures)
    model = robot.world.model
    hand = next(b for b in range(model.nbody) if model.body(b).name.endswith("hand"))

    def stop_requested() -> bool:
        if robot.state.t - begin < when:
            return False
        if pushes:
            # The push ends with the first tick after it.
            data = robot.world._data
            data.xfrc_applied[hand, 1] = 0.0 if data.xfrc_applied[hand, 1] else PUSH
            return robot.state.t - begin > when + 1.0
        return True

    done = runner.run(plan, scene, robot, stop_requested=stop_requested)
    robot.world._data.xfrc_applied[hand] = 0.0
    robot.advance(AFTERWARDS)
    seen = Probed(done, harm(witness, named_objects(plan, scene)))
    row = judged_run(replace(blank, what=f"{name}, after {when:.1f} s{', pushed' * pushes}"), seen)
    # A fixture is back where it was found, or held.
    ajar = [
        f"{one} stays open"
        for one, pose in robot.world.true_poses(scene.fixtures).items()
        if np.linalg.norm(pose.position - found[one].position) > AJAR and not robot.state.gripping
    ]
    last = done.trace.leaves[-1]
    return replace(
        row,
        beyond=(*row.beyond, *ajar),
        figures={**row.figures, "last": f"{last.primitive}: {last.message}"[:200]},
    )
