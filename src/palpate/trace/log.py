"""Recording of an arm in motion, from whatever logged it."""

from __future__ import annotations

from dataclasses import dataclass

from palpate.geometry.pose import Array


@dataclass(frozen=True, slots=True, eq=False)
class ArmLog:
    """Joint signals of an arm with seven joints, in the order of its chain.

    Attributes:
        t: (n,) s, increasing.
        q: (n, 7) joint positions, rad.
        dq: (n, 7) joint velocities, rad/s.
        tau: (n, 7) joint torques as sensed, gravity included (libfranka's tau_J), N m.
        tau_ext: (n, 7) the controller's own estimate of external torques, N m; None where not logged.
        source: name of the file or topic, for messages.
        notes: what was repaired when it was read, a sentence each.
    """

    t: Array
    q: Array
    dq: Array
    tau: Array
    tau_ext: Array | None
    source: str
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.t)
