"""Horizontal position of a held object."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

import numpy as np

from palpate.common.errors import InputError
from palpate.common.parameter import Parameter
from palpate.common.pose import Array, Pose
from palpate.estimation.estimate import (
    Estimate,
    FitView,
    closing_samples,
    constant,
    not_identified,
    not_measured,
)
from palpate.estimation.motion import mean_pose
from palpate.estimation.quantities.quantity import Evidence, Prior, Quantity, Status, Values
from palpate.mjcf.body import Body, BodyDescription
from palpate.mjcf.document import UNKNOWN, has_unknown, label, tokens
from palpate.mjcf.edits import Edit, Slot, number, unknown_only
from palpate.mjcf.elements import Elements
from palpate.trace.recording import Recording
from palpate.trace.samples import POSE, Trace

CENTRING = 0.0015
"""m (1 sigma). Shift of an object as the closing fingers centre it; in simulated grasps it moved by up to 2.5 mm.
Sensitive: position std ×0.5–2.0."""

UNIT = "m"
PRIOR_POSITION = (0.5, 0.0)
"""m. Prior of an object without a given place: the middle of the workspace."""
UNPLACED, PLACED = 0.25, 0.01
"""m (1 sigma) of the prior without a given place, and with one from the poses."""
TRUE_SHIFT = 0.003
"""m. Largest deviation of a hidden position from the believed one, per axis."""
METHOD = (
    "The fingers centre the object between them as they close: along that direction the middle of its "
    "shapes is at the hand. Across it there is no evidence: the position is that of the scene."
)
ELSEWHERE = "It was measured where the object had been dragged or carried to, which does not say where it stood."


class Position(Quantity):
    """World x and y of the object's frame. An unknown z follows from its support."""

    id = "position"
    unit = UNIT
    subject = "object"
    words: ClassVar = {
        "en": ("position", "location", "place", "whereabouts", "where"),
        "de": ("position", "lage"),
        "es": ("posición",),
        "fr": ("position",),
        "it": ("posizione",),
    }
    size = 2
    evidence = (
        Evidence(
            POSE, "MeasureGripperPose while holding the object", holding=True, as_grasped=True
        ),
    )
    estimators: ClassVar = {"fingers": "palpate.estimation.quantities.position:estimate_position"}

    def status(self, body: BodyDescription) -> Status:
        return "missing" if has_unknown(body.elements.element, "pos", 0, 1) else "known"

    def compiled(self, body: BodyDescription) -> tuple[float, ...]:
        x, y, _ = body.pose_world.position
        return float(x), float(y)

    def slots(self, elements: Elements) -> Iterator[Slot]:
        yield Slot(elements.element, "pos", "0")

    def prior(self, body: BodyDescription, believed: Values) -> Prior:
        """Prior from the poses; else from the numbers stated in the file, with the workspace centre for the others."""
        stated = tokens(body.elements.element.get("pos"))[:2]
        if body.given is None:
            pairs = zip(stated, PRIOR_POSITION, strict=True)
            mean = [usual if part == UNKNOWN else float(part) for part, usual in pairs]
            spread = UNPLACED
        else:
            mean, spread = body.given.position[:2].tolist(), PLACED
        return Prior(tuple(mean), tuple(spread if part == UNKNOWN else 0.0 for part in stated))

    def draw(self, body: Body, prior: Prior, random: np.random.Generator) -> tuple[float, ...]:
        """Draw uniformly up to `TRUE_SHIFT` around the prior."""
        scale = np.full(2, TRUE_SHIFT)
        shift = random.uniform(-scale, scale) * (np.array(prior.std) > 0)
        return tuple(float(v) for v in np.array(prior.mean) + shift)

    def write(
        self, body: BodyDescription, value: tuple[float, ...], std: float | None
    ) -> Iterator[Edit]:
        element = body.elements.element
        require_world_frame(body)
        texts = {i: number(v, std) for i, v in enumerate(value[:2])}
        yield Edit(element, "pos", unknown_only(element, "pos", texts), "0 0 0")

    def places(self, body: Body, value: tuple[float, ...]) -> Pose | None:
        x, y = value
        return Pose.of((x, y, body.pose_world.position[2]), body.pose_world.quaternion)

    def follows(self, body: BodyDescription, believed: Values) -> Iterator[Edit]:
        """Fill an open z from the poses, else at rest on the surface below."""
        # A given z first; else the support's top minus the depth of the object's bottom below its frame.
        element = body.elements.element
        if not has_unknown(element, "pos", 2):
            return
        require_world_frame(body)
        z = body.given_z
        if z is None:
            support = support_z(body, believed)
            z = None if support is None else support - body.bottom_z
        if z is not None:
            yield Edit(element, "pos", {2: number(z)})


