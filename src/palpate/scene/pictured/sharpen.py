"""Refinement of detected boxes: a model's boxes are rough, the pixels are exact.

What a thing stands on has a colour; shadows make it darker, not another colour. What is in the
picture of another colour, in one piece, of about the box's size and near to it, is the thing. Where
that is in doubt (a patterned table, a thing of the table's colour, two things in one piece) the
model's box stays as it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from palpate.geometry.pose import Array
from palpate.scene.pictured.objects import SceneObject

SPREADS = 5.0
"""Robust standard deviations from the table's colour at which something is of another: a Gaussian has
six in ten million farther off."""
FINEST = 0.012
"""Least standard deviation of a colour's share: three steps of 8 bits, as JPEG leaves them."""
SHADOW, GLARE = 0.35, 1.25
"""Of the table's brightness: as dark as its shadow, as bright as its shine may be."""
NEAR = 0.12
"""Of the image's diagonal: how far from the model's box a thing is looked for."""
ALIKE = 0.6
"""A thing is between so many times, and one by so many, as wide and high as its box."""
LEAST = 40
"""Pixels: smaller pieces are none."""
POINTS = 32
"""Directions in which a thing's outline is kept."""

Pixels = NDArray[np.uint8]
Mask = NDArray[np.bool_]
Box = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True, eq=False)
class Piece:
    """Connected region of another colour than the table: `box` (left, top, right, bottom) and
    `outline` (n, 2), in pixels."""

    box: Box
    outline: Array


def sharpened(objects: Sequence[SceneObject], pixels: Pixels) -> tuple[SceneObject, ...]:
    """The objects, their boxes as exact as `pixels` (height, width, 3) are, where those are clear."""
    planes = [thing for thing in objects if thing.shape == "plane"]
    things = [thing for thing in objects if thing.shape != "plane" and thing.outline is None]
    if not planes or not things:
        return tuple(objects)
    pieces = _pieces(pixels, planes)
    size = np.array([pixels.shape[1], pixels.shape[0]], dtype=float)
    exact = {thing.name: _own_piece(thing, things, pieces, size) for thing in things}
    found: list[SceneObject] = []
    for thing in objects:
        piece = exact.get(thing.name)
        found.append(thing if piece is None else _exact(thing, piece, size))
    return tuple(found)


def _pieces(pixels: Pixels, planes: Sequence[SceneObject]) -> list[Piece]:
    """Everything on the planes that is of another colour than they are."""
    from scipy.ndimage import (
        binary_closing,
        binary_fill_holes,
        binary_opening,
        find_objects,
        label,
    )

    pieces: list[Piece] = []
    for plane in planes:
        left, top, right, bottom = _in_pixels(plane.bbox, pixels)
        view = pixels[top:bottom, left:right]
        if view.size == 0:
            continue
        other = binary_opening(_other_colour(view), iterations=1)
        other = binary_fill_holes(binary_closing(other, iterations=3))
        labels, _ = label(other)
        for number, (rows, columns) in enumerate(find_objects(labels), start=1):
            mask: Mask = labels[rows, columns] == number
            touches = _touches(rows, columns, view.shape)
            if mask.sum() >= LEAST and not touches:
                pieces.append(_piece(mask, left + columns.start, top + rows.start))
    return pieces


def _other_colour(view: Pixels) -> Mask:
    """Mask of pixels of another colour, or brighter or darker than light and shadow explain."""
    light = view.astype(float).sum(axis=2) + 3.0
    shares = (view[..., :2] + 1.0) / light[..., None]
    middle = np.median(shares.reshape(-1, 2), axis=0)
    spread = 1.4826 * np.median(np.abs(shares - middle).reshape(-1, 2), axis=0)
    off = np.abs(shares - middle) / np.maximum(spread, FINEST / 3)
    usual = float(np.median(light))
    unlit = (light < SHADOW * usual) | (light > GLARE * usual)
    return (off.max(axis=2) > SPREADS) | unlit


def _touches(rows: slice, columns: slice, shape: tuple[int, ...]) -> bool:
    """True if a piece reaches the edge of what is looked at: it may go on beyond."""
    return not (
        rows.start > 0 and columns.start > 0 and rows.stop < shape[0] and columns.stop < shape[1]
    )


def _piece(mask: Mask, left: int, top: int) -> Piece:
    """A mask's corner points, in the directions of `POINTS`, and its box."""
    rows, columns = np.nonzero(mask)
    # A pixel's edges, not its middle: what ends at pixel 9 is ten wide.
    edge = [(dx, dy) for dx in (0, 1) for dy in (0, 1)]
    corners = [np.column_stack([left + columns + dx, top + rows + dy]) for dx, dy in edge]
    points: Array = np.concatenate(corners).astype(float)
    outline = points[np.argmax(points @ directions(POINTS).T, axis=0)]
    (west, north), (east, south) = points.min(axis=0), points.max(axis=0)
    return Piece((float(west), float(north), float(east), float(south)), outline)


def directions(count: int) -> Array:
    """(count, 2) unit vectors around the full circle."""
    turn = np.arange(count) * 2 * np.pi / count
    return np.column_stack([np.cos(turn), np.sin(turn)])


def _own_piece(
    thing: SceneObject, things: Sequence[SceneObject], pieces: Sequence[Piece], size: Array
) -> Piece | None:
    """The piece nearest to a thing's box that is as large, unless another thing's box is nearer."""
    reach = NEAR * float(np.hypot(*size))
    near = [piece for piece in pieces if _alike(thing, piece, size)]
    if not near:
        return None
    nearest = min(near, key=lambda piece: _distance(thing, piece, size))
    mine = _distance(thing, nearest, size)
    others = [_distance(other, nearest, size) for other in things if other is not thing]
    if mine > reach or min(others, default=np.inf) <= mine:
        return None
    return nearest


def _alike(thing: SceneObject, piece: Piece, size: Array) -> bool:
    box = np.array(thing.bbox).reshape(2, 2) * size
    found = np.array(piece.box).reshape(2, 2)
    ratio = (found[1] - found[0]) / (box[1] - box[0])
    return bool(((ratio > ALIKE) & (ratio < 1 / ALIKE)).all())


def _distance(thing: SceneObject, piece: Piece, size: Array) -> float:
    """Pixels between the middles of a thing's box and of a piece's."""
    mine = np.array(thing.bbox).reshape(2, 2).mean(axis=0) * size
    theirs = np.array(piece.box).reshape(2, 2).mean(axis=0)
    return float(np.linalg.norm(mine - theirs))


def _exact(thing: SceneObject, piece: Piece, size: Array) -> SceneObject:
    left, top, right, bottom = (np.array(piece.box).reshape(2, 2) / size).ravel().tolist()
    outline = tuple((x, y) for x, y in (piece.outline / size).round(5).tolist())
    return replace(thing, bbox=(left, top, right, bottom), outline=outline)


def _in_pixels(box: Box, pixels: Pixels) -> tuple[int, int, int, int]:
    height, width = pixels.shape[:2]
    left, top, right, bottom = box
    return round(left * width), round(top * height), round(right * width), round(bottom * height)
