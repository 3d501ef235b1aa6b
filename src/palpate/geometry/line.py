"""Poses along a line, of which a run takes the one that it has found out to be best."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate.errors import InputError
from palpate.geometry.pose import Array, Pose

SPACING = 0.02
"""m, at most, between the places of a line at which a plan is judged: less than the fingers' pads are
broad, so that what they sweep at one place reaches into what they sweep at the next."""
ROUNDING = 1e-9
"""m."""


@dataclass(frozen=True, slots=True, eq=False)
class Line:
    """Poses that differ in where they are along a line; their region is all from `least` to `most`.

    Attributes:
        pose: of the TCP in the world, at 0.
        along: (3,) level unit vector in the world.
        least, most: m along it, the ends of the region.
        believed: m along it, the place that is taken until a run knows better.
    """

    pose: Pose
    along: Array
    least: float
    most: float
    believed: float

    @classmethod
    def through(cls, pose: Pose, half: Array, point: Array) -> Line:
        """The line that leads by `half` (3,) m to either side of a pose, in the world; believed is
        where it is nearest to a point (3,)."""
        length = float(np.linalg.norm(half))
        line = cls(pose, half / length, -length, length, 0.0)
        return cls(line.pose, line.along, line.least, line.most, line.nearest(point))

    def at(self, place: float) -> Pose:
        """The pose at `place`, m along.

        Raises:
            InputError: that is outside the region.
        """
        if not self.least - ROUNDING <= place <= self.most + ROUNDING:
            raise InputError(
                f"{1e3 * place:.0f} mm along is outside {1e3 * self.least:.0f} to "
                f"{1e3 * self.most:.0f} mm, for which the plan was judged"
            )
        return self.pose.translated(place * self.along)

    def nearest(self, point: Array) -> float:
        """m along, of the place in the region nearest to a point (3,) in the world."""
        place = float((point - self.pose.position) @ self.along)
        return min(max(place, self.least), self.most)

    def places(self) -> list[float]:
        """m along: both ends, and places between that are no farther apart than `SPACING`."""
        steps = int(np.ceil((self.most - self.least) / SPACING))
        return np.linspace(self.least, self.most, steps + 1).tolist()
