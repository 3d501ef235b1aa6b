"""Wrench and pose of a six-axis sensor in a recording by another program."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.common.errors import InputError
from palpate.common.pose import Array, Pose, rotations
from palpate.estimation.logs.columns import (
    ANGLES,
    LARGEST_ANGLE,
    NOT_MEASURED,
    SECONDS,
    STEPS,
    UNITS,
    Angle,
    ColumnMap,
    Table,
    Unit,
    find_clock,
    find_joints,
    flat_columns,
    list_names,
    mapped_columns,
    unit_in,
    words_of,
)
from palpate.estimation.motion import runs
from palpate.robots.description import RobotDescription
from palpate.robots.nominal import NominalArm

WRENCHES = {"wrench", "ft", "fts", "netft", "force", "forces"}
"""Words before the numbers 0 to 5 of a wrench's columns."""
FORCE_WORDS = {"f", "force", "forces"}
TORQUE_WORDS = {"t", "m", "torque", "torques", "moment", "moments"}
TURN_WORDS = {"orientation", "quaternion", "quat", "rotation", "rot", "q"}
PLACE_WORDS = {"position", "translation", "pos", "p"}
UNIT_WORDS = {"n", "nm", "m", "rad", "deg", "degrees", "value", "data"}
NOT_SENSED = NOT_MEASURED - {"tcp", "ee", "eef", "effector", "cartesian"}
"""Words of columns that no sensor measured."""
LETTERS = "xyz"
ROLL = ("roll", "pitch", "yaw")
STUCK_ROWS = 10
"""Rows that stay at the extreme value of a column, from which it is saturated."""
STUCK_TIMES = 3
"""Times the longest run of equal values elsewhere in the column, likewise."""
LATEST = 0.1
"""s. Longest time between a wrench and a pose that belong together."""
SINGLE_POSES = 0.9999
"""Cosine of half the angle, median from row to row, below which rows are single poses: 1.6°."""
PERIOD = 0.005
"""s. Faster recordings are averaged over it."""


@dataclass(frozen=True, slots=True, eq=False)
class WrenchLog:
    """Wrench of a six-axis sensor, and pose of the sensor, at n times.

    The wrench is what the sensor exerts on everything below it, in the sensor's axes about its origin, N and N m.
    """

    t: Array  # (n,) s, increasing
    wrench: Array  # (n, 6)
    pose: Array  # (n, 7) position, m, and quaternion wxyz in a frame whose z axis points up
    has_positions: bool  # False: the positions are zero, as none were logged
    label: str  # columns of the wrench
    gain: float  # relative error (1 sigma) of the sensor's sensitivity
    source: str  # name of the file, for messages
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.t)


class VectorComponent(NamedTuple):
    """Component of a vector: words of its name without the component, kind of vector, and its place."""

    stem: tuple[str, ...]
    kind: str  # wrench, quat, pos, rotvec, rpy, or `#WORD` of a column with a number
    place: int


class VectorColumns(NamedTuple):
    """Columns of one vector in a table."""

    table: int
    stem: tuple[str, ...]
    columns: Sequence[str]
    label: str
    values: Array  # (n, k)


