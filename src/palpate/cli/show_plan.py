"""Plans, findings of the check, and prompts on the terminal."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

from palpate.cli.console import escape, out, print_json
from palpate.cli.show_layout import show_next
from palpate.common.display import visible
from palpate.common.redaction import redact
from palpate.runs.reproduce import execute_command, run_command

if TYPE_CHECKING:
    from palpate.planning.check.finding import Finding
    from palpate.planning.plan import Plan
    from palpate.runs.api import Plan as CheckedPlan
    from palpate.runs.run import Run
    from palpate.runs.settings import Settings


def show_plan(plan: CheckedPlan, as_json: bool, file: Path | None) -> None:
    """Print a plan: parameters, tree in the paper's notation, explanation, findings. Write it to a file as well."""
    from palpate.runs.result import finding_json, plan_text

    text = plan_text(plan.run_so_far)
    if file:
        file.write_text(redact(text), encoding="utf-8")
    if as_json:
        print_json(json.loads(text) | {"findings": list(map(finding_json, plan.findings))})
        return
    print_plan(plan, out)
    _print_findings(plan.findings)
    show_proposal(plan.run_so_far)
    if not plan.run_so_far.ready:
        return
    settings = plan.run_so_far.settings
    if file is not None:
        show_next("let the arm carry it out", execute_command(settings, file))
    else:
        show_next("let the arm carry it out", run_command(settings))


def print_plan(plan: Plan, console: Console) -> None:
    """Print parameters, tree, explanation and notes of a plan."""
    from palpate.runs.tools import paper_notation

    names = ", ".join(str(parameter) for parameter in plan.parameters)
    console.print("measures  ", names or "nothing", markup=False, soft_wrap=True)
    if plan.tree:
        console.print(*paper_notation(plan.tree), sep="\n", markup=False, soft_wrap=True)
    console.print(f"\n{plan.explanation}", markup=False)
    show_notes(plan, console)


def understood(plan: Plan) -> str:
    """Word a proposal, as "I understand: mass of red_can.", with the words that are not used."""
    labels = [f"{parameter.quantity} of {parameter.object}" for parameter in plan.proposal]
    sentence = f"I understand: {', '.join(labels)}."
    if plan.not_used:
        sentence += f" Not used: {', '.join(repr(words) for words in plan.not_used)}."
    return sentence


def show_proposal(run: Run) -> None:
    """Print the proposal of a rejected plan, if any, and the command that accepts it."""
    if run.plan.proposal:
        from palpate.runs.answer import has_comparison

        # The accepted command has the parameters instead of the request. A question keeps it, because
        # its answer needs it.
        out.prose(f"\n{escape(understood(run.plan))}")
        request = run.settings.request if has_comparison(run) else None
        accepted = run.settings.having(request=request, measure=run.plan.proposal)
        show_next("measure that", run_command(accepted))


def show_notes(plan: Plan, console: Console) -> None:
    """Print the remarks of the planner."""
    for note in plan.notes:
        console.print(f"[dim]note[/] {escape(note)}")


def show_findings(findings: Iterable[Finding], as_json: bool) -> None:
    """Print the findings of the check on a plan."""
    from palpate.runs.result import finding_json

    rows = list(map(finding_json, findings))
    if as_json:
        print_json({"valid": not rows, "findings": rows})
    elif rows:
        _print_findings(findings)
    else:
        out.print("[green]valid[/]")


def _print_findings(findings: Iterable[Finding]) -> None:
    for finding in findings:
        out.print(f"[yellow]{finding.rule}[/] {finding.path}: {escape(finding.message)}")


def show_prompt(settings: Settings, as_json: bool) -> None:
    """Print system prompt, user message and images as a model would receive them."""
    from palpate.runs.tools import prompt as compose

    prompt = compose(settings)
    images = [str(path) for path in prompt.images]
    if as_json:
        print_json({"system": prompt.system, "user": prompt.user, "images": images})
        return
    parts = [part for part in (prompt.system.rstrip(), prompt.user) if part]
    text = "\n\n".join(parts)
    if images:
        text = "\n".join([text, "Attach:", *images])
    sys.stdout.write(visible(text) + "\n")
