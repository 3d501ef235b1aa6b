"""A primitive of your own: one class is its prompt, its schema, its rules and its behaviour.

Installed packages bring theirs through the entry-point group `palpate.primitives`, and every planner, the
check and the report know them; here the vocabulary is passed on by hand.
"""

import sys
from pathlib import Path
from typing import Annotated, ClassVar

from pydantic import Field

import palpate as pp
from palpate.execution.runner import run
from palpate.execution.simulated_cell import simulated_cell
from palpate.planning.check.check import check
from palpate.planning.plan import parse_plan
from palpate.primitives.registry import load_vocabulary


class Wait(pp.Primitive):
    """Hold still, e.g. until a liquid has come to rest."""

    group: ClassVar = "motion"
    seconds: Annotated[float, Field(gt=0, le=10, description="how long, in s")]

    def run(self, blackboard):
        end = blackboard.robot.state.t + self.seconds
        while blackboard.robot.state.t < end:
            yield
        return f"waited {self.seconds} s"


words = load_vocabulary([sys.modules[__name__]])
scene = pp.load(Path(__file__).with_name("desk.xml"))
plan = parse_plan(
    '{"parameters": [], "explanation": "Be patient.", "tree": {"type": "Wait", "seconds": 2}}'
)
print("findings:", *(f.message for f in check(plan, scene, words=words)))
done = run(plan, scene, simulated_cell(scene, noise="none").robot(), words=words)
for leaf in done.trace.leaves:
    print(f"{leaf.label}: {leaf.status}, {leaf.message}, at {leaf.end:.1f} s")
