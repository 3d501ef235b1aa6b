"""Values of the keys of a noise model: levels, and sizes that values are drawn from.

A scalar stands for all seven joints, or for all axes. A drawn size may be written
`{fixed: value}`: then the value is the same for every seed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any, Literal, cast

import numpy as np
from pydantic import BeforeValidator, Field, PlainValidator

from palpate.files.worded import plain_number
from palpate.geometry.pose import Array

JOINTS = 7
Law = Literal["normal", "uniform", "magnitude", "sign"]
Shape = tuple[int, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Drawn:
    """A value that is drawn, or fixed.

    Attributes:
        size: scale: one standard deviation of a centred normal (`normal`; `magnitude` takes its
            absolute value), half the width of a uniform (`uniform`), or the size of a random sign
            (`sign`).
        fixed: the value itself, with its sign, instead.
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


class Streams:
    """Random number streams, one per key of a noise model (`torque.white`), independent of each
    other: a change of one key reshuffles no other.

    Args:
        seed: the robot.
        visit: the run of that robot.
    """

    def __init__(self, seed: int, visit: int = 0) -> None:
        self._seed, self._visit = seed, visit

    def __call__(self, key: str, *visit: int) -> np.random.Generator:
        """Return the stream of a property of the robot, the same in all its runs."""
        sequence = np.random.SeedSequence(self._seed, spawn_key=(*key.encode(), *visit))
        return np.random.default_rng(sequence)

    def run(self, key: str) -> np.random.Generator:
        """Return the stream of a value that differs from run to run."""
        # 255 is the largest byte of a key, so that no key and visit make another key.
        return self(key, 255 + self._visit) if self._visit else self(key)


def array_of(value: Any, shape: Shape, message: str) -> Array:
    """Read numbers, also infinite ones, in `shape`, from a scalar, one number a joint, or all.

    Raises:
        ValueError: `message`.
    """
    try:
        require_numbers(value)
        array = np.array(value, dtype=float)
        if array.shape == shape[:1] and len(shape) == 2:
            array = array[:, None]
        elif array.shape not in ((), shape):
            raise ValueError
        array = np.broadcast_to(array, shape).copy()
        if np.isnan(array).any():
            raise ValueError
    except (TypeError, ValueError):
        raise ValueError(message) from None
    array.flags.writeable = False
    return array


def require_numbers(value: Any) -> None:
    """Reject booleans, which Python takes for numbers, and anything else that is no number."""
    if isinstance(value, list):
        for inner in cast("list[Any]", value):
            require_numbers(inner)
    elif isinstance(value, bool) or not isinstance(value, int | float | str | np.ndarray):
        raise ValueError


def form_of(shape: Shape) -> str:
    """Describe the values that a key of this shape takes."""
    if not shape:
        return "give a number"
    if len(shape) == 1:
        return f"give a number or a list of {shape[0]} numbers"
    return f"give a number, a list of {shape[0]} numbers, or {shape[0]} lists of {shape[1]}"


def sizes(shape: Shape, infinite: bool = False) -> Callable[[Any], Array]:
    """Make a validator of sizes: numbers that are not negative."""

    def read(value: Any) -> Array:
        array = array_of(value, shape, form_of(shape))
        if (array < 0).any():
            raise ValueError("must not be negative")
        if not infinite and np.isinf(array).any():
            raise ValueError("must be finite")
        return array

    return read


def drawn(shape: Shape, law: Law = "normal") -> Callable[[Any], Drawn]:
    """Make a validator of a size, or `{fixed: value}`."""
    size = sizes(shape)

    def read(value: Any) -> Drawn:
        if isinstance(value, Drawn):
            return value
        if not isinstance(value, dict):
            return Drawn(law, size(value))
        said = cast("dict[str, Any]", value)
        if set(said) != {"fixed"}:
            raise ValueError(f"{form_of(shape)}, or {{fixed: VALUE}}")
        fixed = array_of(said["fixed"], shape, f"fixed: {form_of(shape)}")
        if np.isinf(fixed).any():
            raise ValueError("fixed: must be finite")
        if law == "magnitude" and (fixed < 0).any():
            raise ValueError("fixed: must not be negative")
        return Drawn(law, size(0.0), fixed)

    return read


def nothing(shape: Shape = (), law: Law = "normal") -> Drawn:
    """Return a drawn value that is always zero."""
    return Drawn(law, np.zeros(shape))


Seven = (JOINTS,)
AXES = (3,)
NONE = np.zeros(JOINTS)  # a level of no joint

Levels = Annotated[np.ndarray, PlainValidator(sizes(Seven))]  # one per joint
Ranges = Annotated[np.ndarray, PlainValidator(sizes(Seven, infinite=True))]

Number = Annotated[Drawn, PlainValidator(drawn(()))]
Joints = Annotated[Drawn, PlainValidator(drawn(Seven))]
JointsWithin = Annotated[Drawn, PlainValidator(drawn(Seven, "uniform"))]
JointsSigned = Annotated[Drawn, PlainValidator(drawn(Seven, "sign"))]
JointsSoft = Annotated[Drawn, PlainValidator(drawn(Seven, "magnitude"))]
Soft = Annotated[Drawn, PlainValidator(drawn((), "magnitude"))]
JointAxes = Annotated[Drawn, PlainValidator(drawn((JOINTS, 3)))]
Pairs = Annotated[Drawn, PlainValidator(drawn((JOINTS, JOINTS)))]
Vector = Annotated[Drawn, PlainValidator(drawn(AXES))]
Plane = Annotated[Drawn, PlainValidator(drawn((2,)))]

_Plain = BeforeValidator(plain_number)
Level = Annotated[float, _Plain, Field(ge=0, allow_inf_nan=False)]
Positive = Annotated[float, _Plain, Field(gt=0, allow_inf_nan=False)]
Lasting = Annotated[float, _Plain, Field(gt=0)]  # a time or a distance that may be infinite
Share = Annotated[float, _Plain, Field(ge=0, le=1)]
Factor = Annotated[float, _Plain, Field(ge=1, allow_inf_nan=False)]
