"""Detections of a model in a picture, and their refinement by the picture's edges."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from palpate.common.errors import InputError
from palpate.common.pose import Array

Shape = Literal["box", "cylinder", "sphere", "plane"]


@dataclass(frozen=True, slots=True)
class SceneObject:
    """An object or a support plane that a model detected in a picture."""

    name: str  # name, as in the name of its pose
    shape: Shape  # primitive shape; `plane` is a support
    # (left, top, right, bottom) in the image, as fractions of its width and height.
    bbox: tuple[float, float, float, float]
    height: float | None = None  # the model's estimate of the world z of a plane's top, m; or None
    # Corner points (x, y) of its silhouette, as fractions; None if only its box is known.
    outline: tuple[tuple[float, float], ...] | None = None


@dataclass(frozen=True, slots=True)
class FittedShape:
    """A shape in the world.

    `x` and `y` are its middle; these, `width`, `depth` and `height` are in m. `yaw` is in rad.
    """

    item: SceneObject
    x: float
    y: float
    width: float
    depth: float
    height: float
    yaw: float = 0.0


RIM = 0.03  # m, least margin of a plane around the objects on it
FOOT = 0.20  # m, radius around the arm's foot: its base extends so far, and its hand stays outside


def split_planes(objects: Sequence[SceneObject]) -> tuple[list[SceneObject], list[SceneObject]]:
    """Sort detections into planes and objects; an `InputError` without a plane, or for a name given twice."""
    for name, following in pairwise(sorted(item.name for item in objects)):
        if name == following:
            raise InputError(f"scene: '{name}' is listed twice; give every object its own name")
    planes = [item for item in objects if item.shape == "plane"]
    if not planes:
        raise InputError("scene: no support is listed; list what carries the objects as a 'plane'")
    return planes, [item for item in objects if item.shape != "plane"]


def is_mount(shape: FittedShape) -> bool:
    """True if a shape is at the arm's foot: base, pedestal, or part of the arm itself."""
    return float(np.hypot(shape.x, shape.y)) < FOOT


def support_of(item: SceneObject, planes: Sequence[SceneObject]) -> SceneObject:
    """The smallest plane whose box contains the foot of the object's box, else the largest."""
    # The foot of an object is the middle of the lower edge of its box.
    x, y = (item.bbox[0] + item.bbox[2]) / 2, item.bbox[3]

    def area(plane: SceneObject) -> float:
        left, top, right, bottom = plane.bbox
        return (right - left) * (bottom - top)

    below: list[SceneObject] = []
    for plane in planes:
        left, top, right, bottom = plane.bbox
        if left <= x <= right and top <= y <= bottom:
            below.append(plane)
    return min(below, key=area) if below else max(planes, key=area)


def widen_slab(slab: FittedShape, standing: Sequence[FittedShape]) -> FittedShape:
    """The slab, enlarged so that it reaches `RIM` beyond the objects on it."""
    # Edges of the slab, moved outwards where an object with its margin is beyond them.
    left, right = slab.x - slab.width / 2, slab.x + slab.width / 2
    near, far = slab.y - slab.depth / 2, slab.y + slab.depth / 2
    for shape in standing:
        across, along = shape.width / 2 + RIM, shape.depth / 2 + RIM
        left, right = min(left, shape.x - across), max(right, shape.x + across)
        near, far = min(near, shape.y - along), max(far, shape.y + along)
    return FittedShape(
        slab.item, (left + right) / 2, (near + far) / 2, right - left, far - near, 0.0
    )


# Refinement of detected boxes by pixels: the model's boxes are rough.


# Number of robust standard deviations from the table's colour for a pixel of another colour. Six in
# ten million pixels of a Gaussian distribution are beyond it.
SPREADS = 5.0
FINEST = 0.012  # Least standard deviation of a colour's share: three steps of 8 bits, as JPEG noise
# Brightness limits of the table's shadow and glare, relative to its usual brightness.
SHADOW, GLARE = 0.35, 1.25
NEAR = 0.12  # Search distance around the model's box, relative to the image's diagonal
ALIKE = 0.6  # Least ratio of widths and of heights between region and box, in both senses
BARE = 0.05  # Largest share of pixels of another colour in a box of bare table
LEAST = 40  # Least number of pixels of a region
POINTS = 32  # Number of directions in which an outline is sampled
Pixels = NDArray[np.uint8]
Mask = NDArray[np.bool_]
Box = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True, eq=False)
class ColourRegion:
    """Region of another colour than the table: `box` (left, top, right, bottom), `outline` (n, 2), pixels."""

    box: Box
    outline: Array


