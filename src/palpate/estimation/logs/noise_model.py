"""Statistics of torque errors in a recording, and a noise model built from them."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from palpate.common.errors import InputError
from palpate.common.files import yaml_text
from palpate.common.pose import Array
from palpate.estimation.logs.torque_errors import FigureInterval, ripple, slow_torque
from palpate.estimation.recording_check import explained_upright
from palpate.robots.description import RobotDescription
from palpate.robots.simulated.noise.model import DrawnValue
from palpate.robots.simulated.noise.models import noise_models
from palpate.trace.recording import ArmLog

SHORTEST = 5.0  # s of recording
LEAST_RATE = 250.0  # Hz, slowest recording that shows the noise of samples
REST, LEAST_REST = 0.02, 100  # rad/s, norm over the joints; samples at rest
ALIKE, RECURS = 1.08, 0.005  # ratio of equal steps; share of all differences
FREEDOM = 18 / 35  # of a variance of second differences, for each of them


@dataclass(frozen=True, slots=True, eq=False)
class LogStatistics:
    """Errors of the joint torques in a recording; N m unless stated otherwise."""

    white: FigureInterval  # standard deviation of a sample at rest
    quantisation: FigureInterval  # step of a sample
    offset: FigureInterval
    coulomb: FigureInterval
    presliding: FigureInterval  # rad
    position: FigureInterval  # 1, relative variation of the Coulomb friction over a turn: root mean square
    residual: FigureInterval  # root mean square of what all these leave below 5 Hz
    ripple: FigureInterval  # root mean square at `cycles` a turn, with a resonance's gain
    second: FigureInterval  # of its second harmonic
    cycles: FigureInterval  # 1
    encoder_ripple: (
        FigureInterval  # rad, root mean square at `cycles` a turn, as the velocities show it
    )
    shaking: FigureInterval  # root mean square from 8 to 30 Hz, without gravity
    shaking_left: FigureInterval  # the same without M ddq of the velocities
    drift: FigureInterval  # N m/min

    def figures(self) -> dict[str, FigureInterval]:
        """All figures by name."""
        return {field.name: getattr(self, field.name) for field in fields(self)}


def statistics(log: ArmLog, arm: RobotDescription) -> LogStatistics:
    """Measure the errors of the joint torques of `arm` in a recording of free motion.

    A load beyond the nominal hand, or a missing hand, is fitted and does not count as an error.
    Raises InputError: the recording is too short, or the described arm does not explain it.
    """
    if len(log) < 2 or log.t[-1] - log.t[0] < SHORTEST:
        raise InputError(
            f"{log.source}: give at least {SHORTEST:g} s of free motion; a minute is better"
        )
    found = explained_upright(log, arm)
    if not found.passed:
        raise InputError(f"{log.source}: {found.finding}")
    chain = arm.nominal.chain
    assert chain is not None
    return LogStatistics(
        white=white(log),
        quantisation=quantisation(log.tau),
        **slow_torque(log, chain),
        **ripple(log, chain),
    )


def white(log: ArmLog) -> FigureInterval:
    """White noise of samples at rest, from second differences, which suppress slow changes."""
    # Second differences over three samples at rest have 1.5 times the variance of a sample.
    resting = np.linalg.norm(log.dq, axis=1) < REST
    middle = resting[:-2] & resting[1:-1] & resting[2:]
    count = int(middle.sum())
    if count < LEAST_REST or 1.0 / float(np.median(np.diff(log.t))) < LEAST_RATE:
        return FigureInterval.unseen()
    second = (log.tau[1:-1] - (log.tau[:-2] + log.tau[2:]) / 2)[middle]
    value = np.sqrt((second**2).mean(0) / 1.5)
    return FigureInterval.about(value, value / np.sqrt(2 * FREEDOM * count))


def quantisation(tau: Array) -> FigureInterval:
    """Quantisation step of the samples: the smallest difference, where it recurs."""
    found = np.array([_step(np.abs(np.diff(values))) for values in tau.T])
    return FigureInterval.about(found[:, 0], found[:, 1])


def _step(apart: Array) -> tuple[float, float]:
    """Smallest of distances (n,) and its standard deviation; NaN for continuous values."""
    apart = np.sort(apart[apart > 1e-9])
    least = apart[apart < ALIKE * apart[0]] if len(apart) else apart
    if len(least) < max(5, RECURS * len(apart)):
        return np.nan, np.nan
    return float(np.median(least)), float(least.std() / np.sqrt(len(least)))


# Noise model of an arm from the statistics of its recording, and the figures of other models for comparison


BASE = "measured"
"""Noise model that provides the figures which a recording does not show."""
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
"""Key of each figure in a noise model."""
DIGITS = 3


def stated_figures(name: str, arm: RobotDescription) -> dict[str, Array]:
    """Figures (7,) that a noise model states for an arm; for a random one, its size."""
    model = noise_models().load(name, arm)
    return {figure: np.asarray(_value(model, place)) for figure, place in PLACES.items()}


def noise_file(found: LogStatistics, arm: RobotDescription, name: str, seconds: float) -> str:
    """Write a noise model with the figures of a recording of `seconds` s, as YAML."""
    base, figures = stated_figures(BASE, arm), found.figures()
    content: dict[str, Any] = {}
    # Replace the base model's figures by the observed ones, joint by joint.
    for figure, place in PLACES.items():
        seen = ~np.isnan(figures[figure].value)
        if not seen.any():
            continue
        # The size of a random offset is not a value: unobserved offsets are zero.
        rest = np.zeros(7) if figure == "offset" else base[figure]
        values = _round_figures(np.where(seen, figures[figure].value, rest))
        _set_path(content, place, {"fixed": values} if figure == "offset" else values)
    if "ripple" in content.get("torque", {}):
        # The observed ripple includes the gain of the control loop.
        _set_path(content, "torque.ripple.resonance.frequency", float("inf"))
    if "friction" in content:
        _set_path(content, "friction.spread", 0.0)
    heading = (
        f"# Noise model from {seconds:.0f} s of free motion; what the recording does not show is "
        f"that of '{BASE}'.\n# Keys and units: docs/noise.md.\n"
    )
    return heading + yaml_text({"palpate_noise": 1, "name": name, "extends": BASE, **content})


def _value(model: Any, place: str) -> Any:
    """Value at a dotted path of a model; for a random value, its size."""
    for part in place.split("."):
        model = getattr(model, part)
    return model.size if isinstance(model, DrawnValue) else model


def _set_path(content: dict[str, Any], place: str, value: Any) -> None:
    *sections, key = place.split(".")
    for section in sections:
        content = content.setdefault(section, {})
    content[key] = value


def _round_figures(values: Array) -> list[float]:
    return [float(f"{value:.{DIGITS}g}") for value in values.tolist()]
