"""Free spots of surfaces: for touching the surface, and for putting down objects."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from palpate.common.outline import Obstacle, above, clearance, rectangle
from palpate.common.pose import Array, Pose
from palpate.robots.description import RobotDescription
from palpate.robots.sheet import Reach

# m, margins between hand and nearest object; the largest one that leaves a free spot is used.
MARGINS = (0.06, 0.04, 0.02, 0.005)
APPROACH = 0.10  # m: height of a surface's approach pose above it
# m, largest error of the guessed z of a surface of unknown height. Until it is touched, motions
# keep this clearance from it and from the bodies on it.
GUESSED = 0.05
STEP = 0.02  # m: spacing of the grid of candidate spots
SEARCH = 1.0  # m: half extent of the grid of candidate spots
TOUCHING = 0.012  # m: half extent of the closed fingertips


def reachable(reach: Reach, spots: Array, z: float, base: Pose) -> NDArray[np.bool_]:
    """Mask (n,) of the `spots` (n, 2) at height `z` that the TCP reaches, tool down; a quick estimate."""
    local = (np.column_stack([spots, np.full(len(spots), z)]) - base.position) @ base.rotation
    # Distance and azimuth from the base's axis: the arm reaches ahead, and 100° to either side.
    flat = np.hypot(local[:, 0], local[:, 1])
    azimuth = np.abs(np.arctan2(local[:, 1], local[:, 0]))
    # Distance from the shoulder to the wrist's centre, which is above the TCP.
    stretched = np.hypot(flat, local[:, 2] + reach.wrist - reach.shoulder)
    ahead = (flat >= reach.nearest) & (flat <= reach.farthest) & (azimuth <= np.deg2rad(100))
    return ahead & (stretched <= reach.stretched)


def free_spot(
    reach: Reach,
    shape: Array,
    footing: Array,
    top: Array,
    obstacles: Sequence[Array],
    near: Array,
    z: float,
    base: Pose,
) -> tuple[Array, float] | None:
    """The best spot (2,) with its margin, m; None if none is in reach.

    `shape` must be clear of the obstacles, and `footing` on the surface. Both are (k, 2) about the
    spot; `top` (n, 3) are the points of the surface. The best spot is near `near` and the arm's
    preferred distance, and not at the edge.
    """
    # Largest margin of `MARGINS` that at least one reachable spot keeps.
    spots = _grid(footing, top, near)
    spots = spots[reachable(reach, spots, z, base)]
    room = clearance(shape, spots, obstacles)
    margin = next((margin for margin in MARGINS if (room >= margin).any()), None)
    if margin is None:
        return None
    # Cost in m: distance from `near`, 0.3 m at the edge, 0.3 m for each m from the preferred distance.
    inside = np.minimum(spots - top.min(axis=0)[:2], top.max(axis=0)[:2] - spots).min(axis=1)
    cost = np.linalg.norm(spots - near, axis=1) + np.where(inside < 0.05, 0.3, 0.0)
    cost += 0.3 * np.abs(np.linalg.norm(spots - base.position[:2], axis=1) - reach.preferred)
    best = int(np.argmin(np.where(room >= margin, cost, np.inf)))
    return spots[best], margin


def _grid(footing: Array, top: Array, near: Array) -> Array:
    """(n, 2) spots of a grid through `near` at which `footing` is within the box around `top`."""
    # The footing must stay within the box around the top, and within the search.
    low = np.maximum(top.min(axis=0)[:2] - footing.min(axis=0), near - SEARCH)
    high = np.minimum(top.max(axis=0)[:2] - footing.max(axis=0), near + SEARCH)
    # Multiples of STEP from `near`, so that `near` is itself a candidate.
    first, last = np.ceil((low - near) / STEP), np.floor((high - near) / STEP)
    x = np.arange(float(first[0]), float(last[0]) + 1) * STEP
    y = np.arange(float(first[1]), float(last[1]) + 1) * STEP
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2) + near


def approach_pose(
    arm: RobotDescription,
    top: Array,
    others: Sequence[Obstacle],
    objects: Sequence[Array],
    clear: float,
    base: Pose,
) -> Pose | None:
    """TCP pose `clear` m above a free spot of a surface.

    The surface has the points `top`. The spot is near its `objects`, (n, 3) each, and the hand is clear
    of `others`. Of two yaws, 90° apart, the one with the larger margin is taken.
    """
    height = float(top[:, 2].max())
    obstacles = above(others, height + 0.002)
    near = _middle(arm.reach, top, objects, base)
    turn = float(np.arctan2(base.rotation[1, 0], base.rotation[0, 0]))
    open_tips = arm.hand.opening / 2 + arm.hand.finger
    # Both open fingertips should touch the surface. On a narrow surface only closed ones can.
    for half_span in (open_tips, TOUCHING):
        candidates: list[tuple[float, Pose]] = []
        for yaw in (turn, turn + np.pi / 2):
            along = np.array([np.cos(yaw), np.sin(yaw)])
            hand = rectangle(np.zeros(2), along, *arm.hand.half_extents)
            tips = rectangle(np.zeros(2), along, TOUCHING, half_span)
            spot = free_spot(
                arm.reach,
                shape=hand,
                footing=tips,
                top=top,
                obstacles=obstacles,
                near=near,
                z=height,
                base=base,
            )
            if spot is not None:
                candidates.append((spot[1], Pose.top_down((*spot[0], height + clear), yaw)))
        if candidates:
            return max(candidates, key=lambda candidate: candidate[0])[1]
    return None


def _middle(reach: Reach, top: Array, objects: Sequence[Array], base: Pose) -> Array:
    """Start (2,) of the search, m."""
    # It is the mean of the objects' middles. Without objects it is the surface's middle or, on a
    # large surface, the part in front of the arm.
    if objects:
        middles = [(cloud.max(axis=0) + cloud.min(axis=0))[:2] / 2 for cloud in objects]
        return np.mean(middles, axis=0)
    ahead = base.position[:2] + reach.preferred * base.rotation[:2, 0]
    low, high = top.min(axis=0)[:2], top.max(axis=0)[:2]
    if (high - low).max() > 1.0:
        return np.clip(ahead, low, high)
    return (low + high) / 2
