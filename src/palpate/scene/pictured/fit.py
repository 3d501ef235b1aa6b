"""Shapes on a plane that fill what is seen of them through a pinhole camera."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from palpate.errors import InputError
from palpate.geometry.pose import Array
from palpate.scene.camera import Camera
from palpate.scene.pictured.objects import Fitted, SceneObject, Shape
from palpate.scene.pictured.sharpen import directions
from palpate.scene.poses import PoseEntry

FAR = 3.0
"""m: how far from the camera's foot anything may be."""

MISFIT = 0.04
"""Of the image's height: how far the sides of a fitted shape may be from the box."""


TURNS = (-30.0, 0.0, 30.0, 60.0)
"""degrees: from where the turn of a block is searched for."""
NECKS = ((0.95, 0.95), (0.6, 0.5))
"""Shares of height and width at which shoulder and neck are searched for: hardly any, and a bottle's."""
SCALES = np.array([0.1, 0.1, 0.1, 0.1, 0.5, 0.5])
"""m, and rad or a share: about how far the search steps."""

_CIRCLE = np.linspace(0, 2 * np.pi, 96, endpoint=False)
_RING = np.column_stack([np.cos(_CIRCLE), np.sin(_CIRCLE)])
_SQUARE = np.array([[1.0, 1.0], [1.0, -1.0], [-1.0, -1.0], [-1.0, 1.0]])


def fit(
    camera: Camera, thing: SceneObject, level: float, placed: PoseEntry | None = None
) -> Fitted:
    """The shape on the level plane at world z `level` that fills its box in the image; where it is,
    if `placed`.

    Raises:
        InputError: no such shape does; worded for the model.
    """
    found = _upright(camera, thing, level, placed)
    if thing.outline is None or placed is not None:
        return found
    if thing.shape == "box":
        return _turned(camera, thing, level, found)
    if thing.shape == "cylinder":
        return _necked(camera, thing, level, found)
    return found


def _upright(camera: Camera, thing: SceneObject, level: float, placed: PoseEntry | None) -> Fitted:
    """By the four sides of its box: a square block that is not turned, where it is not placed."""
    from scipy.optimize import least_squares

    left, top, right, bottom = thing.bbox
    width, height = camera.width, camera.height
    wanted = np.array([left * width, top * height, right * width, bottom * height])
    start = _start(camera, thing, wanted, level, placed)
    # Where a thing is placed, its x and y are given and only its size is left to find.
    yaw, free = 0.0, slice(0, None)
    if placed is not None:
        yaw, free = placed.yaw or 0.0, slice(2, None)

    def residual(chosen: Array) -> Array:
        values = start.copy()
        values[free] = chosen
        seen = projected(camera, _OUTLINES[thing.shape](values, level, yaw))
        return np.concatenate([seen.min(axis=0), seen.max(axis=0)]) - wanted

    low = np.array([-np.inf, -np.inf, 0.002, 0.002])[: len(start)][free]
    found = least_squares(
        residual, np.maximum(start[free], low * 1.01), bounds=(low, np.inf), x_scale=0.1
    )
    start[free] = found.x
    foot = camera.pose_world_camera.position[:2]
    misfit = 0.0
    if placed is None:
        misfit = float(np.abs(found.fun).max())
    if misfit > MISFIT * camera.height or np.hypot(*(start[:2] - foot)) > FAR:
        raise InputError(
            f"scene: no {thing.shape} standing at z = {level:.3f} m fills the bbox of '{thing.name}' "
            f"within {FAR:g} m of the camera; correct its shape, its bbox or the plane's height"
        )
    return _FITTED[thing.shape](thing, start, yaw)


def _turned(camera: Camera, thing: SceneObject, level: float, square: Fitted) -> Fitted:
    """A block of any ground plan, turned as its outline says."""
    half = square.width / 2
    starts = [[square.x, square.y, half, half, square.height / 2, yaw] for yaw in np.radians(TURNS)]
    low = [-np.inf, -np.inf, 0.002, 0.002, 0.002, -np.inf]
    high = [np.inf] * 6
    best = _outlined(camera, thing, lambda v: _cuboid(v, level), starts, low, high)
    return _block_of(thing, best)


def _necked(camera: Camera, thing: SceneObject, level: float, straight: Fitted) -> Fitted:
    """A cylinder around what may have a neck: as wide as its widest part, as high as its top."""
    radius, half = straight.width / 2, straight.height / 2
    starts = [[straight.x, straight.y, radius, half, *shares] for shares in NECKS]
    low = [-np.inf, -np.inf, 0.002, 0.002, 0.1, 0.1]
    high = [np.inf] * 4 + [1.0, 1.0]
    best = _outlined(camera, thing, lambda v: _bottle(v, level), starts, low, high)
    x, y, radius, half = map(float, best[:4])
    return Fitted(thing, x, y, 2 * radius, 2 * radius, 2 * half)


