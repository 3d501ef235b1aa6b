"""A scene of what a model saw in a picture: boxes in the image become metric shapes that stand on a
plane.

A box has four sides, and an upright cylinder, a ball or a square block on a plane of known height
has at most four numbers: where it stands, how wide and how high it is. They are chosen such that
the shape, seen through the pinhole camera, fills the box. How high the plane is comes from
`poses.yaml`, else from the model, else it is level with the arm's foot; contact tells better, and
the shapes are then fitted anew, while the arm is at work.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Literal

import numpy as np

from palpate.errors import InputError
from palpate.geometry.pose import Array, Pose
from palpate.mjcf.edits import number
from palpate.robots.description import RobotDescription
from palpate.robots.registry import load_description
from palpate.scene.camera import Camera
from palpate.scene.load import parse_scene
from palpate.scene.places import APPROACH
from palpate.scene.poses import PoseEntry, Poses
from palpate.scene.scene import Scene
from palpate.scene.symbols import (
    DEFAULT_OFFSETS,
    Symbols,
    configurations,
    given_offsets,
    vectors,
)

Shape = Literal["box", "cylinder", "sphere", "plane"]

SEEN_ACCURACY = 0.005
"""m (1 sigma) of the place of a thing in a picture: two pixels, of 2.5 mm each from where a camera sees
a workplace. `accuracy` in poses.yaml overrules it."""

FAR = 3.0
"""m: how far from the camera's foot anything may be."""

MISFIT = 0.04
"""Of the image's height: how far the sides of a fitted shape may be from the box."""

THICKNESS = 0.02
"""m: of the slab that a plane becomes."""

RIM = 0.03
"""m: how far a plane reaches, at least, beyond what stands on it."""

_CIRCLE = np.linspace(0, 2 * np.pi, 96, endpoint=False)
_RING = np.column_stack([np.cos(_CIRCLE), np.sin(_CIRCLE)])
_SQUARE = np.array([[1.0, 1.0], [1.0, -1.0], [-1.0, -1.0], [-1.0, 1.0]])


@dataclass(frozen=True, slots=True)
class SceneObject:
    """An object that a model saw in the picture.

    Attributes:
        name: as in its pose name.
        shape: primitive shape; `plane` is what the things stand on.
        bbox: (left, top, right, bottom) in the image, as fractions of its width and height.
        height: of a plane, world z of its top in m as the model believes; None when it does not
            say.
    """

    name: str
    shape: Shape
    bbox: tuple[float, float, float, float]
    height: float | None = None


@dataclass(frozen=True, slots=True)
class Fitted:
    """A shape in the world: `x`, `y` of its middle, `width` and `depth` across, `height` above its
    foot; m."""

    thing: SceneObject
    x: float
    y: float
    width: float
    depth: float
    height: float
    yaw: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class SceneBuilder:
    """Where the camera is and what else `poses.yaml` says: enough to build scenes of what a model
    saw."""

    poses: Poses
    arm: RobotDescription = field(default_factory=load_description)

    @property
    def camera(self) -> Camera:
        """The camera that took the picture.

        Raises:
            InputError: the poses have none.
        """
        if self.poses.camera is None:
            raise InputError(
                "a request without a scene needs the camera that took the picture: give its pos, quat, "
                "fovy and size under 'camera' in poses=poses.yaml, or describe the scene with scene=D.xml"
            )
        return Camera.of(self.poses.camera)

    @property
    def symbols(self) -> Symbols:
        """The names that `poses.yaml` gives, before anything was seen."""
        poses: dict[str, Pose] = {}
        subjects: dict[str, str] = {}
        for name, entry in self.poses.objects.items():
            poses[f"{name}_pose"] = Pose.top_down(entry.pos, entry.yaw or 0.0)
            subjects[f"{name}_pose"] = name
        for name, entry in self.poses.places.items():
            poses[name] = entry.tool_pose()
        common, own = given_offsets(self.poses)
        return Symbols(
            poses=poses,
            subjects=subjects,
            own_offsets=own,
            configurations=configurations(self.poses, self.arm.home),
            offsets=vectors(DEFAULT_OFFSETS) | common,
        )


