"""Values of the keys of a noise model: levels, and sizes that values are drawn from.

A scalar stands for all seven joints, or for all axes. A drawn size may be written
`{fixed: value}`: then it is that very value for every seed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any, Literal, cast

import numpy as np
from pydantic import BeforeValidator, Field, PlainValidator

from palpate.files.plain_yaml import plain_number
from palpate.geometry.pose import Array

JOINTS = 7
Law = Literal["normal", "uniform", "magnitude", "sign"]
Shape = tuple[int, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Drawn:
    """A value that is drawn, or fixed.

    Attributes:
        size: its scale: one standard deviation of a centred normal (`normal`; `magnitude` is of
            such a normal's absolute value), half the width of a uniform (`uniform`), or what has a
            random sign (`sign`).
        fixed: the very value, with its sign, instead.
    """

    law: Law
    size: Array
    fixed: Array | None = None

    @property
    def any(self) -> bool:
        """Test if it can be non-zero."""
        return bool(np.any(self.size if self.fixed is None else self.fixed))

    def draw(self, random: np.random.Generator) -> Array:
        """Draw a value, in the shape of its size."""
        if self.fixed is not None:
            return self.fixed.copy()
        if self.law == "uniform":
            return self.size * random.uniform(-1.0, 1.0, self.size.shape)
        drawn = random.standard_normal(self.size.shape)
        if self.law == "magnitude":
            drawn = np.abs(drawn)
        elif self.law == "sign":
            drawn = np.sign(drawn)
        return self.size * drawn

    def number(self, random: np.random.Generator) -> float:
        """Draw a scalar value."""
        return float(self.draw(random)[()])


LAST_BYTE = 255
"""Of a key's text; what follows is no text."""


class Streams:
    """Separate stream of random numbers for each key of a noise model, by its name (`torque.white`): a
    change of one reshuffles no other."""

    def __init__(self, seed: int, visit: int = 0) -> None:
        """`seed` is the robot; `visit` is one of the runs that it makes."""
        self._seed, self._visit = seed, visit

    def __call__(self, key: str) -> np.random.Generator:
        """The stream of that name, from its beginning: of what a robot is."""
        return self._stream(tuple(key.encode()))

    def run(self, key: str) -> np.random.Generator:
        """The stream of what is drawn anew in every run."""
        visit = (LAST_BYTE + self._visit,) if self._visit else ()
        return self._stream((*key.encode(), *visit))

    def _stream(self, key: tuple[int, ...]) -> np.random.Generator:
        sequence = np.random.SeedSequence(self._seed, spawn_key=key)
        return np.random.default_rng(sequence)


def _array(value: Any, shape: Shape, what: str) -> Array:
    """Finite or infinite numbers in `shape`, from a scalar, one number a joint, or all of them."""
    try:
        _require_numbers(value)
        array = np.array(value, dtype=float)
        if array.shape == shape[:1] and len(shape) == 2:
            array = array[:, None]
        elif array.shape not in ((), shape):
            raise ValueError
        array = np.broadcast_to(array, shape).copy()
    except (TypeError, ValueError):
        raise ValueError(what) from None
    if np.isnan(array).any():
        raise ValueError(what)
    array.flags.writeable = False
    return array


def _require_numbers(value: Any) -> None:
    """No truth values, which Python takes for numbers, and nothing that is no number."""
    if isinstance(value, list):
        for inner in cast("list[Any]", value):
            _require_numbers(inner)
    elif isinstance(value, bool) or not isinstance(value, int | float | str | np.ndarray):
        raise ValueError


def _wanted(shape: Shape) -> str:
    if not shape:
        return "give a number"
    if len(shape) == 1:
        return f"give a number or a list of {shape[0]} numbers"
    return f"give a number, a list of {shape[0]} numbers, or {shape[0]} lists of {shape[1]}"


def _sizes(shape: Shape, infinite: bool = False) -> Callable[[Any], Array]:
    """A validator that takes sizes: numbers that are not negative."""

    def read(value: Any) -> Array:
        array = _array(value, shape, _wanted(shape))
        if (array < 0).any():
            raise ValueError("must not be negative")
        if not infinite and np.isinf(array).any():
            raise ValueError("must be finite")
        return array

    return read


def _drawn(shape: Shape, law: Law) -> Callable[[Any], Drawn]:
    """A validator that takes a size, or `{fixed: value}`."""
    sizes = _sizes(shape)

    def read(value: Any) -> Drawn:
        if isinstance(value, Drawn):
            return value
        if not isinstance(value, dict):
            return Drawn(law, sizes(value))
        said = cast("dict[str, Any]", value)
        if set(said) != {"fixed"}:
            raise ValueError(f"{_wanted(shape)}, or {{fixed: VALUE}}")
        fixed = _array(said["fixed"], shape, f"fixed: {_wanted(shape)}")
        if np.isinf(fixed).any():
            raise ValueError("fixed: must be finite")
        if law == "magnitude" and (fixed < 0).any():
            raise ValueError("fixed: must not be negative")
        return Drawn(law, sizes(0.0), fixed)

    return read


def nothing(shape: Shape = (), law: Law = "normal") -> Drawn:
    """Level that is always zero."""
    return Drawn(law, np.zeros(shape))


Seven = (JOINTS,)
AXES = (3,)
NONE = np.zeros(JOINTS)
"""A level of no joint."""

Levels = Annotated[np.ndarray, PlainValidator(_sizes(Seven))]
"""Levels, one per joint."""
Ranges = Annotated[np.ndarray, PlainValidator(_sizes(Seven, infinite=True))]

Number = Annotated[Drawn, PlainValidator(_drawn((), "normal"))]
Joints = Annotated[Drawn, PlainValidator(_drawn(Seven, "normal"))]
JointsWithin = Annotated[Drawn, PlainValidator(_drawn(Seven, "uniform"))]
JointsSigned = Annotated[Drawn, PlainValidator(_drawn(Seven, "sign"))]
JointsSoft = Annotated[Drawn, PlainValidator(_drawn(Seven, "magnitude"))]
Soft = Annotated[Drawn, PlainValidator(_drawn((), "magnitude"))]
JointAxes = Annotated[Drawn, PlainValidator(_drawn((JOINTS, 3), "normal"))]
Pairs = Annotated[Drawn, PlainValidator(_drawn((JOINTS, JOINTS), "normal"))]
Vector = Annotated[Drawn, PlainValidator(_drawn(AXES, "normal"))]
Plane = Annotated[Drawn, PlainValidator(_drawn((2,), "normal"))]

_Plain = BeforeValidator(plain_number)
Level = Annotated[float, _Plain, Field(ge=0, allow_inf_nan=False)]
Positive = Annotated[float, _Plain, Field(gt=0, allow_inf_nan=False)]
Lasting = Annotated[float, _Plain, Field(gt=0)]
"""A time or a way that may be infinite."""
Share = Annotated[float, _Plain, Field(ge=0, le=1)]
Factor = Annotated[float, _Plain, Field(ge=1, allow_inf_nan=False)]
