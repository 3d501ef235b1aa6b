"""What palpate uses of SciPy's computational geometry."""

import numpy as np
from numpy.typing import NDArray

class QhullError(RuntimeError): ...

class ConvexHull:
    vertices: NDArray[np.intp]
    def __init__(self, points: NDArray[np.float64]) -> None: ...
