"""Folder with a new scene: MJCF and poses.yaml, with a comment at each decision of the user.

No file is overwritten.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

from palpate.common.errors import InputError
from palpate.common.files import plain_yaml

MAX_OBJECTS = 15
MAX_NAME = 60
UNKNOWN = {"box": [60, 60, 80]}  # Shape and size, mm, of an object of unknown kind
_COLOURS = {
    "red": ".80 .18 .16",
    "blue": ".16 .42 .80",
    "green": ".22 .60 .32",
    "yellow": ".93 .78 .22",
    "orange": ".90 .52 .16",
    "purple": ".52 .28 .64",
    "white": ".93 .93 .91",
    "black": ".14 .14 .15",
    "grey": ".55 .56 .58",
    "gray": ".55 .56 .58",
    "brown": ".50 .35 .22",
}
_PALETTE = ("blue", "red", "green", "yellow", "purple", "orange")
_ROWS = (0.42, 0.56, 0.70)
# m, positions in front of the arm's foot: rows ahead and columns aside, with room for a hand.
_COLUMNS = (0.0, 0.18, -0.18, 0.36, -0.36)


@dataclass(frozen=True, slots=True)
class ScaffoldItem:
    """Object or surface of a new scene."""

    name: str  # name in the MJCF
    kind: str  # key of `kinds()`, or "" for an unknown name
    shape: str  # `box`, `cylinder` or `sphere`
    # M; of a box along x, y and z, of a cylinder diameter and height, of a ball diameter.
    extents: tuple[float, ...]
    # x, y: position, m
    x: float
    y: float
    colour: str  # red, green and blue, 0 to 1

    @property
    def height(self) -> float:
        """Vertical extent, m."""
        return self.extents[-1]

    @property
    def size(self) -> str:
        """MuJoCo's `size` of the geom: half extents, m."""
        return " ".join(f"{extent / 2:.4g}" for extent in self.extents)


@cache
def kinds() -> dict[str, dict[str, list[float]]]:
    """Shape and size by kind: `{"mug": {"cylinder": [74, 95]}}`, in mm."""
    text = files("palpate.scene").joinpath("kinds.yaml").read_text(encoding="utf-8")
    entries: Any = plain_yaml(text, "kinds.yaml")
    return entries


def place_objects(names: Sequence[str]) -> tuple[ScaffoldItem, ...]:
    """Place an object for each name, in rows in front of the arm; at most `MAX_OBJECTS`, all with other names."""
    # More objects than places in front of the arm.
    if len(names) > MAX_OBJECTS:
        raise InputError(
            f"{len(names)} objects are too many: at most {MAX_OBJECTS} fit in front of the arm; "
            "add the others to the file yourself"
        )
    # Fill the rows from near to far, each from its middle outwards.
    places = [(x, y) for x in _ROWS for y in _COLUMNS]
    placed: dict[str, ScaffoldItem] = {}
    for name, place in zip(names, places, strict=False):
        name = identifier(name)
        if name in placed:
            raise InputError(f"two objects are called '{name}': give each its own name")
        words = name.lower().split("_")
        # The last word is the noun: a `box_cutter` is a cutter.
        kind = next((word for word in reversed(words) if word in kinds()), "")
        [(shape, millimetres)] = kinds().get(kind, UNKNOWN).items()
        extents = tuple(value / 1000 for value in millimetres)
        # A colour in the name takes precedence over that of the palette.
        usual = _PALETTE[len(placed) % len(_PALETTE)]
        colour = next((word for word in words if word in _COLOURS and word != kind), usual)
        placed[name] = ScaffoldItem(name, kind, shape, extents, *place, colour=_COLOURS[colour])
    return tuple(placed.values())


def identifier(text: str) -> str:
    """Turn a text into a name for MJCF and plans: a letter, then letters, digits and underscores."""
    # Runs of other characters become one underscore.
    name = re.sub(r"\W+", "_", text.strip()).strip("_")
    if not name or not name[0].isalpha() or len(name) > MAX_NAME:
        raise InputError(
            f"'{text[:MAX_NAME]}' cannot be an object's name: a name starts with a letter and has at most "
            f"{MAX_NAME} letters, digits or '_', for example 'red_mug'"
        )
    return name


SCENE, POSES = "scene.xml", "poses.yaml"


