"""Scenes over MuJoCo's whole schema: read, filled with values, written, and judged without
palpate's own reading."""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from random import Random

from bench.campaign.ledger import Drawn, Ledger, Row, drawn, within_time
from bench.schema.judging import judge

STEPS = 60
"""Tries to add an element or an attribute to one scene."""
QUOTED = re.compile(r"'[^']*'|\"[^\"]*\"|[\d.]+")


def grown(case: Drawn) -> Row:
    """The row of one random scene."""
    blank = case.blank()
    return within_time(lambda: _grown(case, blank), blank)


def _grown(case: Drawn, blank: Row) -> Row:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        verdict = judge(Random(case.seed + case.number), STEPS)
    reason = QUOTED.sub("…", verdict.refused)[:160]
    return replace(
        blank,
        outcome="refused" if verdict.refused else "accepted",
        said=(reason,) if reason else (),
        beyond=tuple(verdict.wrong),
        figures={"read back": verdict.values, "without a place": len(verdict.unwritten)},
    )


def grow(
    folder: Path, count: int, seed: int, workers: int, say: Callable[[str], None]
) -> list[Row]:
    """`count` random scenes."""
    cases = drawn("schema", seed, count)
    return Ledger(folder / "schema.jsonl").complete(cases, grown, workers, say)
