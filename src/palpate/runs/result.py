"""`result.json`: the contract with scripts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from palpate.common.belief import Belief
from palpate.common.display import to_json
from palpate.common.pose import Array, Pose
from palpate.common.version import __version__
from palpate.estimation.estimate import Estimate, FitTest, axes_of
from palpate.planning.check.finding import Finding
from palpate.planning.plan import dump_plan, proposal_json
from palpate.runs.answer import answer
from palpate.runs.held_out import HeldOut
from palpate.runs.reproduce import POSES
from palpate.runs.run import Run
from palpate.twin.twin import Twin
from palpate.twin.validate import ReplayResidual, Validation


def held_out_json(held_out: HeldOut | None) -> dict[str, Any] | None:
    """Held-out motions as JSON: all together, and one by one.

    The least probable motion counts for all of them, and any one that disagrees.
    """
    if held_out is None:
        return None
    motions = held_out.motions
    disagreements = [motion.disagreement for motion in motions if motion.disagreement]
    return {
        "motion": "; ".join(motion.motion for motion in motions) or None,
        "chi2": sum(motion.chi2 for motion in motions),
        "dof": sum(motion.dof for motion in motions),
        "p": min((motion.p for motion in motions), default=None),
        "agrees": held_out.agrees if motions else None,
        "disagreement": " ".join(disagreements) or None,
        "notes": held_out.notes,
        "motions": [
            asdict(motion) | {"tests": _tests_json(motion.tests), "agrees": motion.agrees}
            for motion in motions
        ],
    }


def _tests_json(tests: Sequence[FitTest]) -> list[dict[str, Any]]:
    return [asdict(test) | {"passed": test.passed} for test in tests]


# The document `result.json`: the contract with scripts.

CYCLES = "cycles.npz"  # Log of a real robot's last seconds before a stop, in a run folder


def result_json(run: Run, folder: Path | None) -> dict[str, Any]:
    """Content of `result.json`, which `--json` also prints."""
    from palpate.robots.simulated.noise.models import noise_models

    parameters: list[dict[str, Any]] = []
    for estimate in run.estimates:
        precision = run.settings.within.precision(estimate)
        within = asdict(precision) | {"outcome": precision.outcome} if precision else None
        true = shape_value(run.truth.get(estimate.parameter))
        parameters.append(parameter_json(estimate) | {"within": within, "true_value": true})
    content = {
        "status": run.status,
        "stage": run.stage,
        "interrupted": run.interrupted,
        "shortfalls": run.shortfalls,
        "simulated": run.simulated,
        "truth": _truth(run),
        "request": run.settings.request,
        "answer": answer(run),
        **proposal_json(run.plan),
        "parameters": parameters,
        "poses": [belief_json(name, belief) for name, belief in run.beliefs.items()],
        "plan": {
            "planner": run.plan.planner,
            "actions": run.plan.actions,
            "explanation": run.plan.explanation,
            "notes": run.plan.notes,
            "findings": [finding_json(finding) for finding in run.findings],
        },
        "rehearsal": run.rehearsal.figures() if run.rehearsal else None,
        "execution": _execution_json(run),
        "validation": {"held_out": held_out_json(run.held_out)},
        "twin": None if run.finished is None else twin_json(run.finished),
        "files": _files(run, folder),
        "provenance": {
            "palpate": __version__,
            "seed": None if run.is_recorded else run.settings.seed,
            "noise": None if run.is_recorded else noise_models().title(run.settings.noise),
            "world": run.world,
        },
    }
    return to_json(content)


def _truth(run: Run) -> str | None:
    """Source of the true values of a simulation; null for a real robot."""
    if not run.simulated:
        return None
    if run.drawn:
        return "drawn from priors"
    return run.settings.world.name if run.settings.world else run.world


def finding_json(finding: Finding) -> dict[str, str]:
    """Finding of the check as JSON."""
    return {"path": finding.path, "rule": finding.rule, "message": finding.message}


def plan_text(run: Run) -> str:
    """Content of `plan.json`: the plan, objects that a model detected, and the cost of the model."""
    # A plan of a model also keeps its detected objects and its cost.
    more: dict[str, Any] = {}
    if run.seen is not None:
        more["scene"] = [asdict(item) for item in run.seen.objects]
    if run.conversation is not None:
        more |= run.conversation.summary()
    return dump_plan(run.plan, more)


def parameter_json(estimate: Estimate) -> dict[str, Any]:
    """Estimate as JSON: scalars for quantities of one component, lists for the others, null for unknown values."""
    # Verdicts by axis, for quantities of several components.
    several = len(estimate.values) > 1
    axes = dict(zip(axes_of(len(estimate.values)), estimate.verdicts, strict=True))
    row = {
        "object": estimate.parameter.object,
        "quantity": estimate.parameter.quantity,
        "value": shape_value(estimate.values),
        "unit": estimate.unit,
        "std": shape_value(estimate.stds),
        "ci95": shape_value(estimate.intervals),
        "method": estimate.method,
        "verdict": estimate.verdict,
        "verdicts": estimate.verdicts if several else None,
        "unseen": estimate.unseen,
        "whole": estimate.whole,
        "reason": estimate.reason or None,
        "bounds": np.array(estimate.bounds, dtype=np.float64),
        "at_most": _limit(estimate, 1),
        "at_least": _limit(estimate, -1),
        "axes": axes if several else None,
        "contradiction": estimate.contradiction or None,
        "tests": _tests_json(estimate.tests),
        "components": estimate.parts,
        "shared": estimate.shared,
        "freedom": estimate.freedom,
        "evidence": estimate.evidence,
    }
    return to_json(row)


def _limit(estimate: Estimate, sign: int) -> Any:
    """Limits (95 %, one-sided) of the components at a lower bound (`sign` 1) or an upper one (-1);
    null for the others.
    """
    # Only components at a bound on that side have a limit.
    pairs = zip(estimate.at_bound, estimate.limits, strict=True)
    limits = [limit if bound and bound.sign == sign else None for bound, limit in pairs]
    return shape_value(limits) if any(limit is not None for limit in limits) else None


def belief_json(name: str, belief: Belief) -> dict[str, Any]:
    """Pose of an object by sight, by touch and by both."""
    content = {
        "object": name,
        "sight": _pose_json(belief.seen) | {"covariance": belief.seen_covariance},
        "touch": [
            asdict(touch) | {"z": touch.z, "contradicts": touch.contradicts}
            for touch in belief.touches
        ],
        "both": _pose_json(belief.pose) | {"covariance": belief.covariance},
        "stood": _pose_json(belief.placed),
        "contradiction": belief.contradiction or None,
    }
    return to_json(content)


def _pose_json(pose: Pose) -> dict[str, Any]:
    return {"pos": pose.position, "quat": pose.quaternion}


def shape_value(numbers: Sequence[Any] | Array | None) -> Any:
    """Convert a list of one to a scalar, and an empty or absent one to null."""
    if numbers is None or not len(numbers):
        return None
    return numbers[0] if len(numbers) == 1 else numbers


def has_own_scene(run: Run) -> bool:
    """True if the scene came from no file: it was detected in a picture, or given as text."""
    from_no_file = run.settings.scene is None and bool(run.scene.bodies)
    return from_no_file or run.seen is not None


def _execution_json(run: Run) -> dict[str, Any] | None:
    done = run.execution
    if done is None:
        return None
    return {
        "actions": done.actions,
        "robot_seconds": round(done.robot_seconds, 3),
        "wall_seconds": round(done.wall_seconds, 3),
        "total_seconds": None if run.total_seconds is None else round(run.total_seconds, 3),
        "stopped_by": done.stopped_by,
        "setbacks": done.setbacks,
        "held": done.held,
    }


def twin_json(twin: Twin) -> dict[str, Any]:
    """Twin as JSON: notes, unwritten values, validation."""
    return {
        "notes": twin.notes,
        "unwritten": [str(parameter) for parameter in twin.unwritten],
        "validation": _validation_json(twin.validation),
    }


def _validation_json(marks: Validation | None) -> dict[str, Any] | None:
    if marks is None:
        return None
    return {
        "settled": marks.settled,
        "drift_m": marks.drift,
        "residual_twin": _residual_json(marks.twin),
        "residual_template": _residual_json(marks.template),
    }


def _residual_json(residual: ReplayResidual) -> dict[str, Any]:
    return {"force_N": residual.force, "position_m": residual.position, "note": residual.note}


def _files(run: Run, folder: Path | None) -> dict[str, str]:
    if folder is None:
        return {}
    # Names of the files that such a run has.
    names = {"request": "request.json", "plan": "plan.json", "report": "report.html"}
    if run.plan.tree:
        names["tree"] = "tree.xml"
    if run.conversation:
        names["conversation"] = "conversation.json"
    if has_own_scene(run):
        names["scene"] = "scene.xml"
    if run.settings.camera is not None:
        names["poses"] = POSES
    if run.execution:
        names["trace"] = "trace.mcap"
    if run.black_box or (folder / CYCLES).exists():
        names["cycles"] = CYCLES
    if run.finished:
        names["twin"] = "twin.xml"
    # In a saved run, list only files that exist.
    if folder == run.folder:
        names = {kind: name for kind, name in names.items() if (folder / name).exists()}
    return {kind: str((folder / name).absolute()) for kind, name in names.items()}
