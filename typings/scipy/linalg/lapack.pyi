"""What palpate uses of SciPy's LAPACK wrappers, which are generated when SciPy is built."""

import numpy as np
from numpy.typing import NDArray

_Doubles = NDArray[np.float64]

def dposv(
    a: _Doubles,
    b: _Doubles,
    lower: bool = False,
    overwrite_a: bool = False,
    overwrite_b: bool = False,
) -> tuple[_Doubles, _Doubles, int]: ...
def dpotrf(a: _Doubles, lower: bool = False) -> tuple[_Doubles, int]: ...
def dpotri(c: _Doubles, lower: bool = False) -> tuple[_Doubles, int]: ...
def dpotrs(c: _Doubles, b: _Doubles, lower: bool = False) -> tuple[_Doubles, int]: ...
def dtrtrs(
    a: _Doubles, b: _Doubles, lower: bool = False, trans: bool = False
) -> tuple[_Doubles, int]: ...
