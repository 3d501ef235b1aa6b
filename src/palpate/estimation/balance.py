"""Centre of mass of a held object from the moment of its weight about the TCP, over several grasps."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from palpate.common.pose import Array, Pose
from palpate.estimation.estimate import FitTest, FitView, Shared, chi_squared, map_shared
from palpate.estimation.grip import EXPECTED, SPREAD, before, slid
from palpate.estimation.holds import Hold, ObjectHolds
from palpate.estimation.load_fit import LoadEstimate
from palpate.mjcf.body import Body
from palpate.trace.recording import NominalHand, Recording
from palpate.trace.samples import Trace

GRASP_SHIFT = 2e-4
"""m (1 sigma). Slip of an object along the fingers at a put-down, without droop and repeatability of the arm. In the
simulation, a hammer and a bar put down six times lay within 0.2 mm of the predicted place. Sensitive: com std
×0.9–1.2."""
PLACE_ACCURACY = 5e-4
"""m (1 sigma). Error of an object's position in a scene with measured poses. Sensitive: com std ×0.9–1.2."""
GRIP_SLIDE = 1e-3
"""m per rad (1 sigma). Slip of a load along either axis of the pads as the hand tilts. No published figure of a
hand. In the simulation a hammer of 0.34 kg slid by 0.4 mm per radian along the fingers' plane, a bar of 0.4 kg by
1.2. They slid while the hand turned and hardly while it rested. Sensitive: com std ×0.8–1.5 where it was tilted."""
ARM_WEIGHT = 100.0
"""N m per m. Apparent moment at the hand by the arm's own weight, per error of its pose. Sensitive: no."""
SEEN = 0.05
"""Singular value of the equations' rows below which gravity does not show a coordinate in any grasp. Sensitive: no."""
COM_PRIOR = 0.25
"""Prior 1 sigma of a coordinate of the centre of mass, as a fraction of the object's extent. Sensitive: com std
×0.5–2.0."""
VIEW_LEVEL = 0.0175
"""rad. Tilt of the hand below which a chart counts it as level. Sensitive: no."""
VIEW_SAME_WAY = 0.9
"""Cosine between two tilt directions of the hand above which a chart shows them as one tilt. Sensitive: no."""

BELIEVED = "what was believed before"
"""Prefix of the prior's shared cause: all runs of a scene share the prior, so that it counts once."""


@dataclass(frozen=True, slots=True, eq=False)
class Grasps:
    """Linear equations `rows` c = `right` for the centre of mass c in the body frame, two per hold."""

    recordings: Sequence[Recording]  # one per hold
    rows: Array  # (2n, 3) coefficients
    right: Array  # (2n,) m
    covariance: Array  # (2n, 2n) m², of `right`
    # m, additional std of each equation: the arm's own weight adds a moment when its pose is wrong.
    loose: float
    freedom: float  # degrees of freedom of the noise
    shared: tuple[Shared, ...]  # causes shared with other runs, with their effects (2n,) on `right`


def grasps_of(trace: Trace, held: ObjectHolds, body: Body, about: Array) -> Grasps:
    """Set up the equations for the centre of mass c in the body frame, near `about` (3,).

    The moment about the TCP is M = r x (0, 0, F). Seen from above, the load is at r = (-M_y, M_x) / F from the TCP.
    That point is p + R c in the world, with the position p and the rotation R of the object in the hand. It gives two
    rows of R c = TCP + r - p. A tilt of the hand rotates R, so that the component along gravity becomes observable.
    """
    load = held.load
    recordings: list[Recording] = []
    rows: list[Array] = []
    right: list[Array] = []
    # Two equations per hold, with the pose of the object after its droop.
    for i, hold in enumerate(held.holds):
        moment = load.value[1 + 2 * i : 3 + 2 * i]
        offset = np.array([-moment[1], moment[0]]) / load.force
        pose_world_body = hold.pose_world_tcp @ drooped_pose(hold)
        recordings.append(hold.recording)
        rows.append(pose_world_body.rotation[:2])
        right.append(hold.pose_world_tcp.position[:2] + offset - pose_world_body.position[:2])
    # Covariance of the right side: load fit, grasps, placement in the scene, softness of the pads, slip.
    slopes, places = place_slopes(load), place_errors(held, body, trace.hand)
    covariance = slopes @ load.covariance @ slopes.T
    covariance += grasp_covariance(held, body, trace.hand.pose_repeatability)
    for place in places:
        covariance += np.outer(place.effect, place.effect)
    for effect in (droop_effects(held, about) * SPREAD, slip_effects(held) * GRIP_SLIDE):
        covariance += effect @ effect.T
    shared = (*map_shared(load.shared, slopes), *places)
    loose = ARM_WEIGHT * trace.hand.pose_repeatability / load.force
    return Grasps(
        recordings, np.vstack(rows), np.concatenate(right), covariance, loose, load.freedom, shared
    )


