"""Columns of a recording, and the unit of its clock."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import takewhile
from pathlib import Path
from typing import Literal, NamedTuple, TypeVar

import numpy as np
from pydantic import Field, ValidationError

from palpate.common.errors import InputError, perhaps
from palpate.common.files import Section, describe_error, plain_yaml, read_text
from palpate.common.pose import Array
from palpate.estimation.motion import Mask

JOINTS = 7
T = TypeVar("T")
Table = Mapping[str, Array]
"""Columns of a log by name: (n,), or (n, k) in formats with vector columns."""
Unit = Literal["s", "ms", "us", "ns"]
Angle = Literal["rad", "deg"]
SECOND = ("s", "sec", "secs", "second", "seconds")
PREFIXES: dict[str, Unit] = {
    "": "s", "m": "ms", "milli": "ms", "u": "us", "micro": "us", "n": "ns", "nano": "ns"
}  # fmt: skip
UNITS: dict[str, Unit] = {
    prefix + word: unit for prefix, unit in PREFIXES.items() for word in SECOND
}
ANGLES: dict[str, Angle] = {"rad": "rad", "deg": "deg", "degree": "deg", "degrees": "deg"}

ALIASES = {
    "t": "header_stamp t time timestamp time_stamp stamp elapsed elapsed_time duration "
    f"{' '.join(word for word in UNITS if len(word) > 2)} bag_time",
    "q": "q position positions pos angle angles qpos theta",
    "dq": "dq velocity velocities vel speed speeds qdot q_dot qvel",
    "tau": "tau tau_j effort efforts torque torques",
    "tau_ext": "tau_ext tau_ext_hat tau_ext_hat_filtered tau_ext_hat_filtered_effort external_torque "
    "external_torques",
}
"""Names of columns by signal, without arm and joint, the preferred ones first. tau is libfranka's tau_J, which
includes gravity."""
KNOWN = {
    alias: (signal, rank)
    for signal, aliases in ALIASES.items()
    for rank, alias in enumerate(aliases.split())
}
MEASURED = {"measured", "actual", "sensed"}
_PLAIN = "joint joints state states robot msg arm observation obs data log field value values m nm"
SILENT = {*MEASURED, *UNITS, *ANGLES, *_PLAIN.split()}
_OTHERS = (
    "d des desired cmd command commands commanded target targets ref reference goal setpoint action actions "
    "output error errors err prev previous next predicted model computed sim simulated min max limit limits "
    "delta latency delay ipo cartesian ee eef tcp effector"
)
NOT_MEASURED = set(_OTHERS.split())
WORD = re.compile(r"[a-z]+(?:_?\d+)?|\d+")
NUMBER = re.compile(r"(?<!fr)(?<!iiwa)(?<!\d)\d+")
"""Number in a name, except a robot's."""
ROBOTS = {"panda", "franka", "fer", "fr3", "lbr", "iiwa", "iiwa7", "iiwa14"}
"""Words of robot names, which do not distinguish arms."""
WIDEST = 2_000
"""Largest number of components of a column that may belong to an arm."""
SAME = {"q": 2e-3, "tau": 0.2}
"""rad and N m. Largest medians of the difference at which two topics show the same joints."""


class ColumnMap(Section):
    """Columns of each signal; omitted ones are inferred.

    An entry is a name, the common part of seven numbered names, a slice of a wide column (`observation.state[0:7]`),
    or a list of seven names.
    """

    t: str | None = None
    q: str | list[str] | None = None
    dq: str | list[str] | None = None
    tau: str | list[str] | None = None
    tau_ext: str | list[str] | None = None
    joints: str | None = None
    """Arm among several: words of its columns' names, or the numbers of its joints (`7-13`)."""
    topic: str | None = None
    """Topic of a bag with the joint signals."""
    episode: int | None = None
    """`episode_index` of a LeRobot data set."""
    angles: Angle | None = None
    time: Unit | None = None
    wrench: str | list[str] | None = None
    """Wrench of a six-axis sensor: its topic, the common part of six names, or a list of six."""
    pose: str | None = None
    """Topic, or common part of the names, of the orientation or pose of that sensor."""
    frame: Literal["sensor", "world"] = "sensor"
    """Axes of the wrench: those of the sensor, or those in which its pose is logged."""
    sign: Literal["on_sensor", "by_sensor"] = "on_sensor"
    """The wrench acts on the sensor (a weight pulls it down), or the sensor exerts it on the load."""
    sensor: list[float] | None = Field(default=None, min_length=7, max_length=7)
    """Pose of the sensor in the frame whose pose is logged: m, and quaternion wxyz."""
    quaternion: Literal["xyzw", "wxyz"] = "xyzw"
    """Order of four numbered columns of an orientation."""
    gain: float = Field(default=0.01, gt=0.0, lt=0.5)
    """Relative error (1 sigma) of the sensor's sensitivity."""

    @property
    def numbers(self) -> Sequence[int]:
        """Joints stated by their numbers."""
        ends = re.fullmatch(r"(\d{1,4})-(\d{1,4})", str(self.joints))
        return range(int(ends[1]), int(ends[2]) + 1) if ends else ()


