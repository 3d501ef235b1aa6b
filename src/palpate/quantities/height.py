"""Height of a surface: of what is rigid under the fingertips, from a guarded descent."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

import numpy as np

from palpate.errors import InputError
from palpate.estimation import tuning
from palpate.estimation.contact import Stiff, Touch, touched
from palpate.estimation.estimate import Estimate, Part, not_measured
from palpate.geometry.pose import Array
from palpate.mjcf.body import Body, BodyDescription
from palpate.mjcf.document import UNKNOWN, Element, has_unknown, label, tokens
from palpate.mjcf.edits import Edit, Slot, number
from palpate.mjcf.roles import Elements, half_height_index
from palpate.mjcf.shapes import RESTING
from palpate.parameter import Parameter
from palpate.quantities.evidence import Evidence
from palpate.quantities.quantity import Prior, Quantity, Status, Values
from palpate.trace.recording import Hand
from palpate.trace.samples import POSE, Trace

UNIT = "m"

PLACEHOLDER = 0.01
"""m: stands for an unknown half height while the scene's shapes are compiled."""

SHOWN = 1e-4
"""m: a believed height must show in the compiled scene this closely."""

PRIOR_HEIGHT = 0.4
"""m, of a surface on which nothing stands."""

BARE_SPREAD, LADEN_SPREAD = 0.2, 0.01
"""m (1 sigma): of a surface nobody says anything of, and of one that something tells of."""

SUNK = 0.003
"""m: how far a hidden surface is below the believed one where things stand on it, at most: they
must not start inside it."""

OFF = 0.03
"""m: how far a hidden surface is off the believed one where nothing stands on it, at most."""


class Height(Quantity):
    """World z of a surface's top. Whichever number places the top may be unknown; when half height
    and place both are, a geom stands on its body's origin, and a body on the ground."""

    id = "height"
    unit = UNIT
    subject = "surface"
    words: ClassVar = {"en": ("height", "elevation", "level", "high", "tall")}
    evidence = (
        Evidence(
            POSE,
            "MoveUntilContact -z over a free spot, MeasureGripperPose",
            activity=("contact",),
        ),
    )
    estimators: ClassVar = {"loading-curve": "palpate.quantities.height:estimate_height"}

    def status(self, body: BodyDescription) -> Status:
        return "missing" if body.top_is_open else "known"

    def known(self, body: BodyDescription) -> tuple[float, ...]:
        return (body.top_z,)

    def slots(self, elements: Elements) -> Iterator[Slot]:
        if elements.element.tag == "body":
            yield Slot(elements.element, "pos", "0", (2,))
        for geom in elements.geoms:
            yield Slot(geom, "pos", "0", (2,))
            index = half_height_index(geom, elements.defaults)
            if index is not None:
                yield Slot(geom, "size", str(PLACEHOLDER), (index,))

    def prior(self, body: BodyDescription, believed: Values) -> Prior:
        """As given; else the lowest bottom of what stands there on nothing that is known; else
        below the given approach."""
        if body.given_z is not None:
            return Prior((body.top_z + body.given_z,), (LADEN_SPREAD,))
        bottoms = [float(foot[2]) for foot in _feet_above(body) if not _is_carried(body, foot)]
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
        """Into the numbers that are open; into the place of what is measured again."""
        element, geom = body.elements.element, body.carrier
        unknown = _open_places(body) or {str(element.tag)}
        rise = value[0] - body.top_z
        if "size" in unknown:
            rise, half = _half_height(unknown, rise)
            if half <= 0:
                raise InputError(
                    f"a height of {value[0]:.4g} m leaves '{body.name}' no thickness "
                    f"({label(geom)})"
                )
            index = half_height_index(geom, body.defaults)
            assert index is not None
            yield Edit(geom, "size", {index: number(half, std)})
        if "geom" in unknown:
            yield _raised(geom, rise, std)
        if "body" in unknown:
            yield _raised(element, 0.0 if "geom" in unknown else rise, std)

    def confirm(self, body: BodyDescription, value: tuple[float, ...]) -> None:
        if abs(body.top_z - value[0]) > SHOWN:
            raise InputError(
                f"the unknown number of {label(body.elements.element)} does not raise its top "
                "straight up; `?` needs an upright box, cylinder or plane"
            )


