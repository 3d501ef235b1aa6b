"""Height and tilt of the rigid surface under the fingertips, from guarded descents."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import ClassVar

import numpy as np

from palpate.common.errors import InputError
from palpate.common.parameter import Parameter
from palpate.common.pose import Array
from palpate.estimation.descent import probes
from palpate.estimation.estimate import (
    Estimate,
    FitTest,
    FurtherValue,
    Shared,
    chi_squared,
    not_identified,
    not_measured,
)
from palpate.estimation.quantities.quantity import Evidence, Prior, Quantity, Status, Values
from palpate.estimation.touch import (
    APART,
    CORRECTION,
    STIFF,
    YIELDING,
    Plane,
    SurfaceTouch,
    plane_of,
    touch_views,
    touches_of,
)
from palpate.mjcf.body import Body, BodyDescription
from palpate.mjcf.document import UNKNOWN, Element, has_unknown, label, tokens
from palpate.mjcf.edits import Edit, Slot, number
from palpate.mjcf.elements import Elements, half_height_index
from palpate.mjcf.shapes import RESTING
from palpate.trace.samples import POSE, Trace

SOFT_ACCURACY = 2e-3
"""m (1 sigma). Error of the first contact with a soft surface, which has no sharp onset. Sensitive: `soft onset` std
×0.5–2.0."""
UNGAUGED = 1e-3
"""m (1 sigma). Height error of an arm from which it counts as uncalibrated. A datasheet states 0.2 mm; a gauge block
reduces it to less than 0.1. Sensitive: no."""

UNIT, TILT_UNIT = "m", "rad"
TOUCH = Evidence(
    POSE,
    "MoveUntilContact -z over a free spot, MeasureGripperPose",
    activity=("contact",),
    distinct="place",
)
PLACEHOLDER = 0.01
"""m. Placeholder of an unknown half height while the scene is compiled."""
SHOWN = 1e-4
"""m. Tolerance of a believed height in the compiled scene."""
PRIOR_HEIGHT = 0.4
"""m. Prior height of a surface without objects on it."""
BARE_SPREAD, LADEN_SPREAD = 0.2, 0.01
"""m (1 sigma) of the prior height, without and with a hint: an object on the surface, or a given pose."""
SUNK = 0.003
"""m. Largest depth of a hidden surface below the believed one where objects rest on it, so that they do not start
inside it."""
OFF = 0.03
"""m. Largest deviation of a hidden surface from the believed one where no object rests on it."""


class Height(Quantity):
    """World z of a surface's top.

    Any number that places the top may be unknown. If both half height and position are, a geom rests on its body's
    origin, and a body on the ground.
    """

    id = "height"
    unit = UNIT
    subject = "surface"
    words: ClassVar = {
        "en": ("height", "elevation", "level", "high", "tall"),
        "de": ("höhe", "hoehe"),
        "es": ("altura",),
        "fr": ("hauteur",),
        "it": ("altezza",),
    }
    elsewhere = "size"
    evidence = (TOUCH,)
    estimators: ClassVar = {"loading-curve": "palpate.estimation.quantities.height:estimate_height"}

    def status(self, body: BodyDescription) -> Status:
        return "missing" if body.top_is_open else "known"

    def compiled(self, body: BodyDescription) -> tuple[float, ...]:
        return (body.top_z,)

    def slots(self, elements: Elements) -> Iterator[Slot]:
        if elements.element.tag == "body":
            # The z of the body and of its geoms, and the half height of upright shapes.
            yield Slot(elements.element, "pos", "0", (2,))
        for geom in elements.geoms:
            yield Slot(geom, "pos", "0", (2,))
            index = half_height_index(geom, elements.defaults)
            if index is not None:
                yield Slot(geom, "size", str(PLACEHOLDER), (index,))

    def prior(self, body: BodyDescription, believed: Values) -> Prior:
        """Prior from the given pose.

        Else it is the lowest bottom of the objects above that no known surface carries, else the given approach pose.
        """
        if body.given_z is not None:
            return Prior((body.top_z + body.given_z,), (LADEN_SPREAD,))
        bottoms = [float(foot[2]) for foot in feet_above(body) if not is_carried(body, foot)]
        if bottoms:
            return Prior((min(bottoms),), (LADEN_SPREAD,))
        if body.given_top is not None:
            return Prior((body.given_top,), (LADEN_SPREAD,))
        return Prior((PRIOR_HEIGHT,), (BARE_SPREAD,))

    def draw(self, body: Body, prior: Prior, random: np.random.Generator) -> tuple[float, ...]:
        off = random.uniform(-SUNK, 0.0) if body.carries else random.uniform(-OFF, OFF)
        return (float(prior.mean[0] + off),)

    def write(
        self, body: BodyDescription, value: tuple[float, ...], std: float | None
    ) -> Iterator[Edit]:
        """Write into the open numbers; without any, into the z of the element."""
        element, geom = body.elements.element, body.carrier
        unknown = open_places(body) or {str(element.tag)}
        rise = value[0] - body.top_z
        if "size" in unknown:
            # Half height alone: the geom grows about its centre. Otherwise the geom rests on its body's origin: half
            # of the top's rise above the placeholder is its half height, and its centre rises as much.
            if unknown == {"size"}:
                rise, half = 0.0, PLACEHOLDER + rise
            else:
                rise = half = (rise + PLACEHOLDER) / 2
            if half <= 0:
                raise InputError(
                    f"a height of {value[0]:.4g} m leaves '{body.name}' no thickness "
                    f"({label(geom)})"
                )
            index = half_height_index(geom, body.defaults)
            assert index is not None
            yield Edit(geom, "size", {index: number(half, std)})
        # The rise goes to the geom if its z is open, else to the body.
        if "geom" in unknown:
            yield raise_element(geom, rise, std)
        if "body" in unknown:
            yield raise_element(element, 0.0 if "geom" in unknown else rise, std)

    def confirm(self, body: BodyDescription, value: tuple[float, ...]) -> None:
        if abs(body.top_z - value[0]) > SHOWN:
            raise InputError(
                f"the unknown number of {label(body.elements.element)} does not raise its top "
                "straight up; `?` needs an upright box, cylinder or plane"
            )


def open_places(body: BodyDescription) -> set[str]:
    """Unknown numbers of a surface's height: the z of its `body` or `geom`, or its half height, `size`."""
    element = body.elements.element
    places: set[str] = set()
    # The z of the body, then the z and half height of its geoms.
    if element.tag == "body" and has_unknown(element, "pos", 2):
        places.add("body")
    for geom in body.elements.geoms:
        if has_unknown(geom, "pos", 2):
            places.add("geom")
        index = half_height_index(geom, body.defaults)
        if index is not None and has_unknown(geom, "size", index):
            places.add("size")
    return places


