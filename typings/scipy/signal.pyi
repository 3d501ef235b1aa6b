"""What palpate uses of SciPy's filters."""

from typing import Literal

import numpy as np
from numpy.typing import NDArray

def butter(N: int, Wn: float, *, fs: float, output: Literal["sos"]) -> NDArray[np.float64]: ...
def sosfiltfilt(
    sos: NDArray[np.float64], x: NDArray[np.float64], axis: int = ...
) -> NDArray[np.float64]: ...
def savgol_filter(
    x: NDArray[np.float64],
    window_length: int,
    polyorder: int,
    *,
    deriv: int = ...,
    delta: float = ...,
    axis: int = ...,
) -> NDArray[np.float64]: ...
