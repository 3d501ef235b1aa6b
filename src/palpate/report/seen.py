"""Poses of objects on the page: by sight, by touch, and by both."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from palpate.geometry.belief import Belief
from palpate.geometry.pose import Array, Pose


@dataclass(frozen=True, slots=True)
class PoseRow:
    """Pose of an object, in words; `both` is empty where nothing touched it."""

    object: str
    sight: str
    touches: tuple[str, ...]
    both: str
    contradiction: str


def pose_rows(beliefs: Mapping[str, Belief]) -> Iterator[PoseRow]:
    """Poses of objects that were seen."""
    for name, belief in beliefs.items():
        touches = tuple(f"{touch.means}: {touch.said}" for touch in belief.touches)
        both = _in_words(belief.pose, belief.covariance) if touches else ""
        sight = _in_words(belief.seen, belief.seen_covariance)
        yield PoseRow(name, sight, touches, both, belief.contradiction)


def _in_words(pose: Pose, covariance: Array) -> str:
    """Position to a tenth of a millimetre, each with its standard deviation."""
    stds = np.sqrt(np.diag(covariance)[:3])
    parts = zip("xyz", (1e3 * pose.position).tolist(), (1e3 * stds).tolist(), strict=True)
    return ", ".join(f"{axis} {value:.1f} ± {std:.1f}" for axis, value, std in parts)
