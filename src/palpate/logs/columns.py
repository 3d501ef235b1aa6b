"""Columns of a log, by name, and the joint signals that their names stand for.

Names differ between loggers: `q0 … q6` (franky), `state.tau_J[3]` (libfranka), `fr3_joint1/position`
(joint_states of ROS). A name is split into words and one index; words that say nothing about the kind of
signal (`state`, `measured`, `panda`) are left out, and what remains is looked up in `ALIASES`. A map in YAML
states the columns where that fails.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import ValidationError

from palpate.errors import InputError, perhaps
from palpate.files.plain_yaml import Section, plain_yaml, worded
from palpate.files.read import read_text
from palpate.geometry.pose import Array

JOINTS = 7
Table = Mapping[str, Array]
"""Columns of a log by name: (n,), or (n, k) where the format has columns of several numbers."""

ALIASES = {
    "t": "t time timestamp stamp secs seconds nanoseconds header_stamp",
    "q": "q position positions pos angle angles theta qpos",
    "dq": "dq velocity velocities vel speed speeds qdot qvel",
    "tau": "tau tau_j effort efforts torque torques tau_measured",
    "tau_ext": "tau_ext tau_ext_hat tau_ext_hat_filtered tau_ext_hat_filtered_effort external_torque "
    "external_torques",
}
"""Names of columns without their joint's number, by signal; tau is libfranka's tau_J, with gravity in it."""
KNOWN = {alias: signal for signal, aliases in ALIASES.items() for alias in aliases.split()}
_PLAIN = (
    "joint joints state states robot measured actual msg panda franka fer arm observation data log"
)
_UNITS = "rad m nm s ms us ns"
MEANINGLESS = {*_PLAIN.split(), *_UNITS.split()}


class ColumnMap(Section):
    """Columns that hold each signal: a name, the common part of seven numbered names, a slice of a wide column
    (`observation.state[0:7]`), or a list of seven names. What is left out is guessed."""

    t: str | None = None
    q: str | list[str] | None = None
    dq: str | list[str] | None = None
    tau: str | list[str] | None = None
    tau_ext: str | list[str] | None = None
    topic: str | None = None
    """Of a bag: the topic with the joint signals."""
    episode: int | None = None
    """Of a LeRobot data set: `episode_index`."""
    angles: Literal["rad", "deg"] | None = None
    time: Literal["s", "ms", "us", "ns"] | None = None


def read_map(path: Path | None) -> ColumnMap:
    """Read a column map; without a file all columns are guessed.

    Raises:
        InputError: not readable, or not of the form of `ColumnMap`.
    """
    if path is None:
        return ColumnMap()
    content = plain_yaml(read_text(path, 100_000, "a map of columns"), str(path))
    try:
        return ColumnMap.model_validate(content)
    except ValidationError as error:
        raise InputError(f"{path}: {worded(error, ColumnMap)}") from None


def signals(table: Table, columns: ColumnMap, source: str) -> dict[str, Array]:
    """Find the signals in a table: `t` (n,), the others (n, 7).

    Raises:
        InputError: t, q or tau is missing, or a mapped column is.
    """
    found = guessed(table)
    for signal in ALIASES:
        stated = getattr(columns, signal)
        if stated is not None:
            found[signal] = _stated(table, signal, stated, source)
    missing = [signal for signal in ("t", "q", "tau") if signal not in found]
    if missing:
        meant = {"t": "time", "q": "joint positions", "tau": "joint torques with gravity"}
        names = " and ".join(f"{meant[signal]} ({signal})" for signal in missing)
        lines = "; ".join(f"{signal}: COLUMN" for signal in missing)
        raise InputError(
            f"{source}: no column for {names}. Columns: {listed(table)}. State them in a file with "
            f"'{lines}', and give it as columns=MAP.yaml"
        )
    rows = {signal: len(values) for signal, values in found.items()}
    if len(set(rows.values())) > 1:
        raise InputError(f"{source}: columns of unequal length: {rows}")
    return found


def guessed(table: Table) -> dict[str, Array]:
    """Recognise signals by the names of their columns."""
    found: dict[str, Array] = {}
    # A ROS stamp in two columns.
    ends = {name.rpartition(".")[2]: values for name, values in table.items()}
    if {"sec", "nanosec"} <= set(ends):
        found["t"] = ends["sec"] + 1e-9 * ends["nanosec"]
    numbered: dict[tuple[str, str], dict[int, Array]] = {}
    for name, values in table.items():
        words, index = split(name)
        signal = KNOWN.get(words)
        if signal == "t" and index is None and values.ndim == 1:
            found.setdefault("t", values)
        elif signal not in (None, "t") and index is None and wide(values):
            found.setdefault(signal, values[:, :JOINTS])
        elif signal not in (None, "t") and index is not None and values.ndim == 1:
            numbered.setdefault((signal, words), {}).setdefault(index, values)
    for (signal, _), parts in numbered.items():
        joints = sorted(parts)[:JOINTS]  # from 0 or 1 on; fingers come behind
        if joints in (list(range(JOINTS)), list(range(1, JOINTS + 1))):
            found.setdefault(signal, np.column_stack([parts[joint] for joint in joints]))
    return found


def split(name: str) -> tuple[str, int | None]:
    """Words of a column's name, joined by `_`, and the number of its joint: `state.tau_J[3]` → tau_j, 3."""
    text = re.sub(r"(?i)\b(fr3|iiwa\d*)", "", name.replace("_", " "))
    numbers = re.findall(r"\d+", text)
    words = [w for w in re.split(r"[^a-z]+", text.lower()) if w and w not in MEANINGLESS]
    return "_".join(words), int(numbers[-1]) if numbers else None


