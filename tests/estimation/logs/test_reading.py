"""Recordings in CSV and NPZ: columns by name, clocks, units, and what is wrong with a file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import palpate as pp
from palpate.common.errors import InputError
from palpate.estimation.logs.reading import read_log

N = 400
T = np.arange(N) * 1e-3 + 0.5
PHASE = np.arange(7)
Q = 0.4 * np.sin(2 * T[:, None] + PHASE)
DQ = 0.8 * np.cos(2 * T[:, None] + PHASE)
TAU = 10 * np.cos(T[:, None] + PHASE)


def csv(path: Path, names: list[str], *columns: np.ndarray, split: str = ",") -> Path:
    rows = np.column_stack(columns)
    np.savetxt(path, rows, delimiter=split, header=split.join(names), comments="", fmt="%.12g")
    return path


def numbered(form: str, first: int = 1) -> list[str]:
    return [form.format(i) for i in range(first, first + 7)]


@pytest.mark.parametrize(
    ("t", "q", "dq", "tau", "first"),
    [
        ("t", "q{}", "dq{}", "tau_J{}", 1),
        ("time", "q_{}", "dq_{}", "tau_{}", 0),
        ("timestamp", "state.q[{}]", "state.dq[{}]", "state.tau_J[{}]", 0),
        (
            "__time",
            "/joint_states/fr3_joint{}/position",
            "/joint_states/fr3_joint{}/velocity",
            "/joint_states/fr3_joint{}/effort",
            1,
        ),
    ],
)
def test_columns_are_recognised(
    tmp_path: Path, t: str, q: str, dq: str, tau: str, first: int
) -> None:
    commanded = numbered("state.q_d[{}]", 0) + numbered("cmd.tau_J_d[{}]", 0)
    names = [t, *commanded, *(n for form in (q, dq, tau) for n in numbered(form, first))]
    file = csv(tmp_path / "log.csv", names, T, 0 * Q, 0 * TAU, Q, DQ, TAU)
    log = read_log(file)
    np.testing.assert_allclose(log.t, T - T[0], atol=1e-9)
    for found, wanted in ((log.q, Q), (log.dq, DQ), (log.tau, TAU)):
        np.testing.assert_allclose(found, wanted, atol=1e-9)
    assert log.tau_ext is None
    assert log.notes == ()


def test_an_archive_of_arrays_is_read(tmp_path: Path) -> None:
    file = tmp_path / "log.npz"
    np.savez(file, time=T, position=Q, velocity=DQ, effort=TAU, tau_ext_hat_filtered=0 * TAU)
    log = read_log(file)
    np.testing.assert_array_equal(log.tau, TAU)
    np.testing.assert_array_equal(log.tau_ext, 0 * TAU)
    assert log.source == "log.npz"


def test_repeats_nanoseconds_degrees_and_missing_velocities(tmp_path: Path) -> None:
    rows = np.sort(np.concatenate([np.arange(N), np.arange(10, 50)]))
    file = tmp_path / "log.npz"
    stamps = (1.7e18 + 1e9 * (T[0] + 1e-3 * np.arange(len(rows)))).astype(np.int64)
    degrees = np.degrees(Q)[rows]
    np.savez(file, timestamp=stamps, q=degrees, tau=TAU[rows])
    log = read_log(file)
    assert len(log) == N
    assert "\n".join(log.notes) == (
        "the clock counts in ns\n40 rows (9.1 %) that repeat the one before them are left out\n"
        "angles are in degrees\njoint velocities are not logged: taken from the positions"
    )
    np.testing.assert_allclose(log.q, Q)
    np.testing.assert_allclose(log.dq[100:], DQ[100:], atol=2e-3)


def test_rows_out_of_order_and_without_a_number_are_left_out(tmp_path: Path) -> None:
    torques = TAU.copy()
    torques[7] = np.nan
    t = T.copy()
    t[20] = t[18]
    file = csv(
        tmp_path / "log.csv",
        ["t", *numbered("q{}"), *numbered("dq{}"), *numbered("tau{}")],
        t,
        Q,
        DQ,
        torques,
    )
    log = read_log(file)
    assert len(log) == N - 2
    assert (np.diff(log.t) > 0).all()
    assert [note.split(" (")[0] for note in log.notes] == ["1 rows", "1 rows"]


def test_a_map_states_columns(tmp_path: Path) -> None:
    file = tmp_path / "log.npz"
    np.savez(file, clock=T, state=np.hstack([Q, DQ]), u=TAU)
    with pytest.raises(InputError, match=r"no column for time \(t\) and joint positions \(q\)"):
        read_log(file)
    columns = tmp_path / "map.yaml"
    columns.write_text("t: clock\nq: state[0:7]\ndq: state[7:14]\ntau: u\n")
    np.testing.assert_array_equal(read_log(file, columns).dq, DQ)
    columns.write_text("t: clok\nq: state[0:7]\ntau: u\n")
    with pytest.raises(InputError, match=r"t: no column 'clok'; did you mean 'clock'\?"):
        read_log(file, columns)
    columns.write_text("position: q\n")
    with pytest.raises(InputError, match="unknown key 'position'; valid: angles"):
        read_log(file, columns)


def test_a_file_that_is_no_recording_is_refused(tmp_path: Path) -> None:
    pickled = tmp_path / "objects.npz"
    np.savez(pickled, q=np.array([{}], dtype=object))
    with pytest.raises(InputError, match="no NumPy archive of numbers"):
        read_log(pickled)
    (tmp_path / "log.xls").write_text("")
    with pytest.raises(InputError, match=r"unknown kind of recording '.xls'; valid: .csv"):
        read_log(tmp_path / "log.xls")
    nameless = csv(tmp_path / "nameless.csv", numbered("{}"), Q)
    with pytest.raises(InputError, match="first line must name the columns"):
        read_log(nameless)


NAMES = ["t", *(name for form in ("q{}", "dq{}", "tau{}") for name in numbered(form))]


def test_decimal_commas_of_a_spreadsheet_are_read(tmp_path: Path) -> None:
    file = csv(tmp_path / "log.csv", NAMES, T, Q, DQ, TAU, split=";")
    file.write_text(file.read_text().replace(".", ","))
    np.testing.assert_allclose(read_log(file).tau, TAU, atol=1e-9)


def test_a_line_that_is_cut_off_and_a_line_of_units(tmp_path: Path) -> None:
    file = csv(tmp_path / "log.csv", NAMES, T, Q, DQ, TAU)
    whole = file.read_text()
    file.write_text(whole[:-60])
    with pytest.raises(InputError, match=f"line {N + 1} of {N + 1} is cut off; remove or complete"):
        read_log(file)
    names, rows = whole.split("\n", 1)
    file.write_text(f"{names}\n{','.join(['s'] + ['rad'] * 14 + ['Nm'] * 7)}\n{rows}")
    with pytest.raises(InputError, match="second line holds no number; leave one line of names"):
        read_log(file)


def write_table(path: Path, columns: dict[str, np.ndarray]) -> Path:
    """Write columns as CSV, NPZ or Parquet, by the ending of the path."""
    if path.suffix == ".csv":
        return csv(path, [*columns], *columns.values())
    if path.suffix == ".npz":
        np.savez(path, **columns)
        return path
    pyarrow = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    parquet.write_table(pyarrow.table(columns), path)
    return path


def scalar_columns() -> dict[str, np.ndarray]:
    values = np.column_stack([T, Q, DQ, TAU]).T
    return dict(zip(NAMES, values, strict=True))


FORMATS = pytest.mark.parametrize("ending", ["csv", "npz", "parquet"])


@FORMATS
@pytest.mark.parametrize("name", ["q3", "tau7", "t", "dq1"])
def test_a_column_without_numbers_is_named(tmp_path: Path, ending: str, name: str) -> None:
    columns = scalar_columns() | {name: np.full(N, np.nan)}
    file = write_table(tmp_path / f"log.{ending}", columns)
    with pytest.raises(
        InputError, match=f"column '{name}' .* has no numbers in most rows: mend it"
    ):
        read_log(file)


@FORMATS
def test_a_second_column_of_one_name_is_refused(tmp_path: Path, ending: str) -> None:
    """pandas writes it with a number behind a dot."""
    file = write_table(tmp_path / f"log.{ending}", scalar_columns() | {"q1.1": Q[:, 1]})
    with pytest.raises(InputError, match=r"columns with one name: q1 \(q1\.1\)"):
        read_log(file)
    # Numbers behind a dot alone are the joints.
    dotted = {name.replace("tau", "tau."): part for name, part in scalar_columns().items()}
    np.testing.assert_allclose(read_log(write_table(tmp_path / f"b.{ending}", dotted)).tau, TAU)


@pytest.mark.parametrize("t", [T[:, None], T[None], T])
def test_a_clock_of_one_column_or_row_is_read(tmp_path: Path, t: np.ndarray) -> None:
    file = tmp_path / "log.npz"
    np.savez(file, t=t, q=Q, dq=DQ, tau=TAU)
    np.testing.assert_allclose(read_log(file).t, T - T[0])


@pytest.mark.parametrize("given", [None, 3, "", {"q": "position"}])
def test_a_path_that_names_no_file_gets_one_clear_error(tmp_path: Path, given: Any) -> None:
    for function in (pp.estimate, pp.dynamics, pp.noise):
        with pytest.raises(InputError, match=r"log=.*: give the path of a file"):
            function(given)
        if given is not None:
            with pytest.raises(InputError, match=r"columns=.*: give the path of a file"):
                function(tmp_path / "log.csv", columns=given)
