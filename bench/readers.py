"""Table of what acts of an export in simulators that are installed in other environments.

`python -m bench.readers RUN --python ENV/bin/python ...` exports the twin of a run folder as MJCF,
URDF and USD, loads each in every reader that one of the interpreters has, and prints one row a reader
and one column a quantity. The environments need not have palpate. `--portable` reads
`portable.xml` instead of the MJCF.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

import palpate
from palpate.common.errors import Unavailable
from palpate.twin.export import FORMATS, PORTABLE, check_written
from palpate.twin.export_check import TOLERANCE, Finding


def check_run(run: Path, pythons: list[str], portable: bool) -> dict[str, list[Finding]]:
    """Check all formats of a run's twin; findings by format."""
    found: dict[str, list[Finding]] = {}
    with tempfile.TemporaryDirectory() as folder:
        finished = palpate.open(run)
        source = finished.export("mjcf", Path(folder) / "mjcf").file
        for chosen in FORMATS[:3]:
            try:
                file = source
                if chosen != "mjcf":
                    file = finished.export(chosen, Path(folder) / chosen).file
                elif portable:
                    file = source.with_name(PORTABLE)
            except Unavailable as error:
                print(error, file=sys.stderr)
                continue
            found[chosen] = []
            for python in pythons:
                known = {finding.reader for finding in found[chosen]}
                made = check_written(source, file, chosen, finished.estimates, python)
                found[chosen] += [finding for finding in made if finding.reader not in known]
    return found


def table(found: dict[str, list[Finding]]) -> str:
    """Markdown: a row for each format and reader, a column for each quantity."""
    quantities = ("file", *TOLERANCE)
    lines = ["| format | reader | " + " | ".join(quantities[1:]) + " |"]
    lines.append("|---" * (len(quantities) + 1) + "|")
    for chosen, findings in found.items():
        for reader in dict.fromkeys(finding.reader for finding in findings):
            by = {f.quantity: f for f in findings if f.reader == reader}
            if "file" in by:
                cells = [f"lost: {by['file'].detail}", *[""] * (len(quantities) - 2)]
            else:
                cells = [cell_of(by.get(quantity)) for quantity in quantities[1:]]
            lines.append(f"| {chosen} | {reader} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def cell_of(finding: Finding | None) -> str:
    if finding is None:
        return ""
    return finding.verdict if finding.verdict != "differs" else finding.detail


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("run", type=Path)
    parser.add_argument("--python", action="append", default=[], help="interpreter of a reader")
    parser.add_argument("--portable", action="store_true")
    given = parser.parse_args()
    print(table(check_run(given.run, given.python or [sys.executable], given.portable)))


if __name__ == "__main__":
    main()
