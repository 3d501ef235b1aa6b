"""The whole campaign: every kind of fault, its rows, the page, and the one case that is repeated."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from bench.campaign.ledger import Case, Drawn, Ledger, Row
from bench.campaign.page import TITLES, counts, page
from bench.faults import hidden, inputs, nasty, plans, runtime, signals
from bench.faults.bases import bases
from bench.schema import campaign as schema
from palpate import __version__
from palpate.errors import InputError, unknown_name

KINDS = tuple(TITLES)
ASKED = (
    "plans",
    "nasty",
    "runtime",
    "signals",
    "poses",
    "obstacles",
    "cautious",
    "light",
    "inputs",
    "schema",
)
"""Kinds that can be asked for; the others come with `plans`."""
DEFAULTS = {
    "plans": 10_000,
    "signals": 100,
    "poses": 100,
    "obstacles": 100,
    "cautious": 50,
    "light": 50,
    "schema": 2000,
}
"""How many cases of the kinds that are drawn at random."""
BY_NAME: dict[str, tuple[Sequence[Case], Callable[[Any], Row]]] = {
    "nasty": (nasty.NASTY, nasty.judged),
    "runtime": (runtime.CASES, runtime.struck),
    "inputs": (inputs.BAD, inputs.given),
}
"""Kinds whose cases have names: all of them, and what is done with one."""


@dataclass(frozen=True, slots=True)
class Order:
    """What a campaign is to do.

    Attributes:
        folder: of its rows and its page; one that was stopped goes on there.
        count: cases, None for as many as `DEFAULTS` says, or all there are.
        execute: corrupted plans that are executed of those which the check accepts, and, with
            `bypass`, as many again of those that it refuses.
    """

    folder: Path
    count: int | None = None
    execute: int = 0
    bypass: bool = False
    seed: int = 0
    workers: int = 1


def conduct(kind: str, order: Order, say: Callable[[str], None]) -> dict[str, list[Row]]:
    """Do all cases of a kind, and write the page of all that lie in the folder.

    Raises:
        InputError: there is no such kind.
    """
    if kind not in ASKED:
        raise unknown_name("kind of fault", kind, ASKED)
    found = _conducted(kind, order, say)
    write(order.folder)
    return found


def _conducted(kind: str, order: Order, say: Callable[[str], None]) -> dict[str, list[Row]]:
    folder, seed, workers = order.folder, order.seed, order.workers
    count = DEFAULTS.get(kind, 10_000) if order.count is None else order.count
    if kind == "plans":
        return _plans(order, count, say)
    if kind == "nasty":
        return {kind: nasty.judge_nasty(folder, workers, say)}
    if kind == "runtime":
        return {kind: runtime.strike(folder, count, workers, say)}
    if kind == "signals":
        return {kind: signals.send(folder, count, seed, workers, say)}
    if kind == "schema":
        return {kind: schema.grow(folder, count, seed, workers, say)}
    if kind == "inputs":
        return {kind: inputs.give(folder, say)}
    return {kind: hidden.meet(folder, kind, count, seed, workers, say)}


def _plans(order: Order, count: int, say: Callable[[str], None]) -> dict[str, list[Row]]:
    folder, workers = order.folder, order.workers
    if workers > 1:
        bases()  # worked out once: the workers are forks of this process, and have them, too
    rows = plans.check_plans(folder, count, order.seed, workers, say)
    found = {"plans": rows}
    if order.execute:
        found["accepted"] = plans.execute_plans(
            folder, "accepted", rows, order.execute, workers, say
        )
    if order.bypass:
        found["bypass"] = plans.execute_plans(folder, "bypass", rows, order.execute, workers, say)
    return found


def repeat(kind: str, case: str, seed: int) -> Row:
    """One case again.

    Raises:
        InputError: there is no such kind, or no such case.
    """
    if kind in BY_NAME:
        known, work = BY_NAME[kind]
        by_name = {each.name: each for each in known}
        if case not in by_name:
            raise unknown_name("case", case, by_name)
        return work(by_name[case])
    if kind not in KINDS:
        raise unknown_name("kind of fault", kind, KINDS)
    if not case.isdecimal():
        raise InputError(f"'{case}' is no case of this kind: cases have numbers")
    return _again(Drawn(kind, seed, int(case)))


def _again(case: Drawn) -> Row:
    if case.kind == "plans":
        return plans.checked(case)
    if case.kind in plans.WANTED:
        return plans.executed(case)
    if case.kind == "signals":
        return signals.sent(case, signals.whole_run())
    if case.kind == "schema":
        return schema.grown(case)
    return hidden.met(case)


def write(folder: Path) -> None:
    """`campaign.json` and `campaign.html`, of all rows that lie in the folder."""
    rows = {kind: Ledger(folder / f"{kind}.jsonl").rows() for kind in KINDS}
    rows = {kind: found for kind, found in rows.items() if found}
    document = {"palpate": __version__, "summary": summary(rows), "rows": _documents(rows)}
    text = json.dumps(document, ensure_ascii=False, indent=1)
    (folder / "campaign.json").write_text(text, encoding="utf-8")
    about = f"palpate {__version__}. Judged from MuJoCo's own state at every physics step."
    (folder / "campaign.html").write_text(page(rows, about), encoding="utf-8")


def summary(rows: dict[str, list[Row]]) -> dict[str, dict[str, Any]]:
    """Counts, endings and the hardest contact of every kind."""
    found: dict[str, dict[str, Any]] = {}
    for kind, cases in rows.items():
        forces = [touch["mean10"] for row in cases for touch in row.touches]
        found[kind] = {
            **counts(cases),
            "endings": dict(Counter(row.outcome for row in cases)),
            "hardest": max(forces, default=None),
        }
    return found


def _documents(rows: dict[str, list[Row]]) -> dict[str, list[dict[str, Any]]]:
    return {kind: [asdict(row) for row in found] for kind, found in rows.items()}
