"""Plan without moving anything: which parameters, which tree, and why; or why not."""

from pathlib import Path

import palpate as pp

scene = pp.load(Path(__file__).with_name("desk.xml"))

plan = scene.plan("how heavy is the mug?")
print(plan)
print(plan.explanation)
print("findings of the check:", plan.findings or "none")

rejected = scene.plan("how warm is the mug?")
print(rejected.tree, rejected.explanation)