def sharpen_boxes(objects: Sequence[SceneObject], pixels: Pixels) -> tuple[SceneObject, ...]:
    """Refine boxes and add outlines by `pixels` (height, width, 3), if these are unambiguous.

    Raises InputError: a box shows bare table, and a region of its size is elsewhere.
    """
    planes = [item for item in objects if item.shape == "plane"]
    items = [item for item in objects if item.shape != "plane" and item.outline is None]
    if not planes or not items:
        return tuple(objects)
    pieces = _pieces(pixels, planes)
    size = np.array([pixels.shape[1], pixels.shape[0]], dtype=float)
    # Assign regions to boxes; a box of bare table near a free region is an error.
    pieces_of = {item.name: _own_piece(item, items, pieces, size) for item in items}
    sharpened: list[SceneObject] = []
    for item in objects:
        piece = pieces_of.get(item.name)
        if piece is None and item in items and _shows_table(item, planes, pixels):
            others = [other for other in items if other is not item]
            free = [p for p in pieces if not any(_overlap(other, p, size) for other in others)]
            _refuse_bare(
                item, [piece for piece in free if _is_similar_size(item, piece, size)], size
            )
        if piece is not None:
            # Box and outline of the region as fractions of the image.
            left, top, right, bottom = (np.array(piece.box).reshape(2, 2) / size).ravel().tolist()
            outline = tuple((x, y) for x, y in (piece.outline / size).round(5).tolist())
            item = replace(item, bbox=(left, top, right, bottom), outline=outline)
        sharpened.append(item)
    return tuple(sharpened)


def _pieces(pixels: Pixels, planes: Sequence[SceneObject]) -> list[ColourRegion]:
    """Connected regions within planes, of another colour than the plane."""
    from scipy.ndimage import binary_closing, binary_fill_holes, binary_opening, find_objects, label

    pieces: list[ColourRegion] = []
    for plane in planes:
        height, width = pixels.shape[:2]
        left, right = round(plane.bbox[0] * width), round(plane.bbox[2] * width)
        top, bottom = round(plane.bbox[1] * height), round(plane.bbox[3] * height)
        view = pixels[top:bottom, left:right]
        if view.size == 0:
            continue
        # Remove single pixels, close gaps, fill holes, and label connected regions.
        other = binary_opening(_other_colour(view), iterations=1)
        other = binary_fill_holes(binary_closing(other, iterations=3))
        labels, _ = label(other)
        for number, (rows, columns) in enumerate(find_objects(labels), start=1):
            mask: Mask = labels[rows, columns] == number
            # A region at the edge of the plane's box may continue outside of it.
            is_inside = rows.start > 0 and columns.start > 0
            is_inside &= rows.stop < view.shape[0] and columns.stop < view.shape[1]
            if mask.sum() >= LEAST and is_inside:
                pieces.append(_piece(mask, left + columns.start, top + rows.start))
    return pieces


def _other_colour(view: Pixels) -> Mask:
    """Mask of pixels of another colour, or brighter or darker than the table's glare and shadow."""
    # Shares of red and green do not depend on the brightness. Their median is the table's colour.
    light = view.astype(float).sum(axis=2) + 3.0
    shares = (view[..., :2] + 1.0) / light[..., None]
    middle = np.median(shares.reshape(-1, 2), axis=0)
    # Median absolute deviation, scaled to a Gaussian's standard deviation.
    spread = 1.4826 * np.median(np.abs(shares - middle).reshape(-1, 2), axis=0)
    off = np.abs(shares - middle) / np.maximum(spread, FINEST / 3)
    # Brightness outside of the range from shadow to glare.
    usual = float(np.median(light))
    unlit = (light < SHADOW * usual) | (light > GLARE * usual)
    return (off.max(axis=2) > SPREADS) | unlit


def _piece(mask: Mask, left: int, top: int) -> ColourRegion:
    """Box of a mask, and its extreme pixel corners in `POINTS` directions."""
    rows, columns = np.nonzero(mask)
    # Corners of the pixels, not their middles: a region from pixel 0 to 9 is ten wide.
    edge = [(dx, dy) for dx in (0, 1) for dy in (0, 1)]
    corners = [np.column_stack([left + columns + dx, top + rows + dy]) for dx, dy in edge]
    points: Array = np.concatenate(corners).astype(float)
    outline = points[np.argmax(points @ directions(POINTS).T, axis=0)]
    (west, north), (east, south) = points.min(axis=0), points.max(axis=0)
    return ColourRegion((float(west), float(north), float(east), float(south)), outline)


