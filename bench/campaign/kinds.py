"""All kinds of cases: run a campaign of one kind, repeat one case, write the page."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from bench.campaign.ledger import Case, Drawn, Ledger, Row, drawn, judged
from bench.campaign.page import counts, page
from bench.faults import hidden, inputs, nasty, plans, runtime, signals, stops
from bench.faults.bases import bases
from bench.schema import judging
from palpate import __version__
from palpate.common.errors import InputError, unknown_name

Work = Callable[..., Row]
"""Fills the blank row of a case: `work(case, blank)`, with what `Kind.given` returns as keywords."""


def warmed_up() -> dict[str, Any]:
    """Compute the valid plans once: workers are forks of this process."""
    bases()
    return {}


@dataclass(frozen=True, slots=True)
class Kind:
    """A kind of cases.

    Attributes:
        work: executes one.
        named: all cases, if they have names; else they are drawn at random.
        count: default number of random cases.
        given: keyword arguments of `work`, computed once before workers start.
        workers: most processes.
    """

    work: Work
    named: Sequence[Case] = ()
    count: int = 0
    given: Callable[[], dict[str, Any]] = dict[str, Any]
    workers: int | None = None


KINDS: dict[str, Kind] = {
    "plans": Kind(plans.check_plan, count=10_000, given=warmed_up),
    "accepted": Kind(plans.execute_plan, given=warmed_up),
    "bypass": Kind(plans.execute_plan, given=warmed_up),
    "nasty": Kind(nasty.judge, nasty.NASTY),
    "physics": Kind(nasty.judge, nasty.PHYSICS),
    "sensible": Kind(nasty.judge, nasty.SENSIBLE),
    "runtime": Kind(runtime.strike, runtime.CASES),
    "signals": Kind(
        signals.send, count=100, given=lambda: {"undisturbed": signals.undisturbed_seconds()}
    ),
    "stops": Kind(stops.stop, count=100, given=warmed_up),
    "astray": Kind(stops.stop, count=50, given=warmed_up),
    "poses": Kind(hidden.meet, count=100),
    "obstacles": Kind(hidden.meet, count=100),
    "cautious": Kind(hidden.meet, count=50),
    "light": Kind(hidden.meet, count=50),
    # Time and memory of a process are measured: one at a time.
    "inputs": Kind(inputs.give, inputs.BAD, workers=1),
    "schema": Kind(judging.judge_scene, count=2000),
}
REQUESTED = tuple(name for name, kind in KINDS.items() if kind.named or kind.count)
"""Kinds to ask for; the others are executed after `plans`."""


@dataclass(frozen=True, slots=True)
class Order:
    """Extent of a campaign.

    Attributes:
        folder: of its rows and its page; a campaign that was stopped is continued there.
        count: number of cases; by default `Kind.count`, or all named ones.
        execute: number of corrupted plans that are executed of those that the check accepts, and,
            with `bypass`, of those that it refuses.
    """

    folder: Path
    count: int | None = None
    execute: int = 0
    bypass: bool = False
    seed: int = 0
    workers: int = 1


def conduct(kind: str, order: Order, say: Callable[[str], None]) -> dict[str, list[Row]]:
    """Execute the cases of a kind, and write the page of all rows in the folder.

    Raises:
        InputError: there is no such kind.
    """
    if kind not in REQUESTED:
        raise unknown_name("kind of fault", kind, REQUESTED)
    count = order.count or KINDS[kind].count
    cases = named(kind, order.seed)[: count or None] or drawn(kind, order.seed, count)
    found = {kind: _completed(kind, cases, order, say)}
    if kind == "plans":
        executed = {"accepted": order.execute, "bypass": order.execute if order.bypass else 0}
        for name, number in executed.items():
            if number:
                quick = plans.quick_cases(name, found["plans"])
                found[name] = _completed(name, quick[:number], order, say)
    write(order.folder)
    return found


def named(kind: str, seed: int) -> list[Case]:
    """Cases of a kind that have names; those of written plans with an arm of this seed."""
    found = KINDS[kind].named
    return [replace(case, seed=seed) if isinstance(case, nasty.Written) else case for case in found]


def _completed(
    kind: str, cases: Sequence[Case], order: Order, say: Callable[[str], None]
) -> list[Row]:
    known = KINDS[kind]
    work = partial(known.work, **known.given())
    workers = min(order.workers, known.workers or order.workers)
    return Ledger(order.folder / f"{kind}.jsonl").complete(cases, work, workers, say)


def repeat(kind: str, case: str, seed: int) -> Row:
    """Execute one case again.

    Raises:
        InputError: there is no such kind, or no such case.
    """
    if kind not in KINDS:
        raise unknown_name("kind of fault", kind, KINDS)
    known = KINDS[kind]
    work = partial(known.work, **known.given())
    if not known.named:
        if not case.isdecimal():
            raise InputError(f"'{case}' is no case of this kind: cases have numbers")
        return judged(Drawn(kind, seed, int(case)), work)
    by_name = {each.name: each for each in named(kind, seed)}
    if case not in by_name:
        raise unknown_name("case", case, by_name)
    return judged(by_name[case], work)


def write(folder: Path) -> None:
    """Write `campaign.json` and `campaign.html` of all rows in the folder."""
    rows = {kind: Ledger(folder / f"{kind}.jsonl").rows() for kind in KINDS}
    rows = {kind: found for kind, found in rows.items() if found}
    documents = {kind: [asdict(row) for row in found] for kind, found in rows.items()}
    document = {"palpate": __version__, "summary": summary(rows), "rows": documents}
    text = json.dumps(document, ensure_ascii=False, indent=1)
    (folder / "campaign.json").write_text(text, encoding="utf-8")
    about = f"palpate {__version__}. Judged from MuJoCo's own state at every physics step."
    (folder / "campaign.html").write_text(page(rows, about), encoding="utf-8")


def summary(rows: Mapping[str, Sequence[Row]]) -> dict[str, dict[str, Any]]:
    """Counts, outcomes and the largest contact force of every kind."""
    found: dict[str, dict[str, Any]] = {}
    for kind, cases in rows.items():
        forces = [touch["mean10"] for row in cases for touch in row.touches]
        found[kind] = {
            **counts(cases),
            "endings": dict(Counter(row.outcome for row in cases)),
            "hardest": max(forces, default=None),
        }
    return found
