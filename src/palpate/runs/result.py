"""`result.json`: the contract with scripts."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from palpate.common.version import __version__
from palpate.estimation.estimate import Estimate, FitTest, axes_of
from palpate.planning.plan import dump_plan, proposal_json
from palpate.runs.answer import answer
from palpate.runs.held_out import Curve, HeldOut, HeldOutMotion
from palpate.runs.reproduce import POSES

if TYPE_CHECKING:
    from palpate.common.belief import Belief
    from palpate.common.pose import Array, Pose
    from palpate.runs.run import Run
    from palpate.twin.twin import Twin
    from palpate.twin.validate import ReplayResidual, Validation


def held_out_json(held: HeldOut | None) -> dict[str, Any] | None:
    """Held-out motions as JSON: all together, and one by one."""
    if held is None:
        return None
    together = _combine_motions(held.motions)
    each = [_motion_json(motion) for motion in held.motions]
    return {**together, "notes": list(held.notes), "motions": each}


def _combine_motions(motions: Sequence[HeldOutMotion]) -> dict[str, Any]:
    """Combine all motions into one entry: the least probable one counts, and any one that
    disagrees.
    """
    # Collect descriptions, p-values and findings.
    words: list[str] = []
    findings: list[str] = []
    probable: list[float] = []
    for motion in motions:
        words.append(motion.motion)
        probable.append(motion.p)
        if motion.disagreement:
            findings.append(motion.disagreement)
    # Join the misfits of all motions.
    return {
        "motion": "; ".join(words) or None,
        "chi2": sum(motion.chi2 for motion in motions),
        "dof": sum(motion.dof for motion in motions),
        "p": min(probable, default=None),
        "agrees": all(motion.agrees for motion in motions) if motions else None,
        "disagreement": " ".join(findings) or None,
    }


def _motion_json(motion: HeldOutMotion) -> dict[str, Any]:
    content = asdict(motion)
    content["tests"] = [asdict(test) | {"passed": test.passed} for test in motion.tests]
    return content | {"agrees": motion.agrees}


def held_out_from(document: Mapping[str, Any] | None) -> HeldOut | None:
    """Read the output of `held_out_json`."""
    if document is None:
        return None
    motions = tuple(_motion(motion) for motion in document["motions"])
    return HeldOut(motions, tuple(document["notes"]))


def fit_test(document: Mapping[str, Any]) -> FitTest:
    """Read a test from `result.json`; null means a statistic that is not a number."""
    statistic = math.nan if document["statistic"] is None else document["statistic"]
    return FitTest(document["name"], statistic, document["limit"], document["finding"])


def _motion(document: Mapping[str, Any]) -> HeldOutMotion:
    parts = {name: part for name, part in document.items() if name != "agrees"}
    parts["tests"] = tuple(fit_test(test) for test in document["tests"])
    parts["curve"] = _curve(document["curve"])
    return HeldOutMotion(**parts)


def _curve(document: Mapping[str, Any]) -> Curve:
    grids = ("measured", "std", "twin", "template")
    rows = {name: tuple(tuple(row) for row in document[name]) for name in grids}
    return Curve(tuple(document["signals"]), tuple(document["t"]), **rows)


# The document `result.json`: the contract with scripts.


CYCLES = "cycles.npz"
"""Log of a real robot's last seconds before a stop, in a run folder."""


