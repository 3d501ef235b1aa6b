"""Corrupted plans: what the check says to each, and what those that it accepts, and those that it
refuses, do to the world when they are executed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from palpate.errors import InputError
from palpate.planning.check.check import check
from palpate.planning.plan import Plan, parse_plan
from palpate.quantities.estimators import estimate_all
from palpate.studies.campaign.bases import Base, bases
from palpate.studies.campaign.corrupt import Corrupted, corrupted
from palpate.studies.campaign.ledger import Ledger, Row, touches_of, within_time
from palpate.studies.probe import probed_run

NOISE = "lab"
UNBUILDABLE = frozenset({"unknown-primitive", "bad-argument", "leaf-children", "empty-composite"})
"""Rules without which there is no tree at all, check or no check."""
LIGHTER = 0.7
"""Share of the plans that are drawn from those which are quick to execute."""


@dataclass(frozen=True, slots=True)
class Case:
    """One corrupted plan: the number of it, from a seed."""

    seed: int
    number: int

    @property
    def name(self) -> str:
        return f"{self.seed}/{self.number}"

    def made(self) -> tuple[Base, Corrupted]:
        """The valid plan that it was, and what it has become."""
        random = np.random.default_rng([self.seed, self.number])
        found: Sequence[Base] = bases()
        if random.random() < LIGHTER:
            found = [base for base in found if base.light]
        base = found[int(random.integers(0, len(found)))]
        return base, corrupted(base, random)

    def command(self, kind: str) -> str:
        """What repeats it."""
        return f"palpate study faults --kind {kind} --seed {self.seed} --case {self.number}"


def checked(case: Case) -> Row:
    """What the check says to a corrupted plan."""
    base, plan = case.made()
    blank = Row("plans", case.name, _what(base, plan), case.command("plans"), "")

    def work() -> Row:
        outcome, rules, said = _judged(base, plan)
        figures = {"base": base.name, "light": base.light, "rules": rules}
        return Row("plans", case.name, blank.what, blank.command, outcome, said, figures=figures)

    return within_time(work, blank)


def executed(case: Case, bypass: bool) -> Row:
    """What a corrupted plan does to the world; `bypass`: though the check refuses it."""
    kind = "bypass" if bypass else "accepted"
    base, corrupt = case.made()
    what = _what(base, corrupt)
    blank = Row(kind, case.name, what, case.command(kind), "")

    def work() -> Row:
        plan = parse_plan(corrupt.text)
        seen = probed_run(plan, base.scene, base.world, NOISE, case.number)
        done = seen.execution
        estimate_all(plan.parameters, done.trace, base.scene.bodies)
        figures = {
            "base": base.name,
            "robot_seconds": round(done.robot_seconds, 2),
            "turned": {name: round(angle, 3) for name, angle in seen.harm.turned.items()},
        }
        return Row(
            kind,
            case.name,
            what,
            blank.command,
            done.status,
            (done.stopped_by,) if done.stopped_by else (),
            beyond=seen.harm.beyond,
            touches=touches_of(seen.harm),
            figures=figures,
        )

    return within_time(work, blank)


def plan_of(case: Case) -> str:
    """The text of a corrupted plan."""
    return case.made()[1].text


def check_plans(
    folder: Path, count: int, seed: int, workers: int, say: Callable[[str], None]
) -> list[Row]:
    """`count` corrupted plans, judged by the check."""
    cases = [Case(seed, number) for number in range(count)]
    return Ledger(folder / "plans.jsonl").complete(cases, _name, checked, workers, say)


def execute_plans(
    folder: Path,
    rows: Sequence[Row],
    count: int,
    workers: int,
    say: Callable[[str], None],
    bypass: bool,
) -> list[Row]:
    """The first `count` of the plans in light scenes that were accepted, or, with `bypass`, that
    were refused."""
    wanted = "refused" if bypass else "accepted"
    chosen = [row for row in rows if row.outcome == wanted and _is_quick(row)]
    cases = [Case(*map(int, row.case.split("/"))) for row in chosen[:count]]
    name = "bypass" if bypass else "accepted"
    work = partial(executed, bypass=bypass)
    return Ledger(folder / f"{name}.jsonl").complete(cases, _name, work, workers, say)


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


def _name(case: Case) -> str:
    return case.name
