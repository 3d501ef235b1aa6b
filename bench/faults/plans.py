"""Corrupted plans: what the check says to each, and what those that it accepts, and those that it
refuses, do to the world when they are executed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from bench.campaign.ledger import (
    Drawn,
    Ledger,
    Row,
    drawn,
    judged_run,
    within_time,
)
from bench.faults.bases import Base, bases
from bench.faults.corrupt import Corrupted, corrupted
from bench.harm.probe import probed_run
from palpate.errors import InputError
from palpate.planning.check.check import check
from palpate.planning.plan import Plan, parse_plan
from palpate.quantities.estimators import estimate_all

NOISE = "lab"
UNBUILDABLE = frozenset({"unknown-primitive", "bad-argument", "leaf-children", "empty-composite"})
"""Rules without which there is no tree at all, check or no check."""
WANTED = {"accepted": "accepted", "bypass": "refused"}
"""What the check says to the plans that are executed, by the kind of their rows."""
LIGHTER = 0.7
"""Share of the plans that are drawn from those which are quick to execute."""


def made(case: Drawn) -> tuple[Base, Corrupted]:
    """A valid plan, and what it has become."""
    random = case.random()
    found: Sequence[Base] = bases()
    if random.random() < LIGHTER:
        found = [base for base in found if base.light]
    base = found[int(random.integers(0, len(found)))]
    return base, corrupted(base, random)


def checked(case: Drawn) -> Row:
    """What the check says to a corrupted plan."""
    base, plan = made(case)
    blank = case.blank(_what(base, plan))

    def work() -> Row:
        outcome, rules, said = _judged(base, plan)
        figures = {"base": base.name, "light": base.light, "rules": rules}
        return replace(blank, outcome=outcome, said=said, figures=figures)

    return within_time(work, blank)


def executed(case: Drawn) -> Row:
    """What a corrupted plan does to the world, whatever the check says to it."""
    base, corrupt = made(case)
    blank = case.blank(_what(base, corrupt))

    def work() -> Row:
        plan = parse_plan(corrupt.text)
        seen = probed_run(plan, base.scene, base.world, NOISE, case.number)
        estimate_all(plan.parameters, seen.execution.trace, base.scene.bodies)
        row = judged_run(blank, seen)
        turned = {name: round(angle, 3) for name, angle in seen.harm.turned.items()}
        return replace(row, figures={**row.figures, "base": base.name, "turned": turned})

    return within_time(work, blank)


def check_plans(
    folder: Path, count: int, seed: int, workers: int, say: Callable[[str], None]
) -> list[Row]:
    """`count` corrupted plans, judged by the check."""
    cases = drawn("plans", seed, count)
    return Ledger(folder / "plans.jsonl").complete(cases, checked, workers, say)


def execute_plans(
    folder: Path,
    kind: str,
    rows: Sequence[Row],
    count: int,
    workers: int,
    say: Callable[[str], None],
) -> list[Row]:
    """The first `count` plans in light scenes of a kind: `accepted` by the check, or refused, and
    executed all the same (`bypass`)."""
    chosen = [row for row in rows if row.outcome == WANTED[kind] and _is_quick(row)]
    cases = [Drawn(kind, *map(int, row.case.split("/"))) for row in chosen[:count]]
    return Ledger(folder / f"{kind}.jsonl").complete(cases, executed, workers, say)


def _is_quick(row: Row) -> bool:
    """Whether there is something to execute, and soon done."""
    return row.figures["light"] and not UNBUILDABLE & set(row.figures["rules"])


def _judged(base: Base, corrupt: Corrupted) -> tuple[str, list[str], tuple[str, ...]]:
    """Outcome, the rules that were broken, and the first messages."""
    try:
        plan = parse_plan(corrupt.text)
    except InputError as error:
        return "unreadable", [], (str(error)[:300],)
    findings = check(plan, base.scene, remeasure=base.remeasure)
    rules = sorted({finding.rule for finding in findings})
    said = tuple(f"{finding.path}: {finding.message}"[:300] for finding in findings[:3])
    if findings:
        return ("refused" if plan.tree is not None else "unreadable"), rules, said
    if plan.tree is None:
        return "unreadable", rules, said
    return ("unchanged" if _same(plan, base.plan) else "accepted"), rules, said


def _same(one: Plan, other: Plan) -> bool:
    """Whether nothing that moves was changed."""
    return one.tree == other.tree


def _what(base: Base, plan: Corrupted) -> str:
    return f"{base.name}: {'; '.join(plan.changes)}"[:500]
