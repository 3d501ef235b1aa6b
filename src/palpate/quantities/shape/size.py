"""Size of an object: its three extents, from the finger opening at a grasp and a touch of its top."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from palpate.estimation import tuning
from palpate.estimation.agreement import FitTest
from palpate.estimation.contact.descent import probes
from palpate.estimation.contact.touch import Touch, plane_of, touch_views, touches_of
from palpate.estimation.estimate import Estimate, not_identified
from palpate.estimation.motion import mean_pose
from palpate.estimation.view import FitView, closing_samples, constant, unit_slopes
from palpate.geometry.pose import Array
from palpate.mjcf.body import Body, BodyDescription
from palpate.mjcf.document import has_unknown
from palpate.mjcf.edits import Edit, Slot
from palpate.mjcf.roles.elements import Elements
from palpate.parameter import Parameter
from palpate.quantities.evidence import Evidence
from palpate.quantities.position import support_z
from palpate.quantities.quantity import Prior, Quantity, Status, Values
from palpate.quantities.shape.extents import filled, is_one_shape, open_extents, scaled
from palpate.trace.recording import Hand, Recording
from palpate.trace.samples import POSE, Trace

UNIT = "m"

HALF = 0.03
"""m: half of an extent that nobody states: two fingers of an ordinary hand reach around it."""

LEAST = 0.005
"""m: the middle of a thing is at least so far above what it stands on."""

OFF = 0.1
"""A hidden extent is at most this share off the believed one."""

ROUND = frozenset(("cylinder", "sphere", "capsule"))
"""Shapes that are as wide whichever way they are taken."""

AXES = "xyz"


class Size(Quantity):
    """Full extents along the axes of the object's own frame: the width from the finger opening at a
    grasp, the height from a touch of its top."""

    id = "size"
    unit = UNIT
    subject = "object"
    words: ClassVar = {
        "en": (
            "size",
            "dimension",
            "extent",
            "width",
            "length",
            "breadth",
            "thickness",
            "wide",
            "long",
            "thick",
            "big",
            "large",
        ),
        "de": ("größe", "grösse", "abmessungen", "maße", "breite", "länge", "dicke"),
        "es": ("tamaño", "dimensiones", "ancho", "largo", "grosor"),
        "fr": ("taille", "dimensions", "largeur", "longueur", "épaisseur"),
        "it": ("dimensione", "dimensioni", "grandezza", "larghezza", "lunghezza", "spessore"),
    }
    size = 3
    evidence = (
        Evidence(
            POSE,
            "with the fingers folded above `<object>_top` MoveUntilContact -z, MeasureGripperPose",
            activity=("contact",),
            place="top",
        ),
        Evidence(
            POSE,
            "MeasureGripperPose while the object is held at its grasp pose",
            holding=True,
            place="pose",
        ),
        Evidence(
            POSE,
            "MeasureGripperPose while it is held at `<object>_across`, a quarter turn on, where "
            "that fits the hand",
            holding=True,
            place="across",
            optional=True,
        ),
    )
    derived = True
    estimators: ClassVar = {"touch": "palpate.quantities.shape.size:estimate_size"}

    def needs(self, body: Body, bodies: Mapping[str, Body]) -> Iterator[Parameter]:
        """The height of what it stands on, where nobody knows it."""
        for other in bodies.values():
            if body.name in other.carries and "height" in other.missing:
                yield Parameter(other.name, "height")

    def shown(self, body: Body) -> tuple[float, ...]:
        return tuple(body.size.tolist())

    def compiled(self, body: BodyDescription) -> tuple[float, ...]:
        return tuple(body.box()[1].tolist())

    def status(self, body: BodyDescription) -> Status:
        """Missing where a `?` stands for it; else MJCF states it in its own way, by shapes."""
        return "missing" if open_extents(body).any() else "not applicable"

    def slots(self, elements: Elements) -> Iterator[Slot]:
        """The numbers of a single shape that is centred where its body is."""
        if is_one_shape(elements) and not has_unknown(elements.element, "pos", 2):
            yield Slot(elements.geoms[0], "size", str(HALF))

    def prior(self, body: BodyDescription, believed: Values) -> Prior:
        """Prior: as high as fits between its middle and its support; as wide as a hand takes."""
        extents, is_open = body.box()[1], open_extents(body)
        mean = np.where(is_open, 2 * HALF, extents)
        std = np.where(is_open, tuning.EXTENT_PRIOR * mean, 0.0)
        support = support_z(body, believed)
        up = np.abs(body.pose_world.rotation[2]) > tuning.ALIGNED
        if support is not None and float(body.cloud[:, 2].mean()) > support + LEAST:
            mean = np.where(is_open & up, 2 * (float(body.cloud[:, 2].mean()) - support), mean)
        return Prior(tuple(mean.tolist()), tuple(std.tolist()))

    def draw(self, body: Body, prior: Prior, random: np.random.Generator) -> tuple[float, ...]:
        """Uniform within `OFF` sideways; supported objects keep their height."""
        up = np.abs(body.pose_world.rotation[2]) > tuning.ALIGNED
        off = random.uniform(-OFF, OFF, 3) * (np.array(prior.std) > 0.0) * ~up
        return tuple((np.array(prior.mean) * (1.0 + off)).tolist())

    def write(
        self, body: BodyDescription, value: tuple[float, ...], std: float | None
    ) -> Iterator[Edit]:
        """Into its shapes, which grow from the middle of what it stands on; a shape of open numbers
        about its own."""
        centre, extents = body.box()
        scale = np.array(value) / np.maximum(extents, 1e-9)
        if open_extents(body).any():
            yield filled(body, body.elements.geoms[0], scale, std)
            return
        if np.abs(scale - 1.0).max() < 1e-6:
            return
        down = -body.pose_world.rotation[2]
        anchor = centre + extents / 2 * np.where(np.abs(down) > tuning.ALIGNED, down, 0.0)
        for geom in body.elements.geoms:
            yield from scaled(body, geom, scale, anchor, std)


@dataclass(frozen=True, slots=True)
class _Extent:
    """Measured extent along an axis of the object, m, with its standard deviation."""

    axis: int
    value: float
    std: float


def estimate_size(trace: Trace, parameter: Parameter, body: Body | None) -> Estimate:
    """Extents of an object from the finger opening at its grasps, and from a touch of its top.

    An extent that nothing told stays as the scene has it, with its prior deviation, and the method
    says so.

    Raises:
        ValueError: a recording holds no samples, or no guarded descent comes before it.
    """
    name, held = parameter.object, _held(trace, parameter.object)
    touches = touches_of(trace, probes(trace, parameter))
    if body is None or not (held or touches):
        return not_identified(parameter, UNIT, f"Nothing was recorded that tells of '{name}'.")
    found = [*_widths(trace, held, body), *_heights(trace, touches, body)]
    if not found:
        why = f"'{name}' was touched across its own axes only, along which its size is told."
        return not_identified(parameter, UNIT, why, tuple(held))
    value, std = body.size.copy(), tuning.EXTENT_PRIOR * body.size
    for axis in range(3):
        told = [extent for extent in found if extent.axis == axis]
        if told:
            weights = np.array([extent.std for extent in told]) ** -2.0
            value[axis] = np.average([extent.value for extent in told], weights=weights)
            std[axis] = max(float(weights.sum() ** -0.5), min(extent.std for extent in told) / 2)
    return Estimate.normal(
        parameter,
        UNIT,
        value,
        std,
        _method({extent.axis for extent in found}),
        (*held, *(touch.recording for touch in touches)),
        least=0.0,
        tests=tuple(_tests(touches)),
        unseen=tuple(sorted({0, 1, 2} - {extent.axis for extent in found})),
        views=(*_width_views(trace, held, value), *_top_views(trace, touches, body)),
    )


def _width_views(trace: Trace, held: Sequence[Recording], value: Array) -> Iterator[FitView]:
    """Opening of the fingers as they closed on the object, against the extent nearest to it."""
    for recording in held:
        samples = closing_samples(trace, recording)
        if samples is None:
            continue
        opening = float(np.median(trace.of(recording).width))
        axis = int(np.abs(value - opening).argmin())
        yield FitView(
            name=f"The grasp before {recording.start:.1f} s.",
            note=f"The fingers stayed {1e3 * opening:.2f} mm apart; what the pads yield as they squeeze is added. It "
            f"is the extent along {AXES[axis]} of the object.",
            axes=("robot time (s)", "opening (mm)"),
            x=samples.t,
            measured=1e3 * samples.width,
            predicted=constant(1e3 * float(value[axis]), samples.t),
            used=samples.t >= recording.start,
            groups="between the fingers",
            slopes=unit_slopes(samples.t, axis, 3, 1e3),
        )


def _top_views(trace: Trace, touches: Sequence[Touch], body: Body) -> tuple[FitView, ...]:
    upright = np.abs(body.pose_world.rotation[2]) > tuning.ALIGNED
    if not touches or not upright.any():
        return ()
    return touch_views(touches, plane_of(touches, trace.hand), upright.astype(float))


def _held(trace: Trace, name: str) -> list[Recording]:
    found: list[Recording] = []
    for recording in trace.recordings:
        if recording.buffer == POSE and recording.context.holding == name:
            found.append(recording)
    return found


def _widths(trace: Trace, held: Sequence[Recording], body: Body) -> Iterator[_Extent]:
    """Widths from grasps that closed along an axis of the object, or around a round one."""
    for recording in held:
        closing = mean_pose(trace.of(recording)).rotation[:, 1]
        width, std = _width(trace, recording)
        along = np.abs(body.pose_world.rotation.T @ closing)
        level = np.abs(body.pose_world.rotation[2]) < 1.0 - tuning.ALIGNED
        axes = np.flatnonzero(along > tuning.ALIGNED)
        if body.words & ROUND and level.sum() == 2:
            axes = np.flatnonzero(level)
        for axis in axes.tolist():
            yield _Extent(axis, width, std)


def _width(trace: Trace, recording: Recording) -> tuple[float, float]:
    """m, and its standard deviation: how far the fingers were open as they met the object, before
    they took hold of it, and by how much they came nearer then."""
    held = float(np.median(trace.of(recording).width))
    before = [leaf for leaf in trace.leaf_runs("CloseGripper") if leaf.end <= recording.start]
    if not before:
        return held, tuning.OPENING_HELD
    samples = trace.samples.between(before[-1].start, before[-1].end)
    resting = np.abs(np.gradient(samples.width, samples.t)) < tuning.FINGERS_REST
    met = samples.width[resting & (samples.width < held + tuning.GRASP_YIELDS)]
    if not len(met):
        return held, tuning.OPENING_HELD
    squeezed = max(float(np.quantile(met, tuning.FIRST_MET)) - held, 0.0)
    share = tuning.FIRST_SQUEEZE
    width = held + (1.0 + share) * squeezed
    return width, float(np.hypot(tuning.OPENING, share * squeezed))


def _heights(trace: Trace, touches: Sequence[Touch], body: Body) -> Iterator[_Extent]:
    """Height of the touched top above the support."""
    upright = np.flatnonzero(np.abs(body.pose_world.rotation[2]) > tuning.ALIGNED)
    if not touches or not len(upright):
        return
    top, top_std = _height(touches, trace.hand)
    below, below_std = _support(trace, body)
    yield _Extent(int(upright[0]), top - below, float(np.hypot(top_std, below_std)))


def _height(touches: Sequence[Touch], hand: Hand) -> tuple[float, float]:
    """World z, m, and its standard deviation without the length of the tips."""
    plane = plane_of(touches, hand)
    return plane.height, plane.std


def _support(trace: Trace, body: Body) -> tuple[float, float]:
    """World z of what the object stands on: of the surface that was touched nearest to where the
    scene has its bottom, else that; m, with its standard deviation.

    The length of the tips is in both touches, and so in neither extent; in one alone it counts.
    """
    bottom = body.bottom_z()
    told = [(bottom, float(np.hypot(tuning.PLACE_ACCURACY, trace.hand.tip_offset_std)))]
    names = {r.context.support for r in trace.recordings} - {None, body.name}
    for name in sorted(filter(None, names)):
        touches = touches_of(trace, probes(trace, Parameter(name, "height")))
        if touches:
            told.append(_height(touches, trace.hand))
    near = [found for found in told[1:] if abs(found[0] - bottom) < tuning.SAME_SUPPORT]
    return min(near, key=lambda found: abs(found[0] - bottom)) if near else told[0]


def _tests(touches: Iterable[Touch]) -> Iterator[FitTest]:
    """Tests for a rigid top: nothing soft on the object or under it.

    An object ends where it is met. It may give way a little as it is pressed, or what it stands on:
    where it was met is then uncertain by a part of that, which its standard deviation tells.
    """
    for touch in touches:
        if touch.penetration > tuning.SOFT:
            yield touch.firm()


def _method(axes: set[int]) -> str:
    told = ", ".join(AXES[axis] for axis in sorted(axes))
    text = (
        f"Along {told}: how far the fingers stayed open as they held it, and how high its top was touched above "
        "what it stands on."
    )
    blind = [AXES[axis] for axis in range(3) if axis not in axes]
    if not blind:
        return text
    return f"{text} Along {', '.join(blind)} nothing told, and it is as the scene has it."