_HEAD = """\
<!-- A scene for palpate. Lengths in m, masses in kg; x points away from the arm's foot, y to its left, z up.
     Write known values. Leave unknown values out, or write "?": palpate measures them. -->
<mujoco model="{model}">
  <asset>
    <texture name="sky" type="skybox" builtin="gradient" rgb1=".86 .91 .96" rgb2=".55 .66 .78" width="64" height="384"/>
  </asset>

  <worldbody>
    <light pos="0.4 -0.6 1.9" dir="0 0.2 -1" diffuse=".8 .8 .8"/>
    <camera name="workspace" pos="1.35 -1.05 0.95" xyaxes="0.65 0.76 0 -0.38 0.33 0.86" fovy="42"/>

    <!-- The arm's base. All positions below are relative to it. -->
    <site name="robot_base" pos="0 0 0"/>

    <!-- The middle of a slab of 1.2 x 1.2 x 0.04 m, whose top is level with the arm's foot. If you do not know how
         high your {surface} is, write pos="0.35 0 ?". -->
    <body name="{surface}" pos="0.35 0 -0.02">
      <geom type="box" size=".60 .60 .02" rgba=".88 .80 .66 1"/>
    </body>
"""
_OBJECT = """
    <!-- {about} -->
    <body name="{name}" pos="{x:g} {y:g} {z:.4g}">
      <freejoint/>
      <geom type="{shape}" size="{size}" rgba="{colour} 1"/>
    </body>
"""
_SIZES = {
    "box": "half its extents along x, y and z",
    "cylinder": "its radius and half its height",
    "sphere": "its radius",
}
_POSES = """\
# Poses that the MJCF does not state, or not well enough. Every entry is optional: remove the '#'
# of those you need. Lengths in m, angles in rad, z up. `palpate teach scene.xml` fills this in with you.

# objects:                      # poses of the objects' frames in the world; they overrule the MJCF
#   {first}: {{pos: [0.42, 0.0, 0.05], yaw: 0.3}}

# accuracy: 0.002               # how well these are known (1 sigma)

# places:                       # poses of the point between the fingertips, which point down
#   shelf_approach: {{pos: [0.4, 0.3, 0.3]}}

# grasps:                       # where the hand takes an object, in the object's own frame
#   {first}: {{pos: [0.0, 0.0, 0.01], yaw: 1.57}}

# offsets:                      # how far a plan goes: up before and after a grasp, aside for a second one
#   z_offset: 0.12
"""


@dataclass(frozen=True, slots=True)
class Scaffold:
    """Files of a new scene, and the names of its objects."""

    scene: Path
    poses: Path
    objects: tuple[str, ...]


def new_scene(folder: Path, names: Sequence[str], surface: str = "table") -> Scaffold:
    """Write a scene of the named objects on a surface.

    Raises InputError: not a name, a file that exists, or a folder that cannot be written.
    """
    surface = identifier(surface)
    items = place_objects(names)
    # One name space for all bodies, as MuJoCo requires.
    if surface in {item.name for item in items}:
        raise InputError(f"'{surface}' is the surface's name: give the object another name")
    # The model's name is that of the folder, without characters special to XML.
    letters = [letter for letter in folder.absolute().name if letter.isalnum() or letter in " _-"]
    model = "".join(letters) or "scene"
    first = items[0].name if items else "mug"
    texts = {SCENE: scene_text(model, surface, items), POSES: _POSES.format(first=first)}
    write_texts(folder, texts)
    return Scaffold(folder / SCENE, folder / POSES, tuple(item.name for item in items))


def write_texts(folder: Path, texts: Mapping[str, str]) -> None:
    """Write all files, or none and raise an `InputError` if one of them exists."""
    for name in texts:
        if (folder / name).exists():
            raise InputError(f"'{folder / name}' exists already: choose another folder")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, text in texts.items():
            # Mode x fails if the file appeared in the meantime.
            with (folder / name).open("x", encoding="utf-8") as file:
                file.write(text)
    except OSError as error:
        raise InputError(f"cannot write into '{folder}': {error.strerror}") from error


def scene_text(model: str, surface: str, items: Sequence[ScaffoldItem]) -> str:
    """MJCF of a surface and the objects on it, all masses missing."""
    text = _HEAD.format(model=model, surface=surface)
    for item in items:
        # A known kind gets a common size, any other object a box.
        guess = "A box, as the shape is unknown"
        if item.kind:
            guess = f"A {item.kind} of common size"
        text += _OBJECT.format(
            about=f"{guess}: size is {_SIZES[item.shape]}. Mass and friction are missing.",
            name=item.name,
            x=item.x,
            y=item.y,
            z=item.height / 2,
            shape=item.shape,
            size=item.size,
            colour=item.colour,
        )
    return text + "  </worldbody>\n</mujoco>\n"
