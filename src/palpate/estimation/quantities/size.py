"""Size of an object: its three extents, from the finger opening at a grasp and a touch of its top.

In the file they are the `size` of its geoms, or the `scale` of its meshes.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from palpate.common.errors import InputError
from palpate.common.parameter import Parameter
from palpate.common.pose import Array, Pose
from palpate.estimation.balance import PLACE_ACCURACY
from palpate.estimation.descent import SOFT, probes
from palpate.estimation.estimate import (
    Estimate,
    FitView,
    closing_samples,
    constant,
    not_identified,
    unit_slopes,
)
from palpate.estimation.grip import ALIGNED, Extent, widths, widths_at_grasps
from palpate.estimation.quantities.position import support_z
from palpate.estimation.quantities.quantity import Evidence, Prior, Quantity, Status, Values
from palpate.estimation.touch import SurfaceTouch, plane_of, touch_views, touches_of
from palpate.mjcf.body import Body, BodyDescription
from palpate.mjcf.document import UNKNOWN, Element, has_unknown, label, tokens
from palpate.mjcf.edits import Edit, Slot, number, unknown_only
from palpate.mjcf.elements import Elements
from palpate.trace.recording import Recording
from palpate.trace.samples import POSE, Trace

EXTENT_PRIOR = 0.25
"""1 sigma of an extent before measuring, as a fraction of it. Sensitive: no."""
SAME_SUPPORT = 0.05
"""m. Largest distance of a touched surface from an object's bottom in the scene at which it is its support. Sensitive:
no."""

UNIT = "m"
HALF = 0.03
"""m. Half of an unstated extent: two fingers of an ordinary hand reach around it."""
LEAST = 0.005
"""m. Smallest height of the middle of an object above its support."""
OFF = 0.1
"""Largest relative deviation of a hidden extent from the believed one."""
AXES = "xyz"
RADII: Mapping[str, tuple[tuple[int, ...], ...]] = {
    "box": ((0,), (1,), (2,)),
    "ellipsoid": ((0,), (1,), (2,)),
    "cylinder": ((0, 1), (2,)),
    "capsule": ((0, 1), (2,)),
    "sphere": ((0, 1, 2),),
}
"""Axes of a geom along which each number of its `size` lies, by type."""


class Size(Quantity):
    """Full extents along the axes of the object's frame.

    The width is from the finger opening at a grasp, the height from a touch of its top.
    """

    id = "size"
    unit = UNIT
    subject = "object"
    bounds = (0.0, np.inf)
    words: ClassVar = {
        "en": (
            *("size", "dimension", "extent", "width", "length", "breadth", "thickness"),
            *("wide", "long", "thick", "big", "large"),
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
            "likewise while it is held at `<object>_across`, a quarter turn on, where "
            "that fits the hand",
            holding=True,
            place="across",
            optional=True,
        ),
    )
    derived = True
    estimators: ClassVar = {"touch": "palpate.estimation.quantities.size:estimate_size"}

    def needs(self, body: Body, bodies: Mapping[str, Body]) -> Iterator[Parameter]:
        """Height of its support, if the file does not state it."""
        for other in bodies.values():
            if body.name in other.carries and "height" in other.missing:
                yield Parameter(other.name, "height")

    def compiled(self, body: BodyDescription) -> tuple[float, ...]:
        return tuple(body.box()[1].tolist())

    def status(self, body: BodyDescription) -> Status:
        """Missing where a `?` represents it; otherwise the shapes together state it."""
        return "missing" if open_extents(body).any() else "not applicable"

    def slots(self, elements: Elements) -> Iterator[Slot]:
        """Numbers of a single shape centred at its body's origin."""
        if is_one_shape(elements) and not has_unknown(elements.element, "pos", 2):
            yield Slot(elements.geoms[0], "size", str(HALF))

    def prior(self, body: BodyDescription, believed: Values) -> Prior:
        """Prior: twice the height of its middle above its support; horizontally, the width of an ordinary grasp."""
        extents, is_open = body.box()[1], open_extents(body)
        mean = np.where(is_open, 2 * HALF, extents)
        std = np.where(is_open, EXTENT_PRIOR * mean, 0.0)
        support = support_z(body, believed)
        up = np.abs(body.pose_world.rotation[2]) > ALIGNED
        if support is not None and float(body.cloud[:, 2].mean()) > support + LEAST:
            mean = np.where(is_open & up, 2 * (float(body.cloud[:, 2].mean()) - support), mean)
        return Prior(tuple(mean.tolist()), tuple(std.tolist()))

    def draw(self, body: Body, prior: Prior, random: np.random.Generator) -> tuple[float, ...]:
        """Draw horizontally, uniformly within `OFF`; supported objects keep their height."""
        up = np.abs(body.pose_world.rotation[2]) > ALIGNED
        off = random.uniform(-OFF, OFF, 3) * (np.array(prior.std) > 0.0) * ~up
        return tuple((np.array(prior.mean) * (1.0 + off)).tolist())

    def write(
        self, body: BodyDescription, value: tuple[float, ...], std: float | None
    ) -> Iterator[Edit]:
        """Write into its shapes, scaled about the middle of the lower face.

        A shape with open numbers is scaled about its own middle.
        """
        # Scale factors along the object's axes.
        centre, extents = body.box()
        scale = np.array(value) / np.maximum(extents, 1e-9)
        # A single shape with open numbers: scale along its own axes.
        if open_extents(body).any():
            (geom,) = body.elements.geoms
            turned = np.abs((body.pose_world.inverse() @ body.shapes.geom_pose(geom)).rotation)
            numbers = scaled_numbers(body, geom, scale @ turned, std)
            yield Edit(geom, "size", unknown_only(geom, "size", numbers))
            return
        if np.abs(scale - 1.0).max() < 1e-6:
            return
        # All shapes: scale about the middle of the lower face.
        down = -body.pose_world.rotation[2]
        anchor = centre + extents / 2 * np.where(np.abs(down) > ALIGNED, down, 0.0)
        for geom in body.elements.geoms:
            yield from scale_geom(body, geom, scale, anchor, std)


