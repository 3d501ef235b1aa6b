"""Tilt of a surface: how its height rises along the world's x and y, from touches at several spots."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import ClassVar

import numpy as np

from palpate.estimation import tuning
from palpate.estimation.agreement import FitTest, chi_squared
from palpate.estimation.contact.descent import probes
from palpate.estimation.contact.plane import Plane
from palpate.estimation.contact.touch import Touch, plane_of, touches_of
from palpate.estimation.estimate import Estimate, Part, not_identified
from palpate.mjcf.body import Body
from palpate.parameter import Parameter
from palpate.quantities.evidence import Evidence
from palpate.quantities.quantity import Quantity
from palpate.trace.samples import POSE, Trace

UNIT = "rad"


class Tilt(Quantity):
    """Rise of a surface over world x and over world y. What the twin has of it stands in
    `<custom>`."""

    id = "tilt"
    unit = UNIT
    subject = "surface"
    words: ClassVar = {
        "en": ("tilt", "tilted", "slope", "inclination", "inclined", "lean", "levelness"),
        "de": ("neigung",),
        "es": ("inclinación",),
        "fr": ("inclinaison",),
        "it": ("inclinazione",),
    }
    size = 2
    evidence = (
        Evidence(
            POSE,
            "MoveUntilContact -z over three free spots at least 50 mm apart and not in line, each with "
            "MeasureGripperPose",
            activity=("contact",),
            distinct="place",
            count=3,
        ),
    )
    derived = True
    estimators: ClassVar = {"plane": "palpate.quantities.shape.tilt:estimate_tilt"}


def estimate_tilt(trace: Trace, parameter: Parameter, body: Body | None) -> Estimate:
    """Tilt of a surface from the plane through all its touches; `parts`: `angle` from level.

    Raises:
        ValueError: a recording holds no samples, or no guarded descent comes before it.
    """
    recordings = tuple(probes(trace, parameter))
    touches = touches_of(trace, recordings)
    plane = plane_of(touches, trace.hand) if touches else None
    if plane is None or plane.tilt is None or plane.slope is None or plane.slope_std is None:
        few = (
            f"{parameter.object} was touched at {len(touches)} spots; three that are {1e3 * tuning.APART:.0f} "
            "mm apart and not in line show how it leans."
        )
        return not_identified(parameter, UNIT, few, recordings)
    return Estimate.normal(
        parameter,
        UNIT,
        plane.slope,
        plane.slope_std,
        f"The plane through {len(touches)} touches leans by {np.degrees(plane.tilt[0]):.2f}°.",
        recordings,
        parts={"angle": Part(*plane.tilt)},
        tests=tuple(_tests(touches, plane)),
        views=(plane.view(of_tilt=True),),
    )


def _tests(touches: Sequence[Touch], plane: Plane) -> Iterator[FitTest]:
    yield max(touches, key=lambda touch: touch.at_most).firm()
    if plane.freedom:
        finding = "The touches do not lie in one plane: something lies on it, or it is not plane."
        yield chi_squared("touch against touch", plane.misfit, plane.freedom, finding)
