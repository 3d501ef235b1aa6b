"""Pictures as they are sent to a model: downscaled, re-encoded, and without whatever else was in
the file."""

from __future__ import annotations

import hashlib
import io
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from PIL import Image

from palpate.scene.camera import load_image

LONGEST_SIDE = 1024
"""Pixels of the longer side as sent; larger pictures are downscaled, smaller ones are not
enlarged."""
JPEG_QUALITY = 90


@dataclass(frozen=True, slots=True)
class Picture:
    """An encoded picture: JPEG bytes and its size in pixels."""

    data: bytes
    width: int
    height: int
    media_type: str = "image/jpeg"

    def note(self) -> dict[str, Any]:
        """Note of a picture for the record."""
        return {
            "width": self.width,
            "height": self.height,
            "sha256": hashlib.sha256(self.data).hexdigest(),
        }


def picture(path: Path) -> Picture:
    """The picture file at the size in which it is sent.

    Raises:
        InputError: not readable as a picture, or too large.
    """
    pixels = load_image(path, LONGEST_SIDE)
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, "JPEG", quality=JPEG_QUALITY)
    return Picture(buffer.getvalue(), pixels.shape[1], pixels.shape[0])
