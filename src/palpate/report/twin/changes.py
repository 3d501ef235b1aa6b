"""Visible changes from the scene as given to the twin."""

from __future__ import annotations

import io
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.pictures.renderer import png

SEEN = 12
"""Of 255: a pixel that differs by more in any colour has changed."""
LEAST = 5e-5
"""Share of a picture's pixels from which a change is worth a look."""
MARK = (13, 148, 136)
"""The page's accent."""


@dataclass(frozen=True, slots=True)
class Change:
    """Share of the picture that changed, 0 to 1, and the second picture with the change marked
    (PNG)."""

    share: float
    marked: bytes | None

    @property
    def visible(self) -> bool:
        return self.share >= LEAST


def change(before: bytes | None, after: bytes | None) -> Change | None:
    """Between two pictures of one camera; None where there are no two that can be compared."""
    from PIL import Image

    pictures: list[NDArray[np.uint8]] = []
    for content in (before, after):
        if not content:
            return None
        try:
            with Image.open(io.BytesIO(content), formats=("PNG", "JPEG")) as image:
                pictures.append(np.asarray(image.convert("RGB")))
        except (OSError, ValueError, Image.DecompressionBombError):
            return None
    one, other = pictures
    if one.shape != other.shape:
        return None
    apart = np.abs(one.astype(np.int16) - other.astype(np.int16)).max(axis=2) > SEEN
    share = float(apart.mean())
    marked = _marked(other, apart) if share >= LEAST else None
    return Change(share, marked)


def _marked(picture: NDArray[np.uint8], apart: NDArray[np.bool_]) -> bytes:
    """The picture, pale, with what changed in colour."""
    grey = picture.mean(axis=2, keepdims=True)
    pale = (0.45 * grey + 0.55 * 255).astype(np.uint8)
    shown = np.repeat(pale, 3, axis=2)
    shown[apart] = (0.35 * picture[apart] + 0.65 * np.array(MARK)).astype(np.uint8)
    return png(shown)