def raise_element(element: Element, rise: float, std: float | None) -> Edit:
    """Edit that raises an element by `rise`, m, from its z, or from 0 if that is unknown."""
    part = tokens(element.get("pos") or "0 0 0")[2]
    z = rise + (0.0 if part == UNKNOWN else float(part))
    return Edit(element, "pos", {2: number(z, std)}, "0 0 0")


def feet_above(surface: BodyDescription) -> Iterator[Array]:
    """Yield the support points (3,), m, world, of the objects with known z above a surface."""
    for thing in surface.objects():
        foot = thing.footing()
        if thing.given_z is not None:
            foot[2] += thing.given_z
        elif has_unknown(thing.elements.element, "pos", 2):
            continue
        if surface.reaches_over(foot):
            yield foot


def is_carried(surface: BodyDescription, foot: Array) -> bool:
    """True if a surface of known height is directly below the support point `foot`."""
    known = [other for other in surface.surfaces() if not other.top_is_open]
    return any(abs(foot[2] - s.top_z) < RESTING and s.reaches_over(foot) for s in known)


def estimate_height(trace: Trace, parameter: Parameter, body: Body | None) -> Estimate:
    """World z of the rigid surface under the fingertips, from all touches.

    `parts` holds `penetration` (depth of the pressed tip below it), `soft onset` (world z) where a soft layer was
    pressed through, and `tilt` from three touches on.
    Raises ValueError: A recording holds no samples, or no guarded descent comes before it.
    """
    declared = trace.converted(parameter)
    if declared is None:
        return not_measured(parameter, UNIT)
    # All guarded descents on the surface, or the declared one alone.
    recordings = probes(trace, parameter) or [declared]
    found = touches_of(trace, recordings)
    if not found:
        nothing = "The descent ended with nothing pressing back on the fingertips."
        return not_identified(parameter, UNIT, nothing, tuple(recordings))
    # Plane through all touches; the tip length adds an error common to the arm.
    plane, tip_std = plane_of(found, trace.hand), trace.hand.tip_offset_std
    made = Estimate.normal(
        parameter,
        UNIT,
        plane.height,
        float(np.hypot(plane.std, tip_std)),
        method=height_method(found, plane, tip_std),
        evidence=tuple(touch.recording for touch in found),
        parts=height_parts(found, plane),
        # Equal load on both fingers counts for the height alone.
        tests=(*plane_tests(found, plane), *(test for touch in found for test in touch.sides())),
        views=touch_views(found, plane),
    )
    return replace(made, shared=(Shared("length of the fingertips", "arm", (tip_std,)),))