def balance(grasps: Grasps, body: Body) -> tuple[Array, Array, FitTest, tuple[Shared, ...]]:
    """Estimate the centre of mass by generalised least squares with a prior at the geometric centre.

    Returns:
        The centre (3,) m; its covariance, inflated by the Birge ratio where the grasps disagree; the test of
        their agreement; and the errors shared with other runs.
    """
    # Bayesian normal equations.
    weight = np.linalg.inv(grasps.covariance)
    spread = COM_PRIOR * np.maximum(body.size, 1e-3)
    prior: Array = np.diag(spread**-2.0).astype(np.float64)
    information: Array = grasps.rows.T @ weight @ grasps.rows + prior
    covariance: Array = np.linalg.inv(information).astype(np.float64)
    carried = covariance @ grasps.rows.T @ weight
    centre = carried @ grasps.right + covariance @ prior @ body.centre
    # Birge ratio: chi-squared of the residuals per degree of freedom.
    left = grasps.right - grasps.rows @ centre
    freedom = max(1, len(left) - int(np.linalg.matrix_rank(grasps.rows, tol=SEEN)))
    inflated: Array = covariance * max(1.0, float(left @ weight @ left) / freedom)
    # Propagate each shared cause and the prior to the estimate.
    shared = [*map_shared(grasps.shared, carried)]
    for axis, column in zip("xyz", (covariance / spread).T, strict=True):
        shared.append(Shared(f"{BELIEVED} of {axis}", "scene", tuple(column.tolist())))
    # Test the agreement of the grasps within the datasheet accuracy of the arm.
    allowed = grasps.covariance + grasps.loose**2 * np.eye(len(left))
    agreement = chi_squared(
        "grasps agree",
        float(left @ np.linalg.solve(allowed, left)),
        freedom,
        f"The grasps disagree on where the centre of mass is by {1e3 * float(np.abs(left).max()):.1f} mm: something "
        "in the object moves, something else pulls on it, or it is not where the scene has it.",
        grasps.freedom,
    )
    return centre, inflated, agreement, tuple(shared)


def balance_views(grasps: Grasps, held: ObjectHolds, centre: Array) -> Iterator[FitView]:
    """Yield the views of the report: the centre of mass of each hold against the fit along world x and y.

    For each tilt of the hand, a further view shows its horizontal displacement over the tilt.
    """
    fitted = (grasps.rows @ centre).reshape(-1, 2)
    measured = grasps.right.reshape(-1, 2)
    tools = np.array([hold.pose_world_tcp.rotation[:, 2] for hold in held.holds])
    fingers = np.array([hold.pose_world_tcp.position[:2] for hold in held.holds])
    bodies = [(hold.pose_world_tcp @ drooped_pose(hold)).position[:2] for hold in held.holds]
    # Horizontal lever of the weight's line of action from the fingers, (n, 2) m.
    levers, expected = (each + bodies - fingers for each in (measured, fitted))
    # Error bars show only the error that a hold does not share with the others.
    common = [np.array(one.effect) for one in grasps.shared]
    own = grasps.covariance - sum((np.outer(one, one) for one in common), np.zeros(()))
    times = np.array([(one.start + one.end) / 2.0 for one in grasps.recordings])
    leans = np.linalg.norm(tools[:, :2], axis=1)
    level = np.flatnonzero(leans < VIEW_LEVEL)
    # Level grasps: absolute place along each axis.
    for i, axis in enumerate("xy"):
        place = (fingers + expected)[level, i]
        yield FitView(
            name=f"Place of the centre of mass along world {axis}, grasp by grasp.",
            note="Moment over weight is its distance from the fingers; added to where they closed, each grasp names "
            "the same place, ± 1 std of what the grasps do not share.",
            axes=("robot time (s)", f"{axis} beside {place.mean():.4f} m (mm)"),
            x=times[level],
            measured=1e3 * ((fingers + levers)[level, i] - place.mean()),
            predicted=1e3 * (place - place.mean()),
            std=1e3 * np.sqrt(np.maximum(own.diagonal()[2 * level + i], 0.0)),
            groups="a grasp held level",
            slopes=1e3 * grasps.rows[2 * level + i],
        )
    left = [int(i) for i in np.argsort(-leans) if leans[i] >= VIEW_LEVEL]
    while left:
        # Group all steps of tilts of one grasp about the axis of the steepest of them.
        first = left[0]
        aside = tools[first, :2] / leans[first]
        tilt = [
            i
            for i in left
            if held.holds[i].grasp == held.holds[first].grasp
            and abs(float(tools[i, :2] @ aside)) > VIEW_SAME_WAY * leans[i]
        ]
        left = [i for i in left if i not in tilt]
        if len(tilt) > 2:
            below = float(drooped_pose(held.holds[first]).apply(centre)[2])
            spread = [aside @ own[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] @ aside for i in tilt]
            yield FitView(
                name=f"Tilted towards {np.degrees(np.arctan2(aside[1], aside[0])) % 360.0:.0f}° from world x.",
                note="As the hand leans, a centre of mass below the fingers moves aside and its weight pulls there: "
                f"d cos a + h sin a. It lies {1e3 * abs(below):.1f} mm {'below' if below > 0.0 else 'above'} "
                "the fingers.",
                axes=("lean of the hand (°)", "moment over weight (mm)"),
                x=np.degrees(np.arcsin(tools[tilt, :2] @ aside)),
                measured=1e3 * levers[tilt] @ aside,
                predicted=1e3 * expected[tilt] @ aside,
                std=1e3 * np.sqrt(np.maximum(spread, 0.0)),
                groups="a bit of the tilt",
                slopes=1e3 * np.array([aside @ grasps.rows[2 * i : 2 * i + 2] for i in tilt]),
            )


