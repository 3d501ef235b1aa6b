"""Tiny scenes for planning: a bench under a bolted arm, and what stands on it."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache

from palpate.common.parameter import Parameter
from palpate.planning.plan import Node, Plan
from palpate.scene.load import parse_scene
from palpate.scene.scene import Scene

BOTTLE = (
    '<body name="bottle" pos="0.50 0.00 0.08"><freejoint/>'
    '<geom type="cylinder" size=".03 .08" friction="0.6"/></body>'
)
MUG = '<body name="mug" pos="0.45 0.25 0.05"><freejoint/><geom type="cylinder" size=".035 .05" mass="0.3"/></body>'
CRATE = (
    '<body name="crate" pos="0.45 -0.25 0.03"><freejoint/>'
    '<geom type="box" size=".06 .03 .03" rgba="1 0 0 1"/></body>'
)
KNOWN = (
    '<body name="can" pos="0.62 0.15 0.06"><freejoint/>'
    '<geom type="cylinder" size=".03 .06" mass="0.2" friction="0.5"/></body>'
)

BAR = (
    '<body name="bar" pos="0.50 0.00 0.015"><freejoint/>'
    '<inertial pos="? ? ?" mass="?" diaginertia="? ? ?"/>'
    '<geom type="box" size=".11 .012 .015" friction="0.7"/></body>'
)
"""Long enough to be grasped at several places."""
BESIDE_ITS_END = (
    '<body name="post" pos="0.37 0.055 0.06"><geom type="box" size=".012 .012 .06"/></body>'
)
"""What a hand meets that takes the bar farther to its end than one x_offset."""


@cache
def bench(
    *bodies: str, height: str = "-0.03", poses: str | None = None, name: str = "bench"
) -> Scene:
    """A scene with `bodies` on a bench whose top is at z = 0 (its centre at `height`)."""
    return parse_scene(
        f"""<mujoco><worldbody>
      <site name="robot_base"/>
      <body name="{name}" pos="0.35 0 {height}"><geom type="box" size=".6 .6 .03" friction="0.6"/></body>
      {"".join(bodies)}</worldbody></mujoco>""",
        poses=poses,
    )


def parameters(*names: str) -> tuple[Parameter, ...]:
    """`bottle.mass` as gaps."""
    return tuple(Parameter(*name.split(".")) for name in names)


def leaf(type: str, argument: str | None = None) -> Node:
    """A leaf with the one argument that its primitive takes."""
    field = {"MovePose": "pose", "MoveJoints": "joints", "MoveUntilContact": "axis"}.get(type)
    return Node(type, ((field, argument),) if field and argument is not None else ())


def sequence(*actions: str | Node) -> Node:
    """A Sequence from words as `MovePose bottle_pose + z_offset`."""
    return Node("Sequence", children=tuple(_read(a) for a in actions))


def parallel(*actions: str | Node) -> Node:
    """A Parallel, likewise."""
    return Node("Parallel", children=tuple(_read(a) for a in actions))


def plan(tree: Node | None, *names: str) -> Plan:
    """A plan that promises the parameters named."""
    return Plan(parameters(*names), tree, "because")


def weigh(name: str) -> list[str]:
    """The paper's twelve actions for the mass of one object."""
    above, at = f"MovePose {name}_pose + z_offset", f"MovePose {name}_pose"
    return [
        "MoveJoints home_config",
        "OpenGripper",
        above,
        at,
        "CloseGripper",
        above,
        "MeasureForces",
        "Force2Mass",
        at,
        "OpenGripper",
        above,
        "MoveJoints home_config",
    ]


def visit(pose: str) -> list[str]:
    """The actions that grasp, lift and feel what is at a pose, and put it back."""
    above, at = f"MovePose {pose} + z_offset", f"MovePose {pose}"
    return [above, at, "CloseGripper", above, "MeasureForces", at, "OpenGripper", above]


def actions(tree: Node | None) -> list[str]:
    """The leaves of a tree in words, in order."""
    found: Iterable[Node] = () if tree is None else (n for _, n in tree.walk() if not n.children)
    return [" ".join([n.type, *(str(v) for _, v in n.args)]) for n in found]


def _read(action: str | Node) -> Node:
    if isinstance(action, Node):
        return action
    type, _, argument = action.partition(" ")
    return leaf(type, argument or None)
