"""Where the fingertips end, from heights that are known.

What the arm's frame adds to a height (its base, its links, its encoders' zeros) cannot be told from
the tips' length at one place. Over several it shows in how far the touches disagree, and stays in the
standard deviation: what is gauged here holds over the places that were touched.
"""

from __future__ import annotations

import math
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
from palpate.geometry.pose import Array
from palpate.parameter import Parameter
from palpate.trace.samples import Trace

FEWEST = 3
"""Places that show how the arm's frame leans."""
STIFF = 1e-6
"""m/N: what a gauge of steel, and what it stands on, give way by themselves."""


@dataclass(frozen=True, slots=True)
class Tips:
    """Of the fingertips: m and m/N.

    Attributes:
        offset: from the TCP to their end, along the tool, with offset_std.
        compliance: of pads and joints beyond the encoders, with compliance_std.
        touches: how many it rests on.
    """

    offset: float
    offset_std: float
    compliance: float
    compliance_std: float
    touches: int


def gauged(trace: Trace, surfaces: Sequence[Parameter], known: Stated) -> Tips:
    """What is known of the fingertips after touches of `surfaces`, all of which are `known` m high.

    Raises:
        InputError: too few touches, or what was met is not as high as it is said to be.
    """
    found = _touches(trace, surfaces)
    places = _places(found)
    hand = trace.hand
    longer = np.array([place.mean() for place in places]) - known.value
    single = float(np.hypot(hand.pose_repeatability, tuning.UNSEEN))
    # What the places disagree beyond the repeatability of touches is the frame, which is another one
    # elsewhere.
    chance = float(np.mean([single**2 / len(place) for place in places]))
    between = float(longer.var(ddof=1))
    frame = max(0.0, between - chance)
    mean = float(longer.mean())
    std = math.sqrt(max(between, chance) / len(places) + frame + known.std**2)
    apart = chi_squared(
        "gauge",
        mean**2 / (std**2 + hand.tip_offset_std**2),
        1,
        f"It was met {1e3 * abs(mean):.2f} mm {'above' if mean > 0 else 'below'} the height that it is "
        f"said to have ({known.text}): it is another one, or the fingers are not the description's.",
    )
    require([apart], "the gauge")
    touches = sum(len(place) for place in places)
    return Tips(hand.tip_offset + mean, std, *_compliance(found), touches)


def _touches(trace: Trace, surfaces: Sequence[Parameter]) -> list[Touch]:
    found: list[Touch] = []
    for surface in surfaces:
        met = [touched(trace, recording) for recording in probes(trace, surface)]
        found += [touch for touch in met if touch is not None]
    for touch in found:
        if touch.gives_way or touch.soft > 0.0:
            raise InputError(
                f"the gauge gives way by {1e6 * touch.yields:.0f} µm/N where it was touched: put it "
                "on something rigid; nothing is written"
            )
    return found


def _places(found: Sequence[Touch]) -> list[Array]:
    """Heights (k,), m, of the touches at each place.

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
            "mm apart: one alone does not tell the fingers' length from what the arm's frame adds to "
            "a height there; give a scene with gauges of that height at several places"
        )
    return [np.array(place) for place in heights]


def _is_near(spot: Array, other: Array) -> bool:
    return float(np.linalg.norm(spot - other)) < tuning.APART


def _compliance(found: Sequence[Touch]) -> tuple[float, float]:
    """m/N, mean and standard deviation, of what gives way where the gauge does not. One loading
    curve tells it no better than its beginning is known."""
    each = np.array([touch.penetration / touch.full for touch in found])
    single = float(np.median([touch.first_std / touch.full for touch in found]))
    spread = max(float(each.std(ddof=1)), single / np.sqrt(len(found)))
    return float(each.mean()), max(spread, STIFF)