def find_wrench(
    tables: Sequence[tuple[str, Table]],
    columns: ColumnMap,
    source: str,
    arm: RobotDescription | None = None,
) -> WrenchLog | None:
    """Find wrench and pose of a sensor in the tables of a log; None without a wrench.

    Without columns of a pose it is that of the TCP of `arm`, by the joint angles.
    Raises InputError: several wrenches or poses, none of a pose, a saturated or dead sensor, or invalid columns.
    """
    flat = [flat_columns(table) for _, table in tables]
    groups = [*_groups(tables, flat)]
    wrench = _choose("wrench", columns.wrench, _wrenches(groups), flat, tables, source)
    if wrench is None:
        return None
    posed = _choose("pose", columns.pose, _poses(groups, columns), flat, tables, source)
    if posed is None and arm is not None:
        posed = next(_poses_of_joints(flat, columns, arm), None)
    if posed is None:
        names = list_names(name for table in flat for name in table)
        raise InputError(
            f"{source}: the wrench {wrench.label} has no orientation beside it. Log the sensor's quaternion (qw qx qy "
            f"qz), rotation vector (rx ry rz), pose, or seven joint angles, and state its columns as 'pose: NAME' or "
            f"'q: NAME'. Columns: {names}"
        )
    notes: list[str] = [f"the wrench is {wrench.label}, the pose {posed.label}"]
    # Neighbouring rows turned far apart are single poses, some seconds after each other.
    turned = posed.values[:, -4:]
    are_single = float(np.median(np.abs((turned[1:] * turned[:-1]).sum(axis=1)))) < SINGLE_POSES
    t, unit = _clock(flat[wrench.table], columns, source, are_single)
    values, pose = wrench.values, posed.values
    # Poses at the times of the wrench, where they have a clock of their own.
    if posed.table != wrench.table:
        other, _ = _clock(flat[posed.table], columns, source)
        values, t, pose = _at_common_times(t, values, other, pose, source)
    kept = np.isfinite(np.column_stack([t, values, pose])).all(axis=1)
    kept &= np.concatenate([[True], t[1:] > np.maximum.accumulate(t)[:-1]])
    if kept.sum() < max(2, len(t) / 2):
        raise InputError(
            f"{source}: most rows lack a number or go back in time; mend the recording"
        )
    if not kept.all():
        notes.append(f"{int((~kept).sum())} rows without a number or out of order are left out")
    if unit != "s":
        notes.append(f"the clock counts in {unit}")
    t, values, pose = t[kept] - t[kept][0], values[kept], pose[kept]
    _require_alive(values, wrench, source)
    pose, has_positions = _full_poses(pose, posed, source)
    if "tcp" in wrench.stem and "raw" not in wrench.stem:
        notes.append("its controller may have subtracted a payload: record with a payload of 0")
    log = WrenchLog(
        t, values, pose, has_positions, wrench.label, columns.gain, source, tuple(notes)
    )
    return _averaged(_in_sensor(log, columns))


def has_wrench(tables: Sequence[tuple[str, Table]]) -> bool:
    """Return true if a table has six columns of one wrench."""
    return any(_wrenches([*_groups(tables, [flat_columns(table) for _, table in tables])]))


def _part(name: str) -> VectorComponent | None:
    """Split a column's name into vector and component; None for other columns."""
    words = words_of(name)
    while len(words) > 1 and words[-1] in UNIT_WORDS:
        words.pop()
    if not words or NOT_SENSED & {*words}:
        return None
    *stem, last = words
    before = stem[-1] if stem else ""
    # Components by letter: `fx`, `force.x`, `orientation.w`, `rx`.
    if re.fullmatch("[ftm][xyz]", last):
        return VectorComponent(tuple(stem), "wrench", LETTERS.index(last[1]) + 3 * (last[0] != "f"))
    if re.fullmatch("q[wxyz]", last):
        return VectorComponent(tuple(stem), "quat", "wxyz".index(last[1]))
    if last in ROLL:
        return VectorComponent(tuple(stem), "rpy", ROLL.index(last))
    if re.fullmatch("r[xyz]", last):
        return VectorComponent(tuple(stem), "rotvec", LETTERS.index(last[1]))
    if last in LETTERS and before in FORCE_WORDS | TORQUE_WORDS:
        return VectorComponent(
            tuple(stem[:-1]), "wrench", LETTERS.index(last) + 3 * (before in TORQUE_WORDS)
        )
    if last in "wxyz" and before in TURN_WORDS:
        return VectorComponent(tuple(stem[:-1]), "quat", "wxyz".index(last))
    if last in LETTERS:
        return VectorComponent(
            tuple(stem[:-1] if before in PLACE_WORDS else stem), "pos", LETTERS.index(last)
        )
    # Components by number: `ft[3]`, `actual_TCP_force_0`.
    number = re.fullmatch(r"([a-z]*)_?(\d+)", last)
    if number is None:
        return None
    word = number[1] or before
    rest = stem if number[1] else stem[:-1]
    return VectorComponent(tuple(rest), f"#{word}", int(number[2])) if word else None


def _groups(
    tables: Sequence[tuple[str, Table]], flat: Sequence[Table]
) -> Iterator[tuple[str, VectorColumns]]:
    """Yield the vectors of all tables with their kinds; components in order, numbers from 0 or 1 on."""
    for place, (topic, _) in enumerate(tables):
        found: dict[tuple[tuple[str, ...], str], dict[int, str]] = {}
        for name in flat[place]:
            part = _part(name)
            if part is not None:
                found.setdefault((part.stem, part.kind), {}).setdefault(part.place, name)
        for (stem, kind), parts in found.items():
            order = sorted(parts)
            if order not in ([*range(len(order))], [*range(1, len(order) + 1)]):
                continue
            names = [parts[index] for index in order]
            values = np.column_stack([flat[place][name] for name in names])
            label = " ".join(filter(None, [topic, f"{names[0]} … {names[-1]}"]))
            yield kind, VectorColumns(place, (*words_of(topic), *stem), names, label, values)


