"""Scene from detections: shapes fitted to boxes or outlines in the image of a pinhole camera."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from palpate.common.errors import InputError
from palpate.common.pose import Array, Pose
from palpate.mjcf.edits import number
from palpate.robots.description import RobotDescription
from palpate.robots.owner import load_description
from palpate.scene.camera import Camera, load_image
from palpate.scene.detections import (
    FittedShape,
    SceneObject,
    Shape,
    directions,
    is_mount,
    sharpen_boxes,
    split_planes,
    support_of,
    widen_slab,
)
from palpate.scene.load import parse_scene
from palpate.scene.places import APPROACH
from palpate.scene.poses import ObjectEntry, PoseEntry, Poses
from palpate.scene.scene import Scene
from palpate.scene.symbols import DEFAULT_OFFSETS, Symbols, configurations, given_offsets, vectors

FAR = 3.0  # m, largest horizontal distance of a shape from the camera
# Largest distance between sides of the fitted shape and of the box, relative to the image's height.
MISFIT = 0.04
TURNS = (-30.0, 0.0, 30.0, 60.0)  # Degrees, initial yaws of a block
# Initial shoulder and neck as shares of height and width: almost no neck, and that of a bottle.
NECKS = ((0.95, 0.95), (0.6, 0.5))
# Scales of the parameters in the search: m, then rad or a share.
SCALES = np.array([0.1, 0.1, 0.1, 0.1, 0.5, 0.5])
_CIRCLE = np.linspace(0, 2 * np.pi, 96, endpoint=False)
_RING = np.column_stack([np.cos(_CIRCLE), np.sin(_CIRCLE)])
_SQUARE = np.array([[1.0, 1.0], [1.0, -1.0], [-1.0, -1.0], [-1.0, 1.0]])


def fit(
    camera: Camera, item: SceneObject, level: float, placed: PoseEntry | None = None
) -> FittedShape:
    """Fit a shape on the level plane at world z `level` to its box in the image.

    With `placed`, its position and yaw are given. An outline refines blocks and cylinders.
    Raises InputError: no such shape fits; the message addresses the model.
    """
    # The box alone first: its result is the start of the fit to the outline.
    upright = _upright(camera, item, level, placed)
    if item.outline is None or placed is not None:
        return upright
    if item.shape == "box":
        return _fit_turned_block(camera, item, level, upright)
    if item.shape == "cylinder":
        return _fit_necked_cylinder(camera, item, level, upright)
    return upright


def _upright(
    camera: Camera, item: SceneObject, level: float, placed: PoseEntry | None
) -> FittedShape:
    """Fit a shape to the four sides of its box by least squares; a block is turned only if `placed`."""
    from scipy.optimize import least_squares

    left, top, right, bottom = item.bbox
    width, height = camera.width, camera.height
    wanted = np.array([left * width, top * height, right * width, bottom * height])
    start = _start(camera, item, wanted, level, placed)
    # For a placed object, x and y are given and only the size is fitted.
    yaw, free = 0.0, slice(0, None)
    if placed is not None:
        yaw, free = placed.yaw or 0.0, slice(2, None)

    def residual(chosen: Array) -> Array:
        values = start.copy()
        values[free] = chosen
        seen = project_points(camera, _OUTLINES[item.shape](values, level, yaw))
        return np.concatenate([seen.min(axis=0), seen.max(axis=0)]) - wanted

    low = np.array([-np.inf, -np.inf, 0.002, 0.002])[: len(start)][free]
    # Sizes are at least 2 mm. The start must be inside of the bounds.
    solution = least_squares(
        residual, np.maximum(start[free], low * 1.01), bounds=(low, np.inf), x_scale=0.1
    )
    start[free] = solution.x
    # A poor fit, or a shape far away, shows that shape, box or plane is wrong.
    foot = camera.pose_world_camera.position[:2]
    misfit = 0.0
    if placed is None:
        misfit = float(np.abs(solution.fun).max())
    if misfit > MISFIT * camera.height or np.hypot(*(start[:2] - foot)) > FAR:
        raise InputError(
            f"scene: no {item.shape} on a plane at z = {level:.3f} m fits the bbox of '{item.name}' "
            f"within {FAR:g} m of the camera; correct its shape, its bbox or the plane's height"
        )
    return _FITTED[item.shape](item, start, yaw)


def _fit_turned_block(
    camera: Camera, item: SceneObject, level: float, square: FittedShape
) -> FittedShape:
    """Fit a block with any two sides and yaw to its outline."""
    # Start from the square block at several yaws, as the outline has local optima.
    half = square.width / 2
    starts = [[square.x, square.y, half, half, square.height / 2, yaw] for yaw in np.radians(TURNS)]
    low = [-np.inf, -np.inf, 0.002, 0.002, 0.002, -np.inf]
    high = [np.inf] * 6
    best = _fit_outline(camera, item, lambda v: _cuboid(v, level), starts, low, high)
    x, y, half, half_depth, half_height, yaw = map(float, best)
    # Normalise the yaw to at most 45°: quarter turns exchange the sides.
    quarters = round(yaw / (np.pi / 2))
    if quarters % 2:
        half, half_depth = half_depth, half
    turn = yaw - quarters * np.pi / 2
    return FittedShape(
        item, x, y, width=2 * half, depth=2 * half_depth, height=2 * half_height, yaw=turn
    )


def _fit_necked_cylinder(
    camera: Camera, item: SceneObject, level: float, straight: FittedShape
) -> FittedShape:
    """Fit a cylinder that encloses an object with a neck: widest radius and full height."""
    # Start from the straight cylinder with and without a neck.
    radius, half = straight.width / 2, straight.height / 2
    starts = [[straight.x, straight.y, radius, half, *shares] for shares in NECKS]
    low = [-np.inf, -np.inf, 0.002, 0.002, 0.1, 0.1]
    high = [np.inf] * 4 + [1.0, 1.0]
    best = _fit_outline(camera, item, lambda v: _bottle(v, level), starts, low, high)
    x, y, radius, half = map(float, best[:4])
    return FittedShape(item, x, y, width=2 * radius, depth=2 * radius, height=2 * half)


def _fit_outline(
    camera: Camera,
    item: SceneObject,
    shape: Callable[[Array], Array],
    starts: Sequence[Sequence[float]],
    low: Sequence[float],
    high: Sequence[float],
) -> Array:
    """Parameters of the shape that fits an outline best, over the fits from `starts`.

    The residuals are the differences of the support functions h(d) = max x . d in all directions d.
    """
    from scipy.optimize import least_squares

    assert item.outline is not None
    # Support function of the outline: largest projection on each direction, pixels.
    ways = directions(len(item.outline))
    size = np.array([camera.width, camera.height])
    reach = (np.array(item.outline) * size @ ways.T).max(axis=0)

    def residual(values: Array) -> Array:
        return (project_points(camera, shape(values)) @ ways.T).max(axis=0) - reach

    tries = [
        least_squares(residual, start, bounds=(low, high), x_scale=SCALES, loss="soft_l1")
        for start in starts
    ]
    return min(tries, key=lambda solution: float(solution.cost)).x


def _bottle(values: Array, level: float) -> Array:
    """(n, 3) points of rings at foot, shoulder (a share of the height) and top (a share of the width)."""
    x, y, radius, half, shoulder, neck = values
    ring, top = radius * _RING, neck * radius * _RING
    middle = np.array([x, y])
    return np.concatenate(
        [
            _raise_outline(middle + ring, level),
            _raise_outline(middle + ring, level + shoulder * 2 * half),
            _raise_outline(middle + top, level + 2 * half),
        ]
    )


def _cuboid(values: Array, level: float) -> Array:
    """(8, 3) corners of a block."""
    x, y, half, half_depth, half_height, yaw = values
    # Rotate the footprint by yaw and extrude it from the plane to the top.
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    corners = np.array([x, y]) + _SQUARE * np.array([half, half_depth]) @ turn.T
    return np.concatenate(
        [_raise_outline(corners, level), _raise_outline(corners, level + 2 * half_height)]
    )


def project_points(camera: Camera, points: Array) -> Array:
    """(n, 2) pixels of (n, 3) world points; those behind the camera are projected far outside."""
    local = (points - camera.pose_world_camera.position) @ camera.pose_world_camera.rotation
    depth = np.maximum(-local[:, 2], 1e-2)
    # Pinhole projection with the optical axis through the image centre.
    right = camera.width / 2 + camera.focal * local[:, 0] / depth
    down = camera.height / 2 - camera.focal * local[:, 1] / depth
    return np.column_stack([right, down])


def _start(
    camera: Camera, item: SceneObject, box: Array, level: float, placed: PoseEntry | None
) -> Array:
    """Initial x, y and half extents, m."""
    # The foot of an object is at the lower edge of its box, the middle of a plane at the box's middle.
    middle, foot = (box[0] + box[2]) / 2, box[3]
    if item.shape == "plane":
        foot = (box[1] + box[3]) / 2
    at = camera.on_plane(float(middle), float(foot), level)
    if at is None:
        raise InputError(
            f"scene: the bbox of '{item.name}' is above the horizon of a plane at z = {level:.3f} m"
        )
    # Half extents by similar triangles: pixels times distance over focal length.
    distance = float(np.linalg.norm(at - camera.pose_world_camera.position))
    half = np.clip(distance * (box[2:] - box[:2]) / camera.focal / 2, 0.005, 1.0)
    x, y = at[:2]
    if placed is not None:
        x, y = placed.pos[:2]
    if item.shape == "sphere":
        half = half[:1]
    return np.array([x, y, *half])


def _cylinder(values: Array, level: float, _: float) -> Array:
    """(n, 3) points of the rings at foot and top of a cylinder."""
    x, y, radius, half = values
    ring = np.array([x, y]) + radius * _RING
    return np.concatenate([_raise_outline(ring, level), _raise_outline(ring, level + 2 * half)])


def _ball(values: Array, level: float, _: float) -> Array:
    """(n, 3) points on the surface of a ball that touches the plane."""
    x, y, radius = values
    rings: list[Array] = []
    # Rings at several latitudes.
    for tilt in np.linspace(-np.pi / 2, np.pi / 2, 17):
        ring = np.array([x, y]) + radius * np.cos(tilt) * _RING
        rings.append(_raise_outline(ring, level + radius * (1 + np.sin(tilt))))
    return np.concatenate(rings)


def _raise_outline(outline: Array, z: float) -> Array:
    """(n, 3) points of an outline (n, 2) at height z."""
    return np.column_stack([outline, np.full(len(outline), z)])


_OUTLINES: Mapping[Shape, Callable[[Array, float, float], Array]] = {
    "cylinder": _cylinder,
    "box": lambda v, level, yaw: _cuboid(np.array([*v[:3], v[2], v[3], yaw]), level),
    "sphere": _ball,
    "plane": lambda v, level, _: _raise_outline(v[:2] + v[2:] * _SQUARE, level),
}
_FITTED: Mapping[Shape, Callable[[SceneObject, Array, float], FittedShape]] = {
    "cylinder": lambda t, v, _: FittedShape(t, v[0], v[1], 2 * v[2], 2 * v[2], 2 * v[3]),
    "box": lambda t, v, yaw: FittedShape(t, v[0], v[1], 2 * v[2], 2 * v[2], 2 * v[3], yaw),
    "sphere": lambda t, v, _: FittedShape(t, v[0], v[1], 2 * v[2], 2 * v[2], 2 * v[2]),
    "plane": lambda t, v, _: FittedShape(t, v[0], v[1], 2 * v[2], 2 * v[3], 0.0),
}


# Scene from the detections of a model in a picture: metric shapes on planes.


# m, standard deviation of a position from a picture: two pixels of 2.5 mm each at a workplace.
# `accuracy` in poses.yaml takes precedence.
SEEN_ACCURACY = 0.005
THICKNESS = 0.02  # m, thickness of the slab that represents a plane


@dataclass(frozen=True, slots=True, eq=False)
class SceneBuilder:
    """Builder of scenes from a model's detections, with the camera and names of `poses.yaml`."""

    poses: Poses
    arm: RobotDescription = field(default_factory=load_description)

    @property
    def camera(self) -> Camera:
        """The camera that took the picture; an `InputError` if the poses have none."""
        if self.poses.camera is None:
            raise InputError(
                "a request without a scene needs the picture's camera: give its pos, quat, fovy and size "
                "under 'camera' in poses=poses.yaml, or give a scene with scene=D.xml"
            )
        return Camera.of(self.poses.camera)

    @property
    def symbols(self) -> Symbols:
        """The names in `poses.yaml`, before any detection."""
        # Grasps straight from above at the given poses, as no shapes are known yet.
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

    def from_detections(
        self, objects: Sequence[SceneObject], images: Sequence[Path] = ()
    ) -> DetectedScene:
        """Scene of detections in the first of `images`, refined by its pixels."""
        if images:
            objects = sharpen_boxes(objects, load_image(images[0]))
        return DetectedScene(self, tuple(objects))


