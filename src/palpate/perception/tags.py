"""Tags of a scene, and a sheet of tags to print."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from palpate.common.errors import InputError
from palpate.common.pose import Array, Pose
from palpate.perception.detection import CORNERS, MODULES, QUIET, TAGS, tag_pixels
from palpate.scene.scene import Scene

SITE = re.compile(r"tag_(\d{1,3})")
"""Name of a tag's site."""
SMALLEST, LARGEST = 0.002, 0.5
"""m: half sides of tags that are taken for ones; MJCF's default is 5 mm."""


@dataclass(frozen=True, slots=True, eq=False)
class SceneTag:
    """A tag on a body.

    Attributes:
        number: of the family.
        half: half a side of its black square, m.
        body: name of the scene's body that it is on; "" for what stands still and is no surface.
        pose_world: where the scene has it.
    """

    number: int
    half: float
    body: str
    pose_world: Pose


def tags_of(scene: Scene) -> dict[int, SceneTag]:
    """Tags that a scene states, by number.

    Raises:
        InputError: a number beyond the family's, a size that is none, or a tag on a drawer or door.
    """
    shapes = scene.resolved.shapes
    model, data = shapes.model, shapes.data
    found: dict[int, SceneTag] = {}
    for i in range(model.nsite):
        name = model.site(i).name
        match = SITE.fullmatch(name)
        if match is None:
            continue
        number, half = int(match[1]), float(model.site_size[i, 0])
        if number >= TAGS:
            raise InputError(f"site '{name}': the family tag36h11 has tags 0 to {TAGS - 1}")
        if not SMALLEST <= half <= LARGEST:
            raise InputError(
                f"site '{name}': size=\"{half:g}\" is half a side of the tag's black square, m"
            )
        body = _body(scene, model, int(model.site_bodyid[i]))
        if body in scene.fixtures:
            raise InputError(
                f"site '{name}' is on '{body}', which moves: put the tag on something else"
            )
        quaternion = np.empty(4)
        mujoco.mju_mat2Quat(quaternion, data.site_xmat[i])
        found[number] = SceneTag(number, half, body, Pose.of(data.site_xpos[i], quaternion))
    return found


def corners(half: float, pose: Pose) -> Array:
    """(4, 3) corners of a tag whose site has this pose, m."""
    return pose.position + (half * CORNERS) @ pose.rotation.T


def _body(scene: Scene, model: mujoco.MjModel, index: int) -> str:
    """The scene's body that a compiled one is, or is a part of."""
    while index > 0 and model.body(index).name not in scene.bodies:
        index = int(model.body_parentid[index])
    return model.body(index).name if index > 0 else ""


# A sheet of tags to print: a PDF at its exact size, with numbers and a scale bar.


DPI = 600
PAPER = (0.210, 0.297)
"""m: ISO A4, upright."""
EDGE, GAP, LINE = 0.012, 0.006, 0.004
"""m: margin of the sheet, space between tags, height of a line of writing."""
BAR = 0.1
"""m: length of the scale bar."""


def write_sheet(path: Path, numbers: Sequence[int], side: float) -> int:
    """Write a PDF of tags whose black square has a `side` in m; return its pages.

    Raises:
        InputError: a number or a side that cannot be, or the file exists or cannot be written.
    """
    widest = min(PAPER) - 2 * EDGE
    cell = side * (MODULES + 2 * QUIET) / MODULES
    if not (side >= 0.005 and cell <= widest):
        most = 1e3 * widest * MODULES / (MODULES + 2 * QUIET)
        raise InputError(f"size= must be 0.005 to {most / 1e3:.3f} m, not {side:g}")
    wrong = [number for number in numbers if not 0 <= number < TAGS]
    if wrong or not 0 < len(numbers) <= TAGS:
        raise InputError(f"tags are numbered 0 to {TAGS - 1}; give some of them")
    if path.exists():
        raise InputError(f"'{path}' exists already: choose another file")
    columns = int((widest + GAP) / (cell + GAP))
    rows = int((PAPER[1] - 2 * EDGE - 3 * LINE + GAP) / (cell + GAP + LINE))
    each = columns * rows
    pages = [_page(numbers[i : i + each], side, columns) for i in range(0, len(numbers), each)]
    try:
        pages[0].save(path, "PDF", resolution=DPI, save_all=True, append_images=pages[1:])
    except OSError as error:
        raise InputError(f"cannot write '{path}': {error.strerror}") from None
    return len(pages)


def _page(numbers: Sequence[int], side: float, columns: int) -> Image.Image:
    sheet = Image.new("L", (_dots(PAPER[0]), _dots(PAPER[1])), 255)
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(_dots(0.7 * LINE))
    module = side / MODULES
    cell = side + 2 * QUIET * module
    for i, number in enumerate(numbers):
        row, column = divmod(i, columns)
        x, y = EDGE + column * (cell + GAP), EDGE + row * (cell + GAP + LINE)
        inner = (_dots(x + QUIET * module), _dots(y + QUIET * module))
        tag = Image.fromarray(np.asarray(tag_pixels(number)))
        sheet.paste(tag.resize((_dots(side), _dots(side)), Image.Resampling.NEAREST), inner)
        words = f'tag_{number}  size="{side / 2:g}"'
        draw.text((_dots(x + QUIET * module), _dots(y + cell)), words, fill=0, font=font)
    # A printer that scales is found out with a ruler.
    x, y = _dots(EDGE), _dots(PAPER[1] - EDGE)
    draw.line((x, y, x + _dots(BAR), y), fill=0, width=_dots(3e-4))
    for end in (x, x + _dots(BAR)):
        draw.line((end, y - _dots(0.002), end, y + _dots(0.002)), fill=0, width=_dots(3e-4))
    words = "100 mm: print at 100 %, and measure this line"
    draw.text((x, y - _dots(1.6 * LINE)), words, fill=0, font=font)
    return sheet


def _dots(length: float) -> int:
    return round(length / 0.0254 * DPI)