def _wrenches(groups: Sequence[tuple[str, VectorColumns]]) -> list[VectorColumns]:
    """Select the vectors that are wrenches."""
    return [
        group
        for kind, group in groups
        if group.values.shape[1] == 6 and (kind == "wrench" or kind[1:] in WRENCHES)
    ]


def _poses(groups: Sequence[tuple[str, VectorColumns]], columns: ColumnMap) -> list[VectorColumns]:
    """Select and complete the vectors that are orientations: (n, 4) wxyz or (n, 7) with a position."""
    places = {
        (g.table, g.stem): g for kind, g in groups if kind == "pos" and g.values.shape[1] == 3
    }
    found: list[VectorColumns] = []
    for kind, group in groups:
        values, size = group.values, group.values.shape[1]
        at = places.get((group.table, group.stem))
        if kind == "#pose" and size == 6:
            turned = np.column_stack([values[:, :3], _of_vectors(values[:, 3:])])
        elif kind == "#pose" and size == 7:
            turned = np.column_stack([values[:, :3], _ordered(values[:, 3:], columns)])
        elif kind == "#ee" and size == 16:
            turned = _of_matrices(values)
        elif kind == "quat" and size == 4:
            turned = values
        elif kind[1:] in TURN_WORDS - {"q"} and size == 4:
            turned = _ordered(values, columns)
        elif kind == "rotvec" and size == 3:
            turned = _of_vectors(values)
        elif kind == "rpy" and size == 3:
            turned = _of_angles(values, columns.angles or unit_in(group.columns[0], ANGLES))
        else:
            continue
        if turned.shape[1] == 4 and at is not None:
            turned = np.column_stack([at.values, turned])
        found.append(group._replace(values=turned))
    return found


def _poses_of_joints(
    flat: Sequence[Table], columns: ColumnMap, arm: RobotDescription
) -> Iterator[VectorColumns]:
    """Yield the poses of an arm's TCP by its joint angles."""
    for place, table in enumerate(flat):
        run = find_joints(table, columns, len(arm.joints))
        if run:
            q = np.column_stack([one.values for one in run])
            scale = columns.angles or unit_in(run[0].name, ANGLES) or "rad"
            q = np.radians(q) if scale == "deg" else q
            tool = NominalArm(arm, Pose.of((0.0, 0.0, 0.0)), np.zeros(3)).poses(q)
            names = [one.name for one in run]
            label = f"that of the TCP of '{arm.name}' by {names[0]} … {names[-1]}"
            yield VectorColumns(place, (), names, label, tool)


def _ordered(values: Array, columns: ColumnMap) -> Array:
    """Quaternions in order wxyz, from that of the map; ROS's order xyzw by default."""
    return values if columns.quaternion == "wxyz" else values[:, [3, 0, 1, 2]]


def _of_vectors(vectors: Array) -> Array:
    """Quaternions (n, 4) of rotation vectors (n, 3), rad."""
    half = np.linalg.norm(vectors, axis=1, keepdims=True) / 2.0
    return np.hstack([np.cos(half), np.sinc(half / np.pi) / 2.0 * vectors])


def _of_angles(angles: Array, unit: Angle | None) -> Array:
    """Quaternions (n, 4) of roll, pitch and yaw (n, 3): turns about the fixed axes x, y and z in this order."""
    from scipy.spatial.transform import Rotation  # slow to import

    if (unit or ("deg" if np.nanmax(np.abs(angles)) > LARGEST_ANGLE else "rad")) == "deg":
        angles = np.radians(angles)
    whole = np.isfinite(angles).all(axis=1)
    turned = np.full((len(angles), 4), np.nan)
    turned[whole] = Rotation.from_euler("xyz", angles[whole]).as_quat()[:, [3, 0, 1, 2]]
    return turned


