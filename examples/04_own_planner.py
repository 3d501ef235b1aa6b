"""A planner of your own: any object with a name and a `plan`. Its plans pass the same check as everybody's.

Installed packages bring theirs through the entry-point group `palpate.planners`.
"""

from pathlib import Path

import palpate as pp
from palpate.planning.plan import parse_plan
from palpate.planning.symbolic.planner import SymbolicPlanner

LAZY = '{"parameters": [{"object": "mug", "quantity": "mass"}], "explanation": "Just lift it.", "tree": %s}'
LIFT = '{"type": "Sequence", "children": [{"type": "MovePose", "pose": "mug_pose"}, {"type": "CloseGripper"}]}'


class Lazy:
    name = "lazy"

    def plan(self, request, scene, images=()):
        return parse_plan(LAZY % LIFT)


scene = pp.load(Path(__file__).with_name("desk.xml"))
for planner in (Lazy(), SymbolicPlanner()):
    plan = scene.plan("how heavy is the mug?", planner=planner)
    print(f"{planner.name}: {plan.actions} actions, {len(plan.findings)} findings")
    for finding in plan.findings:
        print(f"  {finding.path}: {finding.message}")