def _outlined(
    camera: Camera,
    thing: SceneObject,
    shape: Callable[[Array], Array],
    starts: Sequence[Sequence[float]],
    low: Sequence[float],
    high: Sequence[float],
) -> Array:
    """The numbers of a shape that reaches as far in each direction of the image as the outline of the
    thing does: the best that is found from some starts."""
    from scipy.optimize import least_squares

    assert thing.outline is not None
    ways = directions(len(thing.outline))
    size = np.array([camera.width, camera.height])
    reach = (np.array(thing.outline) * size @ ways.T).max(axis=0)

    def residual(values: Array) -> Array:
        return (projected(camera, shape(values)) @ ways.T).max(axis=0) - reach

    tries = [
        least_squares(residual, start, bounds=(low, high), x_scale=SCALES, loss="soft_l1")
        for start in starts
    ]
    return min(tries, key=lambda found: float(found.cost)).x


def _block_of(thing: SceneObject, values: Array) -> Fitted:
    """A turned block, by the turn of at most 45° that makes it the same."""
    x, y, half, half_depth, half_height, yaw = map(float, values)
    quarters = round(yaw / (np.pi / 2))
    if quarters % 2:
        half, half_depth = half_depth, half
    turn = yaw - quarters * np.pi / 2
    return Fitted(thing, x, y, 2 * half, 2 * half_depth, 2 * half_height, turn)


def _bottle(values: Array, level: float) -> Array:
    """Rings at the foot, at the shoulder and at the top: the last two by shares of height and width."""
    x, y, radius, half, shoulder, neck = values
    ring, top = radius * _RING, neck * radius * _RING
    middle = np.array([x, y])
    return np.concatenate(
        [
            _raised(middle + ring, level),
            _raised(middle + ring, level + shoulder * 2 * half),
            _raised(middle + top, level + 2 * half),
        ]
    )


def _cuboid(values: Array, level: float) -> Array:
    x, y, half, half_depth, half_height, yaw = values
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    corners = np.array([x, y]) + _SQUARE * np.array([half, half_depth]) @ turn.T
    return np.concatenate([_raised(corners, level), _raised(corners, level + 2 * half_height)])


def projected(camera: Camera, points: Array) -> Array:
    """(n, 2) pixels of (n, 3) world points; what is behind the camera is pushed far out of the
    image."""
    local = (points - camera.pose_world_camera.position) @ camera.pose_world_camera.rotation
    depth = np.maximum(-local[:, 2], 1e-2)
    right = camera.width / 2 + camera.focal * local[:, 0] / depth
    down = camera.height / 2 - camera.focal * local[:, 1] / depth
    return np.column_stack([right, down])


def _start(
    camera: Camera, thing: SceneObject, box: Array, level: float, placed: PoseEntry | None
) -> Array:
    """Start of the fit: x, y and half extents, m."""
    middle, foot = (box[0] + box[2]) / 2, box[3]
    if thing.shape == "plane":
        foot = (box[1] + box[3]) / 2
    at = camera.on_plane(float(middle), float(foot), level)
    if at is None:
        raise InputError(
            f"scene: the bbox of '{thing.name}' is above the horizon of a plane at z = {level:.3f} m"
        )
    distance = float(np.linalg.norm(at - camera.pose_world_camera.position))
    half = np.clip(distance * (box[2:] - box[:2]) / camera.focal / 2, 0.005, 1.0)
    x, y = at[:2]
    if placed is not None:
        x, y = placed.pos[:2]
    if thing.shape == "sphere":
        half = half[:1]
    return np.array([x, y, *half])


def _cylinder(values: Array, level: float, _: float) -> Array:
    x, y, radius, half = values
    ring = np.array([x, y]) + radius * _RING
    return np.concatenate([_raised(ring, level), _raised(ring, level + 2 * half)])


def _block(values: Array, level: float, yaw: float) -> Array:
    x, y, half, half_height = values
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    corners = np.array([x, y]) + half * _SQUARE @ turn.T
    return np.concatenate([_raised(corners, level), _raised(corners, level + 2 * half_height)])


def _ball(values: Array, level: float, _: float) -> Array:
    x, y, radius = values
    rings: list[Array] = []
    for tilt in np.linspace(-np.pi / 2, np.pi / 2, 17):
        ring = np.array([x, y]) + radius * np.cos(tilt) * _RING
        rings.append(_raised(ring, level + radius * (1 + np.sin(tilt))))
    return np.concatenate(rings)


def _slab(values: Array, level: float, _: float) -> Array:
    return _raised(values[:2] + values[2:] * _SQUARE, level)


def _raised(outline: Array, z: float) -> Array:
    return np.column_stack([outline, np.full(len(outline), z)])


_OUTLINES: Mapping[Shape, Callable[[Array, float, float], Array]] = {
    "cylinder": _cylinder,
    "box": _block,
    "sphere": _ball,
    "plane": _slab,
}

_FITTED: Mapping[Shape, Callable[[SceneObject, Array, float], Fitted]] = {
    "cylinder": lambda t, v, _: Fitted(t, v[0], v[1], 2 * v[2], 2 * v[2], 2 * v[3]),
    "box": lambda t, v, yaw: Fitted(t, v[0], v[1], 2 * v[2], 2 * v[2], 2 * v[3], yaw),
    "sphere": lambda t, v, _: Fitted(t, v[0], v[1], 2 * v[2], 2 * v[2], 2 * v[2]),
    "plane": lambda t, v, _: Fitted(t, v[0], v[1], 2 * v[2], 2 * v[3], 0.0),
}
