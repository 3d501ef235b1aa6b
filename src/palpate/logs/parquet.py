"""Tables in Parquet, such as a LeRobot data set's episodes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from palpate.errors import InputError, Unavailable
from palpate.files.read import read_text, require_regular
from palpate.logs.columns import ColumnMap, Table

MAX_BYTES = 1_000_000_000
EPISODE = "episode_index"
INFO = "meta/info.json"
"""What a LeRobot data set says of its columns, beside the folder `data`."""


def read_parquet(path: Path, columns: ColumnMap) -> Table:
    """Read numeric columns, and columns of lists of equal length; of a LeRobot file one episode.

    Raises:
        InputError: no such file, too large, or several episodes and none is stated.
        Unavailable: `pyarrow` is not installed.
    """
    try:
        import pyarrow.parquet as parquet  # pyright: ignore[reportMissingModuleSource]
    except ImportError:
        raise Unavailable(f"{path}: Parquet needs pyarrow: pip install 'palpate[logs]'") from None
    require_regular(path, MAX_BYTES, "a recording of an arm")
    try:
        file: Any = parquet.ParquetFile(path)
        groups = range(file.metadata.num_row_groups)
        if sum(file.metadata.row_group(i).total_byte_size for i in groups) > MAX_BYTES:
            raise InputError(f"{path} unpacks to more than {MAX_BYTES // 10**6} MB; cut it")
        content: Any = file.read()
    except (OSError, ValueError) as error:
        raise InputError(f"{path} is no Parquet file: {str(error).splitlines()[0]}") from None
    found: dict[str, Any] = {}
    for name in content.column_names:
        values = content[name].to_pylist()
        try:
            numbers = np.array(values, dtype=float)
        except (TypeError, ValueError):
            continue  # texts, pictures, lists of different lengths
        if numbers.ndim in (1, 2):
            found[name] = numbers
    return _named(path, _episode(path, found, columns.episode))


def _episode(path: Path, table: dict[str, Any], wanted: int | None) -> dict[str, Any]:
    if EPISODE not in table:
        return table
    every = sorted({int(number) for number in table[EPISODE]})
    if wanted is None and len(every) > 1:
        raise InputError(
            f"{path} has episodes {every[0]} to {every[-1]}; state one in a file with 'episode: "
            f"{every[0]}', and give it as columns=MAP.yaml"
        )
    number = every[0] if wanted is None else wanted
    if number not in every:
        raise InputError(f"{path}: no episode {number}; it has {every[0]} to {every[-1]}")
    rows = table[EPISODE] == number
    return {name: values[rows] for name, values in table.items()}


def _named(path: Path, table: dict[str, Any]) -> Table:
    """Split columns of several numbers whose numbers a LeRobot data set names."""
    info = next((up / INFO for up in path.absolute().parents[:4] if (up / INFO).is_file()), None)
    if info is None:
        return table
    try:
        features: Any = json.loads(read_text(info, 1_000_000, "a data set's description"))[
            "features"
        ]
    except (ValueError, KeyError, TypeError):
        return table
    found = dict(table)
    for column, values in table.items():
        stated: Any = features.get(column, {}).get("names")
        # Either a list, or a list by a name of its own: {"motors": [...]}.
        lists: Any = stated.values() if hasattr(stated, "values") else [stated]
        names: list[str] = next(iter(lists), None) or []
        if values.ndim == 2 and len({*names}) == len(names) == values.shape[1]:
            del found[column]
            found |= {f"{column}.{name}": part for name, part in zip(names, values.T, strict=True)}
    return found
