"""A picture with words in it: names where the scene has its things, the world's axes, and a grid of
10 cm on the table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from palpate.geometry.pose import Array, Pose
from palpate.pictures.renderer import Pixels
from palpate.scene.camera import Camera

STEP = 0.1
"""m between two lines of the grid."""
LINE, RAISED = 0.0006, 0.0004
"""m: half the width of a line, and how far it lies above the table."""
MARGIN = 0.12
"""m of ground around what stands on it."""
GRID = "palpate_grid"
INK, HALO = (18, 22, 28), (255, 255, 255)
AXES = {"x": (196, 30, 34), "y": (22, 130, 52), "z": (28, 84, 196)}
ARROW = 0.08
"""m: how long an axis is drawn."""
HIDDEN = 0.05
"""m below the ground: what the picture cannot show."""
TAG, SMALL_TAG, MANY = 20, 15, 8
"""Pixels of a name's letters, and where there are more names than that many."""
FIGURES = 6
"""Lines of the grid, each way, that at most have a figure."""
CORNER = (-0.13, 0.0)
"""m from the grid's corner to where the axes are drawn, clear of its figures."""
PLACES = ((0.0, -1.0), (-1.0, -0.6), (1.0, -0.6), (-1.2, 0.2), (1.2, 0.2), (0.0, -2.2))
"""Candidate positions of a label: offset in half widths beside its object, and in heights above;
best first."""


@dataclass(frozen=True, slots=True)
class Ground:
    """The part of the table that is looked at: world z, and from where to where, m, in whole steps."""

    z: float
    low: tuple[float, float]
    high: tuple[float, float]

    @classmethod
    def under(cls, points: Array, level: float, margin: float = MARGIN) -> Ground:
        """The ground of `points` (n, 3) and `margin` m around, at world z `level`, m."""
        low, high = points.min(axis=0), points.max(axis=0)
        west, south = (STEP * np.floor((low[:2] - margin) / STEP)).tolist()
        east, north = (STEP * np.ceil((high[:2] + margin) / STEP)).tolist()
        return cls(level, (west, south), (east, north))

    def lines(self, axis: int) -> list[float]:
        """Positions of the grid's lines across `axis`, m."""
        count = round((self.high[axis] - self.low[axis]) / STEP)
        return [round(self.low[axis] + STEP * number, 3) for number in range(count + 1)]

    @property
    def corners(self) -> Array:
        """(4, 3) m."""
        (west, south), (east, north) = self.low, self.high
        flat = [(west, south), (east, south), (east, north), (west, north)]
        return np.array([[x, y, self.z] for x, y in flat])


def ruled(spec: mujoco.MjSpec, ground: Ground) -> None:
    """Draw the grid on the table of `spec`, in place: things stand before it."""
    spec.add_material(name=GRID, rgba=[0.10, 0.12, 0.16, 0.55], specular=0.0)
    middle = (np.array(ground.low) + ground.high) / 2
    half = (np.array(ground.high) - ground.low) / 2
    z = ground.z + RAISED
    for x in ground.lines(0):
        _line(spec, [x, middle[1], z], [LINE, half[1], LINE / 4])
    for y in ground.lines(1):
        _line(spec, [middle[0], y, z], [half[0], LINE, LINE / 4])


def _line(spec: mujoco.MjSpec, pos: list[float], size: list[float]) -> None:
    spec.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX,
        pos=pos,
        size=size,
        material=GRID,
        mass=0.0,
        contype=0,
        conaffinity=0,
    )


def camera_of(view: mujoco.MjvCamera, fovy: float, width: int, height: int) -> Camera:
    """A free camera as a pinhole; `fovy` in degrees."""
    az, el = np.radians([view.azimuth, view.elevation])
    forward = np.array([np.cos(el) * np.cos(az), np.cos(el) * np.sin(az), np.sin(el)])
    right = np.array([np.sin(az), -np.cos(az), 0.0])
    turn = np.column_stack([right, np.cross(right, forward), -forward])
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, turn.ravel())
    eye = np.array(view.lookat) - view.distance * forward
    return Camera(Pose(eye, quaternion), float(np.radians(fovy)), width, height)


def annotated(pixels: Pixels, camera: Camera, names: Mapping[str, Array], ground: Ground) -> Pixels:
    """The picture with every name above its place (3,) m, the grid's figures and the axes. What lies
    under the ground is not named."""
    names = {name: point for name, point in names.items() if point[2] > ground.z - HIDDEN}
    image = Image.fromarray(pixels)
    draw = ImageDraw.Draw(image)
    _figures(draw, camera, ground)
    _axes(draw, camera, ground)
    size = SMALL_TAG if len(names) > MANY else TAG
    for name, (foot, box) in _tags(pixels, draw, camera, names, size).items():
        left, top, right, bottom = box
        middle = ((left + right) / 2, (top + bottom) / 2)
        draw.line((*foot, *middle), fill=INK, width=2)
        draw.rounded_rectangle(box, 6, fill=HALO, outline=INK, width=2)
        draw.text(middle, name, font=_font(size), fill=INK, anchor="mm")
    return np.asarray(image)


Box = tuple[float, float, float, float]


