"""Memory that is given back to the operating system."""

from __future__ import annotations

import os
import platform
from pathlib import Path

import pytest

from palpate.common.processes import release_memory

BLOCK, COUNT = 1000, 100_000


def resident() -> int:
    """Resident memory of this process, bytes."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="only glibc can give memory back")
def test_freed_blocks_below_one_in_use_are_given_back() -> None:
    blocks = [bytes(BLOCK) for _ in range(COUNT)]
    del blocks[:-1]
    before = resident()
    release_memory()
    assert resident() < before - BLOCK * COUNT / 2
