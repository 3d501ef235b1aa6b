"""Tags of a scene, and a printable sheet of tags."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from palpate.common.errors import InputError
from palpate.common.files import writing
from palpate.common.pose import Array, Pose
from palpate.perception.detection import CORNERS, MODULES, QUIET, TAGS, tag_pixels
from palpate.scene.scene import Scene

SITE = re.compile(r"tag_(\d{1,3})")  # Name pattern of a tag's site
# m. Range of valid half sides of tags; the default of an MJCF site is 5 mm.
SMALLEST, LARGEST = 0.002, 0.5


@dataclass(frozen=True, slots=True, eq=False)
class SceneTag:
    """Tag on a body."""

    number: int  # number in the family
    half: float  # half the side of its black square, m
    body: str  # name of the scene's body under it; "" for a static part that is no surface
    pose_world: Pose  # its pose in the scene


def tags_of(scene: Scene) -> dict[int, SceneTag]:
    """Return the tags of a scene by number.

    Raises InputError: a number outside the family, an invalid size, or a tag on a drawer or door.
    """
    shapes = scene.resolved.shapes
    model, data = shapes.model, shapes.data
    found: dict[int, SceneTag] = {}
    for i in range(model.nsite):
        name = model.site(i).name
        match = SITE.fullmatch(name)
        if match is None:
            continue
        # The site's name gives the number, its size half the side.
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
        # World pose of the site.
        quaternion = np.empty(4)
        mujoco.mju_mat2Quat(quaternion, data.site_xmat[i])
        found[number] = SceneTag(number, half, body, Pose.of(data.site_xpos[i], quaternion))
    return found


def corners(half: float, pose: Pose) -> Array:
    """Corners (4, 3) of a tag at this site pose, m."""
    return pose.position + (half * CORNERS) @ pose.rotation.T


def _body(scene: Scene, model: mujoco.MjModel, index: int) -> str:
    """Return the scene body that contains a compiled body, or ""."""
    # Go up the kinematic tree to the next named body of the scene.
    while index > 0 and model.body(index).name not in scene.bodies:
        index = int(model.body_parentid[index])
    return model.body(index).name if index > 0 else ""


# Printable sheet of tags: a PDF at exact scale, with numbers and a scale bar.


DPI = 600
PAPER = (0.210, 0.297)  # m. ISO A4, portrait.
# m. Margin of the sheet, gap between tags, and height of a text line.
EDGE, GAP, LINE = 0.012, 0.006, 0.004
BAR = 0.1  # m. Length of the scale bar.


def write_sheet(path: Path, numbers: Sequence[int], side: float) -> int:
    """Write a PDF of tags with a black square of `side` m.

    Returns:
        The number of pages.

    Raises:
        InputError: an invalid number or side, or the file exists or cannot be written.
    """
    # A tag with its white margin must fit into the sheet.
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
    # Fill each page with as many tags as fit, below them one line of text each.
    columns = int((widest + GAP) / (cell + GAP))
    rows = int((PAPER[1] - 2 * EDGE - 3 * LINE + GAP) / (cell + GAP + LINE))
    each = columns * rows
    pages = [_page(numbers[i : i + each], side, columns) for i in range(0, len(numbers), each)]
    with writing(path):
        pages[0].save(path, "PDF", resolution=DPI, save_all=True, append_images=pages[1:])
    return len(pages)


def _page(numbers: Sequence[int], side: float, columns: int) -> Image.Image:
    sheet = Image.new("L", (_dots(PAPER[0]), _dots(PAPER[1])), 255)
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(_dots(0.7 * LINE))
    # A tag, its white margin, and its number with the size attribute of its site.
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
    # The scale bar reveals a printer that scales the page.
    x, y = _dots(EDGE), _dots(PAPER[1] - EDGE)
    draw.line((x, y, x + _dots(BAR), y), fill=0, width=_dots(3e-4))
    for end in (x, x + _dots(BAR)):
        draw.line((end, y - _dots(0.002), end, y + _dots(0.002)), fill=0, width=_dots(3e-4))
    words = "100 mm: print at 100 %, and measure this line"
    draw.text((x, y - _dots(1.6 * LINE)), words, fill=0, font=font)
    return sheet


def _dots(length: float) -> int:
    return round(length / 0.0254 * DPI)
