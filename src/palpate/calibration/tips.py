"""Where the fingertips end, and how the arm's frame leans, from heights that are known.

What a fingertip touches h too high, at x and y from the base, tells

    h = c + s_x x + s_y y

c: the tips are longer than was thought, or the base lower; s: the base leans, or the joints' zeros and
links make it seem so, which over a few decimetres is the same. What such a plane leaves of the frames
of arms that nobody calibrated is `BENT`, and how well an arm comes to a height again its datasheet says.
Of this very arm the touches tell how much of the latter there is; five places, of which a plane takes three,
tell too little of the former.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

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
    """What is known after touches of `surfaces`, all of which are `known` m high, by an arm that
    stands at `base` and reaches `reach` m.

    Raises:
        InputError: too few touches, or what was met is not as high as it is said to be, or not in one
            plane.
    """
    found, hand = _touches(trace, surfaces), trace.hand
    places = _places(found, base)
    high = np.array([float(np.mean(place.heights)) for place in places]) - known.value
    stated = _spread(places, hand.pose_repeatability)
    spots = np.array([place.spot for place in places])
    middle = spots.mean(axis=0)
    # About the middle of the gauges, where height and lean are told apart best.
    design = np.column_stack([np.ones(len(spots)), spots - middle])
    leaning = hand.tip_offset_std / reach
    prior = np.array([hand.tip_offset_std, leaning, leaning])
    deviations = [place.heights - known.value for place in places]
    repeated = _repeated(deviations, design, prior, hand.pose_repeatability)
    spread = _spread(places, repeated)
    white = design / spread[:, None]
    covariance = _inverse(white.T @ white + np.diag(prior**-2.0))
    mean = covariance @ (white.T @ (high / spread))
    _require_plane(high, design, mean, stated, prior, known)
    here = float(np.trace(design @ covariance @ design.T)) / len(places)
    away = hand.tip_offset_std * AROUND / reach
    along = np.sqrt(covariance.diagonal()[1:])
    return Tips(
        hand.tip_offset + float(mean[0] - mean[1:] @ middle),
        float(np.linalg.norm([here**0.5, BENT, away, known.std])),
        repeated,
        np.array([-mean[2], mean[1]]),
        np.array([along[1], along[0]]),
        *_compliance(found),
        len(found),
    )


def _spread(places: Sequence[_Place], repeatability: float) -> Array:
    """(n,) m (1 sigma) by which the mean of the touches at each place may be off a plane."""
    single = np.hypot(repeatability, tuning.UNSEEN)
    return np.array([np.hypot(BENT, single / np.sqrt(len(place.heights))) for place in places])


def _repeated(heights: Sequence[Array], design: Array, prior: Array, stated: float) -> float:
    """m, how well this arm's poses repeat: root mean square over how likely each of `SHARES` of what is
    `stated` makes the `heights` (k,) felt at each place, m too high (Bishop, Pattern Recognition and Machine
    Learning, section 3.4)."""
    each = [len(high) for high in heights]
    felt, rows = np.concatenate(heights), np.repeat(design, each, axis=0)
    place = np.repeat(np.arange(len(each)), each)
    known: Array = (rows * prior) @ (rows * prior).T
    known += BENT**2 * np.equal.outer(place, place) + tuning.UNSEEN**2 * np.eye(len(felt))
    variances = (stated * np.array(SHARES)) ** 2
    likely: list[float] = []
    for variance in variances.tolist():
        covariance: Array = known + variance * np.eye(len(felt))
        misfit = float(felt @ np.linalg.solve(covariance, felt))
        likely.append(-(misfit + float(np.linalg.slogdet(covariance)[1])) / 2.0)
    weights = np.exp(np.array(likely) - max(likely))
    return float(np.sqrt(np.average(variances, weights=weights)))


def _require_plane(
    high: Array, design: Array, mean: Array, spread: Array, prior: Array, known: Stated
) -> None:
    """That the gauges lie in one plane, and not farther off than what was known of the arm allows."""
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
    for touch in found:
        if touch.gives_way or touch.soft > 0.0:
            raise InputError(
                f"the gauge gives way by {1e6 * touch.spring.compliance:.0f} µm/N where it was touched: put it "
                "on something rigid; nothing is written"
            )
    sides = [test for touch in found for test in touch.sides()]
    require(sides, "the gauge")
    return found


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
    if len(spots) < FEWEST:
        raise InputError(
            f"gauges were touched at {len(spots)} places, and {FEWEST} are needed, {1e3 * tuning.APART:g} "
            "mm apart: fewer do not tell the fingers' length from how the arm's frame leans; give a "
            "scene with gauges of that height at several places"
        )
    found_places: list[_Place] = []
    for spot, high in zip(spots, heights, strict=True):
        local = base.local(np.array([*spot, high[0]]))
        found_places.append(_Place(local[:2], np.array(high)))
    return found_places


def _is_near(spot: Array, other: Array) -> bool:
    return float(np.linalg.norm(spot - other)) < tuning.APART


def _compliance(found: Sequence[Touch]) -> tuple[float, float]:
    """m/N, mean and standard deviation, of what gives way where the gauge does not. One loading
    curve tells it no better than its beginning is known."""
    each = np.array([touch.penetration / touch.full for touch in found])
    single = float(np.median([touch.first_std / touch.full for touch in found]))
    spread = max(float(each.std(ddof=1)), single / np.sqrt(len(found)))
    return float(each.mean()), max(spread, STIFF)