def _of_matrices(values: Array) -> Array:
    """Poses (n, 7) of homogeneous matrices (n, 16), column by column as libfranka's O_T_EE."""
    from scipy.spatial.transform import Rotation

    whole = values.reshape(-1, 4, 4).swapaxes(1, 2)
    kept = np.abs(np.linalg.det(whole[:, :3, :3]) - 1.0) < 0.01
    turned = np.full((len(whole), 4), np.nan)
    turned[kept] = Rotation.from_matrix(whole[kept, :3, :3]).as_quat()[:, [3, 0, 1, 2]]
    return np.column_stack([whole[:, :3, 3], turned])


def _choose(
    signal: str,
    stated: str | list[str] | None,
    found: Sequence[VectorColumns],
    flat: Sequence[Table],
    tables: Sequence[tuple[str, Table]],
    source: str,
) -> VectorColumns | None:
    """Choose the vector that the map states, or the only one.

    Raises InputError: the map states none or several of them, or there are several.
    """
    if isinstance(stated, str):
        wanted = {name for part in flat for name in part if name.startswith(stated)}
        named = [
            one for one in found if tables[one.table][0] == stated or wanted.issuperset(one.columns)
        ]
        if not named and signal == "wrench":
            named = _mapped(signal, stated, flat)
    elif stated is not None:
        named = _mapped(signal, stated, flat)
    else:
        named = _measured_first(found)
    if stated is None and not named:
        return None
    if len(named) != 1:
        what = f"no {signal} '{stated}'" if not named else f"several columns of a {signal}"
        labels = list_names(one.label for one in (named or found)) or "none"
        raise InputError(
            f"{source}: {what}; found: {labels}. State one in a file with '{signal}: NAME', and give it as "
            "columns=MAP.yaml"
        )
    return named[0]


def _mapped(signal: str, stated: str | list[str], flat: Sequence[Table]) -> list[VectorColumns]:
    """Six columns that the map lists, or a column of six numbers or a slice."""
    found: list[VectorColumns] = []
    for place, table in enumerate(flat):
        run = mapped_columns(table, signal, stated)
        if len(run) == 6 and signal == "wrench":
            names = [one.name for one in run]
            values = np.column_stack([one.values for one in run])
            found.append(VectorColumns(place, (), names, list_names(names, 2), values))
    return found


def _measured_first(found: Sequence[VectorColumns]) -> list[VectorColumns]:
    """Prefer raw and measured vectors where there are several."""
    for words in ({"raw"}, {"actual"}, {"measured"}):
        few = [one for one in found if words & {*one.stem, *words_of(one.columns[0])}]
        if len(few) == 1:
            return few
    return [*found]


def _clock(
    flat: Table, columns: ColumnMap, source: str, are_single: bool = False
) -> tuple[Array, Unit]:
    """Times (n,), s, of a table, and the unit that its clock counts in; that of single poses is s by default."""
    name = columns.t or find_clock(flat)
    if name is None or name not in flat:
        raise InputError(
            f"{source}: no column for time (t). Columns: {list_names(flat)}. State it in a file with 't: COLUMN', and "
            "give it as columns=MAP.yaml"
        )
    t = flat[name]
    step = float(np.median(np.diff(t))) if len(t) > 1 else 0.0
    # Without a stated unit, the coarsest one in which rows follow each other as in a recording.
    likely: list[Unit] = [u for u, size in SECONDS.items() if STEPS[0] <= size * step <= 1.0]
    guess = likely[0] if likely and not are_single else "s"
    unit = columns.time or unit_in(name, UNITS) or guess
    return t * SECONDS[unit], unit


def _at_common_times(
    t: Array, wrench: Array, other: Array, pose: Array, source: str
) -> tuple[Array, Array, Array]:
    """Interpolate poses at `other` (m,) to the times of the wrench; rows far from any pose are left out."""
    order = np.argsort(other, kind="stable")
    other, pose = other[order], pose[order]
    after = np.clip(np.searchsorted(other, t), 1, len(other) - 1)
    near = np.minimum(np.abs(other[after] - t), np.abs(t - other[after - 1])) < LATEST
    if near.mean() < 0.5:
        raise InputError(
            f"{source}: wrench and pose do not overlap in time: {t[0]:.3f} to {t[-1]:.3f} s, and {other[0]:.3f} to "
            f"{other[-1]:.3f} s; give both one clock"
        )
    # A quaternion and its opposite are one orientation: make them continuous before interpolation.
    turned = pose[:, -4:].copy()
    turned[1:] *= np.cumprod(np.where((turned[1:] * turned[:-1]).sum(1) < 0.0, -1.0, 1.0))[:, None]
    columns = np.column_stack([pose[:, :-4], turned])
    even: list[Array] = [np.interp(t[near], other, column) for column in columns.T]
    return wrench[near], t[near], np.column_stack(even)