def grasp_covariance(held: ObjectHolds, body: Body, repeatability: float) -> Array:
    """Covariance (2n, 2n), m², of the object's position in the hand.

    The arm's repeatability in each grasp and put-down and slip along the fingers at each put-down cause it. Errors
    of put-downs accumulate, as the object is gripped where it was put down.
    """
    grasps = np.array([hold.grasp for hold in held.holds])
    same = np.repeat(np.repeat(grasps[:, None] == grasps, 2, axis=0), 2, axis=1)
    axes = np.vstack([hold.pose_world_tcp.rotation[:2] for hold in held.holds])
    # Each grasp has its own error. Put-downs add up: two grasps share those before the earlier one.
    gripped = repeatability**2 * (axes @ axes.T) * same
    put: list[float] = []
    for grasp in grasps:
        shifts = [one.displacement_std(body) for one in before(grasp, held.put_down)]
        each = [GRASP_SHIFT**2 + repeatability**2 + shift**2 for shift in shifts]
        put += [sum(each)] * 2
    along = axes[:, 0]
    return gripped + np.minimum.outer(put, put) * np.outer(along, along)


def droop_effects(held: ObjectHolds, about: Array) -> Array:
    """Horizontal displacement (2n, 2), m, of the centre of mass `about` per unit of pad softness.

    The softness is the same in all grasps.
    """
    effects: list[Array] = []
    for hold in held.holds:
        closing = hold.pose_world_tcp.rotation[:, 1]
        lever = hold.pose_world_tcp.rotation @ drooped_pose(hold).apply(about)
        effects.append(np.outer(np.cross(closing, lever)[:2], hold.droop.turns))
    return np.vstack(effects)


def drooped_pose(hold: Hold) -> Pose:
    """Pose of the object in the hand after the expected droop."""
    return hold.droop.turned(hold.pose_tcp_body, EXPECTED)


def slip_effects(held: ObjectHolds) -> Array:
    """Horizontal displacement (2n, 2), m, per unit of slip (m/rad) along the tool's x and z as the hand tilts."""
    effects: list[Array] = []
    for hold in held.holds:
        effect = slid(hold.pose_tcp_body, hold.swept)
        for one in before(hold.grasp, held.put_down):
            effect += one.slid
        effects.append((hold.pose_world_tcp @ hold.pose_tcp_body).rotation[:2] @ effect)
    return np.vstack(effects)


def accuracy(body: Body, along: Array | None = None) -> float:
    """Standard deviation, m, of an object's position in the scene along a direction (3,), world.

    The default is the largest horizontal one.
    """
    std = body.accuracy if along is None else body.std(along)
    return PLACE_ACCURACY if std is None else std


def place_errors(held: ObjectHolds, body: Body, hand: NominalHand) -> list[Shared]:
    """Shared errors of position: scene against arm, and the fingertips, with effects (2n,), m, on `right`.

    They are the same in all grasps.
    """
    # The closing fingers centre the object along y. Along x and z no measurement shows its error.
    seen = np.vstack([hold.pose_world_tcp.rotation[:2] for hold in held.holds])
    placed = {"x": accuracy(body, held.holds[0].along), "z": PLACE_ACCURACY}
    found: list[Shared] = []
    for axis, column in zip("xyz", seen.T, strict=True):
        if axis in placed:
            place = (placed[axis] * column).tolist()
            cause = f"place in the scene along the tool's {axis}"
            found.append(Shared(cause, "scene", tuple(place)))
        tip = (hand.tip_offset_std * column).tolist()
        found.append(Shared(f"fingertips along the tool's {axis}", "arm", tuple(tip)))
    return found


def place_slopes(load: LoadEstimate) -> Array:
    """Derivatives (2n, 1 + 2n) of the places r = (-M_y, M_x) / F by F and the moments."""
    moments = load.value[1:]
    slopes = np.zeros((len(moments), 1 + len(moments)))
    for x in range(0, len(moments), 2):
        slopes[x, 2 + x], slopes[x + 1, 1 + x] = -1.0, 1.0
        slopes[x, 0], slopes[x + 1, 0] = moments[x + 1] / load.force, -moments[x] / load.force
    return slopes / load.force
