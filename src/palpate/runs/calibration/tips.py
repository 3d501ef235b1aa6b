"""Length of the fingertips and tilt of the arm's base, from touches of known heights.

The height error h of a touch at x and y from the base follows the plane

    h = c + s_x x + s_y y

The offset c is the error of the tip length and of the base's height. The slope s is the tilt of the
base. Joint offsets and link errors have the same effect over a few decimetres.

The residuals of the plane have two parts: the frame error `PLANE_RESIDUAL` of an uncalibrated arm, and the
pose repeatability on the datasheet. The touches show which share of both this arm has. A distorted
frame also tilts, so tilts and residuals are judged together. The residuals of five places alone
would be too uncertain.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from palpate.common.errors import InputError
from palpate.common.parameter import Parameter
from palpate.common.pose import Array, Pose
from palpate.estimation.descent import UNSEEN, probes
from palpate.estimation.estimate import chi_squared
from palpate.estimation.touch import APART, RIGID, SurfaceTouch, find_touch
from palpate.runs.calibration.gains import StatedSize, require
from palpate.trace.samples import Trace

FEWEST = 3  # Least count of places: a plane has three coefficients
# m (1 sigma): residuals of a plane through the gauges of the bench, at them and between them. Root
# mean square over 200 arms with joint offsets of 1 mrad and link errors of 0.3 mm.
PLANE_RESIDUAL = 6e-5
# m above and below the gauges. Over this range of heights the frame error is taken to grow in
# proportion to the arm's reach.
HEIGHT_RANGE = 0.1
# Shares of the pose repeatability on the datasheet, which is an upper bound. They are equally
# probable a priori.
SHARES = (1.0 / 64.0, 1.0 / 8.0, 1.0)
# Shares of the frame error that this arm may have, equally probable a priori. Two tilts and the
# residuals of five places are sometimes small by chance. With these shares, 1 in 1000 heights of
# arms with the full frame error is 4 deviations off. With smaller shares it would be 8.
FRAMES = (1.0 / 4.0, 1.0 / 2.0, 1.0)
STIFF = 1e-6  # m/N: compliance of a steel gauge and of its support


@dataclass(frozen=True, slots=True, eq=False)
class Tips:
    """Calibration of the fingertips and the base."""

    offset: float  # from the TCP to the fingertips' end, along the tool, m
    offset_std: float  # of a height near the gauges, by tips and frame together, m
    repeatability: float  # of the pose, by touches of one height, m
    # (2,) tilt of the base about its x and y axes, beyond the one already corrected, rad.
    lean: Array
    lean_std: Array  # (2,) its standard deviation
    compliance: float  # of pads and joints behind the encoders, m/N
    compliance_std: float  # its standard deviation
    touches: int  # number of touches


def fit_tips(
    trace: Trace, surfaces: Sequence[Parameter], known: StatedSize, base: Pose, reach: float
) -> Tips:
    """Fit tip length and base tilt to the touches of a trace.

    `surfaces` were touched; all have the `known` height, m. `base` is the pose of the arm's base, `reach` its
    reach, m.
    """
    hand = trace.hand
    # Find the touches of all descents; group them by place.
    descents = [recording for surface in surfaces for recording in probes(trace, surface)]
    met = [find_touch(trace, recording) for recording in descents]
    touches = rigid_touches([touch for touch in met if touch is not None])
    require([test for touch in touches for test in touch.sides()], "the gauge")
    spots, heights = places_of(touches, base)
    deviations = [place - known.value for place in heights]
    high = np.array([float(np.mean(place)) for place in heights]) - known.value
    # Centre the design on the gauges, where height and tilt are uncorrelated.
    middle = spots.mean(axis=0)
    design = np.column_stack([np.ones(len(spots)), spots - middle])
    # Prior of the tilts: an error of the tip length over the arm's reach.
    leaning = hand.tip_offset_std / reach
    prior = np.array([hand.tip_offset_std, leaning, leaning])
    # Estimate the shares of frame error and scatter, then fit the plane by weighted least squares
    # with a Gaussian prior.
    frame, share = shares(deviations, design, prior, hand.pose_repeatability)
    repeated = share * hand.pose_repeatability
    white = design / (spread := place_stds(heights, frame, repeated))[:, None]
    information = white.T @ white + np.diag((np.array([1.0, frame, frame]) * prior) ** -2.0)
    covariance: Array = np.linalg.inv(information).astype(np.float64)
    mean = covariance @ (white.T @ (high / spread))
    # Test height and flatness with the full datasheet errors.
    full = place_stds(heights, 1.0, hand.pose_repeatability)
    require_plane(float(mean[0]), (high - design @ mean) / full, prior[0], known)
    # Variance of a height between the gauges, and factor for heights above or below them.
    variance = float(np.trace(design @ covariance @ design.T)) / len(spots)
    away = leaning * HEIGHT_RANGE
    std_x, std_y = np.sqrt(covariance.diagonal()[1:])
    # Compliance: the mean over touches. One loading curve is no more accurate than its contact
    # onset.
    compliances = np.array([touch.penetration / touch.full for touch in touches])
    single = float(np.median([touch.first_std / touch.full for touch in touches]))
    scatter = max(float(compliances.std(ddof=1)), single / np.sqrt(len(touches)))
    return Tips(
        offset=hand.tip_offset + float(mean[0] - mean[1:] @ middle),
        offset_std=float(
            np.linalg.norm([variance**0.5, frame * PLANE_RESIDUAL, frame * away, known.std])
        ),
        repeatability=repeated,
        # A slope along y is a rotation about x, one along x a negative rotation about y.
        lean=np.array([-mean[2], mean[1]]),
        lean_std=np.array([std_y, std_x]),
        compliance=float(compliances.mean()),
        compliance_std=max(scatter, STIFF),
        touches=len(touches),
    )


def place_stds(heights: Sequence[Array], frame: float, repeatability: float) -> Array:
    """Standard deviation (n,), m, of the mean height at each place from the plane.

    `heights`, m, are the touches of each of n places, `frame` is the share of `PLANE_RESIDUAL`, `repeatability` in m.
    """
    # Scatter of one touch, reduced by averaging, and the frame error that averaging keeps.
    single = np.hypot(repeatability, UNSEEN)
    return np.hypot(frame * PLANE_RESIDUAL, [single / np.sqrt(len(place)) for place in heights])


def shares(
    heights: Sequence[Array], design: Array, prior: Array, repeatability: float
) -> tuple[float, float]:
    """Estimate the arm's shares of the frame error `PLANE_RESIDUAL` and of the stated repeatability.

    The result is the root mean square over `FRAMES` and `SHARES`, weighted by the evidence (Bishop,
    Pattern Recognition and Machine Learning, section 3.4). `heights` (k,), m, are the touches of each place, `design`
    (n, 3) the rows of the plane, `prior` (3,) the standard deviations of its coefficients. `repeatability`, m, is the
    one on the datasheet.
    """
    # Stack all touches, with the place and the row of the plane for each.
    each = [len(high) for high in heights]
    measured, rows = np.concatenate(heights), np.repeat(design, each, axis=0)
    place, identity = np.repeat(np.arange(len(each)), each), np.eye(sum(each))
    # Covariance of all touches: common height, tilts and frame error of each place, scatter of each touch.
    level, leans = rows[:, :1] * prior[0], rows[:, 1:] * prior[1:]
    always: Array = level @ level.T + UNSEEN**2 * identity
    framed: Array = leans @ leans.T + PLANE_RESIDUAL**2 * np.equal.outer(place, place)
    # Evaluate the evidence on a grid of shares.
    pairs = list(product(FRAMES, SHARES))
    # Gaussian log evidence of each pair of shares, without its constant.
    log_likelihoods: list[float] = []
    for frame, share in pairs:
        covariance: Array = always + frame**2 * framed + (share * repeatability) ** 2 * identity
        misfit = float(measured @ np.linalg.solve(covariance, measured))
        log_likelihoods.append(-(misfit + float(np.linalg.slogdet(covariance)[1])) / 2.0)
    # Weights relative to the largest evidence, so that the exponential does not underflow.
    weights = np.exp(np.array(log_likelihoods) - max(log_likelihoods))
    frame, share = np.sqrt(np.average(np.square(pairs), axis=0, weights=weights)).tolist()
    return frame, share


def require_plane(offset: float, residuals: Array, prior: float, known: StatedSize) -> None:
    """Require that the gauges have the known height and lie in one plane.

    `offset`, m, is the deviation from the known height, `residuals` (n,) are the whitened ones of the plane, and
    `prior`, m (1 sigma), is that of the arm's own height.
    """
    side = "above" if offset > 0 else "below"
    # Height against the certificate, with the prior of the arm's own height.
    tests = [
        chi_squared(
            "gauge",
            offset**2 / (prior**2 + known.std**2),
            1,
            f"It was met {1e3 * abs(offset):.2f} mm {side} the height that it is said to have "
            f"({known.text}): it is another one, or the fingers are not the description's.",
        )
    ]
    if len(residuals) > FEWEST:  # as many as the coefficients of a plane
        tests.append(
            chi_squared(
                "gauge against gauge",
                float(residuals @ residuals),
                len(residuals),
                "The gauges do not lie in one plane: one is another one, or something lies on it.",
            )
        )
    require(tests, "the gauge")


def rigid_touches(touches: Sequence[SurfaceTouch]) -> list[SurfaceTouch]:
    """Select the touches of a rigid surface.

    Certainly rigid touches are selected if they are the majority. Otherwise possibly rigid ones
    are, of an arm with compliant tips.
    Raises InputError: the majority is certainly compliant, or under something soft.
    """
    # Possibly rigid: the lower bound of the compliance is that of a rigid surface.
    may_be = [touch for touch in touches if touch.at_least <= RIGID and touch.soft == 0.0]
    if 2 * len(may_be) <= len(touches):
        most = max((touch.at_least for touch in touches), default=0.0)
        how = f"by {1e6 * most:.0f} µm/N at least" if most > RIGID else "above something rigid"
        raise InputError(
            f"the gauge gives way {how} where it was touched: put it on something rigid, with nothing soft "
            "on it; nothing is written"
        )
    certain = [touch for touch in may_be if not touch.gives_way]
    return certain if 2 * len(certain) > len(touches) else may_be


def places_of(touches: Sequence[SurfaceTouch], base: Pose) -> tuple[Array, list[Array]]:
    """Group touches by place.

    Returns:
        (n, 2) m, places in the axes of the base, and the heights (k,) m of each in the world.
    """
    groups: list[list[SurfaceTouch]] = []
    # Each touch joins the first group within `APART`, or begins a new one.
    for touch in touches:
        for group in groups:
            if np.linalg.norm(touch.spot - group[0].spot) < APART:
                group.append(touch)
                break
        else:
            groups.append([touch])
    require_places(len(groups))
    # Express the places in the axes of the base, in which the plane is defined.
    spots = [base.local(np.array([*group[0].spot, group[0].height]))[:2] for group in groups]
    return np.array(spots), [np.array([touch.height for touch in group]) for group in groups]


def require_places(count: int) -> None:
    """Require enough places to determine the tilt of the arm's frame. Raises InputError: there are
    fewer than `FEWEST`."""
    if count < FEWEST:
        where = "at one place" if count == 1 else f"at {count} places"
        raise InputError(
            f"there are gauges {where}, and {FEWEST} are needed, {1e3 * APART:g} mm apart: fewer do not "
            "separate the fingers' length from the tilt of the arm's frame; give a scene with gauges of that "
            "height at several places"
        )
