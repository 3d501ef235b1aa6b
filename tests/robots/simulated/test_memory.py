"""Return of objects to an earlier state."""

import numpy as np

from palpate.robots.simulated.memory import Memory


class Part:
    def __init__(self) -> None:
        self.random = np.random.default_rng(1)
        self.sum = np.zeros(2)
        self.count = 0

    def draw(self) -> None:
        self.sum += self.random.standard_normal(2)
        self.count += 1


class Whole:
    def __init__(self) -> None:
        self.part, self.name = Part(), "whole"


def test_arrays_numbers_and_random_streams_return_as_often_as_wanted() -> None:
    whole = Whole()
    memory = Memory(whole)
    whole.part.draw()
    state, found = memory.save(), []
    for _ in range(3):
        whole.part.draw()
        found.append((whole.part.sum.tolist(), whole.part.count))
        memory.restore(state)
    assert found[0] == found[1] == found[2]
    assert whole.part.count == 1
