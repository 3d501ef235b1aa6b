"""What palpate uses of MuJoCo's rollout."""

from collections.abc import Sequence

import numpy as np
from mujoco import MjData, MjModel
from numpy.typing import NDArray

class Rollout:
    def __init__(self, *, nthread: int | None = None) -> None: ...
    def rollout(
        self,
        model: Sequence[MjModel],
        data: Sequence[MjData],
        initial_state: NDArray[np.float64],
        control: NDArray[np.float64],
        *,
        skip_checks: bool = False,
        nstep: int | None = None,
        initial_warmstart: NDArray[np.float64] | None = None,
        state: NDArray[np.float64] | None = None,
        sensordata: NDArray[np.float64] | None = None,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]: ...
