"""Corrupted plans: judged by the check; accepted and refused ones executed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from bench.campaign.ledger import Drawn, Row, judged_run
from bench.faults.bases import Base, bases
from bench.faults.corrupt import Corrupted, corrupted
from bench.harm.probe import probed_run
from palpate.common.errors import InputError
from palpate.estimation.quantities.estimators import estimate_all
from palpate.planning.check.check import check
from palpate.planning.plan import parse_plan

NOISE = "lab"
UNBUILDABLE = frozenset({"unknown-primitive", "bad-argument", "leaf-children", "empty-composite"})
"""Rules whose violation leaves no tree to execute."""
WANTED = {"accepted": "accepted", "bypass": "refused"}
"""Outcome of the check for the plans that are executed, by kind."""
LIGHTER = 0.7
"""Share of the plans that are drawn from the quick ones."""


def made(case: Drawn) -> tuple[Base, Corrupted]:
    """Draw a valid plan and corrupt it."""
    random = case.random()
    found: Sequence[Base] = bases()
    if random.random() < LIGHTER:
        found = [base for base in found if base.light]
    base = found[int(random.integers(0, len(found)))]
    return base, corrupted(base, random)


def check_plan(case: Drawn, blank: Row) -> Row:
    """Judge a corrupted plan by the check."""
    base, corrupt = made(case)
    blank = replace(blank, what=_description(base, corrupt))
    figures = {"base": base.name, "light": base.light, "rules": list[str]()}
    try:
        plan = parse_plan(corrupt.text)
    except InputError as error:
        return replace(blank, outcome="unreadable", said=(str(error)[:300],), figures=figures)
    findings = check(plan, base.scene, remeasure=base.remeasure)
    figures["rules"] = sorted({finding.rule for finding in findings})
    outcome = "unchanged" if plan.tree == base.plan.tree else "accepted"
    if plan.tree is None:
        outcome = "unreadable"
    elif findings:
        outcome = "refused"
    said = tuple(f"{finding.path}: {finding.message}"[:300] for finding in findings[:3])
    return replace(blank, outcome=outcome, said=said, figures=figures)


def execute_plan(case: Drawn, blank: Row) -> Row:
    """Execute a corrupted plan, accepted by the check or not."""
    base, corrupt = made(case)
    plan = parse_plan(corrupt.text)
    seen = probed_run(plan, base.scene, base.world, NOISE, case.number)
    estimate_all(plan.parameters, seen.execution.trace, base.scene.bodies)
    row = judged_run(replace(blank, what=_description(base, corrupt)), seen)
    turned = {name: round(angle, 3) for name, angle in seen.harm.turned.items()}
    return replace(row, figures={**row.figures, "base": base.name, "turned": turned})


def quick_cases(kind: str, rows: Sequence[Row]) -> list[Drawn]:
    """Cases of kind `accepted` or `bypass`, from the rows of checked plans: those with a tree, in
    scenes that are quick to simulate."""
    chosen = [
        row
        for row in rows
        if row.outcome == WANTED[kind]
        and row.figures["light"]
        and not UNBUILDABLE & set(row.figures["rules"])
    ]
    return [Drawn(kind, *map(int, row.case.split("/"))) for row in chosen]


def _description(base: Base, plan: Corrupted) -> str:
    return f"{base.name}: {'; '.join(plan.changes)}"[:500]