def _open_places(body: BodyDescription) -> set[str]:
    """Which numbers of a surface's height are `?`: the place of its `body` or `geom`, or `size`."""
    element = body.elements.element
    places: set[str] = set()
    if element.tag == "body" and has_unknown(element, "pos", 2):
        places.add("body")
    for geom in body.elements.geoms:
        if has_unknown(geom, "pos", 2):
            places.add("geom")
        if _has_open_size(geom, body):
            places.add("size")
    return places


def _has_open_size(geom: Element, body: BodyDescription) -> bool:
    index = half_height_index(geom, body.defaults)
    return index is not None and has_unknown(geom, "size", index)


def _half_height(unknown: set[str], rise: float) -> tuple[float, float]:
    """What the place rises and the half height becomes, from how far the top must rise, m."""
    if unknown == {"size"}:
        return 0.0, PLACEHOLDER + rise
    half = (rise + PLACEHOLDER) / 2
    return half, half


def _raised(element: Element, rise: float, std: float | None) -> Edit:
    part = tokens(element.get("pos") or "0 0 0")[2]
    z = rise + (0.0 if part == UNKNOWN else float(part))
    return Edit(element, "pos", {2: number(z, std)}, "0 0 0")


def _feet_above(surface: BodyDescription) -> Iterator[Array]:
    """Where objects with a known z stand over a surface: (3,) in the world, m."""
    for thing in surface.objects():
        foot = thing.footing()
        if thing.given_z is not None:
            foot[2] += thing.given_z
        elif has_unknown(thing.elements.element, "pos", 2):
            continue
        if surface.reaches_over(foot):
            yield foot


def _is_carried(surface: BodyDescription, foot: Array) -> bool:
    """Whether a surface of known height is right below."""
    for other in surface.surfaces():
        is_near = abs(foot[2] - other.top_z) < RESTING
        if not other.top_is_open and is_near and other.reaches_over(foot):
            return True
    return False


def estimate_height(trace: Trace, parameter: Parameter, body: Body | None) -> Estimate:
    """World z of the rigid surface under the fingertips.

    `parts`: `penetration` (how far the pressed tip was below it) and, when the force began to rise
    earlier, `soft onset` (world z). A surface that still gives way under the full force is
    `prior-dominated`.

    Raises:
        ValueError: the recording holds no samples, or no guarded descent comes before it.
    """
    recording = trace.converted(parameter)
    if recording is None:
        return not_measured(parameter, UNIT)
    touch = touched(trace, recording)
    stiff = touch.stiff
    penetration = stiff.compliance * max(touch.full - stiff.knee, 0.0)
    parts = {"penetration": Part(penetration, tuning.CORRECTION * penetration, UNIT)}
    if touch.soft is not None:
        parts["soft onset"] = Part(touch.soft, tuning.SOFT_ACCURACY, UNIT)
    return Estimate.normal(
        parameter,
        UNIT,
        stiff.height,
        _std(touch, penetration, trace.hand),
        _method(touch),
        (recording,),
        "identified" if stiff.rigid else "prior-dominated",
        parts,
    )


def _std(touch: Touch, penetration: float, hand: Hand) -> float:
    """m: of the pose, of the line, of its way back to no force, and of the force it starts from."""
    stiff = touch.stiff
    variance = (
        hand.pose_repeatability**2
        + stiff.scatter**2
        + (tuning.CORRECTION * penetration) ** 2
        + (stiff.compliance * hand.force_repeatability) ** 2
    )
    std = float(np.sqrt(variance))
    if stiff.rigid:
        return std
    # What gives way may end anywhere as far below as it has given way so far.
    return max(std, stiff.compliance * touch.full)


def _method(touch: Touch) -> str:
    stiff = touch.stiff
    text = (
        f"Height of the fingertips where the descent was stopped, carried back along the loading curve "
        f"({1e6 * stiff.compliance:.0f} µm/N, pressed with {touch.full:.1f} N) to its beginning"
    )
    if not stiff.rigid:
        return text + "; it still gives way under the full force, so nothing rigid was reached."
    return text + _softly(stiff, touch.soft) + "."


def _softly(stiff: Stiff, soft: float | None) -> str:
    if soft is None:
        return ""
    thickness = 1e3 * (soft - stiff.height)
    return f"; something soft above it, {thickness:.0f} mm thick, was pressed through"
