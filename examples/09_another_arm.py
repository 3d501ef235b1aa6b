"""The same scene for two arms: what each of them can reach and grasp is in its description."""

from pathlib import Path

import palpate as pp

desk = Path(__file__).with_name("desk.xml")

for arm in ("fr3", "iiwa14"):
    scene = pp.load(desk, arm=arm)
    plan = scene.plan("how heavy is the mug?")
    print(f"{scene.arm.label}: lifts {scene.arm.limits.payload} kg, {plan.actions} actions")
    print(plan.run(noise="none")["mug.mass"])
