"""Clocks of logs: their units by name, by dates, by velocities and by motion."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from palpate.common.errors import InputError
from palpate.estimation.logs.reading import read_log
from palpate.trace.recording import ArmLog

N = 400
T = np.arange(N) * 2e-3
PHASE = np.arange(7)
Q = 0.4 * np.sin(2 * T[:, None] + PHASE)
DQ = 0.8 * np.cos(2 * T[:, None] + PHASE)
TAU = 10 * np.cos(T[:, None] + PHASE)
SINCE_1970 = 1.76e9


def read(tmp_path: Path, **columns: np.ndarray) -> ArmLog:
    np.savez(tmp_path / "log.npz", **columns)
    return read_log(tmp_path / "log.npz")


@pytest.mark.parametrize(
    ("name", "scale"),
    [
        ("t_ms", 1e3),
        ("time [ns]", 1e9),
        ("timestamp_us", 1e6),
        ("t[µs]", 1e6),
        ("Time (s)", 1.0),
        ("timeMs", 1e3),
        ("duration", 1.0),
        ("elapsed_seconds", 1.0),
        ("nanoseconds", 1e9),
        ("wall_time", 1.0),
    ],
)
def test_a_column_names_its_unit(tmp_path: Path, name: str, scale: float) -> None:
    """Of an arm at rest, nothing but the name shows the unit."""
    still = np.full((N, 7), 0.3) + 1e-5 * Q[:, ::-1]
    log = read(tmp_path, **{name: T * scale, "q": still, "tau": TAU})
    assert log.t[-1] == pytest.approx(T[-1])
    assert any(note.startswith("the clock counts") for note in log.notes) == (scale != 1.0)


@pytest.mark.parametrize("step", [0.3, 0.5, 1.0, 2.0, 30.0])
@pytest.mark.parametrize("moving", [True, False])
def test_static_logs_are_in_seconds(tmp_path: Path, step: float, moving: bool) -> None:
    random, rows = np.random.default_rng(0), 60
    poses = np.repeat(random.uniform(-1, 1, (12, 7)), 5, axis=0) * moving
    q = poses + 1e-4 * random.standard_normal((rows, 7))
    for columns in ({}, {"dq": 1e-3 * random.standard_normal((rows, 7))}):
        log = read(tmp_path, t=step * np.arange(rows), q=q, tau=TAU[:rows], **columns)
        assert log.t[-1] == pytest.approx(step * (rows - 1))
        assert not any("counts" in note for note in log.notes)


@pytest.mark.parametrize(("unit", "scale"), [("ms", 1e3), ("us", 1e6), ("ns", 1e9)])
@pytest.mark.parametrize("since", [0.0, SINCE_1970])
def test_motion_and_dates_show_the_unit(
    tmp_path: Path, unit: str, scale: float, since: float
) -> None:
    for columns in ({}, {"dq": DQ}):
        log = read(tmp_path, t=(since + T) * scale, q=Q, tau=TAU, **columns)
        assert log.t[-1] == pytest.approx(T[-1], abs=1e-4)
        assert f"the clock counts in {unit}" in log.notes
    still = np.full((N, 7), 0.3) + 1e-5 * np.random.default_rng(0).standard_normal((N, 7))
    log = read(tmp_path, t=(SINCE_1970 + T) * scale, q=still, tau=TAU)
    assert log.t[-1] == pytest.approx(T[-1], abs=1e-4)


def test_a_wrong_unit_in_a_name_is_refused(tmp_path: Path) -> None:
    with pytest.raises(
        InputError, match=r"named in ms, but the velocities fit one in s.*'time: s'"
    ):
        read(tmp_path, t_ms=T, q=Q, dq=DQ, tau=TAU)
    columns = tmp_path / "map.yaml"
    columns.write_text("time: s\n")
    assert read_log(tmp_path / "log.npz", columns).t[-1] == pytest.approx(T[-1])


def test_the_better_of_two_clocks_is_reported(tmp_path: Path) -> None:
    """As `rostopic echo -p` writes them, in ns; and a stamp of two columns."""
    stamps = {"%time": 1e9 * (SINCE_1970 + T) + 5e6, "field.header.stamp": 1e9 * (SINCE_1970 + T)}
    log = read(tmp_path, **stamps, **{"field.position": Q, "field.effort": TAU})
    assert "the clock is field.header.stamp, not %time" in log.notes
    parts = {"header.stamp.sec": np.floor(SINCE_1970 + T), "header.stamp.nanosec": 1e9 * (T % 1)}
    log = read(tmp_path, **parts, q=Q, dq=DQ, tau=TAU)
    assert log.t[-1] == pytest.approx(T[-1], abs=1e-6)
    assert log.notes == ()


def test_small_angles_in_degrees_are_known_by_their_name(tmp_path: Path) -> None:
    log = read(tmp_path, t=T, q_deg=np.degrees(Q) / 10, dq_deg=np.degrees(DQ) / 10, tau=TAU)
    np.testing.assert_allclose(log.q, Q / 10)
    assert "angles are in degrees" in log.notes
