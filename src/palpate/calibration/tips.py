"""Length of the fingertips and tilt of the arm's base, from touches of known heights.

The height error h of a touch at x and y from the base follows the plane

    h = c + s_x x + s_y y

c: the tips are longer than was thought, or the base lower; s: the base leans, or the joints' zeros and
links make it seem so, which over a few decimetres is the same. What such a plane leaves of the frames
of arms that nobody calibrated is `BENT`, and how well an arm comes to a height again its datasheet says.
Of this very arm the touches tell how much of both there is: a frame that is bent leans, too, and how far it
leans and what a plane leaves are judged together. What a plane of five places leaves alone tells too little.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from palpate.calibration.gains import require
from palpate.calibration.stated import Stated
from palpate.errors import InputError
from palpate.estimation import tuning
from palpate.estimation.agreement import chi_squared
from palpate.estimation.contact.descent import probes
from palpate.estimation.contact.touch import Touch, touched
from palpate.geometry.pose import Array, Pose
from palpate.parameter import Parameter
from palpate.trace.samples import Trace

FEWEST = 3
"""Places that show how the arm's frame leans."""
BENT = 6e-5
"""m (1 sigma): of arms whose joints' zeros are off by 1 mrad and whose links by 0.3 mm, what a plane
through the gauges of the bench leaves beside them and between, root mean square of 200."""
AROUND = 0.1
"""m above and below the gauges, in which a frame changes as if what is wrong with it grew evenly over
the arm's reach."""
SHARES = (1.0 / 64.0, 1.0 / 8.0, 1.0)
"""parts of the pose's repeatability, which a datasheet states at most, that this very arm may have: from next
to nothing to all of it, each as likely before it touched anything."""
FRAMES = (1.0 / 4.0, 1.0 / 2.0, 1.0)
"""parts of what is not known of the frame, likewise. Two leans and what a plane leaves of five places are
small by chance now and then: of arms with all of it, 1 in 1000 heights is 4 deviations off; with less than a
quarter it would be 8."""
STIFF = 1e-6
"""m/N: what a gauge of steel, and what it stands on, give way by themselves."""


@dataclass(frozen=True, slots=True, eq=False)
class Tips:
    """Of the fingertips, m and m/N, and the base, rad.

    Attributes:
        offset: from the TCP to their end, along the tool.
        offset_std: of what they and the frame add to a height where the gauges stood.
        repeatability: of the pose, as heights show it.
        lean: (2,) about the base's x and y axes, beyond what was known of it, with lean_std.
        compliance: of pads and joints beyond the encoders, with compliance_std.
        touches: how many it rests on.
    """

    offset: float
    offset_std: float
    repeatability: float
    lean: Array
    lean_std: Array
    compliance: float
    compliance_std: float
    touches: int


def gauged(
    trace: Trace, surfaces: Sequence[Parameter], known: Stated, base: Pose, reach: float
) -> Tips:
    """Fit tip length and base tilt to touches of `surfaces`, all `known` m high, by an arm with its base at
    `base` and a reach of `reach` m.

    Raises:
        InputError: too few touches, or what was met is not as high as it is said to be, or not in one
            plane.
    """
    found, hand = _touches(trace, surfaces), trace.hand
    places = _places(found, base)
    high = np.array([float(np.mean(place.heights)) for place in places]) - known.value
    stated = _spread(places, 1.0, hand.pose_repeatability)
    spots = np.array([place.spot for place in places])
    middle = spots.mean(axis=0)
    # About the middle of the gauges, where height and lean are told apart best.
    design = np.column_stack([np.ones(len(spots)), spots - middle])
    leaning = hand.tip_offset_std / reach
    prior = np.array([hand.tip_offset_std, leaning, leaning])
    deviations = [place.heights - known.value for place in places]
    frame, share = _shares(deviations, design, prior, hand.pose_repeatability)
    repeated = share * hand.pose_repeatability
    spread = _spread(places, frame, repeated)
    white = design / spread[:, None]
    scale = np.array([1.0, frame, frame])
    covariance = _inverse(white.T @ white + np.diag((scale * prior) ** -2.0))
    mean = covariance @ (white.T @ (high / spread))
    _require_plane(high, design, mean, stated, prior, known)
    here = float(np.trace(design @ covariance @ design.T)) / len(places)
    away = leaning * AROUND
    along = np.sqrt(covariance.diagonal()[1:])
    return Tips(
        hand.tip_offset + float(mean[0] - mean[1:] @ middle),
        float(np.linalg.norm([here**0.5, frame * BENT, frame * away, known.std])),
        repeated,
        np.array([-mean[2], mean[1]]),
        np.array([along[1], along[0]]),
        *_compliance(found),
        len(found),
    )


def _spread(places: Sequence[_Place], frame: float, repeatability: float) -> Array:
    """(n,) m (1 sigma) by which the mean of the touches at each place may be off a plane, of an arm with
    the part `frame` of `BENT`."""
    single = np.hypot(repeatability, tuning.UNSEEN)
    each = [single / np.sqrt(len(place.heights)) for place in places]
    return np.hypot(frame * BENT, each)