def directions(count: int) -> Array:
    """(count, 2) unit vectors around the full circle."""
    turn = np.arange(count) * 2 * np.pi / count
    return np.column_stack([np.cos(turn), np.sin(turn)])


def _own_piece(
    item: SceneObject, items: Sequence[SceneObject], pieces: Sequence[ColourRegion], size: Array
) -> ColourRegion | None:
    """The nearest region of similar size to a box, unless another object's box is nearer to it."""
    reach = NEAR * float(np.hypot(*size))
    near = [piece for piece in pieces if _is_similar_size(item, piece, size)]
    if not near:
        return None
    nearest = min(near, key=lambda piece: _distance(item, piece, size))
    # The assignment must be mutual: no other box may be nearer to the region.
    own = _distance(item, nearest, size)
    others = [_distance(other, nearest, size) for other in items if other is not item]
    if own > reach or min(others, default=np.inf) <= own:
        return None
    return nearest


def _is_similar_size(item: SceneObject, piece: ColourRegion, size: Array) -> bool:
    """True if a region and an object's box have similar width and height."""
    box, corners = np.array(item.bbox).reshape(2, 2) * size, np.array(piece.box).reshape(2, 2)
    # Ratios of width and height must be in [ALIKE, 1 / ALIKE].
    ratio = (corners[1] - corners[0]) / (box[1] - box[0])
    return bool(((ratio > ALIKE) & (ratio < 1 / ALIKE)).all())


def _overlap(item: SceneObject, piece: ColourRegion, size: Array) -> bool:
    """True if an object's box and a region's have pixels in common."""
    box, corners = np.array(item.bbox).reshape(2, 2) * size, np.array(piece.box).reshape(2, 2)
    return bool((box[0] < corners[1]).all() and (corners[0] < box[1]).all())


def _shows_table(item: SceneObject, planes: Sequence[SceneObject], pixels: Pixels) -> bool:
    """True if a box within a plane's box shows only the plane's colour."""
    size = np.array([pixels.shape[1], pixels.shape[0]])
    for plane in planes:
        first, last = (np.array(plane.bbox).reshape(2, 2) * size).round().astype(int)
        low, high = (np.array(item.bbox).reshape(2, 2) * size).round().astype(int)
        if (low < first).any() or (high > last).any() or (high <= low).any():
            continue
        # Share of pixels of another colour in the box, with the plane as reference.
        other = _other_colour(pixels[first[1] : last[1], first[0] : last[0]])
        (left, top), (right, bottom) = low - first, high - first
        return bool(other[top:bottom, left:right].mean() < BARE)
    return False


def _refuse_bare(item: SceneObject, alike: Sequence[ColourRegion], size: Array) -> None:
    """Refuse a box of bare table if the picture has a region of its size elsewhere, in words for the model."""
    if not alike:
        return
    # State the nearest candidate, so that the model can compare it with its box.
    nearest = min(alike, key=lambda piece: _distance(item, piece, size))
    box = np.array(nearest.box).reshape(2, 2) / size
    wide, high = 100 * (box[1] - box[0])
    left, top, right, bottom = item.bbox
    off = 100 * _distance(item, nearest, size) / float(np.hypot(*size))
    shown = ", ".join(f"{edge:.3f}" for edge in box.ravel().tolist())
    raise InputError(
        f"scene: the box of '{item.name}', {100 * (right - left):.0f} % x {100 * (bottom - top):.0f} % of the image, "
        f"shows bare table; the nearest region of about its size, {wide:.0f} % x {high:.0f} %, is {off:.0f} % of "
        f"the image's diagonal away: look again, and correct the box of '{item.name}', perhaps to [{shown}]"
    )


def _distance(item: SceneObject, piece: ColourRegion, size: Array) -> float:
    """Distance between the middles of an object's box and of a region's, pixels."""
    centre = np.array(item.bbox).reshape(2, 2).mean(axis=0) * size
    piece_centre = np.array(piece.box).reshape(2, 2).mean(axis=0)
    return float(np.linalg.norm(centre - piece_centre))
