"""The picture of a look with the outlines of what was found in it, for a person to confirm."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from palpate.geometry.outline import hull
from palpate.geometry.pose import Array, Pose
from palpate.pictures.renderer import png
from palpate.scene.scene import Scene
from palpate.seeing.problem import Problem

COLOURS = (
    (230, 60, 50),
    (30, 110, 220),
    (20, 150, 80),
    (200, 120, 0),
    (140, 60, 190),
    (0, 140, 160),
)
HALO = (255, 255, 255)
LINE, LETTERS = 3, 26
"""Width of a line and height of letters, pixels, of a picture `USUAL` pixels wide."""
USUAL = 1280


@dataclass(frozen=True, slots=True, eq=False)
class Outlines:
    """A picture and outlines in it.

    Attributes:
        pixels: (height, width, 3) RGB.
        shapes: polygons (n, 2), pixels, of each object's geoms.
    """

    pixels: NDArray[np.uint8]
    shapes: Mapping[str, tuple[Array, ...]]

    def png(self) -> bytes:
        """The picture with the outlines and names in it."""
        image = Image.fromarray(self.pixels)
        draw, scale = ImageDraw.Draw(image), max(image.width / USUAL, 0.5)
        font = ImageFont.load_default(size=round(LETTERS * scale))
        for number, (name, polygons) in enumerate(self.shapes.items()):
            colour, width = COLOURS[number % len(COLOURS)], round(LINE * scale)
            for polygon in polygons:
                way = [(float(x), float(y)) for x, y in [*polygon, *polygon[:2]]]
                draw.line(way, fill=HALO, width=width + 2, joint="curve")
                draw.line(way, fill=colour, width=width, joint="curve")
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
    """Outlines of a scene's objects at fitted poses, in the picture of a camera, in OpenCV's frame, with the focal
    length times `zoom`. What is behind it is left out."""
    shapes: dict[str, tuple[Array, ...]] = {}
    description = scene.resolved.description
    for name, pose in poses.items():
        body = description.bodies[name]
        step = pose @ scene.body(name).pose_world.inverse()
        found: list[Array] = []
        for geom in body.elements.colliding:
            points = scene.resolved.shapes.points(geom) @ step.rotation.T + step.position
            if ((points - camera.position) @ camera.rotation[:, 2] > 0.0).all():
                found.append(hull(problem.pixels(camera, points, zoom)))
        if found:
            shapes[name] = tuple(found)
    return Outlines(pixels, shapes)
