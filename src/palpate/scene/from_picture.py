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
from palpate.scene.symbols import DEFAULT_OFFSETS, Symbols, vectors

Shape = Literal["box", "cylinder", "sphere", "plane"]

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
        poses = {
            f"{name}_pose": Pose.top_down(entry.pos, entry.yaw or 0.0)
            for name, entry in self.poses.objects.items()
        }
        common = {name: v for name, v in self.poses.offsets.items() if not isinstance(v, dict)}
        own = {name: vectors(v) for name, v in self.poses.offsets.items() if isinstance(v, dict)}
        return Symbols(
            poses=poses | {name: entry.tool_pose() for name, entry in self.poses.places.items()},
            subjects={f"{name}_pose": name for name in self.poses.objects},
            own_offsets=own,
            configurations={"home_config": self.arm.home}
            | {n: np.array(q) for n, q in self.poses.joints.items()},
            offsets={name: np.array(v) for name, v in DEFAULT_OFFSETS.items()} | vectors(common),
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
        felt = dict(heights or {})
        planes, things = _sorted(self.objects)
        levels = {p.name: felt.get(p.name, self._level(p)) for p in planes}
        camera = self.template.camera
        fitted = [
            fit(camera, thing, levels[support.name], self.template.poses.objects.get(thing.name))
            for thing, support in ((t, _support(t, planes)) for t in things)
        ]
        slabs = [
            _widened(
                fit(camera, p, levels[p.name]),
                [f for f in fitted if _support(f.thing, planes) is p],
            )
            for p in planes
        ]
        text = _mjcf(slabs, fitted, self.template.poses)
        scene = parse_scene(text, poses=self._poses(slabs, levels), arm=self.template.arm)

        def refit(name: str, height: float) -> Scene:
            return self.scene({**felt, name: height})

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
        tops = {s.thing.name: PoseEntry(pos=(s.x, s.y, levels[s.thing.name])) for s in slabs}
        offsets = {n: v for n, v in given.offsets.items() if not isinstance(v, dict) or n in names}
        return given.model_copy(
            update={
                "objects": tops,
                "offsets": offsets,
                "grasps": {n: g for n, g in given.grasps.items() if n in names},
            }
        )


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
    wanted = np.array(
        [left * camera.width, top * camera.height, right * camera.width, bottom * camera.height]
    )
    yaw = (placed.yaw or 0.0) if placed else 0.0
    start = _start(camera, thing, wanted, level, placed)
    free = slice(2, None) if placed else slice(0, None)

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
    misfit = float(np.abs(found.fun).max()) if not placed else 0.0
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
    return np.column_stack(
        [
            camera.width / 2 + camera.focal * local[:, 0] / depth,
            camera.height / 2 - camera.focal * local[:, 1] / depth,
        ]
    )


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
    x, y = placed.pos[:2] if placed else at[:2]
    return np.array([x, y, half[0]] if thing.shape == "sphere" else [x, y, *half])


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
    tilts = np.linspace(-np.pi / 2, np.pi / 2, 17)
    return np.concatenate(
        [
            _raised(
                np.array([x, y]) + radius * np.cos(tilt) * _RING,
                level + radius * (1 + np.sin(tilt)),
            )
            for tilt in tilts
        ]
    )


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
    names = [thing.name for thing in objects]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise InputError(f"scene: '{twice[0]}' is listed twice; give every thing a name of its own")
    planes = [thing for thing in objects if thing.shape == "plane"]
    if not planes:
        raise InputError(
            "scene: nothing is listed that the things stand on; list it with the shape 'plane'"
        )
    return planes, [thing for thing in objects if thing.shape != "plane"]


def _support(thing: SceneObject, planes: Sequence[SceneObject]) -> SceneObject:
    """The smallest plane in whose box the foot of the thing's box is, else the largest."""
    x, y = (thing.bbox[0] + thing.bbox[2]) / 2, thing.bbox[3]
    below = [p for p in planes if p.bbox[0] <= x <= p.bbox[2] and p.bbox[1] <= y <= p.bbox[3]]
    return min(below, key=_area) if below else max(planes, key=_area)


def _area(thing: SceneObject) -> float:
    left, top, right, bottom = thing.bbox
    return (right - left) * (bottom - top)


def _widened(slab: Fitted, standing: Sequence[Fitted]) -> Fitted:
    """The slab, large enough for what stands on it."""
    spans = [
        (slab.x, slab.y, slab.width / 2, slab.depth / 2),
        *((f.x, f.y, f.width / 2 + RIM, f.depth / 2 + RIM) for f in standing),
    ]
    low = [min(s[i] - s[i + 2] for s in spans) for i in (0, 1)]
    high = [max(s[i] + s[i + 2] for s in spans) for i in (0, 1)]
    return Fitted(
        slab.thing,
        (low[0] + high[0]) / 2,
        (low[1] + high[1]) / 2,
        high[0] - low[0],
        high[1] - low[1],
        0.0,
    )


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
        *(_slab_line(s) for s in slabs),
        *(line for f in things for line in _thing_lines(f)),
        "  </worldbody>",
        "</mujoco>",
    ]
    return "\n".join(lines) + "\n"


def _slab_line(slab: Fitted) -> str:
    return (
        f'    <body name="{slab.thing.name}" pos="{_metres(slab.x, slab.y)} ?">\n'
        f'      <geom type="box" size="{_metres(slab.width / 2, slab.depth / 2, THICKNESS / 2)}" '
        f'pos="0 0 {-THICKNESS / 2:g}"/>\n    </body>'
    )


def _thing_lines(f: Fitted) -> Iterator[str]:
    size = {"cylinder": (f.width / 2, f.height / 2), "sphere": (f.width / 2,)}.get(
        f.thing.shape, (f.width / 2, f.depth / 2, f.height / 2)
    )
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