def _tags(
    pixels: Pixels,
    draw: ImageDraw.ImageDraw,
    camera: Camera,
    names: Mapping[str, Array],
    size: int,
) -> dict[str, tuple[tuple[float, float], Box]]:
    """For each name the pixel that it points at, and the box that it stands in, none over another, and
    where the picture is calm, so that it hides no thing."""
    height, width = pixels.shape[:2]
    seen: list[tuple[tuple[float, float], str]] = []
    for name, point in names.items():
        foot = camera.project(point)
        if foot is not None and 0 <= foot[0] < width and 0 <= foot[1] < height:
            seen.append((foot, name))
    # What is lowest in the picture is nearest: its name is placed first, the others give way upwards.
    seen.sort(key=lambda item: -item[0][1])
    placed: dict[str, tuple[tuple[float, float], Box]] = {}
    for foot, name in seen:
        half = (draw.textlength(name, font=_font(size)) / 2 + 8, size / 2 + 5)
        boxes = [_box(foot, half, place, (width, height)) for place in PLACES]
        placed[name] = (foot, _calmest(pixels, boxes, [box for _, box in placed.values()]))
    return placed


def _calmest(pixels: Pixels, boxes: Sequence[Box], taken: Sequence[Box]) -> Box:
    """The box where the picture is calmest, of those that stand over none that is taken; where all do,
    one above them."""
    free: list[Box] = []
    for box in boxes:
        if not any(_overlap(box, other) for other in taken):
            free.append(box)
    if not free:
        return _above(boxes[0], taken)
    return min(free, key=lambda box: _busy(pixels, box))


def _box(
    foot: tuple[float, float],
    half: tuple[float, float],
    place: tuple[float, float],
    size: tuple[int, int],
) -> Box:
    """A name's box at a place beside what it names, within the picture."""
    beside, above = place
    x = foot[0] + beside * (half[0] + 16)
    y = foot[1] + above * (2 * half[1] + 6)
    x = min(max(x, half[0] + 4), size[0] - half[0] - 4)
    y = min(max(y, half[1] + 4), size[1] - half[1] - 4)
    return x - half[0], y - half[1], x + half[0], y + half[1]


def _above(box: Box, taken: Sequence[Box]) -> Box:
    """The box moved up to where it is free, if there is such a place."""
    while any(_overlap(box, other) for other in taken) and box[1] > box[3] - box[1]:
        box = (box[0], box[1] - 6, box[2], box[3] - 6)
    return box


def _busy(pixels: Pixels, box: Box) -> float:
    """Spread of the colours below a box, 0 to 255: the amount of detail that it would hide."""
    left, top, right, bottom = (max(0, round(edge)) for edge in box)
    return float(np.std(pixels[top:bottom, left:right].astype(np.float64), axis=(0, 1)).sum())


def _overlap(one: Box, other: Box) -> bool:
    beside = one[2] + 4 < other[0] or other[2] + 4 < one[0]
    above = one[3] + 4 < other[1] or other[3] + 4 < one[1]
    return not (beside or above)


def _figures(draw: ImageDraw.ImageDraw, camera: Camera, ground: Ground) -> None:
    """Positions of the grid's figures, at the ends of the lines nearest to the camera."""
    eye = camera.pose_world_camera.position
    near = [ground.high[i] if eye[i] > ground.low[i] else ground.low[i] for i in (0, 1)]
    out = [0.025 if near[i] == ground.high[i] else -0.025 for i in (0, 1)]
    # The corner that both have is left to neither.
    for x in _every(ground.lines(0)[:-1]):
        _write(draw, camera, (x, near[1] + out[1], ground.z), f"x={x:.1f}", AXES["x"])
    for y in _every(ground.lines(1)[1:]):
        _write(draw, camera, (near[0] + out[0], y, ground.z), f"y={y:.1f}", AXES["y"])


def _every(lines: list[float]) -> list[float]:
    """So many of them, evenly, that their figures have room."""
    return lines[:: -(-len(lines) // FIGURES)]


def _axes(draw: ImageDraw.ImageDraw, camera: Camera, ground: Ground) -> None:
    """The world's directions, at the corner of the ground that is nearest to the arm."""
    origin = np.array([ground.low[0] + CORNER[0], ground.low[1] + CORNER[1], ground.z])
    start = camera.project(origin)
    for (name, colour), way in zip(AXES.items(), np.eye(3), strict=True):
        end = camera.project(origin + ARROW * way)
        if start is None or end is None:
            continue
        draw.line((*start, *end), fill=HALO, width=8)
        draw.line((*start, *end), fill=colour, width=4)
        _write(draw, camera, origin + 1.25 * ARROW * way, name, colour)


def _write(
    draw: ImageDraw.ImageDraw,
    camera: Camera,
    point: Array | tuple[float, float, float],
    text: str,
    colour: tuple[int, int, int],
) -> None:
    at = camera.project(np.asarray(point))
    if at is not None:
        draw.text(
            at, text, font=_font(17), fill=colour, anchor="mm", stroke_width=3, stroke_fill=HALO
        )


def _font(size: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    return ImageFont.load_default(size=size)
