"""Object poses from pictures of one camera, and the picture with their outlines."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from palpate.common.display import table
from palpate.common.errors import InputError
from palpate.common.files import write_new, yaml_text
from palpate.common.outline import hull
from palpate.common.pose import Array, Pose
from palpate.perception.detection import detect, sharpness
from palpate.perception.hand_eye import Hand, calibrated_camera
from palpate.perception.lens import Lens, Mount
from palpate.perception.pose_estimators import exchange_document, parse_answer, request
from palpate.perception.renderer import png
from palpate.perception.solve import Estimated, Problem, Solution, UnknownBody, solve
from palpate.perception.tags import SceneTag, tags_of
from palpate.scene.poses import ObjectEntry, Poses, parse_poses
from palpate.scene.scene import Scene

COLOURS = (
    (230, 60, 50),
    (30, 110, 220),
    (20, 150, 80),
    (200, 120, 0),
    (140, 60, 190),
    (0, 140, 160),
)
HALO = (255, 255, 255)
LINE, LETTERS = 3, 26  # px. Line width and letter height in a picture of width `USUAL`.
USUAL = 1280


@dataclass(frozen=True, slots=True, eq=False)
class Outlines:
    """Picture with outlines."""

    pixels: NDArray[np.uint8]  # (height, width, 3) RGB
    shapes: Mapping[str, tuple[Array, ...]]  # polygons (n, 2) of each object's geoms, pixels

    def png(self) -> bytes:
        """Draw the outlines and names into the picture and encode it as PNG."""
        image = Image.fromarray(self.pixels)
        draw, scale = ImageDraw.Draw(image), max(image.width / USUAL, 0.5)
        font = ImageFont.load_default(size=round(LETTERS * scale))
        for number, (name, polygons) in enumerate(self.shapes.items()):
            colour, width = COLOURS[number % len(COLOURS)], round(LINE * scale)
            for polygon in polygons:
                # Close the polygon; the light halo keeps the line visible on any background.
                way = [(float(x), float(y)) for x, y in [*polygon, *polygon[:2]]]
                draw.line(way, fill=HALO, width=width + 2, joint="curve")
                draw.line(way, fill=colour, width=width, joint="curve")
            # Write the name above the highest point of the outline.
            points = np.concatenate(polygons)
            top = points[points[:, 1].argmin()]
            at = (float(top[0]), float(top[1]) - LETTERS * scale)
            draw.text(
                at, name, font=font, fill=colour, anchor="mm", stroke_width=3, stroke_fill=HALO
            )
        return png(np.asarray(image))


def outlines(
    pixels: NDArray[np.uint8],
    scene: Scene,
    problem: Problem,
    camera: Pose,
    zoom: float,
    poses: Mapping[str, Pose],
) -> Outlines:
    """Outlines of a scene's objects at fitted poses; geoms behind the camera are left out.

    The `camera` pose is in OpenCV's frame; `zoom` is the factor of the focal length.
    """
    shapes: dict[str, tuple[Array, ...]] = {}
    description = scene.resolved.description
    for name, pose in poses.items():
        # Motion from the scene pose to the fitted pose.
        body = description.bodies[name]
        step = pose @ scene.body(name).pose_world.inverse()
        # Move the collision shapes to the fitted pose; the outline is the convex hull of each
        # projection.
        found: list[Array] = []
        for geom in body.elements.colliding:
            points = scene.resolved.shapes.points(geom) @ step.rotation.T + step.position
            if ((points - camera.position) @ camera.rotation[:, 2] > 0.0).all():
                found.append(hull(problem.pixels(camera, points, zoom)))
        if found:
            shapes[name] = tuple(found)
    return Outlines(pixels, shapes)


# Object poses from pictures of one camera, with covariances.


LUMA = np.array([0.299, 0.587, 0.114])  # Weights of red, green and blue in grey (ITU-R BT.601)
DIGITS = 6  # Decimals of positions (m) and quaternions in poses.yaml
TOLD = 0.05  # m. Maximum standard deviation of a measured surface height; a guess has as much.


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Seen:
    """Object poses measured by a camera."""

    poses: dict[str, Pose]  # pose of each object's frame in the world
    # (6, 6) of position (m) and rotation (rad) along the axes of the world.
    covariances: dict[str, Array]
    unseen: tuple[str, ...]  # objects of the scene that were not found
    notes: tuple[str, ...]  # messages on rejected data
    noise: float  # estimated standard deviation of a corner coordinate, pixels
    outlines: Outlines | None = None  # outlines of the objects in the picture
    # Poses of surfaces with an unknown height in the scene and a measured one in the picture. A tag
    # on the surface or on an object on it gives the height. Their covariance is of z alone.
    surfaces: Mapping[str, Pose] = field(default_factory=dict[str, Pose])

    def __repr__(self) -> str:
        return f"<Seen: {', '.join(self.poses) or 'nothing'}; noise {self.noise:.2f} px>"

    def std(self, name: str) -> tuple[float, float]:
        """Return the standard deviations of an object's position and rotation.

        The position value is the largest along a horizontal axis, m. The rotation is about the
        vertical, rad.
        """
        covariance = self.covariances[name]
        # Largest eigenvalue of the horizontal block of the covariance.
        level = np.linalg.eigvalsh(covariance[:2, :2])[-1]
        return float(np.sqrt(level)), float(np.sqrt(covariance[5, 5]))

    @property
    def content(self) -> dict[str, Any]:
        """Content of a poses.yaml."""
        poses = {**self.surfaces, **self.poses}
        # Surfaces and objects have entries of the same form.
        return {"objects": {name: self._entry(name, pose) for name, pose in poses.items()}}

    @property
    def entries(self) -> dict[str, ObjectEntry]:
        """Entries of `objects` in a poses.yaml."""
        return Poses.model_validate(self.content).objects

    def save(self, path: str | Path) -> Path:
        """Write a poses.yaml. Raises InputError: the file exists or cannot be written."""
        path = Path(path)
        # Parse the text before it is written, so that no invalid file results.
        text = yaml_text(self.content)
        parse_poses(text, str(path))
        write_new(path, text)
        return path

    def _repr_html_(self) -> str:
        rows = [
            (name, str(pose.position.round(4).tolist()), f"{1e3 * self.std(name)[0]:.2f}")
            for name, pose in self.poses.items()
        ]
        return table(repr(self), ("object", "place, m", "±, mm"), rows)

    def _entry(self, name: str, pose: Pose) -> dict[str, Any]:
        # Four significant digits of the covariance.
        rows = [[float(f"{part:.3e}") for part in row] for row in self.covariances[name].tolist()]
        return {
            "pos": pose.position.round(DIGITS).tolist(),
            "quat": pose.quaternion.round(DIGITS).tolist(),
            "source": "seen",
            "covariance": rows,
        }


def look(
    scene: Scene,
    pictures: list[NDArray[np.uint8]],
    lens: Lens,
    mount: Mount | None = None,
    estimator: str | None = None,
    hand: Hand | None = None,
    depth: NDArray[np.uint16] | None = None,
) -> Seen:
    """Locate the objects of a scene in pictures of one static camera.

    The objects are found by their tags and by an optional pose estimator. A camera calibrated in
    the robot.yaml of the scene's arm has the pose stated there. A camera on the hand moves with the
    hand: at `hand`, else at its stated joints, else at home.

    Args:
        pictures: (height, width, 3) RGB pictures.
        lens: intrinsics of the camera.
        mount: prior of the camera pose.
        estimator: pose estimator, a command or a URL.
        hand: gives the current pose of the TCP.
        depth: (height, width) distances along the view for the estimator, mm.

    Raises:
        InputError: no tags in scene or picture, a picture of another size, an unknown camera pose,
            or an invalid answer of the estimator.
        Unavailable: OpenCV is not installed, or the estimator does not answer.
    """
    # Lens and pose prior of the camera.
    lens, mount = calibrated_camera(scene, lens, mount, hand)
    tags = tags_of(scene)
    if not tags and estimator is None:
        raise InputError(
            'the scene states no tags: a tag is a site of its body, <site name="tag_12" pos="…" size="0.02"/>'
        )
    # Detect the tags and keep those of the scene.
    notes: list[str] = []
    corners = _corners(pictures, lens, notes)
    strange = sorted(number for number in corners if number not in tags)
    if strange:
        notes.append(f"tags that the scene does not state: {', '.join(map(str, strange))}")
    seen = {number: where for number, where in corners.items() if number in tags}
    if not seen and estimator is None:
        raise InputError(
            "none of the scene's tags is in the picture; the scene has "
            f"{', '.join(f'tag {number}' for number in sorted(tags))}"
        )
    # The estimator receives the sharpest picture.
    estimates: dict[str, Estimated] = {}
    if estimator is not None:
        answer = exchange_document(
            estimator, request(scene, max(pictures, key=sharpness), lens, depth)
        )
        estimates = parse_answer(answer, scene.objects)
    # Fit camera and bodies jointly, then report the objects and the surfaces with measured heights.
    problem = Problem(lens, seen, tags, things_of(scene), mount, estimates)
    found = solve(problem)
    notes += _said(found, tags)
    # Order of the scene, whatever the order in the fit.
    objects = [name for name in scene.objects if name in found.poses]
    poses = {name: found.poses[name] for name in objects}
    heights = dict(_heights(scene, found))
    return Seen(
        poses,
        {name: found.covariances[name] for name in (*heights, *objects)},
        tuple(name for name in scene.objects if name not in found.poses),
        tuple(notes),
        found.noise,
        outlines(pictures[0], scene, problem, found.pose_world_camera, found.zoom, poses),
        heights,
    )


def _heights(scene: Scene, found: Solution) -> Iterator[tuple[str, Pose]]:
    """Yield surfaces with an unknown height in the scene and a measured one in the picture.

    All objects on the surface must be found, because the others stay at their stated poses.
    """
    for name, surface in scene.surfaces.items():
        told = name in found.poses and found.covariances[name][2, 2] < TOLD**2
        if told and all(one in found.poses for one in surface.carries):
            yield name, found.poses[name]


def _corners(pictures: list[NDArray[np.uint8]], lens: Lens, notes: list[str]) -> dict[int, Array]:
    """Corners (4, 2) of each tag, pixels: the median over all pictures.

    A tag that occurs twice in a picture is left out.
    """
    found: dict[int, list[Array]] = {}
    twice: set[int] = set()
    for picture in pictures:
        height, width = picture.shape[:2]
        if (width, height) != lens.size:
            raise InputError(
                f"the picture has {width} × {height} pixels and the lens {lens.size[0]} × {lens.size[1]}: give "
                "the intrinsics of this camera, at this size"
            )
        # Detect in grey, and count each number to find duplicates.
        detected = detect((picture @ LUMA).astype(np.uint8), lens)
        counted = Counter(number for number, _ in detected)
        twice |= {number for number, count in counted.items() if count > 1}
        for number, where in detected:
            found.setdefault(number, []).append(where)
    if twice:
        notes.append(
            f"tags that are there twice, and so not used: {', '.join(map(str, sorted(twice)))}"
        )
    return {
        number: np.median(places, axis=0) for number, places in found.items() if number not in twice
    }


def things_of(scene: Scene) -> dict[str, UnknownBody]:
    """Return the bodies with unknown poses: objects, and surfaces of unknown height."""
    # Surface under each object in the scene.
    supports = {
        name: surface.name for surface in scene.surfaces.values() for name in surface.carries
    }
    found = {
        name: UnknownBody(name, body.pose_at_rest, supports.get(name))
        for name, body in scene.objects.items()
    }
    for name, surface in scene.surfaces.items():
        if "height" in surface.missing:
            found[name] = UnknownBody(name, surface.pose_world, None, is_surface=True)
    return found


def _said(found: Solution, tags: Mapping[int, SceneTag]) -> list[str]:
    """Messages on the rejected data of a fit."""
    odd = found.outliers
    said = [f"tag {number} on '{tags[number].body}' does not fit the others" for number in odd.tags]
    said += [f"the estimate of '{name}' contradicts its tags" for name in odd.estimates]
    return said + [f"'{name}' does not stand as the scene has it" for name in odd.leaning]
