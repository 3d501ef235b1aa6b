"""Parameters of a request, and what it says about objects."""

from __future__ import annotations

from dataclasses import dataclass

from palpate.common.parameter import Parameter

GRIPPER = "gripper"
"""Subject of quantities of the empty hand."""


@dataclass(frozen=True, slots=True)
class Grounded:
    """Parameters of a request.

    Attributes:
        asked: the named parameters, including those that the scene states.
        cannot: one sentence for each request that no plan can measure.
        remarks: interpretations of implicit wishes.
        within: requested half widths of 95 % intervals, by quantity, as `1 g`.
    """

    asked: tuple[Parameter, ...]
    cannot: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()
    within: tuple[tuple[str, str], ...] = ()
