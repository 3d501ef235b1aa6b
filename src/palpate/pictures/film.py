"""Frames to MP4: H.264, yuv420p, which every browser plays."""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Iterator
from itertools import chain
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Pixels = NDArray[np.uint8]


def mp4(frames: Iterable[Pixels], fps: float, quality: int = 27) -> bytes | None:
    """An MP4 file's bytes, or None when there is no frame.

    `frames` are (height, width, 3) RGB, all of one size; an odd last row or column is dropped, as
    the pixel format asks. `quality` is x264's constant rate factor: about 100 kB for 10 s at 640 x
    400.
    """
    from imageio_ffmpeg import write_frames

    source = iter(frames)
    first = next(source, None)
    if first is None:
        return None
    height, width = (n - n % 2 for n in first.shape[:2])
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "video.mp4"
        writer = write_frames(
            str(path),
            (width, height),
            fps=fps,
            codec="libx264",
            pix_fmt_out="yuv420p",
            quality=None,
            macro_block_size=2,
            ffmpeg_log_level="error",
            output_params=["-crf", str(quality), "-preset", "veryfast", "-movflags", "+faststart"],
        )
        writer.send(None)
        try:
            for frame in _cropped(chain([first], source), height, width):
                writer.send(frame)
        finally:
            writer.close()
        return path.read_bytes()


def _cropped(frames: Iterable[Pixels], height: int, width: int) -> Iterator[Pixels]:
    for frame in frames:
        yield np.ascontiguousarray(frame[:height, :width])
