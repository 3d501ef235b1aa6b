"""Plans written by hand, and small scenes for them: a table with its top at z = 0 and a few things, the
arm at the origin.

`nasty.toml` has at least one plan against every rule of the check, `physics.toml` plans whose harm is
physics': leaning, rolling, sagging, slipping things, and worlds that are not as believed. Each of them must
be refused by the check or by the rehearsal, or be harmless when it is executed. The plans of `sensible.toml`
must pass both.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import chain
from pathlib import Path
from typing import Any

from bench.campaign.ledger import Row, judged_run
from bench.harm.probe import probed_run
from bench.variety import standing, tabletop
from palpate.common.parameter import Parameter
from palpate.execution.rehearsal import rehearse
from palpate.planning.check.check import check
from palpate.planning.plan import Node, Plan
from palpate.scene.load import parse_scene
from palpate.scene.poses import Poses
from palpate.scene.scene import Scene

FOLDER = Path(__file__).parent
KEYS = {"friction": 'friction="{} 0.005 0.0001"', "mass": 'mass="{}"', "slippery": 'priority="{}"'}
"""Attributes of a thing in a line; of two frictions in contact MuJoCo takes the larger, but for "slippery"."""
CENTIMETRES = Poses(
    offsets={"cx": (0.01, 0.0, 0.0), "cy": (0.0, -0.01, 0.0), "cz": (0.0, 0.0, 0.01)}
)
"""Offsets by which steps are written: along the axes of a grasp, whose y is -y of the world where the hand points
down and the fingers close along y."""
AWAY = re.compile(r"(\w+)((?: -?[\d.]+){3}| up)")
"""`THING X Y Z` and `THING up`."""
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
    "fold": Node("FoldFingers"),
}


TURNS = {"tilt": ("Tilt", "about", "degrees"), "turn": ("Turn", "degrees"), "swing": ("Swing",)}


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
    if plain in _lines():
        return parse_scene(_text(plain, _lines()[plain], unknown), poses=CENTIMETRES)
    half = ".3 .3" if plain in _SMALL else ".38 .5"
    return parse_scene(tabletop(plain, _ALL[plain], unknown, half))


@cache
def _lines() -> Mapping[str, Sequence[str]]:
    """Scenes of the files, in lines."""
    files = ("physics.toml", "sensible.toml")
    return {name: lines for file in files for name, lines in _content(file)["scenes"].items()}


@cache
def _content(file: str) -> Mapping[str, Any]:
    return tomllib.loads((FOLDER / file).read_text(encoding="utf-8"))


def _text(name: str, lines: Sequence[str], table: str) -> str:
    """MJCF of a scene in lines: things, MJCF, `half X Y` of the table, or `table Z` of its middle."""
    half, things, ends = ".38 .5", "", ""
    for line in lines:
        word, _, rest = line.partition(" ")
        if word == "half":
            half = rest
        elif word == "table":
            table = rest
        elif line.startswith("<equality>"):
            ends += line
        else:
            things += line if line.startswith("<") else _thing(line)
    text = tabletop(name, things, table, half)
    return text.replace("</mujoco>", f"{ends}</mujoco>")


def _thing(line: str) -> str:
    """MJCF of `NAME SHAPE SIZE @ X Y Z [ROLL PITCH YAW] [KEY=VALUE]`, fixed with a "!" before it."""
    head, _, tail = line.partition(" @ ")
    name, shape, *size = head.split()
    words = tail.split()
    place = [word for word in words if "=" not in word]
    given = {"friction": "0.7"} | dict(word.split("=") for word in words[len(place) :])
    more = " ".join(KEYS[key].format(value) for key, value in given.items())
    return (
        f'<body name="{name.lstrip("!")}" pos="{" ".join(place[:3])}" euler="{" ".join(place[3:] or "000")}">'
        f"{'' if name.startswith('!') else '<freejoint/>'}"
        f'<geom type="{shape}" size="{" ".join(size)}" {more}/></body>'
    )


SMALL_SCENES = (*_ALL, *_lines())


@dataclass(frozen=True, slots=True)
class Written:
    """A plan written by hand.

    Attributes:
        intention: the harm that it is meant to do, or its purpose, in a line.
        scene: name of a small scene.
        measures: the parameters that it promises.
        requested: the parameters of the request, None without one.
        explanation: names what is handled without being measured.
        world: scene that is the hidden world; the plan's own by default.
        unseen: things of the world that the plan's scene does not show.
        kind: of the campaign.
        seed: of the simulated arm.
    """

    name: str
    scene: str
    steps: tuple[Step, ...] | None
    intention: str = ""
    measures: tuple[str, ...] = ()
    requested: tuple[str, ...] | None = None
    explanation: str = "written by hand"
    world: str = ""
    unseen: tuple[str, ...] = ()
    kind: str = "nasty"
    seed: int = 0

    @property
    def plan(self) -> Plan:
        tree = None if self.steps is None else Node("Sequence", (), _nodes(self.steps))
        return Plan(tuple(map(Parameter, self.measures)), tree, self.explanation)

    @property
    def asked(self) -> tuple[Parameter, ...] | None:
        """Requested parameters; None for those of the plan."""
        return None if self.requested is None else tuple(map(Parameter, self.requested))

    def blank(self) -> Row:
        blank = Row.named(self.kind, self.name, self.intention)
        if not self.seed:
            return blank
        return replace(
            blank,
            case=f"{self.name}, seed {self.seed}",
            command=f"{blank.command} --seed {self.seed}",
        )


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
    if word in TURNS:
        kind, *names = TURNS[word]
        values = [float(one) if one[-1].isdigit() else one for one in rest.split()]
        return Node(kind, tuple(zip(names, values, strict=True)))
    return Node("MovePose", (("pose", _pose(step)),))


def _pose(step: str) -> str:
    """The pose expression of a motion: as it is written, a thing, or from there by centimetres."""
    away = AWAY.fullmatch(step)
    if away is None:
        return f"{step}_pose" if step.isidentifier() and "_" not in step else step
    if away[2] == " up":
        return f"{away[1]}_pose + z_offset"
    parts = [
        f" + {n}*{axis}"
        for n, axis in zip(away[2].split(), ("cx", "cy", "cz"), strict=True)
        if float(n)
    ]
    return f"{away[1]}_pose{''.join(parts)}"


START: tuple[Step, ...] = ("home", "open")


def _grasp(where: str) -> tuple[Step, ...]:
    """Take the thing, at its grasp pose or beside it."""
    place = _pose(where)
    return (*START, f"{place} + z_offset", place, "close")


def _leave(name: str) -> tuple[Step, ...]:
    return (f"{name}_pose", "open", f"{name}_pose + z_offset", "home")


def _weigh(name: str) -> tuple[Step, ...]:
    return (*_grasp(name), f"{name}_pose + z_offset", "forces", "mass", *_leave(name))


def _read(*files: str, **usual: Any) -> tuple[Written, ...]:
    found = chain(*(_content(file)["plan"] for file in files))
    return tuple(_entry(**usual | entry) for one in found for entry in _each(**one))


def _each(each: Sequence[str] = (), **entry: Any) -> Iterator[dict[str, Any]]:
    """An entry for `each` scene and thing, whose names stand for the {} in it."""
    if not each:
        yield entry
    for scene, thing in map(str.split, each):
        steps = [step.replace("{}", thing) for step in entry["steps"]]
        yield entry | {"name": entry["name"].format(thing, scene), "scene": scene, "steps": steps}


def _entry(
    steps: Sequence[Any] | None = None,
    creep: tuple[str, str, int] | None = None,
    then: Sequence[str] = (),
    requested: Sequence[str] | None = None,
    **others: Any,
) -> Written:
    tree = None if steps is None else _steps(steps)
    if creep is not None and tree is not None:
        tree = (*tree, *_crept(*creep), *_steps(then))
    asked = None if requested is None else tuple(requested)
    lists = {key: tuple(others.pop(key, ())) for key in ("measures", "unseen")}
    written = Written(steps=tree, requested=asked, **lists, **others)
    if written.measures or written.explanation != "written by hand":
        return written
    taken = [
        step.split()[1] for step in steps or () if isinstance(step, str) and step.startswith(TAKING)
    ]
    return replace(written, explanation=" ".join(("written by hand, for the", *taken[:1])))


def _crept(start: str, way: str, count: int) -> Sequence[str]:
    """Many small motions: from `start`, each by so many centimetres."""
    name, *first = start.split()
    places = (
        [float(a) + i * float(b) for a, b in zip(first, way.split(), strict=True)]
        for i in range(count)
    )
    return [" ".join((name, *(f"{one:.2f}" for one in place))) for place in places]


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


def _lift(name: str) -> tuple[Step, ...]:
    return (*_grasp(name), f"{name}_pose + z_offset", *_leave(name))


TAKING = ("grasp ", "lift ", "weigh ")
USUAL: dict[str, Callable[[str], tuple[Step, ...]]] = {
    "start": lambda _: START,
    "grasp": _grasp,
    "leave": _leave,
    "weigh": _weigh,
    "lift": _lift,
}
"""Usual sequences by their word."""
NASTY, PHYSICS = _read("nasty.toml"), _read("physics.toml", kind="physics")
SENSIBLE = _read("sensible.toml", kind="sensible")


def judge(case: Written, blank: Row) -> Row:
    """Check and rehearse a plan, and execute it in its world if both accept it."""
    scene, plan = small_scene(case.scene), case.plan
    findings = check(plan, scene, requested=case.asked)
    if not findings and plan.tree is not None:
        rehearsed = rehearse(plan, scene).finding
        findings = [] if rehearsed is None else [rehearsed]
    if findings:
        said = tuple(f"{f.rule}: {f.path}: {f.message}"[:300] for f in findings)
        rules = sorted({f.rule for f in findings})
        beyond = said if case.kind == "sensible" else ()
        return replace(blank, outcome="refused", said=said, beyond=beyond, figures={"rules": rules})
    if plan.tree is None:
        return replace(blank, outcome="nothing to do")
    world = small_scene(case.world) if case.world else None
    return judged_run(blank, probed_run(plan, scene, world, "lab", case.seed, unseen=case.unseen))
