"""Plans written by hand to do harm, at least one against every rule of the check, and small scenes for
them: a floor, a table with its top at z = 0, and a few things, the arm at the origin.

Each plan must be refused, or be harmless when it is executed.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

from bench.campaign.ledger import Row, judged_run
from bench.harm.probe import probed_run
from bench.variety import standing, tabletop
from palpate.parameter import Parameter
from palpate.planning.check.check import check
from palpate.planning.plan import Node, Plan
from palpate.scene.load import parse_scene
from palpate.scene.scene import Scene

FILE = Path(__file__).with_suffix(".toml")
Step = str | tuple["Step", ...]
"""A leaf in a word or two, or a composite's name and its children."""

PLAIN = {
    "open": Node("OpenGripper"),
    "close": Node("CloseGripper"),
    "home": Node("MoveJoints", (("joints", "home_config"),)),
    "forces": Node("MeasureForces"),
    "pose": Node("MeasureGripperPose"),
    "mass": Node("Force2Mass"),
    "height": Node("Pose2Height"),
    "plan": Node("Pose2Plan"),
    "velocity": Node("Force2Velocity"),
}


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
    """A scene by name; with a `?` behind the name, on a table of unknown height."""
    plain = name.removesuffix("?")
    unknown = "?" if name.endswith("?") else "-0.02"
    half = ".3 .3" if plain in _SMALL else ".38 .5"
    return parse_scene(tabletop(plain, _ALL[plain], unknown, half))


SMALL_SCENES = tuple(_ALL)


@dataclass(frozen=True, slots=True)
class Nasty:
    """A plan written by hand.

    Attributes:
        intention: the harm that it is meant to do, in a line.
        scene: name of a small scene.
        measures: the parameters that it promises.
        requested: the parameters of the request, None without one.
        explanation: of a plan without steps.
    """

    name: str
    intention: str
    scene: str
    steps: tuple[Step, ...] | None
    measures: tuple[str, ...] = ()
    requested: tuple[str, ...] | None = None
    explanation: str = "written by hand"

    @property
    def plan(self) -> Plan:
        tree = None if self.steps is None else Node("Sequence", (), _nodes(self.steps))
        return Plan(tuple(map(Parameter, self.measures)), tree, self.explanation)

    @property
    def asked(self) -> tuple[Parameter, ...] | None:
        """Requested parameters; None for those of the plan."""
        return None if self.requested is None else tuple(map(Parameter, self.requested))

    def blank(self) -> Row:
        return Row.named("nasty", self.name, self.intention)


def _nodes(steps: Sequence[Step]) -> tuple[Node, ...]:
    return tuple(_node(step) for step in steps)


def _node(step: Step) -> Node:
    if isinstance(step, tuple):
        kind, *children = step
        assert isinstance(kind, str)
        return Node(kind, (), _nodes(children))
    if step in PLAIN:
        return PLAIN[step]
    word, _, rest = step.partition(" ")
    if word == "probe":
        return Node("MoveUntilContact", (("axis", rest),))
    if word == "joints":
        return Node("MoveJoints", (("joints", tuple(map(float, rest.split()))),))
    if word == "raw":
        return Node(rest)
    return Node("MovePose", (("pose", step),))


START: tuple[Step, ...] = ("home", "open")


def _grasp(name: str) -> tuple[Step, ...]:
    return (*START, f"{name}_pose + z_offset", f"{name}_pose", "close")


def _leave(name: str) -> tuple[Step, ...]:
    return (f"{name}_pose", "open", f"{name}_pose + z_offset", "home")


def _weigh(name: str) -> tuple[Step, ...]:
    return (*_grasp(name), f"{name}_pose + z_offset", "forces", "mass", *_leave(name))


def _read() -> tuple[Nasty, ...]:
    document = tomllib.loads(FILE.read_text(encoding="utf-8"))
    return tuple(_entry(**entry) for entry in document["plan"])


def _entry(
    name: str,
    intention: str,
    scene: str,
    steps: Sequence[Any] | None = None,
    measures: Sequence[str] = (),
    requested: Sequence[str] | None = None,
    explanation: str = "written by hand",
) -> Nasty:
    tree = None if steps is None else _steps(steps)
    asked = None if requested is None else tuple(requested)
    return Nasty(name, intention, scene, tree, tuple(measures), asked, explanation)


def _steps(written: Sequence[Any]) -> tuple[Step, ...]:
    """Steps from the file: composites as lists, usual sequences as a word."""
    found: list[Step] = []
    for step in written:
        if isinstance(step, str):
            word, _, thing = step.partition(" ")
            usual = USUAL.get(word)
            found += usual(thing) if usual else (step,)
        else:
            found.append((step[0], *_steps(step[1:])))
    return tuple(found)


USUAL: dict[str, Callable[[str], tuple[Step, ...]]] = {
    "start": lambda _: START,
    "grasp": _grasp,
    "leave": _leave,
    "weigh": _weigh,
}
"""Usual sequences by their word."""
NASTY = _read()


def judge(case: Nasty, blank: Row) -> Row:
    """Check a nasty plan, and execute it if the check accepts it."""
    scene, plan = small_scene(case.scene), case.plan
    findings = check(plan, scene, requested=case.asked)
    if findings:
        said = tuple(f"{f.rule}: {f.message}"[:300] for f in findings)
        rules = sorted({f.rule for f in findings})
        return replace(blank, outcome="refused", said=said, figures={"rules": rules})
    if plan.tree is None:
        return replace(blank, outcome="nothing to do")
    return judged_run(blank, probed_run(plan, scene, None, "lab", 0))
