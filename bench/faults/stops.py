"""Stops in the middle of every primitive of sensible plans, on bundled scenarios and scenes written by hand, also
in worlds that differ from the scene."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
from py_trees.common import Status

from bench.campaign.ledger import Drawn, Row, judged_run
from bench.faults.bases import bases
from bench.faults.hidden import Wrong, wrong_world
from bench.faults.nasty import SENSIBLE, small_scene
from bench.harm.judge import UNSEEN, harm
from bench.harm.probe import Probed
from palpate.execution import runner
from palpate.execution.leaf import leaves
from palpate.execution.rehearsal import AFTERWARDS, named_objects
from palpate.execution.runner import Snapshot
from palpate.execution.simulated_cell import simulated_cell
from palpate.execution.witness import Witness
from palpate.planning.check.check import check
from palpate.planning.plan import Plan
from palpate.robots.owner import owner_arm
from palpate.robots.simulated.noise.models import noise_models
from palpate.runs import pipeline
from palpate.scene.scene import Scene
from palpate.studies.scenarios.catalogue import scenario

NOISE = "lab"
LONGEST = 1.5
"""s after the beginning of an action, up to which the stop comes."""
PUSHES = 0.3
"""Share of the stops that a push on the hand causes; a caller asks for the others."""
PUSH, PUSHED = 40.0, 0.1  # N, sideways, and s
AJAR = 0.004
"""m of a body's travel from where it was found, from which a released fixture is not back."""
ASTRAY = ("poses", "obstacles")
"""Kinds of worlds that differ from the scene."""


@cache
def plans() -> tuple[tuple[str, Plan, Scene, Path | None], ...]:
    """Name, plan, scene and hidden world of all plans that the check accepts."""
    found = [(base.name, base.plan, base.scene, base.world) for base in bases() if base.light]
    for one in SENSIBLE:
        scene = small_scene(one.scene)
        if one.plan.tree is not None and not check(one.plan, scene):
            found.append((one.name, one.plan, scene, None))
    return tuple(found)


@cache
def places(astray: bool) -> dict[str, list[tuple[int, int]]]:
    """For each primitive that moves something: number of the plan, and which action of that kind in it."""
    found: defaultdict[str, list[tuple[int, int]]] = defaultdict(list)
    for i, (_, plan, scene, world) in enumerate(plans()):
        if plan.tree is None or (astray and (world is None or not scene.objects)):
            continue
        seen: defaultdict[str, int] = defaultdict(int)
        for _, node in plan.tree.walk():
            if not node.children and not node.type.startswith(("Measure", "Force", "Pose")):
                found[node.type].append((i, seen[node.type]))
                seen[node.type] += 1
    return dict(sorted(found.items()))


@dataclass
class Moment:
    """Observer that notes when the wanted action has run for some time.

    Attributes:
        type, nth: of the action, and which one of this type.
        delay: s after its beginning.
    """

    type: str
    nth: int
    delay: float
    has_come: bool = False

    def on_tick(self, snapshot: Snapshot) -> None:
        ended = sum(leaf.primitive == self.type for leaf in snapshot.leaves)
        runs = [
            leaf
            for leaf in leaves(snapshot.root)
            if type(leaf.primitive).__name__ == self.type and leaf.status is Status.RUNNING
        ]
        if ended == self.nth and runs:
            self.has_come |= snapshot.robot.t - runs[0].started >= self.delay
        # A short action has ended before.
        self.has_come |= ended > self.nth


def stop(case: Drawn, blank: Row) -> Row:
    """Execute a plan until a stop, and judge the stop and a second after it.

    Kinds: `stops`, and `astray` in worlds that differ from the scene.
    """
    random, astray = case.random(), case.kind == "astray"
    # All primitives in turn.
    kinds = places(astray)
    wanted = list(kinds)[case.number % len(kinds)]
    index, nth = kinds[wanted][int(random.integers(len(kinds[wanted])))]
    name, plan, scene, world = plans()[index]
    moment = Moment(wanted, nth, float(random.uniform(0.0, LONGEST)))
    pushes, wrong = random.random() < PUSHES, None
    if astray:
        settings = scenario(name.partition(":")[0]).settings()
        true = pipeline.load(replace(settings, scene=settings.world))
        assert true is not None
        wrong = wrong_world(ASTRAY[int(random.integers(len(ASTRAY)))], true, random)
    sheet = noise_models().load(NOISE, scene.arm).datasheet
    scene = replace(scene, arm=owner_arm(scene.arm, sheet))
    cell = simulated_cell(
        scene, world if wrong is None else wrong.world, noise=NOISE, seed=case.number
    )
    robot = cell.robot()
    witness = Witness.of(robot.world)
    found = robot.world.true_poses(scene.fixtures)
    model, pushed = robot.world.model, {"at": np.inf}
    hand = next(b for b in range(model.nbody) if model.body(b).name.endswith("hand"))

    def stop_requested() -> bool:
        if not moment.has_come:
            return False
        if pushes:
            pushed["at"] = min(pushed["at"], robot.state.t)
            since = robot.state.t - pushed["at"]
            robot.world._data.xfrc_applied[hand, 1] = PUSH if since < PUSHED else 0.0
            return since > 1.0
        return True

    done = runner.run(plan, scene, robot, observer=moment, stop_requested=stop_requested)
    robot.world._data.xfrc_applied[hand] = 0.0
    robot.advance(AFTERWARDS)
    unseen, figures = (wrong.unseen, wrong.figures) if isinstance(wrong, Wrong) else ((), UNSEEN)
    seen = Probed(done, harm(witness, named_objects(plan, scene), unseen, hidden=figures))
    what = f"{name}, {moment.delay:.1f} s into {wanted} {nth}{', pushed' * pushes}"
    row = judged_run(replace(blank, what=f"{what}{f', {wrong.what}' if wrong else ''}"), seen)
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
