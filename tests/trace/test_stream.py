"""A trace that is written while it grows is read again as far as it goes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from palpate.errors import InputError
from palpate.trace.mcap import read_mcap, write_mcap
from palpate.trace.samples import Trace
from palpate.trace.stream import TraceStream


def written(path: Path, trace: Trace, *, ends: bool = True) -> None:
    """Tick by tick, as a runner hands it over."""
    stream = TraceStream(path, trace.hand, trace.gravity)
    recorded: Any = SimpleNamespace(leaves=[], recordings=[], conversions=[])
    for start in range(0, len(trace.samples), 4):
        samples = trace.samples.where(slice(start, start + 4))
        now = float(samples.t[-1])
        recorded.leaves[:] = [leaf for leaf in trace.leaves if leaf.end <= now]
        recorded.recordings[:] = [r for r in trace.recordings if r.end <= now]
        recorded.conversions[:] = [c for c in trace.conversions if c.time <= now]
        stream.write(samples, recorded)
    if ends:
        stream.close()


def test_all_of_it_is_read_again(trace: Trace, tmp_path: Path) -> None:
    path = tmp_path / "trace.mcap"
    written(path, trace)
    found = read_mcap(path)
    np.testing.assert_array_equal(found.samples.wrench, trace.samples.wrench)
    np.testing.assert_array_equal(found.samples.width, trace.samples.width)
    assert found.recordings == trace.recordings
    assert found.conversions == trace.conversions
    assert found.hand == trace.hand
    assert len(found.leaves) == sum(leaf.end <= trace.t[-1] for leaf in trace.leaves)


def test_a_process_that_is_killed_takes_a_quarter_of_a_second_with_it(
    trace: Trace, tmp_path: Path
) -> None:
    path = tmp_path / "trace.mcap"
    written(path, trace, ends=False)
    assert read_mcap(path).t[-1] > trace.t[-1] - 0.3


@pytest.mark.parametrize("share", [0.02, 0.3, 0.7, 0.99])
def test_cut_off_anywhere_it_is_read_up_to_there(
    share: float, trace: Trace, tmp_path: Path
) -> None:
    path = tmp_path / "trace.mcap"
    written(path, trace)
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    found = read_mcap(path)
    assert len(found.samples) > (share - 0.1) * len(trace.samples)
    np.testing.assert_array_equal(found.t, trace.t[: len(found.t)])


def test_no_key_is_in_the_file_of_a_run_under_way(
    trace: Trace, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ACME_API_KEY", "ak-31415926535897932384")
    path = tmp_path / "trace.mcap"
    telling = replace(
        trace.leaves[0], label="with ak-31415926535897932384", message="ak-3141592653"
    )
    written(path, replace(trace, leaves=(telling,)), ends=False)
    assert b"ak-31415926" not in path.read_bytes()
    assert read_mcap(path).leaves == (replace(telling, label="with [key]", message="[key]"),)


def test_the_finished_file_takes_its_place(trace: Trace, tmp_path: Path) -> None:
    path = tmp_path / "trace.mcap"
    written(path, trace)
    write_mcap(path, trace)
    assert read_mcap(path).leaves == trace.leaves


def test_no_number_is_written_and_read_as_such(trace: Trace, tmp_path: Path) -> None:
    path = tmp_path / "trace.mcap"
    faulty = replace(trace.leaves[0], end=float("nan"))
    readings = (replace(trace.recordings[0], reading=(float("nan"),)),)
    samples = replace(trace.samples, t=np.where(trace.t > 30.0, np.nan, trace.t))
    write_mcap(path, replace(trace, samples=samples, leaves=(faulty,), recordings=readings))
    found = read_mcap(path)
    assert np.isnan(found.leaves[0].end)
    assert np.isnan(found.recordings[0].reading[0])
    assert np.isnan(found.t).sum() == np.isnan(samples.t).sum()


def test_a_time_that_is_no_number_is_no_reason_to_wait(trace: Trace, tmp_path: Path) -> None:
    path = tmp_path / "trace.mcap"
    lost = replace(trace.samples, t=np.full(len(trace.t), np.nan))
    written(path, replace(trace, samples=lost), ends=False)
    assert len(read_mcap(path).samples) == len(lost)


def test_an_empty_beginning_is_refused(tmp_path: Path, trace: Trace) -> None:
    path = tmp_path / "trace.mcap"
    written(path, trace)
    path.write_bytes(path.read_bytes()[:40])
    with pytest.raises(InputError, match="not a trace"):
        read_mcap(path)
