"""A robot of one's own: a scripted arm, its cell and one registry line, and the whole pipeline runs
on it."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from desk import DESK, MASS, Bench
from installed import install

import palpate as pp
from palpate.execution.cell_drivers import drivers

PACKAGE = """from palpate.execution.cell_drivers import Driver
from desk import Bench

driver = Driver("scripted", lambda url, scene: Bench(url))
"""


@pytest.fixture
def registered(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """One line in the registry, as an installed package brings it."""
    point = {"palpate.cells": "scripted = scripted_driver"}
    install(tmp_path, "scripted", point, {"scripted_driver": PACKAGE})
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "scripted_driver", raising=False)
    drivers.cache_clear()
    yield
    drivers.cache_clear()


def test_a_plan_is_executed_and_estimated_on_an_arm_that_is_not_simulated() -> None:
    bench = Bench()
    run = pp.load(DESK).plan("how heavy is the mug?").run(bench, fast=True)
    assert run.execution is not None
    assert run.execution.stopped_by is None
    assert run.status == "complete"
    assert run["mug.mass"].values == pytest.approx([MASS], rel=0.01)
    assert run.truth == {}
    assert run.footage is None
    assert not run.simulated
    assert repr(run).endswith(", on the real robot>")
    assert "simulated" not in repr(run["mug.mass"])
    assert bench.arm.calls[-1] == ("close", None)


@pytest.mark.long
@pytest.mark.usefixtures("registered")
def test_a_url_is_enough_for_a_run_with_its_report(tmp_path: Path) -> None:
    run = pp.run(
        DESK,
        "how heavy is the mug?",
        robot="scripted://b7",
        out=tmp_path / "run",
        fast=True,
    )
    result = json.loads((tmp_path / "run" / "result.json").read_text(encoding="utf-8"))
    assert result["simulated"] is False
    assert result["provenance"]["world"] == "bench at scripted://b7"
    assert result["parameters"][0]["value"] == pytest.approx(MASS, rel=0.01)
    assert "bench at scripted://b7" in (tmp_path / "run" / "report.html").read_text("utf-8")
    assert repr(pp.open(tmp_path / "run")) == repr(run)


@pytest.mark.long
def test_a_real_cell_is_asked_about_and_moves_only_when_allowed() -> None:
    plan = pp.load(DESK).plan("how heavy is the mug?")
    bench = Bench()
    with pytest.raises(pp.ExecutionAborted, match="nothing has moved"):
        plan.run(bench, confirm=lambda run: False)
    assert bench.arm.calls == []


@pytest.mark.long
def test_a_plan_for_a_real_cell_is_always_rehearsed() -> None:
    told: list[str] = []
    pp.load(DESK).plan("how heavy is the mug?").run(Bench(), progress=told.append, fast=True)
    assert told[0] == "rehearsing in simulation"
    assert "executing on the real robot" in told
    with pytest.raises(pp.InputError, match="rehearse=False"):
        pp.load(DESK).plan("how heavy is the mug?").run(Bench(), rehearse=False)


@pytest.mark.long
def test_measured_forces_are_in_the_trace() -> None:
    run = pp.load(DESK).plan("how heavy is the mug?").run(Bench(), fast=True)
    assert np.isclose(run.trace.wrench[:, 2].max(), MASS * 9.81)
