"""Top-down grasps from geometry: where the hand closes on an object, and along which direction.

The closing direction (tool y) is one in which the object is narrower than the hand opens where the
pads are; the tool's x runs along the object, so that offsets along x stay on a handle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.geometry.outline import (
    Convex,
    Obstacle,
    above,
    clearance,
    profile,
    rectangle,
    slab,
    unit,
)
from palpate.geometry.pose import Array, Pose
from palpate.robots.description import RobotDescription

SPARE = 0.004
"""m: what must remain of the opening, for errors of the pose."""

GROUND = 0.005
"""m: that the fingertips stay above the support."""

HEADROOM = 0.005
"""m: between the palm and the top of what is grasped."""

SHALLOW = 0.02
"""m: how far below the top the TCP is where the hand has no room deeper down."""

SLANT = 0.3
"""Largest angle between the pads and a grasped side (tangent); a steeper one slides out."""

MOST_TURN = np.radians(165.0)
"""rad by which the tool may be turned against home: it takes the shorter way there, which beyond half a
turn is not the one that the arm's base and wrist add up to."""

WRIST_SPARE = 0.2
"""rad that the last joint keeps from its end where the other way round is taken."""

STATION = 0.005
"""m between places along an object where a grasp is tried."""


@dataclass(frozen=True, slots=True, eq=False)
class Grasp:
    """A derived grasp: TCP pose in the world, width there, and how far it may shift along the
    tool's x, m."""

    pose: Pose
    width: float
    slack: float
    problem: str = ""


def derive_grasp(
    arm: RobotDescription,
    geoms: Sequence[Convex],
    obstacles: Sequence[Obstacle],
    yaw: float,
    base: Pose,
) -> Grasp:
    """The grasp of an object made of convex `geoms` (in the world) among `obstacles`.

    `yaw` is the object's own direction (rad); the result has `problem` set when the hand cannot
    take the object.
    """
    cloud = np.concatenate([g.points for g in geoms])
    bottom, top = float(cloud[:, 2].min()), float(cloud[:, 2].max())
    obstacles = _around(arm, cloud, obstacles)
    best: Grasp | None = None
    for height in _heights(arm, bottom, top):
        lowest, highest = height - arm.tip, height + arm.tip
        outlines = [o for g in geoms if len(o := slab(g, lowest, highest)) > 2]
        nearby, tall = above(obstacles, lowest), above(obstacles, height + arm.hand.palm)
        found = [
            _along(arm, outlines, angle, height, nearby, tall, base)
            for angle in _angles(outlines, yaw, base)
        ]
        best = min(found if best is None else [*found, best], key=_badness, default=None)
        if best is not None and not best.problem:
            return best
    return best or _nothing(arm, cloud, yaw, base)


def turned_grasp(
    arm: RobotDescription,
    geoms: Sequence[Convex],
    obstacles: Sequence[Obstacle],
    pose_world_tcp: Pose,
    base: Pose,
) -> Grasp:
    """The grasp at the height of another one, at `pose_world_tcp`, with the fingers a quarter turn
    on."""
    height, closing = float(pose_world_tcp.position[2]), pose_world_tcp.rotation[:, 1]
    lowest, highest = height - arm.tip, height + arm.tip
    outlines = [o for g in geoms if len(o := slab(g, lowest, highest)) > 2]
    cloud = np.concatenate([g.points for g in geoms])
    obstacles = _around(arm, cloud, obstacles)
    if not outlines:
        return _nothing(arm, cloud, 0.0, base)
    angle = float(np.arctan2(closing[1], closing[0])) + np.pi / 2
    nearby, tall = above(obstacles, lowest), above(obstacles, height + arm.hand.palm)
    return _along(arm, outlines, angle, height, nearby, tall, base)


def _around(arm: RobotDescription, cloud: Array, obstacles: Sequence[Obstacle]) -> list[Obstacle]:
    """Select the obstacles that the hand could touch while it grasps."""
    width = 2 * arm.hand.half_extents[1]
    low, high = cloud.min(axis=0)[:2] - width, cloud.max(axis=0)[:2] + width
    return [
        o
        for o in obstacles
        if (o.outline.max(axis=0) > low).all() and (o.outline.min(axis=0) < high).all()
    ]


def _heights(arm: RobotDescription, bottom: float, top: float) -> list[float]:
    """Heights of the TCP to try: below the palm for tall objects, the middle of flat ones."""
    lowest = bottom + arm.tip + GROUND
    middle = (top - bottom) / 2
    depths = (arm.hand.palm - HEADROOM, SHALLOW)
    heights = [max(top - min(depth, middle), lowest) for depth in depths]
    return list(dict.fromkeys(heights))


def _angles(outlines: Sequence[Array], yaw: float, base: Pose) -> list[float]:
    """Closing directions worth trying: where a part is narrowest, and all around for round
    parts."""
    turn = np.arctan2(base.rotation[1, 0], base.rotation[0, 0])
    grid = yaw + np.deg2rad(np.arange(180))
    directions = np.column_stack([np.cos(grid), np.sin(grid)])
    angles: list[float] = []
    for outline in outlines:
        along = outline @ directions.T
        widths = along.max(axis=0) - along.min(axis=0)
        if widths.max() < 1.02 * widths.min():
            angles += [float(turn + np.pi / 2 + a) for a in np.deg2rad(np.arange(0, 180, 15))]
        else:
            lowest = (widths <= np.roll(widths, 1)) & (widths <= np.roll(widths, -1))
            angles += [float(a) for a in grid[lowest]]
    return list(dict.fromkeys(angles))[:60]


