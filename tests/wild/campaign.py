"""`python -m tests.wild.campaign --count 2000`: scenes over MuJoCo's whole schema through palpate's
reading, and, filled with values, through the twin. Files that went wrong are kept in `--out`."""

from __future__ import annotations

import argparse
import collections
import re
import sys
import time
import traceback
import warnings
from pathlib import Path
from random import Random

from .judging import Verdict, judge
from .schema import kinds


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--steps", type=int, default=60)
    parser.add_argument("--tell", action="store_true", help="say why each refused file is")
    parser.add_argument("--out", type=Path, default=None)
    asked = parser.parse_args()
    warnings.simplefilter("ignore")
    began = time.monotonic()
    figures: collections.Counter[str] = collections.Counter()
    reasons: collections.Counter[str] = collections.Counter()
    used: set[tuple[str, str]] = set()
    for seed in range(asked.seed, asked.seed + asked.count):
        try:
            verdict = judge(Random(seed), asked.steps)
        except Exception:
            verdict = Verdict("", wrong=[traceback.format_exc(limit=-4)])
            figures["crashed"] += 1
        used |= verdict.used
        figures["files"] += 1
        figures["accepted"] += bool(verdict.text) and not verdict.refused
        figures["values read back"] += verdict.values
        figures["values without a place, told"] += len(verdict.unwritten)
        figures["wrong"] += bool(verdict.wrong)
        if verdict.refused:
            if asked.tell:
                print(f"seed {seed}: refused: {verdict.refused}", flush=True)
            reasons[re.sub(r"'[^']*'|\"[^\"]*\"|[\d.]+", "…", verdict.refused)[:160]] += 1
        for line in verdict.wrong:
            print(f"seed {seed}: {line}", flush=True)
        if verdict.wrong and asked.out is not None:
            asked.out.mkdir(parents=True, exist_ok=True)
            (asked.out / f"{seed}.xml").write_text(verdict.text, encoding="utf-8", newline="")
    for name, number in figures.items():
        print(f"{number:7d} {name}")
    tags = {tag for tag, _ in used}
    known = {(kind.tag, name) for kind in kinds() for name in kind.attributes}
    print(f"{len(tags):7d} kinds of elements of {len({kind.tag for kind in kinds()})}")
    print(f"{len(used & known):7d} attributes of {len(known)}")
    for reason, number in reasons.most_common():
        print(f"{number:7d} refused: {reason}")
    print(f"{time.monotonic() - began:7.0f} s")
    return int(figures["wrong"] > 0)


if __name__ == "__main__":
    sys.exit(main())
