"""Small scenes for hand-made plans: a floor, a table with its top at z = 0, and a few things.

The arm stands at the origin. What `?` or a missing mass stands for is drawn from priors.
"""

from __future__ import annotations

from functools import cache

from bench.variety import standing, tabletop
from palpate.scene.load import parse_scene
from palpate.scene.scene import Scene


def _fixed(name: str, at: str, size: str) -> str:
    return f'<body name="{name}" pos="{at}"><geom type="box" size="{size}"/></body>'


CAN = standing("can", "0.5 0.1 0.06", 'type="cylinder" size=".033 .06"')
BOTTLE = standing("bottle", "0.5 -0.1 0.1", 'type="cylinder" size=".031 .1" mass=".25"')
TALL = standing("vase", "0.5 0 0.12", 'type="cylinder" size=".022 .12" mass=".3"')
WIDE = standing("crate", "0.5 0 0.08", 'type="box" size=".08 .08 .08"')
HEAVY = standing("anvil", "0.5 0.15 0.05", 'type="box" size=".03 .06 .05" mass="6"')
EDGE = standing("cup", "0.5 0.275 0.05", 'type="cylinder" size=".03 .05" mass=".2"')
PLANK = standing("plank", "0.5 0.2 0.015", 'type="box" size=".02 .16 .015" mass=".6"')
LOWER = standing("lower", "0.5 0 0.03", 'type="box" size=".03 .03 .03" mass=".4"')
UPPER = standing("upper", "0.5 0 0.085", 'type="box" size=".025 .025 .025" mass=".2"')
NEAR = standing("left", "0.5 0.05 0.08", 'type="cylinder" size=".03 .08" mass=".3"') + standing(
    "right", "0.5 -0.05 0.08", 'type="cylinder" size=".03 .08" mass=".3"'
)
WALL = _fixed("wall", "0.5 0.2 0.15", ".2 .01 .15")
LID = _fixed("lid", "0.5 0.1 0.32", ".15 .15 .01")

SMOOTH = (
    '<body name="can" pos="0.5 0.1 0.06"><freejoint/>'
    '<geom type="cylinder" size=".033 .06" mass=".35" friction="? 0.005 0.0001"/></body>'
)

_ALL = {
    "can": CAN + BOTTLE,
    "vase": TALL + CAN,
    "crate": WIDE,
    "anvil": HEAVY + CAN.replace("0.5 0.1", "0.5 -0.1"),
    "edge": EDGE,
    "plank": PLANK,
    "stack": LOWER + UPPER,
    "near": NEAR,
    "wall": WALL + CAN,
    "smooth": SMOOTH,
    "lid": LID + CAN,
}
_SMALL = ("edge", "plank")


@cache
def small_scene(name: str) -> Scene:
    """One of the scenes, or, with a `?` behind its name, the same on a table of unknown height."""
    plain = name.removesuffix("?")
    unknown = "?" if name.endswith("?") else "-0.02"
    half = ".3 .3" if plain in _SMALL else ".38 .5"
    return parse_scene(tabletop(plain, _ALL[plain], unknown, half))


SMALL_SCENES = tuple(_ALL)
