"""Runs the instruments' command line in this process, as a shell would see it."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from typer.testing import CliRunner, Result

from bench.__main__ import app


@pytest.fixture
def instrument(monkeypatch: pytest.MonkeyPatch) -> Callable[..., Result]:
    """`instrument("faults", "--kind", "nasty")` → exit code, stdout, stderr; no pictures."""
    monkeypatch.setenv("MUJOCO_GL", "disable")
    return lambda *args: CliRunner().invoke(app, [str(each) for each in args])
