"""Requests as people write them, in many scenes: what each asks for, or that it is refused.

`requests/before.txt` was written before the grammar that reads it, `requests/after.txt` and
`requests/later.txt` afterwards; what is in these was not looked at while the words were chosen.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

import pytest

from palpate.errors import InputError, PlanRejected
from palpate.planning.request.grounding import ground
from palpate.scene.load import parse_scene
from palpate.scene.scene import Scene

REQUESTS = Path(__file__).parent / "requests"
BOX, ROUND = "box", "cylinder"
GREY = "0.5 0.5 0.5"
RED, BLUE, GREEN, YELLOW = "0.8 0.1 0.1", "0.1 0.2 0.8", "0.1 0.6 0.1", "0.9 0.8 0.2"


class Thing(NamedTuple):
    """A free body that stands at (x, y) m, its foot at `z`."""

    name: str
    x: float
    y: float
    colour: str = GREY
    shape: str = ROUND
    z: float = 0.0

    def mjcf(self) -> str:
        size = ".02 .02 .03" if self.shape == BOX else ".02 .03"
        return (
            f'<body name="{self.name}" pos="{self.x} {self.y} {self.z + 0.03}"><freejoint/><geom '
            f'type="{self.shape}" size="{size}" rgba="{self.colour} 1" friction="0.5"/></body>'
        )


SCENES: dict[str, tuple[str, tuple[Thing, ...]]] = {
    "kitchen": (
        "table",
        (
            Thing("bottle", 0.5, -0.3),
            Thing("mug", 0.5, 0.3),
            Thing("red_box", 0.4, 0.0, RED, BOX),
            Thing("blue_box", 0.5, 0.0, BLUE, BOX),
        ),
    ),
    "workshop": (
        "workbench",
        (
            Thing("hammer", 0.5, -0.3, shape=BOX),
            Thing("screwdriver", 0.5, 0.0, shape=BOX),
            Thing("block", 0.5, 0.2, shape=BOX),
            Thing("battery", 0.5, 0.3),
        ),
    ),
    "shop": (
        "shelf",
        (
            Thing("blue_bottle", 0.5, -0.3, BLUE),
            Thing("green_bottle", 0.5, 0.0, GREEN),
            Thing("yellow_can", 0.5, 0.1, YELLOW),
        ),
    ),
    "vials": (
        "lab_bench",
        (
            Thing("beaker", 0.5, -0.3),
            Thing("vial_1", 0.5, 0.2),
            Thing("vial_2", 0.5, 0.1),
            Thing("vial_3", 0.5, -0.2),
        ),
    ),
    "boxes": (
        "floor_plate",
        (
            Thing("red_box", 0.4, 0.0, RED, BOX),
            Thing("box", 0.4, 0.1, shape=BOX),
            Thing("crate", 0.6, -0.3, shape=BOX),
            Thing("tin", 0.4, -0.3),
        ),
    ),
    "foam": ("foam", (Thing("duck", 0.5, 0.0, YELLOW, BOX),)),
    "werkstatt": ("tisch", (Thing("flasche", 0.5, -0.2), Thing("becher", 0.5, 0.2))),
    "office": (
        "desk",
        (
            Thing("stapler", 0.5, -0.2, shape=BOX),
            Thing("notebook", 0.5, 0.0, shape=BOX),
            Thing("tape", 0.5, 0.2),
        ),
    ),
    "fruit": (
        "counter",
        (
            Thing("apple", 0.5, -0.3, RED),
            Thing("pear", 0.5, -0.1, GREEN),
            Thing("left_bowl", 0.5, 0.3),
            Thing("right_bowl", 0.5, 0.1),
        ),
    ),
    "garage": (
        "bench",
        (
            Thing("wrench", 0.5, -0.3, shape=BOX),
            Thing("drill", 0.5, -0.05, shape=BOX),
            Thing("paint_can", 0.5, 0.15, GREEN),
            Thing("oil_can", 0.5, 0.3, "0.1 0.1 0.1"),
        ),
    ),
    "picnic": (
        "picnic_table",
        (
            Thing("thermos", 0.4, -0.2),
            Thing("juice_carton", 0.4, 0.0, shape=BOX),
            Thing("sandwich_box", 0.6, 0.0, BLUE, BOX),
            Thing("orange_ball", 0.4, 0.25, "0.9 0.5 0.1"),
        ),
    ),
    "bath": (
        "washstand",
        (
            Thing("soap", 0.5, 0.1, shape=BOX),
            Thing("sponge", 0.5, 0.25, YELLOW, BOX),
            Thing("shampoo_bottle", 0.5, -0.1),
            Thing("cup", 0.5, -0.3),
        ),
    ),
    "tower": (
        "table",
        (
            Thing("crate", 0.5, -0.2, "0.6 0.4 0.2", BOX),
            Thing("radio", 0.5, -0.2, shape=BOX, z=0.06),
            Thing("vase", 0.5, 0.2),
            Thing("candle", 0.5, 0.35),
        ),
    ),
    "taller": (
        "mesa",
        (
            Thing("botella", 0.5, -0.2),
            Thing("caja_roja", 0.5, 0.0, RED, BOX),
            Thing("caja_azul", 0.5, 0.25, BLUE, BOX),
        ),
    ),
    "atelier": (
        "etabli",
        (
            Thing("marteau", 0.5, -0.2, shape=BOX),
            Thing("pince", 0.5, 0.0, shape=BOX),
            Thing("bouteille", 0.5, 0.2),
        ),
    ),
    "cucina": (
        "tavolo",
        (Thing("bottiglia", 0.5, -0.2), Thing("tazza", 0.5, 0.0), Thing("mela", 0.5, 0.2, RED)),
    ),
}
STACK = """
  <body name="table" pos=".5 0 ?"><geom name="plate" type="box" size=".5 .5 .02" friction="0.5"/></body>
  <body name="board" pos=".5 .25 0.01"><geom type="box" size=".1 .1 .01" friction="0.5"/></body>
  {things}"""
PILED = (
    Thing("wooden_block", 0.5, -0.2, "0.6 0.4 0.2", BOX),
    Thing("red_cube", 0.5, -0.2, RED, BOX, 0.06),
    Thing("can", 0.5, 0.0),
    Thing("jar", 0.5, 0.25, z=0.02),
)


@cache
def scene(name: str) -> Scene:
    """One of the scenes; heights of surfaces and all masses are missing."""
    if name == "stack":
        inside = STACK.format(things="".join(thing.mjcf() for thing in PILED))
    else:
        surface, things = SCENES[name]
        inside = (
            f'<body name="{surface}" pos=".5 0 ?"><geom type="box" size=".5 .5 .02" friction="0.5"/>'
            "</body>" + "".join(thing.mjcf() for thing in things)
        )
    return parse_scene(f'<mujoco><worldbody><site name="robot_base"/>{inside}</worldbody></mujoco>')


class Line(NamedTuple):
    """One request: `asked` is empty where it is to be refused."""

    scene: str
    kind: str
    request: str
    asked: frozenset[str]


def lines(file: str) -> Iterator[Line]:
    """What is written in a file of requests."""
    for text in (REQUESTS / file).read_text(encoding="utf-8").splitlines():
        if text and not text.startswith("#"):
            where, kind, request, asked = (part.strip() for part in text.split(" | "))
            yield Line(where, kind, request, frozenset(asked.replace("-", "").split()))


def read(line: Line) -> frozenset[str]:
    """What is understood of it: nothing where it is refused."""
    try:
        found = ground(line.request, scene(line.scene))
    except (InputError, PlanRejected):
        return frozenset()
    return frozenset(str(parameter) for parameter in found.asked)


@pytest.mark.parametrize("file", ["before.txt", "after.txt", "later.txt"])
def test_what_is_read_is_what_was_asked_and_else_it_is_refused(file: str):
    asked = [line for line in lines(file) if line.asked]
    wrong: list[str] = []
    missed = 0
    for line in lines(file):
        found = read(line)
        if found and found != line.asked:
            wrong.append(f"{line.request} -> {' '.join(sorted(found))}")
        missed += bool(line.asked and not found)
    assert len(wrong) <= 0.01 * len(asked), "\n".join(wrong)
    assert missed <= 0.05 * len(asked)


def test_the_corpus_is_large_and_of_many_kinds():
    everything = [*lines("before.txt"), *lines("after.txt"), *lines("later.txt")]
    assert len(everything) >= 400
    assert len({line.scene for line in everything}) >= 10
    assert len({line.kind for line in everything}) >= 14


@pytest.mark.parametrize(
    ("request_", "named"),
    [
        ("Tell me a joke about the mug.", "joke"),
        ("What does the bottle weigh by the sea?", "sea"),
        ("Put the mug on the red box.", "Put"),
        ("Is the bottle full?", "full"),
        ("What is the mass of the mug's handle?", "handle"),
    ],
)
def test_a_refusal_names_what_was_not_understood_and_what_can_be_asked(request_: str, named: str):
    try:
        said = " ".join(ground(request_, scene("kitchen")).cannot)
    except PlanRejected as rejection:
        said = str(rejection)
    assert f"'{named.lower()}'" in said
    assert "sliding friction" in said


@pytest.mark.parametrize(
    ("request_", "remark"),
    [
        ("hieght of the table", "'hieght' is read as 'height'"),
        ("weight of the cup", "'cup' is taken for 'mug'"),
        ("mass of the left box", "'left' is as the robot sees it"),
        ("mass of the box closest to the mug", "The nearest is 'blue_box', by 16 mm."),
        ("weigh all containers", "'containers' are taken to be 'bottle' and 'mug' and 'red_box'"),
    ],
)
def test_what_is_not_quite_what_was_said_is_remarked_on(request_: str, remark: str):
    where = scene("boxes") if "left" in request_ else scene("kitchen")
    assert any(remark in told for told in ground(request_, where).remarks)


@pytest.mark.parametrize(
    "request_", ["Which weighs more, the mug or the bottle?", "masses of boxes"]
)
def test_inflected_words_are_no_slips(request_: str):
    assert ground(request_, scene("kitchen")).remarks == ()
