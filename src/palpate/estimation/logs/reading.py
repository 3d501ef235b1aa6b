"""Reading of arm recordings in their logged formats."""

from __future__ import annotations

import csv
import re
import zipfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from palpate.common.errors import InputError
from palpate.common.files import open_with_limit, path_of, read_text
from palpate.estimation.logs.columns import (
    ANGLES,
    JOINTS,
    UNITS,
    ColumnMap,
    Table,
    any_arm,
    clean_signals,
    find_arm,
    read_map,
    unit_in,
)
from palpate.estimation.logs.formats import OF_JOINTS, OF_SENSORS, STORED, read_bag, read_parquet
from palpate.estimation.logs.wrench_log import WrenchLog, find_wrench, has_wrench
from palpate.robots.description import RobotDescription
from palpate.trace.recording import ArmLog

MAX_BYTES = 1_000_000_000
MAX_TEXT = 500_000_000
MAX_ROWS = 4_000_000
"""About an hour at 1 kHz."""
MAX_COLUMNS = 2_000


def log_of(log: str | Path | ArmLog, columns: str | Path | None = None) -> ArmLog:
    """Return a recording unchanged, or read the one at a path (`read_log`)."""
    if isinstance(log, ArmLog):
        return log
    names = None if columns is None else path_of(columns, "columns")
    return read_log(path_of(log, "log"), names)


def read_log(path: Path, columns: Path | None = None) -> ArmLog:
    """Read the joint signals of an arm from a recording.

    The log's `notes` state omitted topics, joints and rows, and inferred units, stamps or velocities.

    Args:
        path: CSV (.csv, .tsv, .txt), .npz, .mcap, .parquet, a folder or database of rosbag2, or a .bag.
        columns: YAML that maps columns to signals (`ColumnMap`) and names the arm; the rest is inferred.

    Raises:
        InputError: The file is of another kind, too large, without time, positions or torques, or of several arms.
        Unavailable: The library for its format is not installed.
    """
    mapped = read_map(columns)
    tables, notes = _read_tables(path, mapped)
    return _arm_log(path, mapped, tables, notes)


def read_recording(
    path: Path, columns: Path | None = None, arm: RobotDescription | None = None
) -> ArmLog | WrenchLog:
    """Read a recording of an arm's joints, or else of a six-axis sensor with its pose.

    Args:
        path: as for `read_log`.
        columns: YAML that maps columns to signals; with `wrench` that sensor is read, also beside joint torques.
        arm: whose TCP is the sensor, where the log has joint angles and no pose of it.

    Raises:
        InputError: as `read_log`; or the sensor has no pose, or is saturated.
        Unavailable: The library for its format is not installed.
    """
    mapped = read_map(columns)
    tables, notes = _read_tables(path, mapped, OF_SENSORS)
    # Joint torques come first where the map does not state a wrench.
    is_arm = mapped.wrench is None and any_arm(tables, mapped)
    wrench = None if is_arm else find_wrench(tables, mapped, str(path), arm)
    if wrench is not None:
        return replace(wrench, notes=(*notes, *wrench.notes), source=path.name)
    if is_arm and has_wrench(tables):
        notes.append("its wrench is not read: state it in a file with 'wrench: NAME' to use it")
    return _arm_log(path, mapped, tables, notes)


def require_joint_torques(arm: RobotDescription) -> None:
    """Require an arm whose recordings of joint torques can be read.

    Raises InputError: another number of joints than seven.
    """
    if len(arm.joints) != JOINTS:
        raise InputError(
            f"the arm '{arm.name}' has {len(arm.joints)} joints, and joint torques are read of arms with "
            f"{JOINTS}: give a recording with the wrench and the pose of its sensor, or the arm that "
            "made this one"
        )


def _is_bag(path: Path) -> bool:
    """Return true for a bag, or a folder of rosbag2."""
    return path.is_dir() or path.name.lower().endswith((*STORED, ".bag"))


def _read_tables(
    path: Path, mapped: ColumnMap, likely: re.Pattern[str] = OF_JOINTS
) -> tuple[list[tuple[str, Table]], list[str]]:
    """Read the tables of a recording, each with its topic, and notes on messages that cannot be decoded.

    `likely` are the topics and types of a bag that are read.
    """
    # Choose the reader by the kind of the path.
    reader, notes = READERS.get(path.suffix.lower()), list[str]()
    if path.is_dir() and not any(file for kind in STORED for file in path.glob(f"*{kind}")):
        raise InputError(
            f"{path}: neither a run folder nor one of rosbag2, which holds {', '.join(STORED)}"
        )
    if _is_bag(path):
        tables, notes = read_bag(path, mapped, likely)
    elif reader is not None:
        tables = [("", reader(path, mapped))]
    else:
        kinds = ", ".join((*READERS, ".bag", *STORED))
        raise InputError(
            f"{path}: unknown kind of recording '{path.suffix}'; valid: {kinds}, and a folder of rosbag2"
        )
    for _, table in tables:
        _check_size(table, path)
    return tables, notes


