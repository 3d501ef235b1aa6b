"""The embedded arm's calibration bench: a plate on which the arm stands, with a weight or gauge
blocks on it.

What the scene states is what somebody said; the hidden world draws within those limits.
"""

from __future__ import annotations

import numpy as np

from palpate.calibration.stated import Stated

BLOCK = "block"
"""The weight: a block of 40 x 40 x 80 mm, whatever it weighs."""
PLACES = (0.45, 0.60, 0.35)
"""m from the base to the weight's place, on one visit each: the joints bear it in other proportions,
and what is known of their gains then holds between and around them."""
GAUGES = ((0.50, -0.18), (0.50, 0.18), (0.66, -0.18), (0.66, 0.18), (0.58, 0.0))
"""m: places of the gauge blocks on the plate, over which the arm's frame may lean."""
HALF = 0.02
"""m: half the width of the weight."""
TALL = 0.04
"""m: half its height."""

_BENCH = """<mujoco model="calibration bench">
  <option timestep="0.002" gravity="0 0 {gravity}"/>
  <worldbody>
    <light pos="0.4 -0.6 2" dir="0 0.2 -1"/>
    <site name="robot_base"/>
    <body name="plate" pos="0.4 0 -0.01">
      <geom type="box" size=".6 .5 .01" rgba=".7 .7 .72 1" friction="0.6 0.005 0.0001"/>
    </body>
{things}
  </worldbody>
</mujoco>
"""
_BLOCK = """    <body name="{name}" pos="{x} 0 {tall}">
      <freejoint/>
      <geom type="box" size="{half} {half} {tall}" mass="{mass!r}" rgba=".75 .7 .5 1"
        friction="0.7 0.005 0.0001"/>
    </body>"""
_GAUGE = """    <body name="{name}" pos="{x} {y} {middle!r}">
      <geom type="box" size=".08 .08 {middle!r}" rgba=".6 .65 .7 1" friction="0.6 0.005 0.0001"/>
    </body>"""


def with_weight(mass: float, x: float, gravity: float) -> str:
    """MJCF of the bench with a weight of `mass` kg on it, `x` m from the base."""
    block = _BLOCK.format(name=BLOCK, x=x, tall=TALL, half=HALF, mass=mass)
    return _BENCH.format(gravity=-gravity, things=block)


def with_gauges(height: float, gravity: float) -> str:
    """MJCF of the bench with gauge blocks on it, whose tops are `height` m above the plane on which
    the arm is mounted."""
    blocks: list[str] = []
    for i, (x, y) in enumerate(GAUGES, 1):
        blocks.append(_GAUGE.format(name=f"gauge_{i}", x=x, y=y, middle=height / 2))
    return _BENCH.format(gravity=-gravity, things="\n".join(blocks))


def truth(said: Stated, seed: int, what: str) -> float:
    """Draw a true value, uniform within the stated limits; deterministic for a seed."""
    random = np.random.default_rng([seed, *what.encode()])
    return said.value + said.limit * random.uniform(-1.0, 1.0)


def plain(gravity: float) -> str:
    """MJCF of the bench with nothing on it."""
    return _BENCH.format(gravity=-gravity, things="")


def gauges() -> tuple[str, ...]:
    """Names of the gauge blocks."""
    return tuple(f"gauge_{i}" for i in range(1, len(GAUGES) + 1))
