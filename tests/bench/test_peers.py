"""Published estimators of a load and palpate's, on recordings whose load is known."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from bench.peers.baselines import BASELINES
from bench.peers.recordings import Case, LoadedLog, drawn_load, recorded
from bench.peers.study import PALPATE, Row, judge_peer, study, summary

EXACT = Case("none", 3, 1.0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("recordings")


@pytest.fixture(scope="module")
def exact(folder: Path) -> LoadedLog:
    return recorded(EXACT, folder)


@pytest.mark.parametrize("name", list(BASELINES))
def test_an_exact_arm_shows_its_load(exact: LoadedLog, name: str) -> None:
    row = judge_peer(EXACT, exact, name)
    assert abs(row.errors["mass"][0]) < 1e-3
    assert max(np.abs(row.errors["com"])) < 1e-3
    assert max(np.abs(row.errors["inertia"])) < 1e-3


def test_a_recording_is_read_again(exact: LoadedLog, folder: Path) -> None:
    again = recorded(EXACT, folder)
    assert np.array_equal(exact.log.tau, again.log.tau)
    assert again.load.com == pytest.approx(drawn_load(EXACT).com)
    assert again.window == exact.window


def test_a_study_has_a_row_a_method_and_a_line_a_load(
    exact: LoadedLog, folder: Path, tmp_path: Path
) -> None:
    out = tmp_path / "rows.jsonl"
    rows = list(study([EXACT], folder, out))
    assert [row.method for row in rows] == [PALPATE, *BASELINES]
    assert [Row(**json.loads(line)) for line in out.read_text().splitlines()] == rows
    (mine,) = [
        line
        for line in summary(rows)
        if (line.quantity, line.method, line.load) == ("mass", PALPATE, "1 kg")
    ]
    assert mine.rms == pytest.approx(abs(rows[0].errors["mass"][0]))
    assert mine.z == pytest.approx(mine.rms / mine.stated)