class LogColumn(NamedTuple):
    """Values of one number per row: joint number, if the name has one, column name, and values (n,)."""

    joint: int | None
    name: str
    values: Array


class Arm(NamedTuple):
    """Joint signals of an arm in one table."""

    name: str  # words that distinguish its columns from those of other arms; may be empty
    table: int  # index of its table
    topic: str  # topic of the table in a bag; else empty
    # One of `t`, seven of `q` and `tau`, and seven of `dq` and `tau_ext` where available.
    columns: dict[str, list[LogColumn]]
    notes: tuple[str, ...]  # omissions and assumptions

    def __str__(self) -> str:
        return f"'{self.name}' ({self.topic or self.columns['q'][0].name + ' …'})"

    @property
    def signals(self) -> dict[str, Array]:
        """Arrays of the columns: (n,) for `t`, (n, 7) for the others."""
        every = {s: np.column_stack([c.values for c in run]) for s, run in self.columns.items()}
        return every | {"t": every["t"][:, 0]}


Arms = dict[str, dict[tuple[bool, int, str], dict[int | None, LogColumn]]]
"""Columns of a signal by arm, by preference and name without number, and by joint."""


def read_map(path: Path | None) -> ColumnMap:
    """Read a column map; without a file all columns are inferred.

    Raises InputError: the file is not readable, or differs from the form of `ColumnMap`.
    """
    if path is None:
        return ColumnMap()
    content = plain_yaml(read_text(path, 100_000, "a map of columns"), str(path))
    try:
        return ColumnMap.model_validate(content)
    except ValidationError as error:
        raise InputError(f"{path}: {describe_error(error, ColumnMap)}") from None


def find_arm(tables: Sequence[tuple[str, Table]], columns: ColumnMap, source: str) -> Arm:
    """Find the joint signals of one arm in the tables of a log, each with its topic, the longest first.

    Raises InputError: t, q, tau or a mapped column is missing, or the number of matching arms is not one.
    """
    # Collect all candidate arms, and check their columns.
    found = [arm for place in range(len(tables)) for arm in _arms(place, *tables[place], columns)]
    if not found:
        raise _missing(*tables[0], columns, source)
    for arm in found:
        rows = {column.name: len(column.values) for run in arm.columns.values() for column in run}
        if len({*rows.values()}) > 1:
            raise InputError(f"{source}: columns of unequal length: {rows}")
    # Prefer arms with more signals, and drop those outside the map and duplicates.
    arms: list[Arm] = []
    for arm in sorted(found, key=lambda arm: (-len(arm.columns), arm.table)):
        if _is_named(arm, columns) and not any(_is_same(arm, other) for other in arms):
            arms.append(arm)
    if len(arms) != 1:
        arms = arms or found
        twins = len({arm.name for arm in arms}) < len(arms)
        example = f"topic: {arms[-1].topic}" if twins else f"joints: {arms[-1].name}"
        raise InputError(
            f"{source} holds the joints of several arms: {list_names(map(str, arms))}. State one of them in a "
            f"file with '{example}', and give it as columns=MAP.yaml"
        )
    _require_numbers(arms[0], tables[arms[0].table][1], source)
    # Note the messages that are not read, and a clock without stamps.
    counts = [
        f"{len(table[name])} messages on {topic} (… {name})"
        for topic, table in tables
        for name in list(table)[-1:]
    ]
    read, arm = counts.pop(arms[0].table), arms[0]
    notes = [f"{read} are read, not {list_names(counts, 8)}"] if counts else []
    if arm.columns["t"][0].name == "bag_time_s":
        notes.append("its messages have no stamps: their times are those of the bag")
    return arm._replace(notes=(*notes, *arm.notes))