def plane_tests(found: Sequence[SurfaceTouch], plane: Plane) -> Iterator[FitTest]:
    """Goodness-of-fit tests of one rigid plane."""
    # Rigidity of the softest touch, and agreement of the touches.
    yield max(found, key=lambda touch: touch.at_most).firm()
    if plane.freedom:
        yield chi_squared(
            "touch against touch",
            plane.misfit,
            plane.freedom,
            "The touches do not agree on one plane: something lies on it, or it is not plane.",
        )


def height_parts(found: Sequence[SurfaceTouch], plane: Plane) -> dict[str, FurtherValue]:
    """Further results: largest penetration, onset of a soft layer, and tilt."""
    # Correction of the deepest touch back to its contact onset, with its relative error.
    deepest = max(found, key=lambda touch: touch.penetration)
    depth = deepest.penetration
    share = CORRECTION if depth <= STIFF * deepest.full else YIELDING
    parts = {"penetration": FurtherValue(depth, share * depth, UNIT)}
    # Onset of the softest layer that was pressed through.
    softest = max(found, key=lambda touch: touch.soft)
    if softest.soft > 0.0:
        accuracy = float(np.hypot(SOFT_ACCURACY, softest.first_std))
        parts["soft onset"] = FurtherValue(softest.first, accuracy, UNIT)
    if plane.tilt is not None:
        parts["tilt"] = FurtherValue(*plane.tilt, "rad")
    return parts


def height_method(found: Sequence[SurfaceTouch], plane: Plane, tip_std: float) -> str:
    """Describe the touches.

    Adds advice to calibrate if the standard deviation of the tip length, m, exceeds that of the touches.
    """
    last = found[-1]
    times = "" if len(found) == 1 else f" of {len(found)} touches"
    text = (
        f"Height of the fingertips{times} where the descent was stopped, carried back along the loading "
        f"curve ({1e6 * last.penetration / last.full:.0f} µm/N, pressed with {last.full:.1f} N) to its "
        "beginning"
    )
    # Mention a soft layer and the tilt.
    thickest = max(touch.soft for touch in found)
    if thickest > 0.0:
        text += f"; something soft above it, {1e3 * thickest:.0f} mm thick, was pressed through"
    if plane.tilt is not None:
        text += f"; the plane through them leans by {np.degrees(plane.tilt[0]):.2f}°"
    if tip_std < UNGAUGED or tip_std < plane.std:
        return f"{text}."
    return (
        f"{text}. The arm's own height is known to ± {2e3 * tip_std:.0f} mm (95 %), because it is "
        "not calibrated: touch something of known height (palpate calibrate --gauge)."
    )


class SurfaceTilt(Quantity):
    """Slope of a surface along world x and y. The twin states it in `<custom>`."""

    id = "tilt"
    unit = TILT_UNIT
    subject = "surface"
    words: ClassVar = {
        "en": ("tilt", "tilted", "slope", "inclination", "inclined", "lean", "levelness"),
        "de": ("neigung",),
        "es": ("inclinación",),
        "fr": ("inclinaison",),
        "it": ("inclinazione",),
    }
    size = 2
    how = "as stiffness, at three free spots at least 50 mm apart and not in line"
    evidence = (replace(TOUCH, how=how, count=3),)
    derived = True
    estimators: ClassVar = {"plane": "palpate.estimation.quantities.height:estimate_tilt"}


def estimate_tilt(trace: Trace, parameter: Parameter, body: Body | None) -> Estimate:
    """Tilt of a surface from the plane through all touches; `parts` holds the `angle` from level.

    Raises ValueError: A recording holds no samples, or no guarded descent comes before it.
    """
    recordings = tuple(probes(trace, parameter))
    touches = touches_of(trace, recordings)
    plane = plane_of(touches, trace.hand) if touches else None
    if plane is None or plane.tilt is None or plane.slope is None or plane.slope_std is None:
        few = (
            f"{parameter.object} was touched at {len(touches)} spots; three that are {1e3 * APART:.0f} "
            "mm apart and not in line show how it leans."
        )
        return not_identified(parameter, TILT_UNIT, few, recordings)
    return Estimate.normal(
        parameter,
        TILT_UNIT,
        plane.slope,
        plane.slope_std,
        method=f"The plane through {len(touches)} touches leans by {np.degrees(plane.tilt[0]):.2f}°.",
        evidence=recordings,
        parts={"angle": FurtherValue(*plane.tilt)},
        tests=tuple(plane_tests(touches, plane)),
        views=(plane.view(of_tilt=True),),
    )