def estimate_size(trace: Trace, parameter: Parameter, body: Body | None) -> Estimate:
    """Extents of an object from the finger opening at its grasps, and from a touch of its top.

    An extent without evidence keeps its value in the scene with its prior standard deviation, and the method says so.
    Raises ValueError: A recording holds no samples, or no guarded descent comes before it.
    """
    name = parameter.object
    poses = [recording for recording in trace.recordings if recording.buffer == POSE]
    held = [recording for recording in poses if recording.context.holding == name]
    touches = touches_of(trace, probes(trace, parameter))
    if body is None or not (held or touches):
        return not_identified(parameter, UNIT, f"No recording is evidence of the size of '{name}'.")
    found = list(widths(trace, held, body))
    return size_of(trace, parameter, body, found, held, touches)


def size_on_the_way(trace: Trace, body: Body) -> Estimate | None:
    """Extents of an object whose size was not requested, from grasps and touches for other measurements.

    Returns None if they are no evidence of it.
    """
    parameter = Parameter(body.name, "size")
    found = list(widths_at_grasps(trace, body))
    touches = touches_of(trace, probes(trace, parameter))
    made = size_of(trace, parameter, body, found, (), touches)
    return made if made.identified else None


def size_of(
    trace: Trace,
    parameter: Parameter,
    body: Body,
    found: list[Extent],
    held: Sequence[Recording],
    touches: Sequence[SurfaceTouch],
) -> Estimate:
    """Estimate an object's size from its extents at grasps and from touches of its top."""
    top_views: tuple[FitView, ...] = ()
    tolerated = SOFT
    upright = np.abs(body.pose_world.rotation[2]) > ALIGNED
    # Height: the touched top above the support.
    if touches and upright.any():
        top, below = plane_of(touches, trace.hand), support(trace, body)
        std = float(np.hypot(top.std, below[1]))
        found.append(Extent(int(upright.argmax()), top.height - below[0], std))
        # Contact height and height at rest agree within the error of the lower end.
        tolerated = max(tolerated, 2.0 * below[1])
        top_views = touch_views(touches, top, upright.astype(float))
    if not found:
        why = f"'{body.name}' was touched only at an angle to its own axes, along which its size is stated."
        return not_identified(parameter, UNIT, why, tuple(held))
    # Weighted mean of each extent.
    value, std = body.size.copy(), EXTENT_PRIOR * body.size
    for axis in range(3):
        measured = [extent for extent in found if extent.axis == axis]
        if measured:
            stds = np.array([extent.std for extent in measured])
            weights = stds**-2.0
            value[axis] = np.average([extent.value for extent in measured], weights=weights)
            # The error of the finger opening is the same at each grasp, so no number of grasps reduces it.
            std[axis] = np.average(stds, weights=weights)
    seen = {extent.axis for extent in found}
    unseen = sorted({0, 1, 2} - seen)
    method = (
        f"Along {', '.join(AXES[axis] for axis in sorted(seen))}: how far the fingers stayed open as they held "
        "it, and how high its top was touched above what it stands on."
    )
    if unseen:
        blind = ", ".join(AXES[axis] for axis in unseen)
        method += f" Along {blind} there is no evidence: the extent is that of the scene."
    return Estimate.normal(
        parameter,
        UNIT,
        value,
        std,
        method,
        evidence=(*held, *(touch.recording for touch in touches)),
        # A rigid top is assumed: an object ends where it is touched. A small compliance, its own or its support's,
        # widens the standard deviation of the touch; a soft top is a failed test.
        tests=tuple(touch.firm() for touch in touches if touch.penetration > tolerated),
        unseen=tuple(unseen),
        views=(*width_views(trace, held, value), *top_views),
    )


