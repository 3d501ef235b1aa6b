"""Detections of a model in a picture, and their shapes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Shape = Literal["box", "cylinder", "sphere", "plane"]


@dataclass(frozen=True, slots=True)
class SceneObject:
    """An object that a model saw in the picture.

    Attributes:
        name: as in its pose name.
        shape: primitive shape; `plane` is what the things stand on.
        bbox: (left, top, right, bottom) in the image, as fractions of its width and height.
        height: of a plane, world z of its top in m as the model believes; None when it does not
            say.
        outline: corner points (x, y) of what is seen of it, as fractions; None when only its box is
            known.
    """

    name: str
    shape: Shape
    bbox: tuple[float, float, float, float]
    height: float | None = None
    outline: tuple[tuple[float, float], ...] | None = None


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
