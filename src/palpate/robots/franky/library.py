"""The library `franky`, loaded when it is used."""

from __future__ import annotations

from functools import cache
from types import ModuleType

from palpate.errors import Unavailable

DISTRIBUTION = "franky-control"


@cache
def franky() -> ModuleType:
    """The module.

    Raises:
        Unavailable: it is not installed here, or does not load.
    """
    try:
        import franky as module  # pyright: ignore[reportMissingTypeStubs]
    except ImportError as error:
        raise Unavailable(
            "the driver for a Franka is not installed: pip install 'palpate[franky]' (Linux on "
            f"x86_64): {error}"
        ) from error
    return module