def any_arm(tables: Sequence[tuple[str, Table]], columns: ColumnMap) -> bool:
    """Return true if a table has time, positions and torques of an arm."""
    return any(True for i in range(len(tables)) for _ in _arms(i, *tables[i], columns))


def _require_numbers(arm: Arm, table: Table, source: str) -> None:
    """Check that each column of an arm is unique and has numbers in most of its rows.

    Raises InputError: it is not; the message names the column.
    """
    for signal, column in ((signal, one) for signal, run in arm.columns.items() for one in run):
        # pandas numbers the second column of a name.
        twice = [name for name in table if re.fullmatch(re.escape(column.name) + r"\.\d+", name)]
        if twice and column.name in table:
            raise InputError(
                f"{source}: columns with one name: {column.name} ({list_names(twice)}); remove or rename one of them"
            )
        if len(column.values) and np.isfinite(column.values).mean() < MOST_LOST:
            rest = "" if signal in ("t", "q", "tau") else f", or remove all columns of {signal}"
            raise InputError(
                f"{source}: column '{column.name}' ({signal}) has no numbers in most rows: mend it, state another one "
                f"in columns=MAP.yaml{rest}"
            )


def _is_named(arm: Arm, columns: ColumnMap) -> bool:
    """True if an arm's name has the words that the map states."""
    if columns.joints is None or columns.numbers:
        return True
    words = {*words_of(columns.joints)} - SILENT
    return words <= {*words_of(arm.name)} if words else not arm.name


