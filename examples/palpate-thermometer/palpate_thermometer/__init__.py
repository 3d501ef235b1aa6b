"""A third party's primitive and its quantity: one class each is all it takes.

The thermometer is a digital one that appends its readings, in °C, one a line, to a file, as serial
loggers do. The environment variable `PALPATE_THERMOMETER` names that file.
"""

from __future__ import annotations

import math
import os
from dataclasses import replace
from pathlib import Path
from statistics import fmean, stdev
from typing import ClassVar

from palpate.common.parameter import Parameter
from palpate.estimation.estimate import Estimate, not_identified, not_measured
from palpate.estimation.quantities.quantity import Quantity
from palpate.mjcf.body import Body
from palpate.primitives.base import Blackboard, ConversionPrimitive, LeafFailure, Steps
from palpate.primitives.state import SymbolicState, Violation
from palpate.trace.recording import Conversion, Recording
from palpate.trace.samples import Trace

__all__ = ["MeasureTemperature", "Temperature"]

LOG = "PALPATE_THERMOMETER"
TOOL = "thermometer"
SOAK = 1.0
"""s that the tip is held still over what it measures."""
ACCURACY = 0.1
"""°C, one standard deviation of the instrument."""
TAIL = 5
"""Latest readings that are averaged."""


class Temperature(Quantity):
    """What a thermometer shows; MJCF has no place for it."""

    id = "temperature"
    unit = "°C"
    subject = "object"
    words: ClassVar = {"en": ("temperature", "warm", "cold", "hot")}
    how = "hold the thermometer over the object"
    estimators: ClassVar = {"mean": f"{__name__}:estimate_temperature"}


class MeasureTemperature(ConversionPrimitive):
    """Read the thermometer while it is held still over an object: fetch it, MovePose to the
    object's probe pose, then measure; one reading is the temperature of the object below."""

    writes: ClassVar[str | None] = "temperature_readings"
    measures: ClassVar[type[Quantity] | None] = Temperature

    def subject(self, state: SymbolicState) -> str | None:
        if state.holding != TOOL or state.pose_world_tcp is None:
            return None
        below = state.surface_below(state.pose_world_tcp)
        return below.name if below else None

    def requires(self, state: SymbolicState) -> list[Violation]:
        if state.holding != TOOL:
            problem = "the thermometer is not in the gripper; grasp and lift it first"
            return [Violation("precondition", problem)]
        if self.subject(state) is None:
            problem = "nothing is below the thermometer; MovePose over what is to be measured first"
            return [Violation("precondition", problem)]
        return []

    def effects(self, state: SymbolicState) -> SymbolicState:
        subject = self.subject(state)
        return (
            replace(state, converted=state.converted | {Parameter(subject, Temperature.id)})
            if subject
            else state
        )

    def run(self, blackboard: Blackboard) -> Steps:
        subject, start = self.subject(blackboard.state), blackboard.robot.state.t
        assert subject is not None
        while blackboard.robot.state.t - start < SOAK:
            yield
        recording = Recording(
            "temperature_readings",
            start,
            blackboard.robot.state.t,
            blackboard.state.context(),
            reading=_latest_readings(),
        )
        blackboard.recorder.recordings.append(recording)
        blackboard.recorder.conversions.append(
            Conversion(
                type(self).__name__, subject, Temperature.id, recording, blackboard.robot.state.t
            )
        )
        return f"{subject} {fmean(recording.reading):.1f} °C"


def estimate_temperature(trace: Trace, parameter: Parameter, body: Body | None) -> Estimate:
    """Mean of the readings, whose scatter adds to the instrument's accuracy."""
    recording = trace.converted(parameter)
    if recording is None:
        return not_measured(parameter, Temperature.unit)
    readings = recording.reading
    if not readings:
        return not_identified(parameter, Temperature.unit, "The thermometer gave no reading.")
    scatter = stdev(readings) / math.sqrt(len(readings)) if len(readings) > 1 else 0.0
    method = f"Mean of {len(readings)} thermometer readings."
    return Estimate.normal(
        parameter,
        Temperature.unit,
        fmean(readings),
        math.hypot(ACCURACY, scatter),
        method,
        (recording,),
    )


def _latest_readings() -> tuple[float, ...]:
    path = os.environ.get(LOG)
    if not path:
        raise LeafFailure(f"no thermometer: set {LOG} to the file its logger writes")
    try:
        lines = Path(path).read_text(encoding="utf-8").split()
        return tuple(float(line) for line in lines[-TAIL:])
    except (OSError, ValueError) as error:
        raise LeafFailure(f"the thermometer's log cannot be read: {error}") from error
