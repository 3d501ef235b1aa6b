"""Mark single cases of a parametrized test as long."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import pytest


def mark_long(
    cases: Iterable[object], is_long: Callable[..., bool], name: Callable[..., str] | None = None
) -> list[object]:
    """Wrap each case that `is_long` as a parameter with the mark `long`.

    Args:
        cases: values of one argument, or tuples of values.
        name: a case's id, if it needs one.
    """
    return [
        pytest.param(
            *(case if isinstance(case, tuple) else (case,)),
            marks=[pytest.mark.long] if is_long(case) else [],
            id=name(case) if name else None,
        )
        for case in cases
    ]
