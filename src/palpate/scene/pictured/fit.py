"""Fits of shapes on a level plane to their boxes or outlines in the image of a pinhole camera."""

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
"""m: largest horizontal distance of a shape from the camera."""

MISFIT = 0.04
"""Largest distance between the sides of a fitted shape and of the box, relative to the image's height."""

TURNS = (-30.0, 0.0, 30.0, 60.0)
"""degrees: initial yaws of a block."""
NECKS = ((0.95, 0.95), (0.6, 0.5))
"""Initial shoulder and neck as shares of height and width: nearly none, and a bottle's."""
SCALES = np.array([0.1, 0.1, 0.1, 0.1, 0.5, 0.5])
"""m, and rad or a share: scales of the parameters in the search."""

_CIRCLE = np.linspace(0, 2 * np.pi, 96, endpoint=False)
_RING = np.column_stack([np.cos(_CIRCLE), np.sin(_CIRCLE)])
_SQUARE = np.array([[1.0, 1.0], [1.0, -1.0], [-1.0, -1.0], [-1.0, 1.0]])


def fit(
    camera: Camera, thing: SceneObject, level: float, placed: PoseEntry | None = None
) -> Fitted:
    """Fit a shape on the level plane at world z `level` to its box in the image, at `placed` if given.

    Raises:
        InputError: no such shape fits; worded for the model.
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
    """Fit to the four sides of its box; a block is square, and turned only where it is placed."""
    from scipy.optimize import least_squares

    left, top, right, bottom = thing.bbox
    width, height = camera.width, camera.height
    wanted = np.array([left * width, top * height, right * width, bottom * height])
    start = _start(camera, thing, wanted, level, placed)
    # Where an object is placed, x and y are given and only the size is fitted.
    yaw, free = 0.0, slice(0, None)
    if placed is not None:
        yaw, free = placed.yaw or 0.0, slice(2, None)

    def residual(chosen: Array) -> Array:
        values = start.copy()
        values[free] = chosen
        seen = projected(camera, _OUTLINES[thing.shape](values, level, yaw))
        return np.concatenate([seen.min(axis=0), seen.max(axis=0)]) - wanted

    low = np.array([-np.inf, -np.inf, 0.002, 0.002])[: len(start)][free]
    # Sizes are at least 2 mm; the start must be inside of the bounds.
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
    """Fit a block with any two sides and yaw to its outline."""
    half = square.width / 2
    starts = [[square.x, square.y, half, half, square.height / 2, yaw] for yaw in np.radians(TURNS)]
    low = [-np.inf, -np.inf, 0.002, 0.002, 0.002, -np.inf]
    high = [np.inf] * 6
    best = _outlined(camera, thing, lambda v: _cuboid(v, level), starts, low, high)
    x, y, half, half_depth, half_height, yaw = map(float, best)
    # The same block turned by at most 45°: quarter turns exchange its sides.
    quarters = round(yaw / (np.pi / 2))
    if quarters % 2:
        half, half_depth = half_depth, half
    turn = yaw - quarters * np.pi / 2
    return Fitted(
        thing, x, y, width=2 * half, depth=2 * half_depth, height=2 * half_height, yaw=turn
    )


def _necked(camera: Camera, thing: SceneObject, level: float, straight: Fitted) -> Fitted:
    """Fit a cylinder that encloses an object with a neck: its widest part and its top."""
    radius, half = straight.width / 2, straight.height / 2
    starts = [[straight.x, straight.y, radius, half, *shares] for shares in NECKS]
    low = [-np.inf, -np.inf, 0.002, 0.002, 0.1, 0.1]
    high = [np.inf] * 4 + [1.0, 1.0]
    best = _outlined(camera, thing, lambda v: _bottle(v, level), starts, low, high)
    x, y, radius, half = map(float, best[:4])
    return Fitted(thing, x, y, width=2 * radius, depth=2 * radius, height=2 * half)


def _outlined(
    camera: Camera,
    thing: SceneObject,
    shape: Callable[[Array], Array],
    starts: Sequence[Sequence[float]],
    low: Sequence[float],
    high: Sequence[float],
) -> Array:
    """Parameters of the shape whose extent in each direction of the image is that of the object's
    outline; the best of the fits from `starts`."""
    from scipy.optimize import least_squares

    assert thing.outline is not None
    # The support function of both: the largest projection on each of the outline's directions.
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


def _bottle(values: Array, level: float) -> Array:
    """(n, 3) rings at the foot, the shoulder and the top; shares of height and width place the last two."""
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
    """(8, 3) corners."""
    x, y, half, half_depth, half_height, yaw = values
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    corners = np.array([x, y]) + _SQUARE * np.array([half, half_depth]) @ turn.T
    return np.concatenate([_raised(corners, level), _raised(corners, level + 2 * half_height)])


def projected(camera: Camera, points: Array) -> Array:
    """(n, 2) pixels of (n, 3) world points; points behind the camera are far outside of the image."""
    local = (points - camera.pose_world_camera.position) @ camera.pose_world_camera.rotation
    depth = np.maximum(-local[:, 2], 1e-2)
    right = camera.width / 2 + camera.focal * local[:, 0] / depth
    down = camera.height / 2 - camera.focal * local[:, 1] / depth
    return np.column_stack([right, down])


def _start(
    camera: Camera, thing: SceneObject, box: Array, level: float, placed: PoseEntry | None
) -> Array:
    """Initial x, y and half extents, m."""
    # An object stands where the lower edge of its box meets the plane; a plane lies at its middle.
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


def _ball(values: Array, level: float, _: float) -> Array:
    x, y, radius = values
    rings: list[Array] = []
    for tilt in np.linspace(-np.pi / 2, np.pi / 2, 17):
        ring = np.array([x, y]) + radius * np.cos(tilt) * _RING
        rings.append(_raised(ring, level + radius * (1 + np.sin(tilt))))
    return np.concatenate(rings)


def _raised(outline: Array, z: float) -> Array:
    """(n, 3) points of an outline (n, 2) at height z."""
    return np.column_stack([outline, np.full(len(outline), z)])


_OUTLINES: Mapping[Shape, Callable[[Array, float, float], Array]] = {
    "cylinder": _cylinder,
    "box": lambda v, level, yaw: _cuboid(np.array([*v[:3], v[2], v[3], yaw]), level),
    "sphere": _ball,
    "plane": lambda v, level, _: _raised(v[:2] + v[2:] * _SQUARE, level),
}

_FITTED: Mapping[Shape, Callable[[SceneObject, Array, float], Fitted]] = {
    "cylinder": lambda t, v, _: Fitted(t, v[0], v[1], 2 * v[2], 2 * v[2], 2 * v[3]),
    "box": lambda t, v, yaw: Fitted(t, v[0], v[1], 2 * v[2], 2 * v[2], 2 * v[3], yaw),
    "sphere": lambda t, v, _: Fitted(t, v[0], v[1], 2 * v[2], 2 * v[2], 2 * v[2]),
    "plane": lambda t, v, _: Fitted(t, v[0], v[1], 2 * v[2], 2 * v[3], 0.0),
}
