"""A scene from the detections of a model in a picture: boxes in the image become metric shapes on a
plane.

A model's boxes are rough: the pixels of the picture make them exact (`sharpen`), and add outlines. A
box has four sides, and an upright cylinder, a ball or a square block on a plane of known height has at
most four parameters: position, width and height. They are fitted such that the shape, projected by
the pinhole camera, fills the box, or the outline (`fit`). The height of the plane is from
`poses.yaml`, else from the model, else level with the arm's foot; when contact has measured it, the
shapes are fitted again.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from palpate.errors import InputError
from palpate.geometry.pose import Pose
from palpate.mjcf.edits import number
from palpate.robots.description import RobotDescription
from palpate.robots.registry import load_description
from palpate.scene.camera import Camera, load_image
from palpate.scene.load import parse_scene
from palpate.scene.named.places import APPROACH
from palpate.scene.pictured.fit import fit
from palpate.scene.pictured.objects import (
    Fitted,
    SceneObject,
    is_mount,
    planes_and_things,
    support_of,
    widened,
)
from palpate.scene.pictured.sharpen import sharpened
from palpate.scene.poses import ObjectEntry, Poses
from palpate.scene.scene import Scene
from palpate.scene.symbols import (
    DEFAULT_OFFSETS,
    Symbols,
    configurations,
    given_offsets,
    vectors,
)

SEEN_ACCURACY = 0.005
"""m: standard deviation of a position from a picture, two pixels of 2.5 mm each at a workplace.
`accuracy` in poses.yaml overrules it."""

THICKNESS = 0.02
"""m: of the slab that represents a plane."""


@dataclass(frozen=True, slots=True, eq=False)
class SceneBuilder:
    """Builder of scenes from a model's detections, with the camera and names of `poses.yaml`."""

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
        """The names that `poses.yaml` gives, before any detection."""
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

    def detected(
        self, objects: Sequence[SceneObject], images: Sequence[Path] = ()
    ) -> DetectedScene:
        """Detections of a model in the first of `images`, refined by its pixels.

        Raises:
            InputError: the image cannot be read, or a box shows bare table.
        """
        if images:
            objects = sharpened(objects, load_image(images[0]))
        return DetectedScene(self, tuple(objects))


@dataclass(frozen=True, slots=True, eq=False)
class DetectedScene:
    """Detections of a model, and the builder of a scene from them."""

    template: SceneBuilder
    objects: tuple[SceneObject, ...]

    def scene(self, heights: Mapping[str, float] | None = None) -> Scene:
        """Fit the scene; `heights` are measured tops of planes, world z in m. Its `refit` fits it
        again to others.

        Raises:
            InputError: no plane, or a box that no such shape fills; worded for the model.
        """
        measured = dict(heights or {})
        planes, things = planes_and_things(self.objects)
        known = self.template.poses
        camera, given = self.template.camera, known.objects
        levels: dict[str, float] = {}
        for plane in planes:
            level = plane.height or 0.0
            if plane.name in known.objects:
                level = known.objects[plane.name].pos[2]
            elif f"{plane.name}_approach" in known.places:
                level = known.places[f"{plane.name}_approach"].pos[2] - APPROACH
            levels[plane.name] = measured.get(plane.name, level)

        # Objects first: a plane must reach as far as they do. A shape at the arm's foot is the arm.
        fitted: list[Fitted] = []
        standing: dict[str, list[Fitted]] = {plane.name: [] for plane in planes}
        for thing in things:
            support = support_of(thing, planes).name
            shape = fit(camera, thing, levels[support], given.get(thing.name))
            if is_mount(shape) and thing.name not in given:
                continue
            fitted.append(shape)
            standing[support].append(shape)
        # A plane at the arm's foot without objects is the arm's pedestal.
        slabs: list[Fitted] = []
        for plane in planes:
            slab = fit(camera, plane, levels[plane.name])
            if standing[plane.name] or not is_mount(slab):
                slabs.append(widened(slab, standing[plane.name]))

        text = _mjcf(slabs, fitted, self.template.poses)
        scene = parse_scene(text, poses=self._poses(slabs, fitted, levels), arm=self.template.arm)

        def refit(name: str, height: float) -> Scene:
            return self.scene({**measured, name: height})

        seen = {name: replace(body, seen=True) for name, body in scene.bodies.items()}
        return replace(scene, bodies=seen, refit=refit)

    def _poses(
        self, slabs: Sequence[Fitted], things: Sequence[Fitted], levels: Mapping[str, float]
    ) -> Poses:
        """Content of `poses.yaml` for the built scene, without names that are not in it."""
        names = {shape.thing.name for shape in (*slabs, *things)}
        given = self.template.poses
        tops: dict[str, ObjectEntry] = {}
        for slab in slabs:
            tops[slab.thing.name] = ObjectEntry(pos=(slab.x, slab.y, levels[slab.thing.name]))
        grasps = {name: entry for name, entry in given.grasps.items() if name in names}
        offsets = dict(given.offsets)
        for name, value in given.offsets.items():
            if isinstance(value, dict) and name not in names:
                del offsets[name]
        stated: dict[str, object] = {"objects": tops, "offsets": offsets, "grasps": grasps}
        stated["accuracy"] = given.accuracy or SEEN_ACCURACY
        return given.model_copy(update=stated)


def _mjcf(slabs: Sequence[Fitted], things: Sequence[Fitted], poses: Poses) -> str:
    """MJCF of fitted shapes: heights `?`, masses and frictions missing."""
    camera = poses.camera
    assert camera is not None

    def numbers(values: Sequence[float]) -> str:
        return " ".join(number(v) for v in values)

    def metres(*values: float) -> str:
        return " ".join(f"{v:.4f}" for v in values)  # to a tenth of a millimetre

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
            f'    <body name="{slab.thing.name}" pos="{metres(slab.x, slab.y)} ?">',
            f'      <geom type="box" size="{size}" pos="0 0 {-THICKNESS / 2:g}"/>',
            "    </body>",
        ]
    for f in things:
        extents = (f.width / 2, f.depth / 2, f.height / 2)
        if f.thing.shape == "cylinder":
            extents = (f.width / 2, f.height / 2)
        elif f.thing.shape == "sphere":
            extents = (f.width / 2,)
        turned = f' euler="0 0 {np.degrees(f.yaw):.2f}"' if f.yaw else ""
        lines += [
            f'    <body name="{f.thing.name}" pos="{metres(f.x, f.y)} ?"{turned}>',
            "      <freejoint/>",
            f'      <geom type="{f.thing.shape}" size="{metres(*extents)}"/>',
            "    </body>",
        ]
    lines += ["  </worldbody>", "</mujoco>"]
    return "\n".join(lines) + "\n"
