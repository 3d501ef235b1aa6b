"""Recorder of the last control cycles before a fault, for diagnosis."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from palpate.geometry.pose import Array
from palpate.robots.franky.control.drive import Row
from palpate.robots.franky.faults import mode_of

SIGNALS = ("q", "dq", "tau_J", "tau_J_d", "tau_ext_hat_filtered", "O_F_ext_hat_K")
"""Of franky's states, under their own names."""


def black_box(rows: Sequence[Row], why: str) -> Mapping[str, Array] | None:
    """The last cycles at 1 kHz, one row a cycle: `t`, `mode`, `SIGNALS`, the commanded pose
    `target_world_tcp`, the part of commands that `arrived`; and `why`. None where there was none."""
    if not rows:
        return None
    states = [row.state for row in rows]
    arrays: dict[str, Array] = {"why": np.array(why)}
    for name in SIGNALS:
        arrays[name] = np.array([getattr(state, name) for state in states])
    arrays["t"] = np.array([state.time.to_sec() for state in states])
    arrays["mode"] = np.array([mode_of(state) for state in states])
    arrays["arrived"] = np.array([state.control_command_success_rate for state in states])
    arrays["target_world_tcp"] = np.array([row.target for row in rows])
    return arrays
