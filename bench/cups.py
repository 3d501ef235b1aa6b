"""Sliding friction of hidden cups against the truth: cylinders of other size, mass, friction and place."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from bench.fixtures import Case, FixtureRun, execute_or_read, score
from palpate.execution.simulated_cell import simulated_cell
from palpate.runs import pipeline
from palpate.runs.settings import Settings
from palpate.scene.load import parse_scene

STREAM = 52
"""Random stream of the hidden cups, independent of all others of a seed."""
RADIUS, HEIGHT = (0.025, 0.038), (0.060, 0.130)
"""m: ranges, uniform; the hand takes 76 mm."""
FRICTION = (0.2, 1.1)
"""Range of the coefficient of cup and table, uniform."""
MASS = (0.05, 0.6)
"""kg: range, log-uniform."""
PLACE = ((0.42, -0.2), (0.58, 0.2))
"""m: corners of the area where a cup stands."""
WORLD = """\
<mujoco model="cup">
  <worldbody>
    <light pos="0.4 0 2"/>
    <site name="robot_base"/>
    <body name="table" pos="0.6 0 -0.02"><geom type="box" size="0.42 0.5 0.02" friction="0.05"/></body>
    <body name="cup" pos="{place} {half:.5f}">
      <freejoint/>
      <geom type="cylinder" size="{radius:.5f} {half:.5f}" mass="{mass}" friction="{friction}"/>
    </body>
  </worldbody>
</mujoco>
"""


def hidden(seed: int) -> str:
    """MJCF of the world with the cup of a seed."""
    random = np.random.default_rng([seed, STREAM])
    radius, height, friction = (random.uniform(*span) for span in (RADIUS, HEIGHT, FRICTION))
    mass = float(np.exp(random.uniform(*np.log(MASS))))
    x, y = random.uniform(*PLACE)
    return WORLD.format(
        radius=radius,
        half=height / 2.0,
        friction=f"{friction:.4f}",
        mass=f"{mass:.4f}",
        place=f"{x:.3f} {y:.3f}",
    )


def judge(case: Case, traces: Path | None = None) -> FixtureRun:
    """Measure the friction of a hidden cup whose mass is unknown, and compare with its truth."""
    text = hidden(case.seed)
    known = re.sub(r'mass="[^"]*" friction="[^"]*"', 'mass="?" friction="?"', text)
    settings = Settings(measure=("cup.friction",), noise=case.noise, seed=case.seed)
    settings = settings.check_values(at_hand=True)
    arm = settings.described_arm()
    scene, world = parse_scene(known, arm=arm), parse_scene(text, arm=arm)
    cell = simulated_cell(scene, world, noise=case.noise, seed=case.seed)
    made = execute_or_read(pipeline.plan(settings, scene), cell, case, traces)
    return score(case, pipeline.estimate(made, cell))
