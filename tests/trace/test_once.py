"""What follows from a trace alone is found once."""

from __future__ import annotations

import gc

import numpy as np
import pytest

from palpate.trace.once import once
from palpate.trace.samples import Samples


def test_it_is_found_once_for_the_same_samples_and_anew_for_others() -> None:
    asked: list[tuple[Samples, float]] = []

    @once
    def times(samples: Samples, factor: float) -> np.ndarray:
        asked.append((samples, factor))
        return factor * np.ones(3)

    one, other = Samples.empty(), Samples.empty()
    assert times(one, 2.0) is times(one, 2.0)
    assert times(one, 3.0).tolist() == [3.0] * 3
    times(other, 2.0)
    assert asked == [(one, 2.0), (one, 3.0), (other, 2.0)]


def test_what_is_shared_cannot_be_written_to() -> None:
    @once
    def zeros(samples: Samples) -> np.ndarray:
        return np.zeros(len(samples) + 1)

    with pytest.raises(ValueError, match="read-only"):
        zeros(Samples.empty())[0] = 1.0


def test_it_is_forgotten_with_the_samples() -> None:
    made: list[int] = []

    @once
    def count(samples: Samples) -> int:
        made.append(len(samples))
        return len(made)

    for _ in range(3):
        count(Samples.empty())
        gc.collect()
    assert len(made) == 3
