"""Many runs of the command line over libfranka's own protocol, on loopback, and what came of them.

    python -m tests.fci.campaign --scenario bottle_and_table --seeds 10 --out DIR
    python -m tests.fci.campaign --faults 50 --out DIR

Each run leaves its folder and a row of `rows.jsonl` in DIR; what is there already is not run again.
A seed is another arm in another world. Exits with 1 where a row is not as it should be.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from .mishaps import faulted
from .runs import SCENARIOS, measured

Row = dict[str, Any]


def main() -> int:
    """Run what is asked and print its table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenario", choices=SCENARIOS, default=SCENARIOS[0])
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--faults", type=int, default=0)
    parser.add_argument("--noise", default="lab")
    parser.add_argument("--out", type=Path, required=True)
    asked = parser.parse_args()
    asked.out.mkdir(parents=True, exist_ok=True)
    if asked.faults:
        rows = carried_out(asked.out, "faults", range(asked.faults), faulted)
        print(fault_table(rows))
        return int(any(row["wrong"] for row in rows))

    def one(seed: int, folder: Path) -> Row:
        return measured(asked.scenario, asked.noise, seed, folder)

    name = f"{asked.scenario}-{asked.noise}"
    rows = carried_out(asked.out, name, range(asked.seeds), one)
    print(table(rows))
    return int(any(row["exit"] != 0 or row["lost"] for row in rows))


def carried_out(out: Path, name: str, seeds: range, one: Callable[[int, Path], Row]) -> list[Row]:
    """The rows of all seeds, those of earlier calls among them."""
    file = out / f"{name}.jsonl"
    lines = file.read_text().splitlines() if file.exists() else []
    done = {row["seed"]: row for row in map(json.loads, lines)}
    for seed in seeds:
        if seed in done:
            continue
        row = one(seed, _vacant(out / f"{name}-{seed}"))
        done[seed] = {"seed": seed, **row}
        with file.open("a") as rows:
            rows.write(json.dumps(done[seed]) + "\n")
        print(json.dumps(done[seed]), file=sys.stderr, flush=True)
    return [done[seed] for seed in seeds]


def _vacant(folder: Path) -> Path:
    """A folder of which nothing is there yet; what a call that was cut off left stays beside it."""
    found, number = folder, 1
    while found.exists():
        found, number = folder.with_name(f"{folder.name}.{number}"), number + 1
    return found


def table(rows: list[Row]) -> str:
    """A line a run."""
    head = "seed exit  robot s  wall s  lost  step µm  peak N  what (error ± stated 95 %)"
    lines = [head]
    for row in rows:
        values = ", ".join(
            f"{name} {value['error']:+.5f} ± {value['within']:.5f}"
            + ("" if value["inside"] else " OUTSIDE")
            for name, value in row["values"].items()
        )
        lines.append(
            f"{row['seed']:4} {row['exit']:4} {row['robot_seconds']:8.1f} {row['wall']:7.1f} "
            f"{row['lost']:5} {1e6 * row['step']:8.1f} {row['peak']:7.1f}  {values}"
            + (f"  [{row['stopped_by']}]" if row["stopped_by"] else "")
        )
    return "\n".join(lines)


def fault_table(rows: list[Row]) -> str:
    """A line a run."""
    lines = ["seed fault         scenario           at s  exit  end s  work s  fall m/s  said"]
    for row in rows:
        wrong = "".join(f" WRONG: {what}" for what in row["wrong"])
        lines.append(
            f"{row['seed']:4} {row['fault']:13} {row['scenario']:16} {row['at']:4.1f}  "
            f"{row['exit']:4} {row['end']:6.2f} {row['work']:7.2f} {row['fell']:9.2f}  {row['said'][:90]}{wrong}"
        )
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
