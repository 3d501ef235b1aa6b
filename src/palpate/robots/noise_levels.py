"""Noise of the simulated arm: levels that come with palpate, and the one that is used where nobody names one."""

from __future__ import annotations

LEVELS = ("none", "lab", "datasheet", "hardware", "measured")
DEFAULT_LEVEL = "measured"
"""Level of recorded real arms."""