def support_z(body: BodyDescription, believed: Values) -> float | None:
    """World z, m, of the highest surface or object with stated z below the middle of an object.

    It is 0, the ground, without one, and None while the height of a surface below is unknown.
    """
    tops = list(_tops_of_objects(body))
    for surface in body.surfaces_below():
        height = believed.get(Parameter(surface.name, "height"))
        if height is None and surface.top_is_open:
            return max(tops, default=None)
        tops.append(surface.top_z if height is None else height[0])
    return max(tops, default=0.0)


def _tops_of_objects(body: BodyDescription) -> Iterator[float]:
    """Yield the world z, m, of the tops of the geoms of other objects below the middle of an object."""
    # Objects with a known position whose horizontal bounding box contains the middle.
    middle = body.footing()[:2]
    for other in body.objects():
        if other is body or has_unknown(other.elements.element, "pos"):
            continue
        for geom in other.elements.colliding:
            points = body.shapes.points(geom)
            low, high = points.min(axis=0), points.max(axis=0)
            if bool(np.all((low[:2] <= middle) & (middle <= high[:2]))):
                yield float(high[2])


def require_world_frame(body: BodyDescription) -> None:
    """Require that the element's `pos` is in the world.

    Raises InputError: the element is inside a frame that moves it.
    """
    outer = body.elements.posed_ancestor()
    if outer is not None:
        raise InputError(
            f"{label(body.elements.element)} is inside a <{outer.tag}> that moves it; write its pos in "
            "the world to have it measured"
        )


def estimate_position(trace: Trace, parameter: Parameter, body: Body | None) -> Estimate:
    """World x and y of the object's frame, from its grasps.

    The closing fingers centre the object: along their direction the middle of its bounding box is at the TCP. Across
    it the fingers give no evidence, and the believed position stays. A component in which that uncertainty dominates
    is prior-dominated. Raises ValueError: the recording holds no samples.
    """
    recording = trace.converted(parameter)
    if recording is None:
        return not_measured(parameter, UNIT)
    if recording.context.is_elsewhere:
        return not_identified(parameter, UNIT, ELSEWHERE, (recording,))
    samples = trace.of(recording)
    # Closing direction in the plane, and the error along it: noise, repeatability, and centring.
    hand = mean_pose(samples)
    closing = hand.rotation[:2, 1] / np.linalg.norm(hand.rotation[:2, 1])
    spread = (samples.pose_world_tcp[:, :2] @ closing).std() / np.sqrt(len(samples))
    measured = closing * np.linalg.norm([spread, trace.hand.pose_repeatability, CENTRING])
    # Across the closing direction, the believed position and its accuracy stay.
    across = np.array([-closing[1], closing[0]])
    value, std = hand.position[:2], None
    if body is not None:
        # Move the believed frame along the closing direction until its middle is at the TCP.
        std, middle = body.std(np.append(across, 0.0)), body.pose_world.apply(body.centre)[:2]
        value = body.pose_world.position[:2] + closing * float(closing @ (value - middle))
    # A component is unseen where the believed error exceeds the measured one.
    believed = across * (std or PLACED)
    unseen = np.abs(believed) > np.abs(measured)
    return Estimate.normal(
        parameter,
        UNIT,
        value,
        np.hypot(measured, believed),
        METHOD,
        evidence=(recording,),
        verdict="prior-dominated" if unseen.all() else "identified",
        unseen=tuple(np.flatnonzero(unseen).tolist()),
        views=tuple(grasp_views(trace, recording, hand.position[:2], closing)),
    )


def grasp_views(
    trace: Trace, recording: Recording, hand: Array, closing: Array
) -> Iterator[FitView]:
    """Chart of the hand's deviation from `hand` (2,) along the closing direction `closing` (2,) of the fingers."""
    samples = closing_samples(trace, recording)
    if samples is None:
        return
    # Motion of the hand along the closing direction, relative to its mean pose.
    heading = float(np.degrees(np.arctan2(closing[1], closing[0])))
    yield FitView(
        name=f"The grasp before {recording.start:.1f} s.",
        note=f"The fingers close along {heading:.0f}° from world x and centre the object between them: along that, its "
        "middle is where the hand is; across it, it is where the scene has it.",
        axes=("robot time (s)", "hand, along that (mm)"),
        x=samples.t,
        measured=1e3 * (samples.pose_world_tcp[:, :2] - hand) @ closing,
        predicted=constant(0.0, samples.t),
        used=samples.t >= recording.start,
        groups="the hand",
        slopes=1e3 * np.tile(closing, (len(samples), 1)),
    )
