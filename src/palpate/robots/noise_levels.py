"""Noise of the simulated arm: palpate's own levels, and the default one."""

from __future__ import annotations

LEVELS = ("none", "lab", "datasheet", "hardware", "measured")
DEFAULT_LEVEL = "measured"  # Default level: the noise of recorded real arms