def _shares(
    heights: Sequence[Array], design: Array, prior: Array, repeatability: float
) -> tuple[float, float]:
    """Estimate this arm's share of the frame error `BENT` and of the stated `repeatability`, m:
    root mean squares over how likely `FRAMES` and `SHARES` make the `heights` (k,) felt at each place, m too
    high (Bishop, Pattern Recognition and Machine Learning, section 3.4)."""
    each = [len(high) for high in heights]
    felt, rows = np.concatenate(heights), np.repeat(design, each, axis=0)
    place, one = np.repeat(np.arange(len(each)), each), np.eye(sum(each))
    level, leans = rows[:, :1] * prior[0], rows[:, 1:] * prior[1:]
    always: Array = level @ level.T + tuning.UNSEEN**2 * one
    framed: Array = leans @ leans.T + BENT**2 * np.equal.outer(place, place)
    pairs = list(product(FRAMES, SHARES))
    likely: list[float] = []
    for frame, share in pairs:
        covariance: Array = always + frame**2 * framed + (share * repeatability) ** 2 * one
        misfit = float(felt @ np.linalg.solve(covariance, felt))
        likely.append(-(misfit + float(np.linalg.slogdet(covariance)[1])) / 2.0)
    weights = np.exp(np.array(likely) - max(likely))
    frame, share = np.sqrt(np.average(np.square(pairs), axis=0, weights=weights)).tolist()
    return frame, share


def _require_plane(
    high: Array, design: Array, mean: Array, spread: Array, prior: Array, known: Stated
) -> None:
    """Require that the gauges lie in one plane, within the prior uncertainty of the arm."""
    apart = float(mean[0])
    side = "above" if apart > 0 else "below"
    tests = [
        chi_squared(
            "gauge",
            apart**2 / (prior[0] ** 2 + known.std**2),
            1,
            f"It was met {1e3 * abs(apart):.2f} mm {side} the height that it is said to have "
            f"({known.text}): it is another one, or the fingers are not the description's.",
        )
    ]
    if len(high) > len(mean):
        left = (high - design @ mean) / spread
        tests.append(
            chi_squared(
                "gauge against gauge",
                float(left @ left),
                len(high),
                "The gauges do not lie in one plane: one is another one, or something lies on it.",
            )
        )
    require(tests, "the gauge")


def _inverse(information: Array) -> Array:
    inverse: Array = np.linalg.inv(information).astype(np.float64)
    return inverse


@dataclass(frozen=True, slots=True, eq=False)
class _Place:
    """Touches at one place: `spot` (2,) m in the base's axes, `heights` (k,) m in the world."""

    spot: Array
    heights: Array


def _touches(trace: Trace, surfaces: Sequence[Parameter]) -> list[Touch]:
    found: list[Touch] = []
    for surface in surfaces:
        met = [touched(trace, recording) for recording in probes(trace, surface)]
        found += [touch for touch in met if touch is not None]
    found = _rigid(found)
    sides = [test for touch in found for test in touch.sides()]
    require(sides, "the gauge")
    return found


def _rigid(found: Sequence[Touch]) -> list[Touch]:
    """The touches of what is rigid, as it is said to be: those that are known to be, where they are most; else
    those that may be, of an arm whose own tips give way.

    Raises:
        InputError: most are of something that certainly gives way, or lies under something soft.
    """
    may_be = [touch for touch in found if touch.at_least <= tuning.RIGID and touch.soft == 0.0]
    if 2 * len(may_be) <= len(found):
        most = max((touch.at_least for touch in found), default=0.0)
        how = (
            f"by {1e6 * most:.0f} µm/N at least" if most > tuning.RIGID else "above something rigid"
        )
        raise InputError(
            f"the gauge gives way {how} where it was touched: put it on something rigid, with nothing soft "
            "on it; nothing is written"
        )
    known = [touch for touch in may_be if not touch.gives_way]
    return known if 2 * len(known) > len(found) else may_be


def _places(found: Sequence[Touch], base: Pose) -> list[_Place]:
    """The touches, place by place.

    Raises:
        InputError: too few places.
    """
    spots: list[Array] = []
    heights: list[list[float]] = []
    for touch in found:
        near = [i for i, spot in enumerate(spots) if _is_near(touch.spot, spot)]
        if near:
            heights[near[0]].append(touch.height)
        else:
            spots.append(touch.spot)
            heights.append([touch.height])
    require_places(len(spots))
    found_places: list[_Place] = []
    for spot, high in zip(spots, heights, strict=True):
        local = base.local(np.array([*spot, high[0]]))
        found_places.append(_Place(local[:2], np.array(high)))
    return found_places


def require_places(count: int) -> None:
    """Raises InputError where so many places do not show how the arm's frame leans."""
    if count < FEWEST:
        there = "at one place" if count == 1 else f"at {count} places"
        raise InputError(
            f"there are gauges {there}, and {FEWEST} are needed, {1e3 * tuning.APART:g} mm apart: fewer do not "
            "tell the fingers' length from how the arm's frame leans; give a scene with gauges of that height "
            "at several places"
        )


def _is_near(spot: Array, other: Array) -> bool:
    return float(np.linalg.norm(spot - other)) < tuning.APART


def _compliance(found: Sequence[Touch]) -> tuple[float, float]:
    """m/N, mean and standard deviation, of what gives way where the gauge does not. One loading
    curve tells it no better than its beginning is known."""
    each = np.array([touch.penetration / touch.full for touch in found])
    single = float(np.median([touch.first_std / touch.full for touch in found]))
    spread = max(float(each.std(ddof=1)), single / np.sqrt(len(found)))
    return float(each.mean()), max(spread, STIFF)
