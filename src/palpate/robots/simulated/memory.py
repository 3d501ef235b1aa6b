"""Memory of the noise models' state, for a return to it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from pydantic import BaseModel

State = tuple[list[dict[str, Any]], list[Mapping[str, Any]]]


class Memory:
    """Attributes of some objects and of all objects below them. Arrays and random generators are
    copied; settings never change."""

    def __init__(self, *roots: object) -> None:
        self._parts: list[object] = []
        self._generators: list[np.random.Generator] = []
        known: set[int] = set()
        left = list(roots)
        while left:
            part = left.pop()
            if id(part) in known or isinstance(part, BaseModel):
                continue
            known.add(id(part))
            if isinstance(part, np.random.Generator):
                self._generators.append(part)
            elif hasattr(part, "__dict__"):
                self._parts.append(part)
                left.extend(vars(part).values())

    def save(self) -> State:
        """Return the present state."""
        attributes = [copied(vars(part)) for part in self._parts]
        return attributes, [random.bit_generator.state for random in self._generators]

    def restore(self, state: State) -> None:
        """Return to a state."""
        for part, attributes in zip(self._parts, state[0], strict=True):
            vars(part).update(copied(attributes))
        for random, drawn in zip(self._generators, state[1], strict=True):
            random.bit_generator.state = drawn


def copied(attributes: Mapping[str, Any]) -> dict[str, Any]:
    """Copy attributes, arrays too."""
    return {
        name: value.copy() if isinstance(value, np.ndarray) else value
        for name, value in attributes.items()
    }