def width_views(trace: Trace, held: Sequence[Recording], value: Array) -> Iterator[FitView]:
    """Yield charts of the finger opening while closing on the object, with the nearest extent of `value` (3,), m."""
    for recording in held:
        samples = closing_samples(trace, recording)
        if samples is None:
            continue
        # Extent nearest to the opening of the firm grasp.
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


def support(trace: Trace, body: Body) -> tuple[float, float]:
    """World z of the object's support, m, and its standard deviation.

    It is that of the touched surface nearest to the object's bottom in the scene, else that bottom. Both touches share
    the tip length, which cancels in the extent; with one touch alone it counts.
    """
    # Touched surfaces near the object's bottom; each gives a plane.
    bottom = body.bottom_z()
    names = {r.context.support for r in trace.recordings} - {None, body.name}
    near: list[tuple[float, float]] = []
    for name in sorted(filter(None, names)):
        touches = touches_of(trace, probes(trace, Parameter(name, "height")))
        if touches:
            plane = plane_of(touches, trace.hand)
            if abs(plane.height - bottom) < SAME_SUPPORT:
                near.append((plane.height, plane.std))
    # Without one, the scene's position is used with its error and that of the tip length.
    stated = bottom, float(np.hypot(PLACE_ACCURACY, trace.hand.tip_offset_std))
    return min(near, key=lambda found: abs(found[0] - bottom), default=stated)


def type_of(geom: Element, elements: Elements) -> str:
    """Type of a geom; MuJoCo's default is a sphere."""
    return elements.defaults.attribute(geom, "type") or "sphere"


def is_one_shape(elements: Elements) -> bool:
    """True if the object is a single geom whose `size` states its extents."""
    if len(elements.geoms) != 1 or elements.geoms[0].get("fromto"):
        return False
    return type_of(elements.geoms[0], elements) in RADII


def open_extents(body: BodyDescription) -> NDArray[np.bool_]:
    """(3,) True for extents along the object's axes that the file leaves open."""
    if not is_one_shape(body.elements):
        return np.zeros(3, dtype=np.bool_)
    # Axes of the shape with an open number, turned to the object's axes.
    (geom,) = body.elements.geoms
    own = np.zeros(3, dtype=np.bool_)
    axes = RADII[type_of(geom, body.elements)]
    for along, part in zip(axes, tokens(geom.get("size")), strict=False):
        if part == UNKNOWN:
            own[list(along)] = True
    turned = np.abs((body.pose_world.inverse() @ body.shapes.geom_pose(geom)).rotation)
    return own[turned.argmax(axis=1)]