def result_json(run: Run, folder: Path | None) -> dict[str, Any]:
    """Content of `result.json`, which `--json` also prints."""
    from palpate.robots.simulated.noise.models import noise_models

    content = {
        "status": run.status,
        "stage": run.stage,
        "interrupted": run.interrupted,
        "shortfalls": list(run.shortfalls),
        "simulated": run.simulated,
        "truth": _truth(run),
        "request": run.settings.request,
        "answer": answer(run),
        **proposal_json(run.plan),
        "parameters": [_parameter_json(run, estimate) for estimate in run.estimates],
        "poses": [belief_json(name, belief) for name, belief in run.beliefs.items()],
        "plan": _plan_json(run),
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
    return finite(content)


def finite(content: Any) -> Any:
    """Replace NaN and infinities by null, because JSON has no such numbers."""
    if isinstance(content, dict):
        named = cast("dict[str, Any]", content)
        return {name: finite(value) for name, value in named.items()}
    if isinstance(content, list):
        return [finite(value) for value in cast("list[Any]", content)]
    if isinstance(content, float) and not math.isfinite(content):
        return None
    return content


def _truth(run: Run) -> str | None:
    """Source of the true values of a simulation; null for a real robot."""
    if not run.simulated:
        return None
    if run.drawn:
        return "drawn from priors"
    return run.settings.world.name if run.settings.world else run.world


def _plan_json(run: Run) -> dict[str, Any]:
    findings: list[dict[str, str]] = []
    for finding in run.findings:
        findings.append({"path": finding.path, "rule": finding.rule, "message": finding.message})
    return {
        "planner": run.plan.planner,
        "actions": run.plan.actions,
        "explanation": run.plan.explanation,
        "notes": list(run.plan.notes),
        "findings": findings,
    }


def plan_text(run: Run) -> str:
    """Content of `plan.json`: the plan, objects that a model detected, and the cost of the model."""
    # A plan of a model also keeps its detected objects and its cost.
    more: dict[str, Any] = {}
    if run.seen is not None:
        more["scene"] = [asdict(thing) for thing in run.seen.objects]
    if run.conversation is not None:
        more |= run.conversation.summary()
    return dump_plan(run.plan, more)


def _parameter_json(run: Run, estimate: Estimate) -> dict[str, Any]:
    precision = run.settings.within.precision(estimate)
    within = asdict(precision) | {"outcome": precision.outcome} if precision else None
    true = list(run.truth.get(estimate.parameter, ()))
    return parameter_json(estimate) | {"within": within, "true_value": _shape_value(true)}


def parameter_json(estimate: Estimate) -> dict[str, Any]:
    """Estimate as JSON: scalars for quantities of one component, lists for the others, null for unknown
    values."""
    # Verdicts by axis, for quantities of several components.
    axes = dict(zip(axes_of(len(estimate.values)), estimate.verdicts, strict=True))
    return {
        "object": estimate.parameter.object,
        "quantity": estimate.parameter.quantity,
        "value": _shape_value(estimate.values.tolist()),
        "unit": estimate.unit,
        "std": _shape_value(estimate.stds.tolist()),
        "ci95": _shape_value(estimate.intervals.tolist()),
        "method": estimate.method,
        "verdict": estimate.verdict,
        "verdicts": list(estimate.verdicts) if len(estimate.verdicts) > 1 else None,
        "unseen": list(estimate.unseen),
        "whole": estimate.whole,
        "reason": estimate.reason or None,
        "bounds": finite(np.array(estimate.bounds).tolist()),
        "at_most": _limit(estimate, 1),
        "at_least": _limit(estimate, -1),
        "axes": axes if len(axes) > 1 else None,
        "contradiction": estimate.contradiction or None,
        "tests": [asdict(test) | {"passed": test.passed} for test in estimate.tests],
        "components": {name: asdict(part) for name, part in estimate.parts.items()},
        "shared": [asdict(one) | {"effect": list(one.effect)} for one in estimate.shared],
        "freedom": estimate.freedom if math.isfinite(estimate.freedom) else None,
        "evidence": [asdict(recording) for recording in estimate.evidence],
    }


def _limit(estimate: Estimate, sign: int) -> Any:
    """Limits (95 %, one-sided) of the components at a lower bound (`sign` 1) or an upper one (-1);
    null for the others.
    """
    # Only components at a bound on that side have a limit.
    pairs = zip(estimate.at_bound, estimate.limits, strict=True)
    limits = [limit if bound and bound.sign == sign else None for bound, limit in pairs]
    return _shape_value(limits) if any(limit is not None for limit in limits) else None


def belief_json(name: str, belief: Belief) -> dict[str, Any]:
    """Pose of an object by sight, by touch and by both."""
    # Each touch with its derived figures.
    touches: list[dict[str, Any]] = []
    for touch in belief.touches:
        touches.append(asdict(touch) | {"z": touch.z, "contradicts": touch.contradicts})
    return {
        "object": name,
        "sight": _pose_json(belief.seen, belief.seen_covariance),
        "touch": touches,
        "both": _pose_json(belief.pose, belief.covariance),
        "stood": {
            "pos": belief.placed.position.tolist(),
            "quat": belief.placed.quaternion.tolist(),
        },
        "contradiction": belief.contradiction or None,
    }


def _pose_json(pose: Pose, covariance: Array) -> dict[str, Any]:
    return {
        "pos": pose.position.tolist(),
        "quat": pose.quaternion.tolist(),
        "covariance": covariance.tolist(),
    }


def _shape_value(numbers: list[Any]) -> Any:
    """Convert a list of one to a scalar and an empty one to null."""
    if len(numbers) == 1:
        return numbers[0]
    return numbers or None


def has_scene_of_its_own(run: Run) -> bool:
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
        "setbacks": list(done.setbacks),
        "held": None if done.held is None else asdict(done.held),
    }


def twin_json(twin: Twin) -> dict[str, Any]:
    """Twin as JSON: notes, unwritten values, validation."""
    return {
        "notes": list(twin.notes),
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
    if has_scene_of_its_own(run):
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