@dataclass(frozen=True, slots=True, eq=False)
class DetectedScene:
    """Detections of a model, and the builder of a scene from them."""

    template: SceneBuilder
    objects: tuple[SceneObject, ...]

    def scene(self, heights: Mapping[str, float] | None = None) -> Scene:
        """Fit the scene; `heights` are measured tops of planes, world z in m.

        The `refit` of the scene fits it again to other heights.
        Raises InputError: no plane, or a box that no such shape fills; the message addresses the model.
        """
        measured = dict(heights or {})
        planes, items = split_planes(self.objects)
        known = self.template.poses
        camera, given = self.template.camera, known.objects
        # Height of each plane: measured, else from poses.yaml, else the model's estimate.
        levels: dict[str, float] = {}
        for plane in planes:
            level = plane.height or 0.0
            if plane.name in known.objects:
                level = known.objects[plane.name].pos[2]
            elif f"{plane.name}_approach" in known.places:
                level = known.places[f"{plane.name}_approach"].pos[2] - APPROACH
            levels[plane.name] = measured.get(plane.name, level)

        # Fit objects first, as a plane must extend below them. A shape at the arm's foot is the arm.
        fitted: list[FittedShape] = []
        standing: dict[str, list[FittedShape]] = {plane.name: [] for plane in planes}
        for item in items:
            support = support_of(item, planes).name
            shape = fit(camera, item, levels[support], given.get(item.name))
            if is_mount(shape) and item.name not in given:
                continue
            fitted.append(shape)
            standing[support].append(shape)
        # A plane at the arm's foot without objects is the arm's pedestal.
        slabs: list[FittedShape] = []
        for plane in planes:
            slab = fit(camera, plane, levels[plane.name])
            if standing[plane.name] or not is_mount(slab):
                slabs.append(widen_slab(slab, standing[plane.name]))

        text = _mjcf(slabs, fitted, self.template.poses)
        scene = parse_scene(text, poses=self._poses(slabs, fitted, levels), arm=self.template.arm)

        def refit(name: str, height: float) -> Scene:
            return self.scene({**measured, name: height})

        # Sizes from a picture are uncertain, and contacts may correct them.
        seen = {name: replace(body, seen=True) for name, body in scene.bodies.items()}
        return replace(scene, bodies=seen, refit=refit)

    def _poses(
        self,
        slabs: Sequence[FittedShape],
        items: Sequence[FittedShape],
        levels: Mapping[str, float],
    ) -> Poses:
        """Content of `poses.yaml` for the built scene, without names that are not in it."""
        names = {shape.item.name for shape in (*slabs, *items)}
        given = self.template.poses
        # The fitted planes get their heights as poses.
        tops: dict[str, ObjectEntry] = {}
        for slab in slabs:
            tops[slab.item.name] = ObjectEntry(pos=(slab.x, slab.y, levels[slab.item.name]))
        grasps = {name: entry for name, entry in given.grasps.items() if name in names}
        offsets = dict(given.offsets)
        for name, value in given.offsets.items():
            if isinstance(value, dict) and name not in names:
                del offsets[name]
        stated: dict[str, object] = {"objects": tops, "offsets": offsets, "grasps": grasps}
        stated["accuracy"] = given.accuracy or SEEN_ACCURACY
        return given.model_copy(update=stated)


