"""Motion of an arm over consecutive log periods, as input of the sensor models."""

from __future__ import annotations

from dataclasses import dataclass

from palpate.geometry.pose import Array


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """n log periods of an arm.

    Attributes:
        q, dq: (n, 7) rad, rad/s.
        jacobian: (6, 7) of the last period, world axes about the TCP.
        position: (n, 3) m, the TCP's.
    """

    q: Array
    dq: Array
    jacobian: Array
    position: Array

    def __len__(self) -> int:
        return len(self.q)
