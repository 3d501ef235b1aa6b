"""A scene of what a model saw in a picture: boxes in the image become metric shapes that stand on a
plane.

A model boxes roughly: where the picture is at hand, its pixels make the boxes exact (`sharpen`), and
tell the outline of what is turned or has a neck. A box has four sides, and an upright cylinder, a
ball or a square block on a plane of known height has at most four numbers: where it stands, how wide
and how high it is. They are chosen such that the shape, seen through the pinhole camera, fills the
box, or the outline (`fit`). How high the plane is comes from `poses.yaml`, else from the model, else
it is level with the arm's foot; contact tells better, and the shapes are then fitted anew, while the
arm is at work.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from palpate.errors import InputError
from palpate.geometry.pose import Pose
from palpate.robots.description import RobotDescription
from palpate.robots.registry import load_description
from palpate.scene.camera import Camera, load_image
from palpate.scene.load import parse_scene
from palpate.scene.pictured.fit import fit
from palpate.scene.pictured.objects import Fitted, SceneObject
from palpate.scene.pictured.planes import is_mount, planes_and_things, support_of, widened
from palpate.scene.pictured.sharpen import sharpened
from palpate.scene.pictured.written import written
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

SEEN_ACCURACY = 0.005
"""m (1 sigma) of the place of a thing in a picture: two pixels, of 2.5 mm each from where a camera sees
a workplace. `accuracy` in poses.yaml overrules it."""


@dataclass(frozen=True, slots=True, eq=False)
class SceneBuilder:
    """Camera and other content of `poses.yaml`, sufficient to build scenes from a model's
    detections."""

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

    def detected(
        self, objects: Sequence[SceneObject], images: Sequence[Path] = ()
    ) -> DetectedScene:
        """Detections of a model in the first of `images`, refined by the image if it is available.

        Raises:
            InputError: the image cannot be read.
        """
        if images:
            objects = sharpened(objects, load_image(images[0]))
        return DetectedScene(self, tuple(objects))


@dataclass(frozen=True, slots=True, eq=False)
class DetectedScene:
    """Detections of a model, and the template that makes a scene of them."""

    template: SceneBuilder
    objects: tuple[SceneObject, ...]

    def scene(self, heights: Mapping[str, float] | None = None) -> Scene:
        """The scene; `heights` are the tops of planes (m) that contact has told since. It refits
        itself to others.

        What stands where the arm does is the arm's own foot, and left out.

        Raises:
            InputError: nothing to stand on, or a box that no such shape fills; worded for the
                model.
        """
        measured = dict(heights or {})
        planes, things = planes_and_things(self.objects)
        levels = {p.name: measured.get(p.name, self._level(p)) for p in planes}
        camera, given = self.template.camera, self.template.poses.objects

        # Things first: a plane must reach as far as what stands on it.
        fitted: list[Fitted] = []
        standing: dict[str, list[Fitted]] = {plane.name: [] for plane in planes}
        for thing in things:
            support = support_of(thing, planes).name
            shape = fit(camera, thing, levels[support], given.get(thing.name))
            if is_mount(shape) and thing.name not in given:
                continue
            fitted.append(shape)
            standing[support].append(shape)
        slabs: list[Fitted] = []
        for plane in planes:
            slab = fit(camera, plane, levels[plane.name])
            if standing[plane.name] or not is_mount(slab):
                slabs.append(widened(slab, standing[plane.name]))

        text = written(slabs, fitted, self.template.poses)
        scene = parse_scene(text, poses=self._poses(slabs, fitted, levels), arm=self.template.arm)

        def refit(name: str, height: float) -> Scene:
            return self.scene({**measured, name: height})

        seen = {name: replace(body, seen=True) for name, body in scene.bodies.items()}
        return replace(scene, bodies=seen, refit=refit)

    def _level(self, plane: SceneObject) -> float:
        """Believed height of a plane's top, m."""
        known = self.template.poses
        if plane.name in known.objects:
            return known.objects[plane.name].pos[2]
        if f"{plane.name}_approach" in known.places:
            return known.places[f"{plane.name}_approach"].pos[2] - APPROACH
        return plane.height or 0.0

    def _poses(
        self, slabs: Sequence[Fitted], things: Sequence[Fitted], levels: Mapping[str, float]
    ) -> Poses:
        """`poses.yaml` for the scene that is built: names of what is not in it are left out."""
        names = {shape.thing.name for shape in (*slabs, *things)}
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