@dataclass(frozen=True, slots=True, eq=False)
class DetectedScene:
    """What a model saw, and the template that makes a scene of it."""

    template: SceneBuilder
    objects: tuple[SceneObject, ...]

    def scene(self, heights: Mapping[str, float] | None = None) -> Scene:
        """The scene; `heights` are the tops of planes (m) that contact has told since. It refits
        itself to others.

        Raises:
            InputError: nothing to stand on, or a box that no such shape fills; worded for the
                model.
        """
        measured = dict(heights or {})
        planes, things = _sorted(self.objects)
        levels = {p.name: measured.get(p.name, self._level(p)) for p in planes}
        camera, given = self.template.camera, self.template.poses.objects

        # Things first: a plane must reach as far as what stands on it.
        fitted: list[Fitted] = []
        standing: dict[str, list[Fitted]] = {plane.name: [] for plane in planes}
        for thing in things:
            support = _support(thing, planes).name
            shape = fit(camera, thing, levels[support], given.get(thing.name))
            fitted.append(shape)
            standing[support].append(shape)
        slabs: list[Fitted] = []
        for plane in planes:
            slab = fit(camera, plane, levels[plane.name])
            slabs.append(_widened(slab, standing[plane.name]))

        text = _mjcf(slabs, fitted, self.template.poses)
        scene = parse_scene(text, poses=self._poses(slabs, levels), arm=self.template.arm)

        def refit(name: str, height: float) -> Scene:
            return self.scene({**measured, name: height})

        return replace(scene, refit=refit)

    def _level(self, plane: SceneObject) -> float:
        """What is believed of a plane's top, m."""
        known = self.template.poses
        if plane.name in known.objects:
            return known.objects[plane.name].pos[2]
        if f"{plane.name}_approach" in known.places:
            return known.places[f"{plane.name}_approach"].pos[2] - APPROACH
        return plane.height or 0.0

    def _poses(self, slabs: Sequence[Fitted], levels: Mapping[str, float]) -> Poses:
        """`poses.yaml` for the scene that is built: names of what was not seen are left out."""
        names = {thing.name for thing in self.objects}
        given = self.template.poses
        tops: dict[str, PoseEntry] = {}
        for slab in slabs:
            name = slab.thing.name
            tops[name] = PoseEntry(pos=(slab.x, slab.y, levels[name]))
        grasps = {name: entry for name, entry in given.grasps.items() if name in names}
        offsets = dict(given.offsets)
        for name, value in given.offsets.items():
            if isinstance(value, dict) and name not in names:
                del offsets[name]
        stated: dict[str, object] = {"objects": tops, "offsets": offsets, "grasps": grasps}
        stated["accuracy"] = given.accuracy or SEEN_ACCURACY
        return given.model_copy(update=stated)


def fit(
    camera: Camera, thing: SceneObject, level: float, placed: PoseEntry | None = None
) -> Fitted:
    """The shape on the level plane at world z `level` that fills its box in the image; where it is,
    if `placed`.

    Raises:
        InputError: no such shape does; worded for the model.
    """
    from scipy.optimize import least_squares

    left, top, right, bottom = thing.bbox
    width, height = camera.width, camera.height
    wanted = np.array([left * width, top * height, right * width, bottom * height])
    start = _start(camera, thing, wanted, level, placed)
    # Where a thing is placed, its x and y are given and only its size is left to find.
    yaw, free = 0.0, slice(0, None)
    if placed is not None:
        yaw, free = placed.yaw or 0.0, slice(2, None)

    def residual(chosen: Array) -> Array:
        values = start.copy()
        values[free] = chosen
        seen = projected(camera, _OUTLINES[thing.shape](values, level, yaw))
        return np.concatenate([seen.min(axis=0), seen.max(axis=0)]) - wanted

    low = np.array([-np.inf, -np.inf, 0.002, 0.002])[: len(start)][free]
    found = least_squares(
        residual, np.maximum(start[free], low * 1.01), bounds=(low, np.inf), x_scale=0.1
    )
    start[free] = found.x
    foot = camera.pose_world_camera.position[:2]
    misfit = 0.0
    if placed is None:
        misfit = float(np.abs(found.fun).max())
    if misfit > MISFIT * camera.height or np.hypot(*(start[:2] - foot)) > FAR:
        raise InputError(
            f"scene: no {thing.shape} standing at z = {level:.3f} m fills the bbox of '{thing.name}' "
            f"within {FAR:g} m of the camera; correct its shape, its bbox or the plane's height"
        )
    return _FITTED[thing.shape](thing, start, yaw)