def wide(values: Array) -> bool:
    """A column has a number for each joint."""
    return values.ndim == 2 and values.shape[1] >= JOINTS


def _stated(table: Table, signal: str, stated: str | list[str], source: str) -> Array:
    if isinstance(stated, list):
        if len(stated) != JOINTS:
            raise InputError(f"{source}: {signal}: a list of {JOINTS} columns, not {len(stated)}")
        return np.column_stack([_column(table, signal, name, source) for name in stated])
    sliced = re.fullmatch(r"(.+)\[(\d+):(\d+)\]", stated)
    if sliced is not None and sliced[1] in table:
        values = table[sliced[1]]
        part = values[:, int(sliced[2]) : int(sliced[3])] if values.ndim == 2 else values[:, None]
        if part.shape[1] != JOINTS:
            raise InputError(f"{source}: {signal}: {stated} has {part.shape[1]} numbers, not 7")
        return part
    if signal == "t" or stated in table:
        values = _column(table, signal, stated, source)
        if signal != "t" and not wide(values):
            raise InputError(f"{source}: {signal}: column {stated} has not {JOINTS} numbers")
        return values if signal == "t" else values[:, :JOINTS]
    parts = {index: name for name in table for stem, index in [_stem(name)] if stem == stated}
    joints = sorted(parts)[:JOINTS]
    if len(joints) < JOINTS or joints[-1] - joints[0] != JOINTS - 1:
        raise _unknown(table, signal, stated, source)
    return np.column_stack([table[parts[joint]] for joint in joints])


def _stem(name: str) -> tuple[str, int]:
    """`state.q[3]` → state.q, 3; a name without a number at its end has -1."""
    parts = re.fullmatch(r"(.*?)[\[_./ ]*(\d+)\]?", name)
    return (parts[1], int(parts[2])) if parts else (name, -1)


def _column(table: Table, signal: str, name: str, source: str) -> Array:
    if name not in table:
        raise _unknown(table, signal, name, source)
    return table[name]


def _unknown(table: Table, signal: str, name: str, source: str) -> InputError:
    return InputError(
        f"{source}: {signal}: no column '{name[:80]}';{perhaps(name, table)} columns: {listed(table)}"
    )


def listed(names: Iterable[str]) -> str:
    """At most forty names, for a message."""
    every = [name[:60] for name in names]
    more = f" and {len(every) - 40} more" if len(every) > 40 else ""
    return ", ".join(every[:40]) + more
