"""Pictures as they are sent to a model: downscaled, re-encoded, and without whatever else was in the file."""

from __future__ import annotations

import hashlib
import io
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from PIL import Image

from palpate.errors import InputError

LONGEST_SIDE = 1024
"""Pixels of the longer side as sent; larger pictures are downscaled, smaller ones are not enlarged."""
JPEG_QUALITY = 90
LARGEST_PICTURE = 64_000_000
"""Pixels of a picture that is opened at all."""


@dataclass(frozen=True, slots=True)
class Picture:
    """An encoded picture: JPEG bytes and its size in pixels."""

    data: bytes
    width: int
    height: int
    media_type: str = "image/jpeg"

    def note(self) -> dict[str, Any]:
        """What a record keeps of it."""
        return {"width": self.width, "height": self.height, "sha256": hashlib.sha256(self.data).hexdigest()}


def picture(path: Path) -> Picture:
    """The picture file at the size in which it is sent.

    Raises:
        InputError: not readable as a picture, or too large.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", Image.DecompressionBombWarning)
            with Image.open(path, formats=("PNG", "JPEG")) as file:
                if file.width * file.height > LARGEST_PICTURE:
                    raise InputError(f"the image '{path.name}' has {file.width} × {file.height} pixels; at most "
                                     f"{LARGEST_PICTURE // 1_000_000} million are read")
                file.thumbnail((LONGEST_SIDE, LONGEST_SIDE))
                return _encoded(file.convert("RGB"))
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError, Image.DecompressionBombWarning) as error:
        raise InputError(f"cannot read the image '{path.name}': {error}; give a PNG or JPEG file") from None


def _encoded(image: Image.Image) -> Picture:
    buffer = io.BytesIO()
    image.save(buffer, "JPEG", quality=JPEG_QUALITY)
    return Picture(buffer.getvalue(), image.width, image.height)
