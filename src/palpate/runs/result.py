"""`result.json`: the contract with scripts."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from palpate import __version__
from palpate.estimation.estimate import Estimate
from palpate.planning.plan import dump_plan

if TYPE_CHECKING:
    from palpate.pipeline import Outcome
    from palpate.twin.validate import Residual, Validation


def result_json(outcome: Outcome, folder: Path | None) -> dict[str, Any]:
    """The content of `result.json`, which `--json` prints too."""
    return {
        "status": outcome.status,
        "request": outcome.job.request,
        "parameters": [parameter_json(e) for e in outcome.estimates],
        "plan": {
            "planner": outcome.plan.planner,
            "actions": outcome.plan.actions,
            "explanation": outcome.plan.explanation,
            "notes": list(outcome.plan.notes),
            "findings": [
                {"path": f.path, "rule": f.rule, "message": f.message} for f in outcome.findings
            ],
        },
        "rehearsal": asdict(outcome.rehearsal) if outcome.rehearsal else None,
        "execution": _execution_json(outcome),
        "twin": _twin_json(outcome),
        "files": _files(outcome, folder),
        "provenance": {
            "palpate": __version__,
            "seed": outcome.job.seed,
            "noise": outcome.job.noise,
            "world": outcome.cell.description if outcome.cell else None,
        },
    }


def plan_text(outcome: Outcome) -> str:
    """The content of `plan.json`: the plan, what a model saw in the picture, and what it took to
    ask the model."""
    seen = {"scene": [asdict(thing) for thing in outcome.seen.objects]} if outcome.seen else {}
    asked = outcome.conversation.summary() if outcome.conversation else {}
    return dump_plan(outcome.plan, seen | asked)


def parameter_json(estimate: Estimate) -> dict[str, Any]:
    """One estimate; scalars for quantities of one component, lists for the others, null where
    nothing is known."""

    def shape(numbers: list[Any]) -> Any:
        return numbers[0] if len(numbers) == 1 else numbers or None

    return {
        "object": estimate.parameter.object,
        "quantity": estimate.parameter.quantity,
        "value": shape(estimate.value.tolist()),
        "unit": estimate.unit,
        "std": shape(estimate.std.tolist()),
        "ci95": shape(estimate.ci95.tolist()),
        "method": estimate.method,
        "verdict": estimate.verdict,
        "components": {
            name: {"value": part.value, "std": part.std} for name, part in estimate.parts.items()
        },
    }


def _execution_json(outcome: Outcome) -> dict[str, Any] | None:
    done = outcome.execution
    if done is None:
        return None
    return {
        "actions": done.actions,
        "robot_seconds": round(done.robot_seconds, 3),
        "wall_seconds": round(done.wall_seconds, 3),
        "stopped_by": done.stopped_by,
        "setbacks": list(done.setbacks),
    }


def _twin_json(outcome: Outcome) -> dict[str, Any] | None:
    if outcome.twin is None:
        return None
    return {
        "notes": list(outcome.twin.notes),
        "validation": _validation_json(outcome.twin.validation),
    }


def _validation_json(marks: Validation | None) -> dict[str, Any] | None:
    if marks is None:
        return None

    def residual(r: Residual) -> dict[str, Any]:
        return {"force_N": r.force, "position_m": r.position, "note": r.note}

    return {
        "settled": marks.settled,
        "drift_m": marks.drift,
        "residual_twin": residual(marks.twin),
        "residual_template": residual(marks.template),
    }


def _files(outcome: Outcome, folder: Path | None) -> dict[str, str]:
    if folder is None:
        return {}
    names = {"request": "request.json", "plan": "plan.json", "report": "report.html"}
    if outcome.plan.tree:
        names["tree"] = "tree.xml"
    if outcome.conversation:
        names["conversation"] = "conversation.json"
    if outcome.seen:
        names["scene"] = "scene.xml"
    if outcome.execution:
        names["trace"] = "trace.mcap"
    if outcome.twin:
        names["twin"] = "twin.xml"
    return {kind: str((folder / name).absolute()) for kind, name in names.items()}