def _arm_log(
    path: Path, mapped: ColumnMap, tables: list[tuple[str, Table]], notes: Sequence[str]
) -> ArmLog:
    """Find the arm's columns, and repair clock and units."""
    arm = find_arm(tables, mapped, str(path))
    unit = unit_in(arm.columns["t"][0].name, UNITS)
    angles = unit_in(arm.columns["q"][0].name, ANGLES)
    found, repairs = clean_signals(arm.signals, mapped, str(path), unit, angles)
    return ArmLog(
        found["t"],
        found["q"],
        found["dq"],
        found["tau"],
        found.get("tau_ext"),
        path.name,
        (*notes, *arm.notes, *repairs),
    )


def read_csv(path: Path, columns: ColumnMap) -> Table:
    """Read the numeric columns of a text table whose first line names them."""
    text = read_text(path, MAX_TEXT, "a recording of an arm")
    lines = text.splitlines()
    if len(lines) < 3:
        raise InputError(f"{path} has {len(lines)} lines; give a line of names and a row a sample")
    # Separator and column names of the first line.
    try:
        dialect = csv.Sniffer().sniff(lines[0], ",;\t ")
        split = dialect.delimiter
    except csv.Error:
        split = ","
    names = [name.strip().strip("\"'") for name in lines[0].lstrip("#% ").split(split)]
    if all(_is_number(name) for name in names):
        raise InputError(
            f"{path}: its first line must name the columns, as in t,q1,…,q7,tau1,…,tau7"
        )
    if len(set(names)) < len(names):
        twice = sorted({name for name in names if names.count(name) > 1})
        raise InputError(f"{path}: columns with one name: {', '.join(twice[:10])}")
    if len(names) > MAX_COLUMNS:
        raise InputError(f"{path} has {len(names)} columns, at most {MAX_COLUMNS} are read")
    # Decimal commas, and the columns that contain numbers.
    if split != "," and "," in lines[1] and "." not in lines[1]:
        lines[1:] = [line.replace(",", ".") for line in lines[1:]]  # decimal commas
    first = lines[1].split(split)
    used = [i for i, cell in enumerate(first[: len(names)]) if not cell.strip() or _is_number(cell)]
    if not used:
        raise InputError(
            f"{path}: its second line holds no number; leave one line of names, without one of units"
        )
    # Parse all rows; on failure, report a truncated line if there is one.
    try:
        rows = np.loadtxt(
            lines[1 : MAX_ROWS + 2],
            delimiter=None if split == " " else split,
            usecols=used,
            ndmin=2,
            converters=None if _complete(lines, split) else _number,
        )
    except ValueError as error:
        cells = lines[1].count(split)
        for number, line in enumerate(lines[2:], 3):
            if split != " " and line.count(split) < cells:
                raise InputError(
                    f"{path}: line {number} of {len(lines)} is cut off; remove or complete it"
                ) from None
        raise InputError(f"{path}: {str(error).splitlines()[0]}") from None
    return {names[i]: rows[:, k] for k, i in enumerate(used)}


def read_npz(path: Path, columns: ColumnMap) -> Table:
    """Read the numeric arrays, (n,) or (n, k), of a NumPy archive; objects (pickles) are refused."""
    try:
        with (
            open_with_limit(path, MAX_BYTES, "a recording of an arm") as file,
            zipfile.ZipFile(file) as archive,
        ):
            # Bound the unpacked size before anything is read.
            if sum(member.file_size for member in archive.infolist()) > MAX_BYTES:
                raise InputError(f"{path} unpacks to more than {MAX_BYTES // 10**6} MB")
            file.seek(0)
            data = np.load(file, allow_pickle=False)
            found = {name: np.asarray(data[name]) for name in data.files}
    except (zipfile.BadZipFile, ValueError, EOFError) as error:
        raise InputError(f"{path} is no NumPy archive of numbers: {error}") from None
    # Keep numeric arrays of one or two dimensions.
    return {
        name: values.astype(float)
        for name, values in found.items()
        if values.dtype.kind in "fiu" and values.ndim in (1, 2)
    }


READERS = {
    ".csv": read_csv,
    ".tsv": read_csv,
    ".txt": read_csv,
    ".npz": read_npz,
    ".parquet": read_parquet,
}


def _check_size(table: Table, path: Path) -> None:
    """Check the size of a table. Raises InputError: there is no column, or there are too many rows."""
    if not table:
        raise InputError(f"{path} holds no numbers")
    rows = {name: len(values) for name, values in table.items()}
    if max(rows.values()) > MAX_ROWS:
        raise InputError(
            f"{path} has {max(rows.values())} rows, at most {MAX_ROWS} are read; cut it"
        )


def _complete(lines: list[str], split: str) -> bool:
    """True if no line has an empty cell."""
    return split == " " or not any(
        f"{split}{split}" in line or line.endswith(split) for line in lines
    )


def _number(cell: str) -> float:
    return float(cell) if cell.strip() else float("nan")


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