def projected(camera: Camera, points: Array) -> Array:
    """(n, 2) pixels of (n, 3) world points; what is behind the camera is pushed far out of the
    image."""
    local = (points - camera.pose_world_camera.position) @ camera.pose_world_camera.rotation
    depth = np.maximum(-local[:, 2], 1e-2)
    right = camera.width / 2 + camera.focal * local[:, 0] / depth
    down = camera.height / 2 - camera.focal * local[:, 1] / depth
    return np.column_stack([right, down])


def _start(
    camera: Camera, thing: SceneObject, box: Array, level: float, placed: PoseEntry | None
) -> Array:
    """Where the fit begins: x, y and half extents, m."""
    middle, foot = (box[0] + box[2]) / 2, box[3]
    if thing.shape == "plane":
        foot = (box[1] + box[3]) / 2
    at = camera.on_plane(float(middle), float(foot), level)
    if at is None:
        raise InputError(
            f"scene: the bbox of '{thing.name}' is above the horizon of a plane at z = {level:.3f} m"
        )
    distance = float(np.linalg.norm(at - camera.pose_world_camera.position))
    half = np.clip(distance * (box[2:] - box[:2]) / camera.focal / 2, 0.005, 1.0)
    x, y = at[:2]
    if placed is not None:
        x, y = placed.pos[:2]
    if thing.shape == "sphere":
        half = half[:1]
    return np.array([x, y, *half])


def _cylinder(values: Array, level: float, _: float) -> Array:
    x, y, radius, half = values
    ring = np.array([x, y]) + radius * _RING
    return np.concatenate([_raised(ring, level), _raised(ring, level + 2 * half)])


def _block(values: Array, level: float, yaw: float) -> Array:
    x, y, half, half_height = values
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    corners = np.array([x, y]) + half * _SQUARE @ turn.T
    return np.concatenate([_raised(corners, level), _raised(corners, level + 2 * half_height)])


def _ball(values: Array, level: float, _: float) -> Array:
    x, y, radius = values
    rings: list[Array] = []
    for tilt in np.linspace(-np.pi / 2, np.pi / 2, 17):
        ring = np.array([x, y]) + radius * np.cos(tilt) * _RING
        rings.append(_raised(ring, level + radius * (1 + np.sin(tilt))))
    return np.concatenate(rings)


def _slab(values: Array, level: float, _: float) -> Array:
    return _raised(values[:2] + values[2:] * _SQUARE, level)


def _raised(outline: Array, z: float) -> Array:
    return np.column_stack([outline, np.full(len(outline), z)])


_OUTLINES: Mapping[Shape, Callable[[Array, float, float], Array]] = {
    "cylinder": _cylinder,
    "box": _block,
    "sphere": _ball,
    "plane": _slab,
}

_FITTED: Mapping[Shape, Callable[[SceneObject, Array, float], Fitted]] = {
    "cylinder": lambda t, v, _: Fitted(t, v[0], v[1], 2 * v[2], 2 * v[2], 2 * v[3]),
    "box": lambda t, v, yaw: Fitted(t, v[0], v[1], 2 * v[2], 2 * v[2], 2 * v[3], yaw),
    "sphere": lambda t, v, _: Fitted(t, v[0], v[1], 2 * v[2], 2 * v[2], 2 * v[2]),
    "plane": lambda t, v, _: Fitted(t, v[0], v[1], 2 * v[2], 2 * v[3], 0.0),
}


