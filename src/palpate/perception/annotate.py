"""Annotated pictures: object names, world axes, and a 10 cm grid on the table."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from math import ceil, dist, floor

import mujoco
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from palpate.common.pose import Array, Pose
from palpate.perception.renderer import Painter, Pixels, directions, extent, forward_data, png
from palpate.perception.stage import (
    add_box,
    build_stage,
    fits_in_view,
    ground_below,
    things_in_view,
)
from palpate.scene.camera import Camera

STEP = 0.1  # m. Distance of grid lines.
LINE, RAISED = 0.0006, 0.0004  # m. Half the width of a grid line, and its height above the table.
MARGIN = 0.12  # m. Ground in view around the objects.
ROUNDING = 1e-6  # Share of a step. Tolerance for equal lengths.
GRID = "palpate_grid"
INK, HALO = (18, 22, 28), (255, 255, 255)
AXES = {"x": (196, 30, 34), "y": (22, 130, 52), "z": (28, 84, 196)}
ARROW = 0.08  # m. Length of an axis.
HIDDEN = 0.05  # m. Depth below the ground from which nothing is visible.
# px and count. Letter height of names, the smaller height for many names, and the number above
# which it applies.
TAG, SMALL_TAG, MANY = 20, 15, 8
FIGURES = 6  # Maximum number of labelled grid lines in each direction
OUTSIDE = 0.025  # m. Distance of coordinates from the edge of the grid.
# m. Position of the axes relative to the grid's corner, clear of its coordinates.
CORNER = (-0.13, 0.0)
SIZE = (1024, 768)  # px. Width and height of a close-up.
# degrees and ratio. Elevation of the close-up, which shows gaps, and margin for the coordinates at
# the edges.
STEEP, EDGE = -46.0, 1.16
# Candidate positions of a label relative to its object: horizontal in half widths, vertical in
# heights. The best is first.
PLACES = tuple(
    (beside, above)
    for above in (-1.0, -2.0, 0.2, -3.0, -4.0, 1.5, 3.0, -5.5)
    for beside in (0.0, -1.0, 1.0, -1.6, 1.6)
    if beside or above < 0.0
)

# Hidden object pixels. Cost of one pixel of distance between label and object, and of a crossing
# line or an ambiguous label.
FAR, ASTRAY = 4.0, 2000.0

Pixel = tuple[float, float]
Box = tuple[float, float, float, float]  # Left, top, right and bottom, pixels
Mask = NDArray[np.bool_]  # (height, width) boolean picture


@dataclass(frozen=True, slots=True)
class Ground:
    """Visible part of the table: world z, and ranges of x and y in whole grid steps, m."""

    z: float
    low: tuple[float, float]
    high: tuple[float, float]

    @classmethod
    def under(cls, points: Array, table: Array) -> Ground:
        """Return the ground on a `table` (n, 3) around `points` (n, 3), m.

        It extends `MARGIN` beyond the points, within the table. A table smaller than one step is
        fully covered.
        """
        ends: list[tuple[float, float]] = []
        for axis in range(2):
            low, high = float(points[:, axis].min()), float(points[:, axis].max())
            near, far = float(table[:, axis].min()), float(table[:, axis].max())
            # Intersect the padded range of the objects with that of the table, in whole steps.
            start = max(floor((low - MARGIN) / STEP), ceil(near / STEP - ROUNDING))
            end = min(ceil((high + MARGIN) / STEP), floor(far / STEP + ROUNDING))
            if start >= end:
                start, end = floor(near / STEP), ceil(far / STEP)
            ends.append((STEP * start, STEP * end))
        # The ground is the top of the table.
        (west, east), (south, north) = ends
        return cls(float(table[:, 2].max()), (west, south), (east, north))

    def lines(self, axis: int) -> list[float]:
        """Coordinates of the grid lines across `axis`, m."""
        count = round((self.high[axis] - self.low[axis]) / STEP)
        return [round(self.low[axis] + STEP * number, 3) for number in range(count + 1)]

    @property
    def axes(self) -> Array:
        """Origin and tips (4, 3) of the drawn axes, m, near the grid corner closest to the arm."""
        origin = np.array([self.low[0] + CORNER[0], self.low[1] + CORNER[1], self.z])
        return origin + ARROW * np.vstack([np.zeros(3), np.eye(3)])

    @property
    def corners(self) -> Array:
        """Corners (4, 3) of the ground, m."""
        (west, south), (east, north) = self.low, self.high
        flat = [(west, south), (east, south), (east, north), (west, north)]
        return np.array([[x, y, self.z] for x, y in flat])


def closer_png(world: mujoco.MjSpec, names: Mapping[str, Array]) -> bytes:
    """Render a close-up of the objects from above as PNG, with axes, a grid, and `names` at positions (3,), m."""
    # Draw the grid into the scene, where objects occlude it.
    things = things_in_view(world, names)
    ground = Ground.under(things, ground_below(world))
    spec = world.copy()
    draw_grid(spec, ground)
    model = build_stage(spec)
    data = forward_data(model)
    # Frame objects, grid and axes, and render the picture with the body of each pixel.
    with Painter(model, *SIZE) as painter:
        points = np.concatenate([things, ground.corners, ground.axes])
        view = painter.enclose(points, elevation=STEEP, margin=EDGE)
        pixels, bodies = painter.paint(data, view), painter.bodies(data, view)
    # Labels should cover the table rather than small bodies, so mark the pixels of these.
    small = [fits_in_view(extent(model, data, [model.body(i).name])) for i in range(model.nbody)]
    shown = np.array(small)[bodies]
    # Label a large body at table height, such as the table itself, at a free spot.
    camera = camera_of(view, float(model.vis.global_.fovy), *SIZE)
    at = dict(names)
    for name, point in names.items():
        body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name)
        if body > 0 and not small[body] and abs(point[2] - ground.z) < HIDDEN:
            at[name] = _bare_spot(camera, ground, shown)
    return png(annotate(pixels, camera, at, ground, shown))


def _bare_spot(camera: Camera, ground: Ground, things: Mask) -> Array:
    """Centre (3,) of the grid square farthest from the objects in the picture, m.

    Squares next to the coordinates are only used if there are no others.
    """
    # Sample every fourth object pixel, which is accurate enough for a label.
    far = np.argwhere(things[::4, ::4])[:, ::-1] * 4.0
    best, most = ground.corners.mean(axis=0), 0.0
    squares = [ground.lines(axis)[1:-2] or ground.lines(axis)[:-1] for axis in (0, 1)]
    for x, y in product(*squares):
        point = np.array([x + STEP / 2, y + STEP / 2, ground.z])
        pixel = camera.project(point)
        if pixel is None or not len(far):
            continue
        clear = float(np.linalg.norm(far - pixel, axis=1).min())
        if clear > most:
            best, most = point, clear
    return best


def draw_grid(spec: mujoco.MjSpec, ground: Ground) -> None:
    """Draw the grid on the table of `spec`, in place; objects occlude it."""
    spec.add_material(name=GRID, rgba=[0.10, 0.12, 0.16, 0.55], specular=0.0)
    # Thin boxes slightly above the table.
    middle = (np.array(ground.low) + ground.high) / 2
    half = (np.array(ground.high) - ground.low) / 2
    z = ground.z + RAISED
    for x in ground.lines(0):
        add_box(spec, GRID, [x, middle[1], z], [LINE, half[1], LINE / 4])
    for y in ground.lines(1):
        add_box(spec, GRID, [middle[0], y, z], [half[0], LINE, LINE / 4])


def camera_of(view: mujoco.MjvCamera, fovy: float, width: int, height: int) -> Camera:
    """Convert a free camera to a pinhole camera; `fovy` in degrees."""
    forward, right, up = directions(view.azimuth, view.elevation)
    # MuJoCo's camera axes: x right, y up, and z backwards.
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, np.column_stack([right, up, -forward]).ravel())
    eye = np.array(view.lookat) - view.distance * forward
    return Camera(Pose(eye, quaternion), float(np.radians(fovy)), width, height)


def annotate(
    pixels: Pixels, camera: Camera, names: Mapping[str, Array], ground: Ground, things: Mask
) -> Pixels:
    """Draw names at positions (3,), m, grid coordinates and axes into a picture.

    Positions below the visible `ground` of the table are left out. Labels leave the pixels of `things` free.
    """
    # Leave out objects below the ground, which are not visible.
    names = {name: point for name, point in names.items() if point[2] > ground.z - HIDDEN}
    image = Image.fromarray(pixels)
    draw = ImageDraw.Draw(image)
    _draw_figures(draw, camera, ground)
    _draw_axes(draw, camera, ground)
    size = SMALL_TAG if len(names) > MANY else TAG
    for name, (foot, box) in _tags(things, draw, camera, names, size).items():
        left, top, right, bottom = box
        middle = ((left + right) / 2, (top + bottom) / 2)
        draw.line((*foot, *middle), fill=INK, width=2)
        draw.rounded_rectangle(box, 6, fill=HALO, outline=INK, width=2)
        draw.text(middle, name, font=_font(size), fill=INK, anchor="mm")
    return np.asarray(image)


def _tags(
    things: Mask, draw: ImageDraw.ImageDraw, camera: Camera, names: Mapping[str, Array], size: int
) -> dict[str, tuple[Pixel, Box]]:
    """Return for each name the pixel of its object and the box of its label.

    Labels do not overlap and cover as few pixels of `things` as possible.
    """
    height, width = things.shape
    # Names with a position inside the picture.
    seen: list[tuple[Pixel, str]] = []
    for name, point in names.items():
        foot = camera.project(point)
        if foot is not None and 0 <= foot[0] < width and 0 <= foot[1] < height:
            seen.append((foot, name))
    # The lowest object in the picture is nearest: place its label first.
    seen.sort(key=lambda item: -item[0][1])
    placed: dict[str, tuple[Pixel, Box]] = {}
    feet = [foot for foot, _ in seen]
    for foot, name in seen:
        # Candidate boxes, shifted into the picture.
        half_width = draw.textlength(name, font=_font(size)) / 2 + 8
        half_height = size / 2 + 5
        boxes: list[Box] = []
        for beside, above in PLACES:
            x = foot[0] + beside * (half_width + 16)
            y = foot[1] + above * (2 * half_height + 6)
            x = min(max(x, half_width + 4), width - half_width - 4)
            y = min(max(y, half_height + 4), height - half_height - 4)
            boxes.append((x - half_width, y - half_height, x + half_width, y + half_height))
        placed[name] = (foot, _clearest(things, foot, feet, boxes, placed.values()))
    return placed


def _clearest(
    things: Mask,
    foot: Pixel,
    feet: Sequence[Pixel],
    boxes: Sequence[Box],
    placed: Collection[tuple[Pixel, Box]],
) -> Box:
    """Return the box with the lowest cost, given the labels already placed.

    Fewer overlaps come first. Then the cost sums the hidden pixels of `things`, the distance to
    `foot`, line crossings, and other objects that are nearer.
    """

    def cost(box: Box) -> tuple[int, float]:
        # Count the object pixels under the label.
        left, top, right, bottom = (max(0, round(edge)) for edge in box)
        hidden = float(things[top:bottom, left:right].sum())
        astray = sum(_crosses(foot, box, other) for _, other in placed)
        astray += sum(_crosses(at, other, box) for at, other in placed)
        middle = (left + right) / 2, (top + bottom) / 2
        # A label nearer to another object would be ambiguous.
        away = dist(middle, foot)
        astray += sum(dist(middle, other) < away for other in feet)
        overlapped = sum(_overlap(box, other) for _, other in placed)
        return overlapped, hidden + FAR * away + ASTRAY * astray

    return min(boxes, key=cost)


def _crosses(foot: Pixel, label: Box, other: Box) -> bool:
    """True if the line from `foot` to the centre of its label crosses another box."""
    # Sample the line at 16 points.
    middle = np.array([(label[0] + label[2]) / 2, (label[1] + label[3]) / 2])
    line = np.linspace(foot, middle, 16)
    return bool(((line > other[:2]) & (line < other[2:])).all(axis=1).any())


def _overlap(one: Box, other: Box) -> bool:
    """True if two boxes overlap or are less than 4 pixels apart."""
    beside = one[2] + 4 < other[0] or other[2] + 4 < one[0]
    above = one[3] + 4 < other[1] or other[3] + 4 < one[1]
    return not (beside or above)


def _draw_figures(draw: ImageDraw.ImageDraw, camera: Camera, ground: Ground) -> None:
    """Write the coordinates at the ends of grid lines nearest to the camera."""
    # Edges on the camera's side, where the text is not occluded.
    eye = camera.pose_world_camera.position
    edges: list[float] = []
    for low, high, place in zip(ground.low, ground.high, eye[:2].tolist(), strict=True):
        edges.append(high + OUTSIDE if place > low else low - OUTSIDE)
    # The corner of both edges gets neither coordinate.
    for x in _thin_lines(ground.lines(0)[:-1]):
        _write(draw, camera, (x, edges[1], ground.z), f"x={x:.1f}", AXES["x"])
    for y in _thin_lines(ground.lines(1)[1:]):
        _write(draw, camera, (edges[0], y, ground.z), f"y={y:.1f}", AXES["y"])


def _thin_lines(lines: list[float]) -> list[float]:
    """Select at most `FIGURES` evenly spaced lines."""
    return lines[:: -(-len(lines) // FIGURES)]


def _draw_axes(draw: ImageDraw.ImageDraw, camera: Camera, ground: Ground) -> None:
    """Draw the axes of the world."""
    # A light outline keeps the axes visible on any table.
    origin, *tips = ground.axes
    start = camera.project(origin)
    for (name, colour), tip in zip(AXES.items(), tips, strict=True):
        end = camera.project(tip)
        if start is not None and end is not None:
            draw.line((*start, *end), fill=HALO, width=8)
            draw.line((*start, *end), fill=colour, width=4)
            _write(draw, camera, origin + 1.25 * (tip - origin), name, colour)


def _write(
    draw: ImageDraw.ImageDraw,
    camera: Camera,
    point: Array | tuple[float, float, float],
    text: str,
    colour: tuple[int, int, int],
) -> None:
    at = camera.project(np.asarray(point))
    if at is not None:
        font = _font(17)
        draw.text(at, text, font=font, fill=colour, anchor="mm", stroke_width=3, stroke_fill=HALO)


def _font(size: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    return ImageFont.load_default(size=size)
