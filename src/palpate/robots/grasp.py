"""Top-down grasps from geometry: the place where the hand closes on an object, and the closing direction.

The closing direction (tool y) is one in which the object is narrower than the opening of the hand, at the
height of the pads. The tool's x runs along the object, so that offsets along x stay on a handle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.common.belief import SURE
from palpate.common.outline import (
    Convex,
    Obstacle,
    above,
    clearance,
    profile,
    rectangle,
    slab,
    unit,
)
from palpate.common.pose import Array, Pose
from palpate.robots.description import RobotDescription

SPARE = 0.004  # m of the opening that are reserved for errors of the pose
GROUND = 0.005  # m of clearance of the fingertips above the support and above neighbours
HEADROOM = 0.005  # m of clearance between the palm and the top of the object
SHALLOW = 0.02  # m of the TCP below the top, where the hand has no room for a deeper grasp
# Largest slope (tangent) of a grasped side against the pads; an object with a steeper side slides
# out.
SLANT = 0.3
# rad: largest turn of the tool against home. The tool takes the shorter way, which beyond half a
# turn is not the sum of the turns of base and wrist.
MOST_TURN = np.radians(165.0)
# rad: turn of the tool against the direction from the base to it, up to which a grasp counts as
# little turned. Beyond it, an equally good grasp with a smaller turn is preferred.
LITTLE_TURN = np.radians(60.0)
WRIST_SPARE = 0.2  # rad of margin of the last joint, where the tool turns the opposite way
STATION = 0.005  # m between stations along an object at which a grasp is tried
NEIGHBOUR = 0.002  # m of clearance between the hand and other objects


@dataclass(frozen=True, slots=True, eq=False)
class Grasp:
    """A derived grasp."""

    pose: Pose  # of the TCP in the world
    width: float  # m, of the object there
    slack: float  # m by which the object may be shifted along the tool's x
    short: float = 0.0  # m missing of the opening for the uncertainty of the object's pose
    problem: str = ""  # reason that the hand cannot take the object


def derive_grasp(
    arm: RobotDescription,
    geoms: Sequence[Convex],
    obstacles: Sequence[Obstacle],
    yaw: float,
    base: Pose,
    spread: Array | None = None,
) -> Grasp:
    """Derive the grasp of an object of convex `geoms` (in the world) among `obstacles`.

    `yaw` is the object's own direction (rad). `spread` (2, 2) is the covariance, m², of its position seen from
    above.
    """
    scene = _Scene(arm, geoms, obstacles, base, spread)
    bottom, top = float(scene.cloud[:, 2].min()), float(scene.cloud[:, 2].max())
    best: Grasp | None = None
    for height in _heights(arm, bottom, top):
        outlines = scene.outlines(height)
        found = [scene.grasp(outlines, a, height) for a in _angles(outlines, yaw, base)]
        # Order of preference: no problem, room for the pose's uncertainty, width (to 3 mm), and a small turn of
        # the wrist. A large turn folds the arm: the elbow then yields sideways, joints turn in a lift, and
        # friction hides the load.
        best = min(
            found if best is None else [*found, best],
            key=lambda grasp: (
                bool(grasp.problem),
                round(grasp.short / 0.001),
                round(grasp.width / 0.003),
                scene.turn(grasp.pose) > LITTLE_TURN,
            ),
            default=None,
        )
        if best is not None and not best.problem:
            return best
    return best or scene.too_flat(yaw)


def turned_grasp(
    arm: RobotDescription,
    geoms: Sequence[Convex],
    obstacles: Sequence[Obstacle],
    pose_world_tcp: Pose,
    base: Pose,
) -> Grasp:
    """Derive the grasp at the height of the grasp `pose_world_tcp`, with the fingers turned by 90 degrees."""
    height, closing = float(pose_world_tcp.position[2]), pose_world_tcp.rotation[:, 1]
    scene = _Scene(arm, geoms, obstacles, base)
    outlines = scene.outlines(height)
    if not outlines:
        return scene.too_flat(0.0)
    angle = float(np.arctan2(closing[1], closing[0])) + np.pi / 2
    return scene.grasp(outlines, angle, height)


class _Scene:
    """An object to grasp, and the obstacles that the hand could touch during the grasp."""

    def __init__(
        self,
        arm: RobotDescription,
        geoms: Sequence[Convex],
        obstacles: Sequence[Obstacle],
        base: Pose,
        spread: Array | None = None,
    ) -> None:
        self._arm, self._geoms, self._base = arm, geoms, base
        self._spread = np.zeros((2, 2)) if spread is None else spread
        self.cloud = np.concatenate([g.points for g in geoms])
        width = 2 * arm.hand.half_extents[1]
        low, high = self.cloud.min(axis=0)[:2] - width, self.cloud.max(axis=0)[:2] + width
        self._obstacles = [
            o
            for o in obstacles
            if (o.outline.max(axis=0) > low).all() and (o.outline.min(axis=0) < high).all()
        ]

    def outlines(self, height: float) -> list[Array]:
        """Return the object's outlines between the ends of the pads, with the TCP at a height."""
        lowest, highest = height - self._arm.tip, height + self._arm.tip
        return [o for g in self._geoms if len(o := slab(g, lowest, highest)) > 2]

    def too_flat(self, yaw: float) -> Grasp:
        """Return the failed grasp of an object that the fingers cannot reach."""
        centre = (self.cloud.max(axis=0) + self.cloud.min(axis=0))[:2] / 2
        pose = self._tool_pose(centre, float(self.cloud[:, 2].max()), yaw)
        return Grasp(pose, 0.0, 0.0, problem="it is too flat for the fingers")

    def grasp(self, outlines: Sequence[Array], angle: float, height: float) -> Grasp:
        # Axes across and along the pads, and stations along the object.
        """Find the best grasp of outlines that closes along `angle`, rad."""
        hand = self._arm.hand
        across, along = unit(angle), unit(angle - np.pi / 2)
        ends = np.concatenate([o @ along for o in outlines])
        start, length = float(ends.min()) + 1e-6, float(np.ptp(ends)) - 2e-6
        count = max(int(length / STATION), 8)
        step = length / count
        stations: Array = start + step * np.arange(count + 1, dtype=float)
        # Profile of the object: its sides at each station, and their slopes.
        low, high = profile(outlines, along, across, stations)
        # Middle of the object's area, near its centre of mass if it is of one material.
        middle = float(np.average(stations, weights=np.nan_to_num(high - low) + 1e-9))
        slopes = np.abs(np.gradient(low, step)), np.abs(np.gradient(high, step))
        # The pads touch the object's extremes within the width of the pads.
        window = max(int(np.ceil(hand.pad / step)), 1)
        low, high = _spread(low, window, np.fmin), _spread(high, window, np.fmax)
        fits = (slopes[0] <= SLANT) & (slopes[1] <= SLANT) & (high - low <= hand.opening - SPARE)
        # Centre the grasp on the graspable stretch.
        at, slack = _best_station(stations, fits, middle)
        wide = float(np.interp(at, stations, high - low))
        centre = at * along + float(np.interp(at, stations, high + low)) / 2 * across
        problem = ""
        if not fits.any():
            problem = (
                f"it is {wide * 1000:.0f} mm wide where the hand could close; the hand takes "
                f"{hand.opening * 1000:.0f} mm less {SPARE * 1000:.0f} mm to spare"
            )
        elif self._has_obstacle(centre, across, height):
            problem = "its neighbours leave no room for the hand"
        # The fingers open farther than the object's width, if they can.
        unsure = 2 * SURE * float(np.sqrt(across @ self._spread @ across))
        short = max(wide + max(unsure, SPARE) - hand.opening, 0.0)
        return Grasp(self._tool_pose(centre, height, angle), wide, slack, short, problem)

    def _has_obstacle(self, centre: Array, across: Array, height: float) -> bool:
        """Test if the opened fingers, or the palm above them, would overlap a neighbour."""
        hand = self._arm.hand
        nearby = above(self._obstacles, height - self._arm.tip - GROUND)
        tall = above(self._obstacles, height + hand.palm)
        reach = hand.opening / 2 + hand.finger / 2
        finger = rectangle(np.zeros(2), across, hand.finger / 2, hand.pad)
        spots = np.array([centre + reach * across, centre - reach * across])
        palm = rectangle(np.zeros(2), across, hand.half_extents[1], hand.half_extents[0])
        return bool(
            clearance(finger, spots, nearby).min() < NEIGHBOUR
            or clearance(palm, centre[None], tall).min() < NEIGHBOUR
        )

    def turn(self, pose: Pose) -> float:
        """Return the unsigned angle, rad, of the tool against the direction from the base to it."""
        away = pose.position - self._base.position
        return float(abs(np.arctan2(*(pose.rotation[:2, :2].T @ away[:2])[::-1])))

    def _tool_pose(self, centre: Array, height: float, closing: float) -> Pose:
        """Return the top-down pose with tool y along `closing`.

        Of both directions it takes the one that turns the wrist less, unless the tool reaches it from home by
        the opposite turn.
        """
        arm, base = self._arm, self._base
        # Direction of the centre from the base, and the tool's turn against it, within a right angle.
        away = centre - base.position[:2]
        azimuth = float(np.arctan2(away[1], away[0]))
        yaw = closing + np.pi / 2
        turned = (yaw - azimuth + np.pi / 2) % np.pi - np.pi / 2
        # A turn near 180 degrees from home is ambiguous: take the other direction, if the last joint allows.
        ahead = float(np.arctan2(*base.local((*centre, height))[1::-1]))
        if abs(ahead + turned) > MOST_TURN:
            other = turned - np.copysign(np.pi, turned)
            wrist = arm.home[-1] - other
            if arm.limits.q_min[-1] + WRIST_SPARE < wrist < arm.limits.q_max[-1] - WRIST_SPARE:
                turned = other
        return Pose.top_down((*centre, height), azimuth + turned)


