"""Verification of a finished twin: every written value is read back from it by MuJoCo.

Much in a file can overrule a number that stands in it: `settotalmass`, a mesh's own way to be
weighed, a second geom, a defaults class. A twin says what was measured, or does not say it at all.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from palpate.mjcf.body import BodyDescription
from palpate.mjcf.document import Texts
from palpate.mjcf.reading import reparsed
from palpate.parameter import Parameter
from palpate.quantities.catalogue import Catalogue
from palpate.quantities.quantity import Quantity, Values
from palpate.scene.describe import Description, describe
from palpate.scene.poses import Poses

Mask = NDArray[np.bool_]

ROUNDED = 1e-5
"""Relative: single precision of meshes, and seven digits of shares that make one value."""
DIGITS = 0.1
"""Standard deviations: a value is written to a tenth of its own."""
TOGETHER = 1.0
"""Standard deviations, where one number states several components: the radius of a round thing."""


def misread(
    before: Description,
    texts: Texts,
    values: Values,
    std: Mapping[Parameter, float],
    quantities: Catalogue,
) -> Iterator[tuple[Parameter, str]]:
    """Values that the compiled file does not reproduce, with its own ones; `before` is the document
    into which they were written.

    Raises:
        InputError: MuJoCo does not accept the file.
    """
    after = describe(reparsed(texts, before.document), Poses(), quantities)
    for parameter, value in values.items():
        quantity = quantities[parameter.quantity]
        body = after.bodies.get(parameter.object)
        status = "missing" if body is None else quantity.status(body)
        if body is None or status == "missing":
            yield parameter, "what is written leaves it open"
            continue
        if reason := quantity.overruled(body):
            yield parameter, reason
            continue
        stated = status in ("known", "assumed")
        read = quantity.known(body) if stated else quantity.compiled(body)
        if read is not None:
            written = _open(quantity, before.bodies[parameter.object], values)
            apart = np.abs(np.array(read) - value)[written]
            share = DIGITS if stated else TOGETHER
            allowed = ROUNDED * float(np.abs(value).max()) + share * std.get(parameter, 0.0)
            if (apart > allowed).any():
                yield parameter, _worded(quantity, value, read)


def _open(quantity: Quantity, body: BodyDescription, values: Values) -> Mask:
    """(n,) the components that are written: those that the file does not state, or all of them."""
    if quantity.status(body) != "missing":
        return np.ones(quantity.size, dtype=np.bool_)
    return np.array(quantity.prior(body, values).std) > 0.0


def _worded(quantity: Quantity, value: Sequence[float], read: Sequence[float]) -> str:
    return (
        f"with {_numbers(value)} {quantity.unit} written, MuJoCo reads {_numbers(read)} "
        f"{quantity.unit}; something else in the file decides it"
    )


def _numbers(values: Sequence[float]) -> str:
    return " ".join(f"{value:.6g}" for value in values)