def _sorted(objects: Sequence[SceneObject]) -> tuple[list[SceneObject], list[SceneObject]]:
    """Planes and things.

    Raises:
        InputError: no planes, or a name twice.
    """
    for name, following in pairwise(sorted(thing.name for thing in objects)):
        if name == following:
            raise InputError(f"scene: '{name}' is listed twice; give every thing a name of its own")
    planes = [thing for thing in objects if thing.shape == "plane"]
    if not planes:
        raise InputError(
            "scene: nothing is listed that the things stand on; list it with the shape 'plane'"
        )
    return planes, [thing for thing in objects if thing.shape != "plane"]


def _support(thing: SceneObject, planes: Sequence[SceneObject]) -> SceneObject:
    """The smallest plane in whose box the foot of the thing's box is, else the largest."""
    left, _, right, bottom = thing.bbox
    below = [plane for plane in planes if _covers(plane, (left + right) / 2, bottom)]
    if below:
        return min(below, key=_area)
    return max(planes, key=_area)


def _covers(plane: SceneObject, x: float, y: float) -> bool:
    """Whether a point of the image is in the plane's box."""
    left, top, right, bottom = plane.bbox
    return left <= x <= right and top <= y <= bottom


def _area(thing: SceneObject) -> float:
    left, top, right, bottom = thing.bbox
    return (right - left) * (bottom - top)


def _widened(slab: Fitted, standing: Sequence[Fitted]) -> Fitted:
    """The slab, large enough for what stands on it."""
    left, right = _reach(slab.x, slab.width / 2)
    near, far = _reach(slab.y, slab.depth / 2)
    for shape in standing:
        west, east = _reach(shape.x, shape.width / 2 + RIM)
        south, north = _reach(shape.y, shape.depth / 2 + RIM)
        left, right = min(left, west), max(right, east)
        near, far = min(near, south), max(far, north)
    return Fitted(slab.thing, (left + right) / 2, (near + far) / 2, right - left, far - near, 0.0)


def _reach(middle: float, half: float) -> tuple[float, float]:
    """From where to where."""
    return middle - half, middle + half


def _mjcf(slabs: Sequence[Fitted], things: Sequence[Fitted], poses: Poses) -> str:
    """The template: shapes as fitted, heights `?`, masses and frictions left out. Names are checked
    where read."""
    camera = poses.camera
    assert camera is not None
    lines = [
        "<!-- Built from a picture: the shapes fill the boxes that a model saw in it. -->",
        '<mujoco model="from picture">',
        "  <worldbody>",
        '    <site name="robot_base"/>',
        f'    <camera name="workspace" pos="{_numbers(camera.pos)}" quat="{_numbers(camera.quat)}" '
        f'fovy="{number(camera.fovy)}"/>',
    ]
    for slab in slabs:
        lines += _slab_lines(slab)
    for thing in things:
        lines += _thing_lines(thing)
    lines += ["  </worldbody>", "</mujoco>"]
    return "\n".join(lines) + "\n"


def _slab_lines(slab: Fitted) -> Iterator[str]:
    size = _metres(slab.width / 2, slab.depth / 2, THICKNESS / 2)
    yield f'    <body name="{slab.thing.name}" pos="{_metres(slab.x, slab.y)} ?">'
    yield f'      <geom type="box" size="{size}" pos="0 0 {-THICKNESS / 2:g}"/>'
    yield "    </body>"


def _thing_lines(f: Fitted) -> Iterator[str]:
    size = (f.width / 2, f.depth / 2, f.height / 2)
    if f.thing.shape == "cylinder":
        size = (f.width / 2, f.height / 2)
    elif f.thing.shape == "sphere":
        size = (f.width / 2,)
    turned = f' euler="0 0 {np.degrees(f.yaw):.2f}"' if f.yaw else ""
    yield f'    <body name="{f.thing.name}" pos="{_metres(f.x, f.y)} ?"{turned}>'
    yield "      <freejoint/>"
    yield f'      <geom type="{f.thing.shape}" size="{_metres(*size)}"/>'
    yield "    </body>"


def _metres(*values: float) -> str:
    """To a tenth of a millimetre."""
    return " ".join(f"{v:.4f}" for v in values)


def _numbers(values: Sequence[float]) -> str:
    return " ".join(number(v) for v in values)
