"""Small scenes for hand-made plans: a floor, a table with its top at z = 0, and a few things.

The arm stands at the origin. What `?` or a missing mass stands for is drawn from priors.
"""

from __future__ import annotations

from functools import cache

from palpate.scene.load import parse_scene
from palpate.scene.scene import Scene

_FRAME = """
<mujoco model="{name}">
  <worldbody>
    <light pos="0.4 0 2"/>
    <site name="robot_base" pos="0 0 0"/>
    <body name="table" pos="{table}">
      <geom type="box" size="{half} .02" friction="0.6 0.005 0.0001" rgba=".8 .7 .55 1"/>
    </body>
    {things}
  </worldbody>
</mujoco>
"""


def _thing(name: str, at: str, geom: str) -> str:
    return f'<body name="{name}" pos="{at}"><freejoint/><geom {geom} friction="0.7 0.005 0.0001"/></body>'


def _fixed(name: str, at: str, size: str) -> str:
    return f'<body name="{name}" pos="{at}"><geom type="box" size="{size}"/></body>'


CAN = _thing("can", "0.5 0.1 0.06", 'type="cylinder" size=".033 .06"')
BOTTLE = _thing("bottle", "0.5 -0.1 0.1", 'type="cylinder" size=".031 .1" mass=".25"')
TALL = _thing("vase", "0.5 0 0.12", 'type="cylinder" size=".022 .12" mass=".3"')
WIDE = _thing("crate", "0.5 0 0.08", 'type="box" size=".08 .08 .08"')
HEAVY = _thing("anvil", "0.5 0.15 0.05", 'type="box" size=".03 .06 .05" mass="6"')
EDGE = _thing("cup", "0.5 0.275 0.05", 'type="cylinder" size=".03 .05" mass=".2"')
PLANK = _thing("plank", "0.5 0.2 0.015", 'type="box" size=".02 .16 .015" mass=".6"')
LOWER = _thing("lower", "0.5 0 0.03", 'type="box" size=".03 .03 .03" mass=".4"')
UPPER = _thing("upper", "0.5 0 0.085", 'type="box" size=".025 .025 .025" mass=".2"')
NEAR = _thing("left", "0.5 0.05 0.08", 'type="cylinder" size=".03 .08" mass=".3"') + _thing(
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
    table = f"0.6 0 {unknown}"
    return parse_scene(_FRAME.format(name=plain, table=table, half=half, things=_ALL[plain]))


SMALL_SCENES = tuple(_ALL)