def _full_poses(pose: Array, group: VectorColumns, source: str) -> tuple[Array, bool]:
    """Poses (n, 7) with unit quaternions, and whether positions were logged."""
    size = np.linalg.norm(pose[:, -4:], axis=1)
    if np.abs(np.median(size) - 1.0) > 0.02 or (size < 0.5).any():
        raise InputError(
            f"{source}: {group.label} are no unit quaternions: their norm is {np.median(size):.3g}. State the "
            "columns of the orientation with 'pose: NAME'"
        )
    turned = pose[:, -4:] / size[:, None]
    turned[1:] *= np.cumprod(np.where((turned[1:] * turned[:-1]).sum(1) < 0.0, -1.0, 1.0))[:, None]
    has_positions = pose.shape[1] == 7
    place = pose[:, :3] if has_positions else np.zeros((len(pose), 3))
    return np.column_stack([place, turned]), has_positions


def _require_alive(values: Array, group: VectorColumns, source: str) -> None:
    """Check that no column of a wrench is constant or saturated. Raises InputError: one is; the message names it."""
    for name, column in zip(group.columns, values.T, strict=True):
        if np.ptp(column) == 0.0:
            raise InputError(
                f"{source}: column '{name}' stays at {column[0]:g}: its sensor is dead, or it is another column"
            )
        # Longest run of equal values at an extreme of the column, and elsewhere.
        same = np.concatenate([[False], column[1:] == column[:-1]])
        for extreme in (column.min(), column.max()):
            at = column == extreme
            held = _longest(same & at)
            if held >= STUCK_ROWS and held > STUCK_TIMES * _longest(same & ~at):
                raise InputError(
                    f"{source}: column '{name}' is saturated: it stays at {extreme:g} for {held + 1} rows. "
                    "Use a sensor with a larger range, or cut this part out"
                )


def _longest(mask: NDArray[np.bool_]) -> int:
    """Length of the longest run of True."""
    return max((rows.stop - rows.start for rows in runs(mask)), default=0)


def _in_sensor(log: WrenchLog, columns: ColumnMap) -> WrenchLog:
    """Turn the wrench into the sensor's axes and to the sign of `WrenchLog`, and place the sensor."""
    wrench = log.wrench.copy()
    pose = Pose.of(columns.sensor[:3], columns.sensor[3:]) if columns.sensor else None
    if pose is not None:
        # Pose of the sensor: that of the logged frame, then that of the sensor in it.
        turned = rotations(log.pose[:, 3:])
        place = log.pose[:, :3] + turned @ pose.position
        quaternion = np.array([(Pose.of((0, 0, 0), q) @ pose).quaternion for q in log.pose[:, 3:]])
        log = replace(log, pose=np.column_stack([place, quaternion]))
    if columns.frame == "world":
        back = rotations(log.pose[:, 3:]).swapaxes(1, 2)
        for part in (slice(0, 3), slice(3, 6)):
            wrench[:, part] = (back @ wrench[:, part, None])[:, :, 0]
    # By default a sensor shows what acts on it: the weight of its load.
    return replace(log, wrench=wrench if columns.sign == "by_sensor" else -wrench)


def _averaged(log: WrenchLog) -> WrenchLog:
    """Average the rows of each `PERIOD`."""
    bins = np.floor(log.t / PERIOD + 1e-3).astype(int)
    starts = np.flatnonzero(np.diff(bins, prepend=-1))
    count = np.diff(np.append(starts, len(bins)))[:, None]
    t, wrench, pose = (
        np.add.reduceat(part, starts, axis=0) / count
        for part in (log.t[:, None], log.wrench, log.pose)
    )
    pose[:, 3:] /= np.linalg.norm(pose[:, 3:], axis=1, keepdims=True)
    return replace(log, t=t[:, 0], wrench=wrench, pose=pose)


def joined(log: WrenchLog, empty: WrenchLog, apart: float) -> WrenchLog:
    """Append a recording of the empty hand, `apart` s later."""
    return replace(
        log,
        t=np.concatenate([log.t, empty.t + log.t[-1] + apart]),
        wrench=np.concatenate([log.wrench, empty.wrench]),
        pose=np.concatenate([log.pose, empty.pose]),
        has_positions=log.has_positions and empty.has_positions,
    )