def _heights(arm: RobotDescription, bottom: float, top: float) -> list[float]:
    """Return heights of the TCP to try: below the palm for tall objects, the middle for flat objects."""
    lowest = bottom + arm.tip + GROUND
    middle = (top - bottom) / 2
    depths = (arm.hand.palm - HEADROOM, SHALLOW)
    heights = [max(top - min(depth, middle), lowest) for depth in depths]
    return list(dict.fromkeys(heights))


def _angles(outlines: Sequence[Array], yaw: float, base: Pose) -> list[float]:
    """Return closing directions to try: the narrow ones of each part, and 15 degree steps for round parts."""
    turn = np.arctan2(base.rotation[1, 0], base.rotation[0, 0])
    grid = yaw + np.deg2rad(np.arange(180))
    directions = np.column_stack([np.cos(grid), np.sin(grid)])
    angles: list[float] = []
    # Width of each part at each degree; a nearly constant width indicates a round part.
    for outline in outlines:
        along = outline @ directions.T
        widths = along.max(axis=0) - along.min(axis=0)
        if widths.max() < 1.02 * widths.min():
            angles += [float(turn + np.pi / 2 + a) for a in np.deg2rad(np.arange(0, 180, 15))]
        else:
            lowest = (widths <= np.roll(widths, 1)) & (widths <= np.roll(widths, -1))
            angles += [float(a) for a in grid[lowest]]
    return list(dict.fromkeys(angles))[:60]


def _spread(values: Array, window: int, pick: np.ufunc) -> Array:
    """Compute the smallest or largest value within `window` stations on either side."""
    padded = np.pad(values, window, constant_values=np.nan)
    return pick.reduce(np.lib.stride_tricks.sliding_window_view(padded, 2 * window + 1), axis=1)


def _best_station(stations: Array, fits: NDArray[np.bool_], middle: float) -> tuple[float, float]:
    """Return the middle of the graspable stretch nearest to the object's middle, m, and half the stretch's
    length.
    """
    if not fits.any():
        return middle, 0.0
    # Find the runs of graspable stations; the short ones are ignored.
    edges = np.flatnonzero(np.diff(np.concatenate([[0], fits.astype(int), [0]])))
    stretches = [(float(stations[a]), float(stations[b - 1])) for a, b in edges.reshape(-1, 2)]
    longest = max(b - a for a, b in stretches)
    first, last = min(
        (s for s in stretches if s[1] - s[0] >= longest / 2),
        key=lambda s: max(s[0] - middle, middle - s[1], 0.0),
    )
    return (first + last) / 2, (last - first) / 2
