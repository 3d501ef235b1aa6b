"""What palpate uses of SciPy's Fourier transforms."""

from typing import Literal

import numpy as np
from numpy.typing import NDArray

def dct(
    x: NDArray[np.float64], *, axis: int = ..., norm: Literal["ortho"] | None = ...
) -> NDArray[np.float64]: ...
