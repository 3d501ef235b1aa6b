"""Threads of the linear algebra libraries."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager

from threadpoolctl import threadpool_limits


@contextmanager
def single_threaded_blas() -> Generator[None]:
    """Limit BLAS to one thread while the block runs, and restore the caller's limit.

    The estimators' matrices are small: more threads block each other and take ten times the processor
    time.
    """
    with threadpool_limits(1, "blas"):
        yield
