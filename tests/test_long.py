"""The list of tests that take long names tests that are there."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.conftest import LONG

ROOT = Path(__file__).parents[1]


@pytest.mark.parametrize("pattern", LONG)
def test_a_long_test_is_there(pattern: str) -> None:
    file, _, name = pattern.partition("::")
    function = name.partition("[")[0].rstrip("*")
    assert f"def {function}" in (ROOT / file).read_text(encoding="utf-8")