def _along(
    arm: RobotDescription,
    outlines: Sequence[Array],
    angle: float,
    height: float,
    nearby: Sequence[Array],
    tall: Sequence[Array],
    base: Pose,
) -> Grasp:
    """The best grasp that closes along `angle`."""
    across, along = unit(angle), unit(angle - np.pi / 2)
    ends = np.concatenate([o @ along for o in outlines])
    start, length = float(ends.min()) + 1e-6, float(np.ptp(ends)) - 2e-6
    count = max(int(length / STATION), 8)
    step = length / count
    stations: Array = start + step * np.arange(count + 1, dtype=float)
    low, high = profile(outlines, along, across, stations)
    facing = (np.abs(np.gradient(low, step)) <= SLANT) & (np.abs(np.gradient(high, step)) <= SLANT)
    window = max(int(np.ceil(arm.hand.pad / step)), 1)
    low, high = _spread(low, window, np.fmin), _spread(high, window, np.fmax)
    fits = facing & (high - low <= arm.hand.opening - SPARE)
    middle = (ends.max() + ends.min()) / 2
    at, slack = _best_station(stations, fits, middle)
    wide = float(np.interp(at, stations, high - low))
    centre = at * along + float(np.interp(at, stations, high + low)) / 2 * across
    problem = (
        ""
        if fits.any()
        else (
            f"it is {wide * 1000:.0f} mm wide where the hand could close; the hand takes "
            f"{arm.hand.opening * 1000:.0f} mm less {SPARE * 1000:.0f} mm to spare"
        )
    )
    if not problem and _hand_blocked(arm, centre, across, nearby, tall):
        problem = "its neighbours leave no room for the hand"
    return Grasp(_tool_pose(arm, centre, height, angle, base), wide, slack, problem)


def _spread(values: Array, window: int, pick: np.ufunc) -> Array:
    """The least or greatest value within `window` stations."""
    padded = np.pad(values, window, constant_values=np.nan)
    return pick.reduce(np.lib.stride_tricks.sliding_window_view(padded, 2 * window + 1), axis=1)


def _best_station(stations: Array, fits: NDArray[np.bool_], middle: float) -> tuple[float, float]:
    """The middle of the graspable stretch nearest the object's middle, and how far it reaches both
    ways."""
    if not fits.any():
        return middle, 0.0
    edges = np.flatnonzero(np.diff(np.concatenate([[0], fits.astype(int), [0]])))
    stretches = [(float(stations[a]), float(stations[b - 1])) for a, b in edges.reshape(-1, 2)]
    longest = max(b - a for a, b in stretches)
    first, last = min(
        (s for s in stretches if s[1] - s[0] >= longest / 2),
        key=lambda s: max(s[0] - middle, middle - s[1], 0.0),
    )
    return (first + last) / 2, (last - first) / 2


def _hand_blocked(
    arm: RobotDescription,
    centre: Array,
    across: Array,
    nearby: Sequence[Array],
    tall: Sequence[Array],
) -> bool:
    """Test if the opened fingers, or the palm above them, would overlap a neighbour."""
    reach = arm.hand.opening / 2 + arm.hand.finger / 2
    finger = rectangle(np.zeros(2), across, arm.hand.finger / 2, arm.hand.pad)
    spots = np.array([centre + reach * across, centre - reach * across])
    palm = rectangle(np.zeros(2), across, arm.hand.half_extents[1], arm.hand.half_extents[0])
    return bool(
        clearance(finger, spots, nearby).min() < 0.002
        or clearance(palm, centre[None], tall).min() < 0.002
    )


def _tool_pose(
    arm: RobotDescription, centre: Array, height: float, closing: float, base: Pose
) -> Pose:
    """Top-down with tool y along `closing`; of the two ways round, the one that turns the wrist
    less, unless the tool comes there from home the other way about."""
    away = centre - base.position[:2]
    azimuth = float(np.arctan2(away[1], away[0]))
    yaw = closing + np.pi / 2
    turned = (yaw - azimuth + np.pi / 2) % np.pi - np.pi / 2
    ahead = float(np.arctan2(*base.local((*centre, height))[1::-1]))
    if abs(ahead + turned) > MOST_TURN:
        other = turned - np.copysign(np.pi, turned)
        wrist = arm.home[6] - other
        if arm.limits.q_min[6] + WRIST_SPARE < wrist < arm.limits.q_max[6] - WRIST_SPARE:
            turned = other
    return Pose.top_down((*centre, height), azimuth + turned)


def _badness(grasp: Grasp) -> tuple[bool, int]:
    """Problems first, then width (to 3 mm)."""
    return bool(grasp.problem), round(grasp.width / 0.003)


def _nothing(arm: RobotDescription, cloud: Array, yaw: float, base: Pose) -> Grasp:
    centre = (cloud.max(axis=0) + cloud.min(axis=0))[:2] / 2
    return Grasp(
        _tool_pose(arm, centre, float(cloud[:, 2].max()), yaw, base),
        0.0,
        0.0,
        "it is too flat for the fingers",
    )
