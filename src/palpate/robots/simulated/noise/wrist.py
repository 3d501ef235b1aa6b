"""Six-axis force/torque sensor at the wrist, with the errors that its data sheet states."""

from __future__ import annotations

import numpy as np

from palpate.common.pose import Array
from palpate.robots.sheet import WristSheet
from palpate.robots.simulated.noise.model import DrawnValue, Streams, WristErrors
from palpate.robots.simulated.noise.sensors import Relaxation
from palpate.robots.simulated.timing import BLOCK, PERIOD

AXES = 6
MOMENT_LEVER = 0.3  # m: relates the cross-talk between forces and moments


class WristSensor:
    """Sensor whose errors are drawn once per robot, and whose noise and drift are drawn per run."""

    def __init__(self, sheet: WristSheet, errors: WristErrors, streams: Streams) -> None:
        """Draw the errors: those of the data sheet `sheet`, times the factors of the noise model."""
        # Sensitivity: a common gain, cross-talk between the axes, and a turn in the mounting.
        unit = np.repeat([1.0, MOMENT_LEVER], 3)

        def draw(name: str, size: float, shape: tuple[int, ...]) -> Array:
            drawn = DrawnValue("normal", np.full(shape, size))
            return drawn.draw(streams(f"sensor.{name}"))

        crossed = draw("crosstalk", errors.crosstalk * sheet.crosstalk, (AXES, AXES))
        np.fill_diagonal(crossed, 0.0)
        gain = float(draw("gain", errors.gain * sheet.gain, ()))
        x, y, z = draw("mounting", errors.mounting * sheet.mounting, (3,)).tolist()
        turn = np.array([[1.0, z, -y], [-z, 1.0, x], [y, -x, 1.0]])
        turned = np.kron(np.eye(2), turn)
        matrix = (1.0 + gain) * np.eye(AXES) + unit[:, None] * crossed / unit
        self._matrix: Array = matrix @ turned
        self._range = sheet.range
        # Noise of a block's mean, and a zero that drifts.
        self._white = errors.white * sheet.white / np.sqrt(BLOCK)
        self._random = streams.run("sensor.white")
        self._zero = draw("offset", errors.offset, (AXES,)) * sheet.drift
        drift = errors.drift * sheet.drift
        self._drift = Relaxation(drift, sheet.drift_time, streams.run("sensor.drift"), AXES)

    def read(self, wrench: Array) -> Array:
        """Measure wrenches (n, 6), N and N m, that the arm exerts below the sensor, in its axes."""
        found = wrench @ self._matrix.T
        found += self._zero + self._drift.after(len(wrench) * PERIOD)
        found += self._white * self._random.standard_normal(found.shape)
        return np.clip(found, -self._range, self._range)
