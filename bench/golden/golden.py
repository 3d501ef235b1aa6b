#!/usr/bin/env python3
"""The golden table: results of every bundled scenario, to the last bit.

    python bench/golden/golden.py compare [--quick] [--only NAME …]     compare with table.json; exit
                                                                        status 1 for a difference
    python bench/golden/golden.py record                                write table.json (with --quick:
                                                                        its quick rows alone)

A row is a scenario, a seed and a noise model: values, standard deviations, intervals, verdicts,
actions, robot seconds and the twin's bytes without its sentences. Everything is run through the
command line, which is a contract, so the table outlives any change of the code behind it. Pictures
are left out, which makes a run several times faster and changes no number. `--quick` runs seed 0 at
`lab` and `measured` and leaves out the scenarios that take over ten seconds, which have seed 0 alone.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from itertools import product
from pathlib import Path
from typing import Any

TABLE = Path(__file__).with_name("table.json")
NOISE = ("none", "lab", "measured")
SEEDS = (0, 1, 2)
SLOW = {"fifteen_objects"}
SENTENCES = re.compile(r'(name="palpate[^"]*method[^"]*" data=)"[^"]*"')
"""The twin's `<custom>` texts with the methods in words: wording may change, bytes around it may not."""


def palpate(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Run palpate without pictures."""
    code = "import sys; from palpate.cli.main import main; sys.exit(main())"
    return subprocess.run(
        [sys.executable, "-c", code, *arguments],
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | {"MUJOCO_GL": "disabled"},
    )


def scenarios() -> list[str]:
    """Names of all bundled scenarios, the slowest first."""
    rows = json.loads(palpate("scenarios", "--json").stdout)
    names = sorted(row["name"] for row in rows)
    return sorted(names, key=lambda name: name not in SLOW)


def measure(name: str, seed: int, noise: str) -> dict[str, object]:
    """Measure a row of the table."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "run"
        done = palpate(
            "demo", name, "--seed", str(seed), "--noise", noise, "--out", str(folder), "--json"
        )
        if not done.stdout:
            return {"exit": done.returncode, "error": done.stderr.strip().splitlines()[-1:]}
        return row(done.returncode, json.loads(done.stdout), folder)


def row(status: int, result: dict[str, Any], folder: Path) -> dict[str, object]:
    """Compared figures of a run."""
    kept = ("object", "quantity", "value", "unit", "std", "ci95", "verdict", "components")
    execution = result.get("execution") or {}
    twin = folder / "twin.xml"
    return {
        "exit": status,
        "status": result["status"],
        "parameters": [
            {key: parameter.get(key) for key in kept} for parameter in result["parameters"]
        ],
        "actions": execution.get("actions"),
        "robot_seconds": execution.get("robot_seconds"),
        "plan": digest((folder / "plan.json").read_text("utf-8"), tree_only=True),
        "twin": digest(SENTENCES.sub(r'\1""', twin.read_text("utf-8"))) if twin.exists() else None,
    }


def digest(text: str, tree_only: bool = False) -> str:
    """A short fingerprint of a text, or of the tree in a plan."""
    if tree_only:
        text = json.dumps(json.loads(text).get("tree"), sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def rows(quick: bool, only: list[str]) -> Iterator[tuple[str, str, int]]:
    """(scenario, noise, seed) of the rows to run."""
    names = [name for name in scenarios() if not only or name in only]
    if quick:
        yield from product([name for name in names if name not in SLOW], ("lab", "measured"), (0,))
        return
    for name in names:
        yield from product([name], NOISE, (0,) if name in SLOW else SEEDS)


def run(wanted: list[tuple[str, str, int]], jobs: int) -> dict[str, dict[str, object]]:
    """Rows by `scenario/noise/seed`."""
    with ThreadPoolExecutor(jobs) as pool:
        made = pool.map(lambda key: measure(key[0], key[2], key[1]), wanted)
        found = {}
        for (name, noise, seed), measured in zip(wanted, made, strict=True):
            print(".", end="", flush=True, file=sys.stderr)
            found[f"{name}/{noise}/{seed}"] = measured
    print(file=sys.stderr)
    return found


def difference(expected: dict[str, object], found: dict[str, object]) -> list[str]:
    """Differences between two rows, in words."""
    if not expected:
        return ["is not in the table"]
    return [
        f"{key}: {expected.get(key)} → {found.get(key)}"
        for key in expected | found
        if expected.get(key) != found.get(key)
    ]


def compare(quick: bool, only: list[str], jobs: int) -> int:
    """Print differences from the rows of the table; return the exit status."""
    table = json.loads(TABLE.read_text("utf-8"))
    wanted = [
        (n, noise, seed) for n, noise, seed in rows(quick, only) if f"{n}/{noise}/{seed}" in table
    ]
    found = run(wanted, jobs)
    failed = 0
    for key, measured in found.items():
        for line in difference(table.get(key, {}), json.loads(json.dumps(measured))):
            failed = 1
            print(f"{key}: {line}")
    print(f"{len(found)} rows, {'some differ' if failed else 'all identical'}")
    return failed


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("action", choices=("compare", "record"))
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--only", nargs="*", default=[])
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    given = parser.parse_args()
    if given.action == "compare":
        return compare(given.quick, given.only, given.jobs)
    table = run(list(rows(given.quick, given.only)), given.jobs)
    TABLE.write_text(json.dumps(table, indent=1) + "\n", "utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