def _is_same(one: Arm, other: Arm) -> bool:
    """True if two arms are the same, by name or by their joint signals at common times."""
    if (one.topic, one.name) == (other.topic, other.name):
        return True  # in other messages further joints, or no velocities
    a, b = (
        {name: x[np.isfinite(arm["tau"]).all(1)] for name, x in arm.items()}
        for arm in (one.signals, other.signals)
    )
    # Compare up to 500 common times by interpolation.
    t, u = a["t"], b["t"]
    both = np.flatnonzero((t >= u.min(initial=np.inf)) & (t <= u.max(initial=-np.inf)))
    both = both[:: max(1, len(both) // 500)]
    for name, most in SAME.items():
        for joint in range(JOINTS):
            x, y = a[name][both, joint], b[name][:, joint]
            if not len(both) or np.median(np.abs(np.interp(t[both], u, y) - x)) > most:
                return False
    return True


def _missing(topic: str, table: Table, columns: ColumnMap, source: str) -> InputError:
    """Build the error that names the columns which are missing in a table, too few or too many."""
    flat, on = flat_columns(table), f"{source}: {topic}" if topic else source
    stated = _read_column(flat, columns)
    # Columns of the map that do not exist, or have the wrong count.
    for signal, run in stated.items():
        given: str | list[str] = getattr(columns, signal)
        names = [given] if isinstance(given, str) else given
        unknown = next((name for name in names if name not in flat), "")
        if not run:
            return InputError(
                f"{on}: {signal}: no column '{unknown[:80]}';{perhaps(unknown, table)} columns: {list_names(table)}"
            )
        if not _is_arm(signal, run):
            return InputError(
                f"{on}: {signal}: {list_names(names)} has {len(run)} numbers, not {JOINTS}; give {JOINTS} names, or "
                f"'{signal}: NAME[0:{JOINTS}]'. Columns: {list_names(table)}"
            )
    # Signals without any column.
    found = {*_families(flat), *stated}
    missing = [signal for signal in ("t", "q", "tau") if signal not in found]
    missing = missing or [signal for signal in ("q", "tau") if signal not in stated]
    meant = {"t": "time", "q": "joint positions", "tau": "joint torques with gravity"}
    names = " and ".join(f"{meant[signal]} ({signal})" for signal in missing)
    lines = "; ".join(f"{signal}: COLUMN" for signal in missing)
    return InputError(
        f"{on}: no column for {names}. Columns: {list_names(table)}. An arm has {JOINTS} joints. State them in "
        f"a file with '{lines}', and give it as columns=MAP.yaml"
    )


def _is_arm(signal: str, run: Sequence[LogColumn]) -> bool:
    """True if a run has the number of columns of one signal of an arm."""
    return len(run) == 1 if signal == "t" else JOINTS <= len(run) < 2 * JOINTS


def _arms(place: int, topic: str, table: Table, columns: ColumnMap) -> Iterator[Arm]:
    """Yield the arms of a table that have time, positions and torques, including columns of the map."""
    flat, context = flat_columns(table), [] if columns.topic else words_of(topic)
    stated, found = _read_column(flat, columns), _families(flat)
    if not all(_is_arm(*one) for one in stated.items()) or NOT_MEASURED & {*context}:
        return
    guide = "tau" if "q" in stated else "q"
    names = [""] if guide in stated else [*found.get(guide, {})]
    for name in names:
        # Best columns of each signal for this arm.
        best = {"t": _clocks(found.get("t", {}), name)} | stated
        for signal in found.keys() - best.keys():
            # Columns without an arm's name belong to the named arms.
            families = found[signal].get(name) or ({} if "" in names else found[signal].get("", {}))
            runs = (_run(families[key], columns) for key in sorted(families))
            # With a map, inferred columns must be seven: which of more it means is known of its own columns only.
            most = JOINTS if {"q", "tau"} & stated.keys() else len(flat)
            if run := next((run for run in runs if JOINTS <= len(run) <= most), None):
                best[signal] = run
        if not {"q", "tau"} <= best.keys() or not best["t"]:
            continue
        # Split runs of fourteen and more joints into arms of seven.
        parts = 1 if columns.numbers else min(len(best[one]) // JOINTS for one in ("q", "tau"))
        for part in range(parts):
            picked = {
                signal: run[part * (len(run) // parts) :][:JOINTS]
                for signal, run in best.items()
                if len(run) >= parts * JOINTS
            }
            q = picked["q"]
            numbers = f"{q[0].joint}-{q[-1].joint}" if parts > 1 else ""
            words = [*(word for word in context if word not in SILENT), name, numbers]
            # Note the joints and clocks that are not read.
            families = (f for arm in found.get("q", {}).values() for f in arm.values())
            every = best["q"] if "q" in stated else [c for f in families for c in f.values()]
            used = {column.name for column in q}
            notes: list[str] = []
            if rest := [column.name for column in every if column.name not in used]:
                notes = [f"joints {q[0].name} to {q[-1].name} are read, not {list_names(rest, 8)}"]
            elif {*words_of(name)} - ROBOTS:
                notes = [f"the columns are those of '{name}', as {q[0].name}"]
            clock, *others = best["t"]
            if others:
                unread = list_names(column.name for column in others)
                notes.append(f"the clock is {clock.name}, not {unread}")
            full_name = "_".join(filter(None, words))
            yield Arm(full_name, place, topic, picked | {"t": [clock]}, tuple(notes))


def _run(family: Mapping[int | None, LogColumn], columns: ColumnMap) -> list[LogColumn]:
    """Columns of the joints stated by the map, else of all consecutive joints from 0 or 1 on."""
    first = 0 if 0 in family else 1
    wanted = columns.numbers or range(first, first + len(family))
    return [family[joint] for joint in takewhile(family.__contains__, wanted)]


def _clocks(found: Arms, arm: str) -> list[LogColumn]:
    """Clocks, the best first: those of the arm, then those without an arm's name."""
    words = {*words_of(arm)}
    ranked = sorted(
        (not {*words_of(name)} <= words, -len(words_of(name)), key, name)
        for name, families in found.items()
        for key in families
    )
    return [found[name][key][None] for *_, key, name in ranked if None in found[name][key]]


def flat_columns(table: Table) -> Table:
    """Scalar columns: `q[0]` of a wide one; the two parts of a stamp (`sec`, `nanosec`) are joined."""
    flat: dict[str, Array] = {}
    # Split a vector column, join the two parts of a stamp, and keep scalars.
    for name, given in table.items():
        values: Array = given.reshape(given.size) if 1 in given.shape else given
        fine = re.fullmatch(r"(.*?)[._/ ]*((?:n|nano_?)(secs?))", name)
        coarse = name.removesuffix(fine[2]) + fine[3] if fine else ""
        if values.ndim == 2 and values.shape[1] <= WIDEST:
            flat |= {f"{name}[{i}]": part for i, part in enumerate(values.T)}
        elif fine and coarse in flat and len(values) == len(flat[coarse]):
            stamp = f"{fine[1]}_stamp_s".replace("stamp_stamp", "stamp")
            flat[stamp] = flat.pop(coarse) + 1e-9 * values
        elif values.ndim == 1:
            flat[name] = values
    return flat


def words_of(name: str) -> list[str]:
    """Words of a name in lower case with the numbers after them: `left_fr3/tauJ` → left, fr3, tau, j."""
    return WORD.findall(_lower(name))


def unit_in(name: str, units: Mapping[str, T]) -> T | None:
    """Unit stated by the words of a column's name."""
    return next((units[word] for word in words_of(name)[::-1] if word in units), None)


def _lower(name: str) -> str:
    """Name in lower case, with camel case split and micro written as u."""
    spaced = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name)
    return re.sub("[µμ]s", "us", spaced).lower()


def _families(flat: Table) -> dict[str, Arms]:
    """Group the columns of measured signals by signal, arm and joint in their names."""
    found: dict[str, Arms] = {}
    for name, values in flat.items():
        # Split the name into joint number, signal alias, and the remaining words of the arm.
        text = _lower(name)
        number = next(iter([*NUMBER.finditer(text)][-1:]), None)
        stem = f"{text[: number.start()]}#{text[number.end() :]}" if number else text
        words = WORD.findall(stem)
        core = [word for word in words if word not in SILENT] or words
        alias = _alias(core)
        if alias is None or NOT_MEASURED & {*words}:
            continue
        signal, rank = KNOWN["_".join(core[alias])]
        del core[alias]
        key = not MEASURED & {*words}, rank, stem
        family = found.setdefault(signal, {}).setdefault("_".join(core), {}).setdefault(key, {})
        joint = int(number[0]) if number else None
        family.setdefault(joint, LogColumn(joint, name, values))
    return found


def _alias(words: list[str]) -> slice | None:
    """Position of the longest run of words that names a signal, the last if there are several."""
    for size in range(len(words), 0, -1):
        for start in range(len(words) - size, -1, -1):
            if "_".join(words[start : start + size]) in KNOWN:
                return slice(start, start + size)
    return None


def _read_column(flat: Table, columns: ColumnMap) -> dict[str, list[LogColumn]]:
    """Find the columns that the map states; missing ones are left out."""
    found: dict[str, list[LogColumn]] = {}
    for signal in ALIASES:
        stated: str | list[str] | None = getattr(columns, signal)
        if stated is not None:
            found[signal] = mapped_columns(flat, signal, stated, columns)
    return found


def mapped_columns(
    flat: Table, signal: str, stated: str | list[str], columns: ColumnMap | None = None
) -> list[LogColumn]:
    """Find the columns of one signal that the map states; missing ones are left out.

    A single name may be a column, a slice, or the common part of numbered names. A list has a name for each number.
    """
    if not isinstance(stated, str):
        return [LogColumn(i, n, flat[n]) for i, n in enumerate(stated) if n in flat]
    sliced = re.fullmatch(r"(.+)\[(\d+):(\d+)\]", stated)
    name = sliced[1] if sliced else stated
    run = [LogColumn(None, name, flat[name])] if name in flat else _parts(flat, name)
    # A slice counts columns in the order of the file.
    if sliced:
        return run[int(sliced[2]) : int(sliced[3])]
    if signal != "t" and name not in flat:
        return _run({column.joint: column for column in run}, columns or ColumnMap())
    return run


def find_joints(flat: Table, columns: ColumnMap, count: int = JOINTS) -> list[LogColumn]:
    """Find the columns of the joint angles of one arm with `count` joints; empty without them."""
    stated = _read_column(flat, columns).get("q")
    families = [f for arm in _families(flat).get("q", {}).values() for f in arm.values()]
    runs = [stated] if stated else [_run(family, columns) for family in families]
    whole = [run for run in runs if len(run) == count]
    return whole[0] if whole else []


def find_clock(flat: Table) -> str | None:
    """Name of the best clock of a table; None without one."""
    clocks = _clocks(_families(flat).get("t", {}), "")
    return clocks[0].name if clocks else None


def _parts(flat: Table, stem: str) -> list[LogColumn]:
    """Columns of one signal: `state.q[3]` of `state.q` by number, `q.wrist` of `q` by name."""
    pattern = re.compile(re.escape(stem) + r"(?:[\[_./ ]*(\d+)\]?|\..*)")
    matches = [(name, part) for name in flat if (part := pattern.fullmatch(name))]
    return [
        LogColumn(int(part[1]) if part[1] else None, name, flat[name]) for name, part in matches
    ]


def list_names(names: Iterable[str], most: int = 40) -> str:
    """At most `most` names, for a message."""
    every = [name[:60] for name in names]
    more = f" and {len(every) - most} more" if len(every) > most else ""
    return ", ".join(every[:most]) + more


# Clock and units of a log: seconds from 0, radians, no duplicate rows; each repair is a note


SECONDS: dict[Unit, float] = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
STEPS = 3e-4, 100.0
"""s. Range of the time between rows of a recording."""
DATES = 0.95e9, 4.1e9
"""s since 1970. Range of dates of this century."""
MOVING, FASTEST = 0.02, 6.0
"""rad/s. Speed range of a joint in motion."""
SMOOTH = 0.5
"""Correlation of successive steps above which a motion is smooth; noise has -0.5."""
LONGEST = 3600.0
"""s. Longest recording of an arm at rest."""
STUCK = 5
"""Rows. Longer runs of equal rows are an arm at rest in a noise-free world, not a late sensor."""
LARGEST_ANGLE = 7.0
"""rad. Largest joint angle of an arm; larger numbers are degrees."""
MOST_LOST = 0.5
"""Smallest fraction of rows that must remain."""
RATE_WINDOW = 0.04
"""s. Half width of the local polynomial that differentiates positions."""
BLOCK = 10_000
"""Rows differentiated at a time, which bounds the memory."""


def clean_signals(
    signals: dict[str, Array],
    columns: ColumnMap,
    source: str,
    unit: Unit | None = None,
    angles: Angle | None = None,
) -> tuple[dict[str, Array], tuple[str, ...]]:
    """Repair clock, repeated rows and units of signals (`t`, `q`, `tau`, optionally `dq`, `tau_ext`).

    Args:
        signals: arrays by name.
        columns: map with stated units.
        source: name of the recording, for messages.
        unit: unit of the clock in its column's name.
        angles: unit of the angles in their columns' names.

    Raises:
        InputError: More than half of the rows are invalid, or the clock does not run.
    """
    notes: list[str] = []
    whole = len(signals["t"])
    if whole < 2:
        raise InputError(f"{source} has {whole} rows; a recording has thousands")
    signals = dict(signals)
    # Drop rows without numbers, out of order, or repeated; each reason is a note.
    for kept, why in (
        (_finite, "without a number"),
        (_forward, "out of the order of time"),
        (_fresh, "that repeat the one before them"),
    ):
        rows = kept(signals)
        lost = int((~rows).sum())
        if lost:
            notes.append(f"{lost} rows ({100 * lost / whole:.1f} %) {why} are left out")
            signals = {name: values[rows] for name, values in signals.items()}
        if len(signals["t"]) < max(2, MOST_LOST * whole):
            raise InputError(f"{source}: {notes[-1]}: more than half; mend the recording")
    # Convert angles: a stated unit first, then the column's name, then the size of the numbers.
    beyond = np.abs(signals["q"]).max() > LARGEST_ANGLE
    if (columns.angles or angles or ("deg" if beyond else "rad")) == "deg":
        for name in {"q", "dq"} & set(signals):
            signals[name] = np.radians(signals[name])
        if columns.angles is None:
            notes.append("angles are in degrees")
    # Unit of the clock: as stated, else as named, else as velocities or steps show it.
    slope = _slope_unit(signals)
    if columns.time is None and unit and slope and slope != unit:
        raise InputError(
            f"{source}: the clock is named in {unit}, but the velocities fit one in {slope}; "
            f"state it in a file with 'time: {slope}', and give it as columns=MAP.yaml"
        )
    unit = columns.time or unit or slope or _likely_unit(signals)
    if unit != "s" and columns.time is None:
        notes.insert(0, f"the clock counts in {unit}")
    signals["t"] = (signals["t"] - signals["t"][0]) * SECONDS[unit]
    if "dq" not in signals:
        signals["dq"] = differentiate(signals["q"], signals["t"])
        notes.append("joint velocities are not logged: taken from the positions")
    return signals, tuple(notes)


def _slope_unit(signals: dict[str, Array]) -> Unit | None:
    """Unit of the clock in which the logged velocities are the slopes of the positions.

    Returns None where the joints do not move enough.
    """
    if "dq" not in signals:
        return None
    steps, speeds = np.diff(signals["t"])[:, None], np.abs(signals["dq"][1:])
    moving = speeds > MOVING
    # Ratio of the travelled distance to the integral of speed, in each candidate unit.
    way = float(np.abs(np.diff(signals["q"], axis=0))[moving].sum())
    expected = float((speeds * steps)[moving].sum())
    ratios: dict[Unit, float] = {
        unit: way / (expected * size + 1e-12) for unit, size in SECONDS.items()
    }
    return next((unit for unit, ratio in ratios.items() if 1 / 3 < ratio < 3), None)


def _likely_unit(signals: dict[str, Array]) -> Unit:
    """Infer the unit of a clock from its steps and the positions alone; s where they are not conclusive."""
    t, moves = signals["t"], np.diff(signals["q"], axis=0)
    steps = np.diff(t)
    # Units with a plausible sample time and joint speed.
    step, fastest = float(np.median(steps)), np.quantile(np.abs(moves).max(1) / steps, 0.999)
    fit: list[Unit] = [
        unit
        for unit, size in SECONDS.items()
        if STEPS[0] <= size * step <= STEPS[1] and fastest < FASTEST * size
    ]
    # A clock that counts from 1970 shows a date of this century.
    for unit in fit:
        if DATES[0] < SECONDS[unit] * t[0] < DATES[1]:
            return unit
    # Successive steps of a densely sampled motion are similar; steps between poses, and noise, are not.
    smooth = (moves[1:] * moves[:-1]).sum() > SMOOTH * (moves**2).sum()
    for unit in fit[::-1] if smooth else ():
        if fastest > MOVING * SECONDS[unit]:
            return unit
    return fit[-1] if fit and not ("s" in fit and t[-1] - t[0] < LONGEST) else "s"


def _finite(signals: dict[str, Array]) -> Mask:
    """Rows in which all signals are finite."""
    return np.logical_and.reduce(
        [np.isfinite(values).reshape(len(values), -1).all(axis=1) for values in signals.values()]
    )


def _forward(signals: dict[str, Array]) -> Mask:
    """Rows that are later than all rows before them."""
    t = signals["t"]
    before = np.concatenate([[-np.inf], np.maximum.accumulate(t)[:-1]])
    return t > before


def _fresh(signals: dict[str, Array]) -> Mask:
    """Rows whose positions and torques differ from the row before, or belong to a long run of equal rows."""
    now = np.column_stack([signals["q"], signals["tau"]])
    same = np.concatenate([[False], (now[1:] == now[:-1]).all(axis=1)])
    # Length of the run of equal rows before and after each row.
    count = np.arange(len(same))
    since = count - np.maximum.accumulate(np.where(same, 0, count))
    until = (np.minimum.accumulate(np.where(same, len(same), count)[::-1])[::-1]) - count
    return ~same | (since + until > STUCK)


def differentiate(q: Array, t: Array) -> Array:
    """Rates (n, k) of q (n, k) per second, by a local quadratic around each row (Savitzky and Golay, 1964).

    The rows may be unevenly spaced.
    """
    half = max(1, round(RATE_WINDOW / max(float(np.median(np.diff(t))), 1e-6)))
    shifts = np.arange(-half, half + 1)
    out = np.empty(q.shape)
    for start in range(0, len(t), BLOCK):
        # Normal equations of the quadratics of all rows of a block; rows beyond the ends have no weight.
        middle = np.arange(start, min(start + BLOCK, len(t)))[:, None]
        rows = np.clip(middle + shifts, 0, len(t) - 1)
        inside = (middle + shifts == rows).astype(float)
        since = t[rows] - t[middle]
        powers = inside[:, :, None] * np.stack([np.ones_like(since), since, since**2], axis=2)
        moments = powers.transpose(0, 2, 1) @ powers
        # Two rows at an end determine no quadratic; the ridge leaves a straight line.
        moments += 1e-12 * moments[:, :1, :1] * np.eye(3)
        right = powers.transpose(0, 2, 1) @ q[rows]
        out[middle[:, 0]] = np.linalg.solve(moments, right)[:, 1]
    return out
