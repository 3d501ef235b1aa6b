"""Cache of results that follow from a trace alone."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from functools import wraps
from typing import Any, Concatenate, ParamSpec, TypeVar
from weakref import WeakKeyDictionary

import numpy as np

from palpate.trace.samples import Samples, Trace

K = TypeVar("K", Samples, Trace)
P = ParamSpec("P")
T = TypeVar("T")


def once(find: Callable[Concatenate[K, P], T]) -> Callable[Concatenate[K, P], T]:
    """`find`, a function of samples or a trace and, besides, of what can be hashed; what it found is
    remembered as long as they are. An array is shared by all who ask, and so cannot be written to."""
    known: WeakKeyDictionary[Any, dict[Hashable, T]] = WeakKeyDictionary()

    @wraps(find)
    def found(of: K, *args: P.args, **named: P.kwargs) -> T:
        mine = known.setdefault(of, {})
        which = (args, *sorted(named.items()))
        if which not in mine:
            made = find(of, *args, **named)
            if isinstance(made, np.ndarray):
                made.flags.writeable = False
            mine[which] = made
        return mine[which]

    return found
