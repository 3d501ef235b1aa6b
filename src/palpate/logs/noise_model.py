"""Noise model of an arm from the statistics of its recording, and the figures of other models beside it."""

from __future__ import annotations

from typing import Any

import numpy as np

from palpate.files.plain_yaml import yaml_text
from palpate.geometry.pose import Array
from palpate.logs.statistics import LogStatistics
from palpate.robots.description import RobotDescription
from palpate.robots.simulated.noise.model import Drawn
from palpate.robots.simulated.noise.models import noise_models

BASE = "measured"
"""Noise model whose figures stand where a recording shows none."""
PLACES = {
    "white": "torque.white",
    "quantisation": "torque.quantisation",
    "offset": "torque.offset",
    "coulomb": "friction.coulomb",
    "presliding": "friction.presliding",
    "position": "friction.position",
    "ripple": "torque.ripple.size",
    "second": "torque.ripple.second",
    "cycles": "torque.ripple.cycles",
    "encoder_ripple": "pose.encoder_ripple.size",
}
"""Key of a noise model that states a figure."""
DIGITS = 3


def stated(name: str, arm: RobotDescription) -> dict[str, Array]:
    """Return the figures (7,) that a noise model states of an arm; of a drawn one, its size."""
    model = noise_models().load(name, arm)
    return {figure: np.asarray(_value(model, place)) for figure, place in PLACES.items()}


def noise_file(found: LogStatistics, arm: RobotDescription, name: str, seconds: float) -> str:
    """Write a noise model with what a recording of `seconds` s shows, as YAML."""
    base, figures = stated(BASE, arm), found.figures()
    content: dict[str, Any] = {}
    for figure, place in PLACES.items():
        seen = ~np.isnan(figures[figure].value)
        if not seen.any():
            continue
        # A drawn size is no value: what is not seen of an offset is zero.
        rest = np.zeros(7) if figure == "offset" else base[figure]
        values = _rounded(np.where(seen, figures[figure].value, rest))
        _put(content, place, {"fixed": values} if figure == "offset" else values)
    if "ripple" in content.get("torque", {}):
        # What is seen holds the control loop's gain.
        _put(content, "torque.ripple.resonance.frequency", float("inf"))
    if "friction" in content:
        _put(content, "friction.spread", 0.0)
    heading = (
        f"# Noise model from {seconds:.0f} s of free motion; what the recording does not show is "
        f"that of '{BASE}'.\n# Keys and units: docs/noise.md.\n"
    )
    return heading + yaml_text({"palpate_noise": 1, "name": name, "extends": BASE, **content})


def _value(model: Any, place: str) -> Any:
    for part in place.split("."):
        model = getattr(model, part)
    return model.size if isinstance(model, Drawn) else model


def _put(content: dict[str, Any], place: str, value: Any) -> None:
    *sections, key = place.split(".")
    for section in sections:
        content = content.setdefault(section, {})
    content[key] = value


def _rounded(values: Array) -> list[float]:
    return [float(f"{value:.{DIGITS}g}") for value in values.tolist()]