def _mjcf(slabs: Sequence[FittedShape], items: Sequence[FittedShape], poses: Poses) -> str:
    """MJCF of fitted shapes: heights `?`, masses and frictions missing."""
    camera = poses.camera
    assert camera is not None

    def numbers(values: Sequence[float]) -> str:
        return " ".join(number(v) for v in values)

    def metres(*values: float) -> str:
        return " ".join(f"{v:.4f}" for v in values)  # resolution 0.1 mm

    lines = [
        "<!-- Built from a picture: the shapes fill the boxes that a model saw in it. -->",
        '<mujoco model="from picture">',
        "  <worldbody>",
        '    <site name="robot_base"/>',
        f'    <camera name="workspace" pos="{numbers(camera.pos)}" quat="{numbers(camera.quat)}" '
        f'fovy="{number(camera.fovy)}"/>',
    ]
    for slab in slabs:
        size = metres(slab.width / 2, slab.depth / 2, THICKNESS / 2)
        lines += [
            f'    <body name="{slab.item.name}" pos="{metres(slab.x, slab.y)} ?">',
            f'      <geom type="box" size="{size}" pos="0 0 {-THICKNESS / 2:g}"/>',
            "    </body>",
        ]
    # Objects with a free joint; MuJoCo's sizes are half extents.
    for f in items:
        extents = (f.width / 2, f.depth / 2, f.height / 2)
        if f.item.shape == "cylinder":
            extents = (f.width / 2, f.height / 2)
        elif f.item.shape == "sphere":
            extents = (f.width / 2,)
        euler = f' euler="0 0 {np.degrees(f.yaw):.2f}"' if f.yaw else ""
        lines += [
            f'    <body name="{f.item.name}" pos="{metres(f.x, f.y)} ?"{euler}>',
            "      <freejoint/>",
            f'      <geom type="{f.item.shape}" size="{metres(*extents)}"/>',
            "    </body>",
        ]
    lines += ["  </worldbody>", "</mujoco>"]
    return "\n".join(lines) + "\n"
