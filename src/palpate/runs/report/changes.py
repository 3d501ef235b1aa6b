"""Changes from scene to twin, and the recordings behind each estimate."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain, groupby, pairwise

import numpy as np
from numpy.typing import NDArray

from palpate.common.parameter import Parameter
from palpate.estimation.estimate import Estimate, round_to_std
from palpate.estimation.motion import tip_height
from palpate.estimation.quantities.catalogue import catalogue
from palpate.perception.renderer import png
from palpate.trace.recording import Recording
from palpate.trace.samples import FORCES, Trace

MAX_LINES = 4000  # Largest count of lines of a diff that is shown
SEEN = 12  # Threshold of a changed pixel, of 255, in any colour
LEAST = 5e-5  # Least share of changed pixels that counts as visible
MARK = (13, 148, 136)  # The page's accent


@dataclass(frozen=True, slots=True)
class DiffLine:
    """A line of the diff: `add`, `del`, `hunk` or `same`. `middle` is the changed part."""

    kind: str
    before: str
    middle: str = ""
    after: str = ""

    @property
    def text(self) -> str:
        return self.before + self.middle + self.after


def diff_lines(diff: str) -> list[DiffLine]:
    """Make the rows of a unified diff, without the file names.

    Where a block replaces another of the same length, each line's changed part is its `middle`.
    """
    # Group the lines by kind.
    lines = [line for line in diff.splitlines() if not line.startswith(("---", "+++"))]
    kinds = {"+": "add", "-": "del", "@": "hunk"}
    blocks: list[list[DiffLine]] = []
    for kind, group in groupby(lines[:MAX_LINES], key=lambda line: kinds.get(line[:1], "same")):
        # All lines except the head of a hunk begin with a sign.
        blocks.append([DiffLine(kind, line if kind == "hunk" else line[1:]) for line in group])
    # Adjacent blocks of equal length replace each other line by line.
    for i, (old, new) in enumerate(pairwise(blocks)):
        if (old[0].kind, new[0].kind, len(old)) == ("del", "add", len(new)):
            blocks[i], blocks[i + 1] = with_middles(old, new), with_middles(new, old)
    return list(chain.from_iterable(blocks))


def with_middles(block: Sequence[DiffLine], other: Sequence[DiffLine]) -> list[DiffLine]:
    """Separate each line's middle from the beginning and end that it shares with its counterpart."""
    lines: list[DiffLine] = []
    for line, counterpart in zip(block, other, strict=True):
        text, changed = line.text, counterpart.text
        # Remove the common head, then the common tail of the rest.
        head = common_prefix_length(text, changed)
        tail = common_prefix_length(text[head:][::-1], changed[head:][::-1])
        end = len(text) - tail
        lines.append(DiffLine(line.kind, text[:head], text[head:end], text[end:]))
    return lines


def common_prefix_length(first: str, other: str) -> int:
    """Length of the common prefix of two texts."""
    pairs = enumerate(zip(first, other, strict=False))
    return next((i for i, (a, b) in pairs if a != b), min(len(first), len(other)))


@dataclass(frozen=True, slots=True)
class Change:
    """Share of the picture that changed, 0 to 1, and the second picture with the change marked (PNG)."""

    share: float
    marked: bytes | None

    @property
    def visible(self) -> bool:
        return self.share >= LEAST


def change(before: bytes | None, after: bytes | None) -> Change | None:
    """Compare two pictures of one camera; None if one is missing, unreadable or of another size."""
    from PIL import Image

    # Read both pictures; a missing or unreadable one gives no comparison.
    pictures: list[NDArray[np.uint8]] = []
    for content in (before, after):
        if not content:
            return None
        try:
            with Image.open(io.BytesIO(content), formats=("PNG", "JPEG")) as image:
                pictures.append(np.asarray(image.convert("RGB")))
        except (OSError, ValueError, Image.DecompressionBombError):
            return None
    first, other = pictures
    if first.shape != other.shape:
        return None
    # Use int16: differences of uint8 wrap around.
    differs = np.abs(first.astype(np.int16) - other.astype(np.int16)).max(axis=2) > SEEN
    share = float(differs.mean())
    if share < LEAST:
        return Change(share, None)
    # Show the second picture in pale grey, and the changed pixels in the accent's colour.
    grey = other.mean(axis=2, keepdims=True)
    faint = (0.45 * grey + 0.55 * 255).astype(np.uint8)
    shown = np.repeat(faint, 3, axis=2)
    shown[differs] = (0.35 * other[differs] + 0.65 * np.array(MARK)).astype(np.uint8)
    return Change(share, png(shown))


# Measured windows: parameters, situation and reading of each recording.

FINEST = 1e-5  # N or m: least spread of a recording that is shown


@dataclass(frozen=True, slots=True)
class RecordingEntry:
    """Recording as the report lists it: situation, time and reading."""

    what: str
    when: str
    reading: str


def quantity_label(id: str) -> str:
    """The quantity's name in words; its id if the catalogue lacks it."""
    return catalogue()[id].label if id in catalogue() else id


def windows(trace: Trace, estimates: Sequence[Estimate]) -> dict[Recording, str]:
    """Name each recording by the parameters whose estimates or conversions use it, else by its situation."""
    names: dict[Recording, list[str]] = {recording: [] for recording in trace.recordings}

    def claim(recording: Recording, parameter: Parameter) -> None:
        name = f"{parameter.object} {quantity_label(parameter.quantity)}"
        if recording in names and name not in names[recording]:
            names[recording].append(name)

    # Estimates and conversions claim their recordings.
    for estimate in estimates:
        for recording in estimate.evidence:
            claim(recording, estimate.parameter)
    for conversion in trace.conversions:
        claim(conversion.recording, Parameter(conversion.object, conversion.quantity))
    # Name the others by activity and object.
    for recording, claimed in names.items():
        if not claimed:
            context = recording.context
            about = context.holding or context.support or ""
            claimed.append(f"{context.activity} {about}".strip())
    return {recording: ", ".join(claimed) for recording, claimed in names.items()}


def evidence(recording: Recording, trace: Trace) -> RecordingEntry:
    """Describe one measured window."""
    context = recording.context
    words: list[str] = [context.activity]
    if context.holding:
        words.append(f"holding {context.holding}")
    if context.support:
        words.append(f"on {context.support}")
    if context.at:
        words.append(f"at {context.at}")
    when = f"{recording.start:.2f}–{recording.end:.2f} s"
    return RecordingEntry(", ".join(words), when, reading_text(recording, trace))


def reading_text(recording: Recording, trace: Trace) -> str:
    """Mean ± standard deviation of the recording's main signal, and the number of samples."""
    samples = trace.of(recording)
    # Choose the main signal: a stated reading, the vertical force, or the height of the fingertips.
    if recording.reading:
        name, unit, values = "reading", "", np.array(recording.reading)
    elif recording.buffer == FORCES:
        name, unit, values = "Fz", " N", samples.wrench[:, 2]
    else:
        name, unit, values = "fingertips z", " m", tip_height(samples, trace.hand)
    count = len(values)
    if not count:
        return "no samples"
    mean, std = round_to_std(float(values.mean()), max(float(values.std()), FINEST))
    return f"{name} = {mean} ± {std}{unit}, {'1 sample' if count == 1 else f'{count} samples'}"
