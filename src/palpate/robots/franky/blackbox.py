"""What every cycle said before a fault, written down for whoever wants to know how it came."""

from __future__ import annotations

import logging
import tempfile
from collections.abc import Sequence
from typing import Any

import numpy as np

from palpate.robots.franky.drive import Row
from palpate.robots.franky.faults import mode_of

log = logging.getLogger(__name__)

SIGNALS = ("q", "dq", "tau_J", "tau_J_d", "tau_ext_hat_filtered", "O_F_ext_hat_K")
"""Of franky's states, under their own names."""


def flush(rows: Sequence[Row], why: str) -> str | None:
    """Write the last cycles at 1 kHz as NumPy arrays, one row a cycle: `t`, `mode`, `SIGNALS`, the
    commanded pose `target_world_tcp`, the part of commands that arrived; and `why`. None where there
    is nothing to write, or nowhere."""
    if not rows:
        return None
    states = [row.state for row in rows]
    arrays: dict[str, Any] = {"why": np.array(why)}
    for name in SIGNALS:
        arrays[name] = np.array([getattr(state, name) for state in states])
    arrays["t"] = np.array([state.time.to_sec() for state in states])
    arrays["mode"] = np.array([mode_of(state) for state in states])
    arrays["arrived"] = np.array([state.control_command_success_rate for state in states])
    arrays["target_world_tcp"] = np.array([row.target for row in rows])
    try:
        with tempfile.NamedTemporaryFile(
            prefix="palpate-franka-", suffix=".npz", delete=False
        ) as file:
            np.savez(file, **arrays)
    except OSError as error:
        log.warning("the last cycles are not written down: %s", error)
        return None
    log.warning("the last %d cycles are in %s", len(rows), file.name)
    return file.name