def scaled_numbers(
    body: BodyDescription, geom: Element, scale: Array, std: float | None
) -> dict[int, str]:
    """Numbers of the `size` of a geom scaled by `scale` (3,) along its own axes."""
    sizes = body.shapes.model.geom_size[body.shapes.geom_ids[geom]]
    axes = RADII[type_of(geom, body.elements)]
    # A radius covers several axes and takes the mean of their factors.
    factors = [float(np.mean(scale[list(along)])) for along in axes]
    return {i: number(float(sizes[i] * factor), std) for i, factor in enumerate(factors)}


def scale_geom(
    body: BodyDescription, geom: Element, scale: Array, anchor: Array, std: float | None
) -> Iterator[Edit]:
    """Changes that scale a geom by `scale` (3,) about a point `anchor` (3,) of its body.

    Raises InputError: the shape does not lie along the body's axes, or others use its mesh.
    """
    kind, shapes = type_of(geom, body.elements), body.shapes
    pose = shapes.geom_pose(geom)
    if kind == "mesh":
        # MuJoCo moves a mesh to its centre; the file states the pose before that.
        mesh = int(shapes.model.geom_dataid[shapes.geom_ids[geom]])
        moved = Pose.of(shapes.model.mesh_pos[mesh], shapes.model.mesh_quat[mesh])
        pose = pose @ moved.inverse()
    frame = body.pose_world.inverse() @ pose
    # Only shapes along the body's axes have numbers for its extents.
    turned = np.abs(frame.rotation)
    has_numbers = kind in RADII or kind == "mesh"
    if not has_numbers or geom.get("fromto") or (turned.max(axis=0) < ALIGNED).any():
        raise InputError(
            f"{label(geom)} of '{body.name}' has no numbers that state its extents; shapes along "
            "the axes of their body have"
        )
    # Scale the shape, then shift its centre away from the anchor.
    if kind == "mesh":
        yield scaled_mesh(body, geom, scale @ turned)
    else:
        sizes = shapes.model.geom_size[shapes.geom_ids[geom]][: len(RADII[kind])]
        stated = " ".join(number(float(value)) for value in sizes)
        yield Edit(geom, "size", scaled_numbers(body, geom, scale @ turned, std), stated)
    shifted = (frame.position - anchor) * (scale - 1.0)
    if geom is body.elements.element or np.abs(shifted).max() < 1e-7:
        return
    middle = frame.position + shifted
    place = {i: number(float(middle[i]), std) for i in range(3)}
    yield Edit(geom, "pos", place, "0 0 0")


def scaled_mesh(body: BodyDescription, geom: Element, scale: Array) -> Edit:
    """Change of the `scale` of a mesh asset, the only statement of its extents.

    Raises InputError: other geoms use the mesh as well.
    """
    # A mesh of other geoms must not change.
    name = body.defaults.attribute(geom, "mesh")
    root = geom.getroottree().getroot()
    for other in root.iter("geom"):
        if other.get("mesh") == name and other not in body.elements.geoms:
            raise InputError(
                f"the mesh '{name}' of '{body.name}' is that of {label(other)}, too; give each a mesh "
                "of its own to have its size written"
            )
    for mesh in root.iterfind("asset/mesh"):
        # A mesh without a name is known by the stem of its file.
        if name in (mesh.get("name"), Path(mesh.get("file") or "").stem):
            stated = body.defaults.attribute(mesh, "scale") or "1 1 1"
            factors = [float(part) for part in tokens(stated)]
            numbers = {i: number(factors[i] * float(scale[i])) for i in range(3)}
            return Edit(mesh, "scale", numbers, stated)
    raise InputError(f"{label(geom)} of '{body.name}' is of a mesh that the scene does not state")
