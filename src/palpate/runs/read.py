"""Reading a run from its folder."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from palpate.common.belief import Belief, BeliefTouch
from palpate.common.errors import InputError
from palpate.common.parameter import Parameter
from palpate.common.pose import Array, Pose
from palpate.common.version import __version__
from palpate.estimation.estimate import UNBOUNDED, Estimate, FurtherValue, Shared
from palpate.execution.stop import HeldObject
from palpate.mjcf.document import read_text
from palpate.planning.check.finding import Finding
from palpate.planning.model.conversation import Conversation, read_conversation
from palpate.planning.registry import load_proposal
from palpate.robots.owner import load_description
from palpate.runs.folder import read_json
from palpate.runs.reproduce import with_seen_poses
from palpate.runs.result import fit_test, held_out_from
from palpate.runs.run import Ending, Run
from palpate.scene.detections import SceneObject
from palpate.scene.load import load_scene, parse_scene, scene_from_text
from palpate.scene.picture_scene import DetectedScene, SceneBuilder
from palpate.scene.poses import Poses, read_poses
from palpate.scene.scene import Scene
from palpate.trace.recording import Context, Recording
from palpate.twin.twin import Twin, read_twin
from palpate.twin.validate import ReplayResidual, Validation

if TYPE_CHECKING:
    from palpate.execution.rehearsal import Rehearsal
    from palpate.runs.settings import Settings


NOTHING = "<mujoco><worldbody/></mujoco>"
"""Scene of a run without a scene file."""


def read_run(folder: Path, settings: Settings) -> Run:
    """Read the run in `folder`, made with `settings`. Its trace is read at first use.

    A folder keeps neither the symbolic state nor the camera's footage. The scene is empty if its
    file was removed.

    Raises:
        InputError: a file is missing or is not of a run.
    """
    # A wrong type or a missing key anywhere means that it is not a run.
    result = read_json(folder / "result.json")
    settings = with_seen_poses(settings, folder)
    try:
        return _run(folder, settings, result)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(
            f"'{folder}' is not a run's folder: result.json: {type(error).__name__}: {error}"
        ) from None


def require_own_version(folder: Path) -> None:
    """Require that this version of palpate recorded the run: formats may differ between versions.

    Raises:
        InputError: another version recorded it.
    """
    recorded = read_json(folder / "request.json").get("palpate")
    if recorded != __version__:
        raise InputError(
            f"'{folder}' was recorded by palpate {recorded or 'of an unknown version'}, and this is "
            f"{__version__}: estimate from its trace with the version that recorded it"
        )


class StoredScene(NamedTuple):
    """Scene of a run, and the objects that a model detected, if the scene was built from them."""

    scene: Scene
    seen: DetectedScene | None = None


def _run(folder: Path, settings: Settings, result: dict[str, Any]) -> Run:
    # Read plan and scene first: estimates and twin refer to them.
    proposal = load_proposal(folder / "plan.json")
    found = _find_scene(folder, settings, proposal.scene)
    estimates = tuple(estimate_from(row) for row in result["parameters"])
    # A complete run without execution had nothing to measure.
    plan = proposal.plan
    if plan.tree is None and result["status"] == "complete" and not result["execution"]:
        plan = replace(plan, declared="nothing_missing")
    return Run(
        settings,
        found.scene,
        plan,
        tuple(Finding.of(**finding) for finding in result["plan"]["findings"]),
        conversation=_conversation(folder / "conversation.json"),
        seen=found.seen,
        rehearsal=_rehearsal(result["rehearsal"]),
        world=result["provenance"]["world"],
        simulated=result.get("simulated", settings.robot is None),
        execution=_ending(result["execution"]),
        beliefs={row["object"]: belief_from(row) for row in result.get("poses", ())},
        estimates=estimates,
        truth=_truth(result["parameters"]),
        held_out=held_out_from(result.get("validation", {}).get("held_out")),
        finished=_twin(folder / "twin.xml", found.scene, estimates, result["twin"]),
        folder=folder,
        stage=result.get("stage"),
        interrupted=result.get("interrupted"),
        shortfalls=tuple(result.get("shortfalls", ())),
        total_seconds=_total_seconds(result["execution"]),
    )


def _find_scene(folder: Path, settings: Settings, objects: tuple[SceneObject, ...]) -> StoredScene:
    """Find the scene: in the folder, else in its own file; else return an empty one."""
    # Use the poses that the run used.
    own, arm, poses = (
        folder / "scene.xml",
        load_description(settings.arm, settings.cautious),
        Poses(),
    )
    if settings.poses is not None and settings.poses.exists():
        poses = read_poses(settings.poses)
    # A scene from a picture keeps the detected objects in the plan.
    if own.exists() and objects:
        seen = DetectedScene(SceneBuilder(poses, arm), objects)
        text = read_text(own)
        return StoredScene(scene_from_text(text, like=seen.scene()), seen)
    if own.exists():
        robots = settings.robot_body
        return StoredScene(parse_scene(read_text(own), poses=poses, arm=arm, robot_body=robots))
    if settings.scene is not None and settings.scene.exists():
        found = load_scene(
            settings.scene,
            settings.poses,
            arm,
            root=settings.root,
            robot_body=settings.robot_body,
        )
        return StoredScene(found)
    return StoredScene(parse_scene(NOTHING, arm=arm))


def _conversation(file: Path) -> Conversation | None:
    if not file.exists():
        return None
    return read_conversation(file)


def _rehearsal(document: dict[str, Any] | None) -> Rehearsal | None:
    if document is None:
        return None
    from palpate.execution.rehearsal import Rehearsal

    return Rehearsal(**document)


def _ending(document: dict[str, Any] | None) -> Ending | None:
    if document is None:
        return None
    return Ending(
        "complete" if document["stopped_by"] is None else "stopped",
        document["stopped_by"],
        document["actions"],
        document["robot_seconds"],
        document["wall_seconds"],
        tuple(document["setbacks"]),
        HeldObject(**held) if (held := document.get("held")) else None,
    )


def _total_seconds(document: dict[str, Any] | None) -> float | None:
    """Wall time of the command; None in folders of earlier versions."""
    return None if document is None else document.get("total_seconds")


def estimate_from(row: Mapping[str, Any]) -> Estimate:
    """Read the output of `parameter_json`.

    Raises:
        ValueError: a standard deviation is negative.
    """
    # Refuse impossible deviations before they reach a fusion.
    stds = _numbers(row["std"])
    if (stds < 0.0).any():
        raise ValueError(f"std of {row['object']}.{row['quantity']} is negative: {row['std']}")
    parts = {name: FurtherValue(**part) for name, part in row["components"].items()}
    return Estimate(
        Parameter(row["object"], row["quantity"]),
        row["unit"],
        _numbers(row["value"]),
        stds,
        _numbers(row["ci95"]),
        row["method"],
        tuple(_recording(document) for document in row.get("evidence", ())),
        row["verdict"],
        parts=parts,
        tests=tuple(fit_test(test) for test in row.get("tests", ())),
        shared=tuple(_read_shared_error(one) for one in row.get("shared", ())),
        freedom=_limitless(row.get("freedom")),
        unseen=tuple(row["unseen"]) if "unseen" in row else _unseen(row),
        reason=row.get("reason") or "",
        bounds=_bounds(row.get("bounds")),
    )


def belief_from(row: Mapping[str, Any]) -> Belief:
    """Read the output of `belief_json`."""
    sight, both, stood = row["sight"], row["both"], row["stood"]
    # Rebuild the touches, then the belief before and after them.
    touches: list[BeliefTouch] = []
    for touch in row["touch"]:
        numbers = (touch[name] for name in ("apart", "std", "believed_std"))
        along, point = tuple(touch["along"]), tuple(touch["point"])
        touches.append(BeliefTouch(touch["means"], along, point, *numbers))
    return Belief(
        Pose.of(sight["pos"], sight["quat"]),
        _numbers(sight["covariance"]),
        Pose.of(stood["pos"], stood["quat"]),
        Pose.of(both["pos"], both["quat"]),
        _numbers(both["covariance"]),
        tuple(touches),
    )


def _truth(rows: Sequence[Mapping[str, Any]]) -> dict[Parameter, tuple[float, ...]]:
    """Read the true values of a simulated world, if the run holds them."""
    found: dict[Parameter, tuple[float, ...]] = {}
    for row in rows:
        true = _numbers(row.get("true_value")).reshape(-1).tolist()
        if true:
            found[Parameter(row["object"], row["quantity"])] = tuple(true)
    return found


def _recording(document: Mapping[str, Any]) -> Recording:
    return Recording(
        document["buffer"],
        document["start"],
        document["end"],
        Context(**document["context"]),
        document["node"],
        tuple(document["reading"]),
    )


def _unseen(row: Mapping[str, Any]) -> tuple[int, ...]:
    """Indices of the unseen components in folders of earlier versions: their verdict differs from
    that of the whole.
    """
    verdicts = enumerate(row.get("verdicts") or ())
    return tuple(place for place, verdict in verdicts if verdict != row["verdict"])


def _read_shared_error(document: Mapping[str, Any]) -> Shared:
    return Shared(document["cause"], document["of"], tuple(document["effect"]))


def _limitless(number: float | None) -> float:
    """Convert null to infinity."""
    return math.inf if number is None else number


def _bounds(document: Any) -> Any:
    """Read physical bounds, common to all components or one pair each.

    Null means infinity. Earlier versions have none.
    """
    ends = np.array([None, None] if document is None else document, dtype=float)  # null: NaN
    return np.where(np.isnan(ends), UNBOUNDED, ends).tolist()


def _numbers(document: Any) -> Array:
    """Array from a number, lists of numbers, or null."""
    return np.array([] if document is None else document, dtype=float)


def _twin(
    file: Path, scene: Scene, estimates: Sequence[Estimate], document: dict[str, Any] | None
) -> Twin | None:
    if document is None:
        return None
    # The stored remarks and the validation stay as they are.
    xml = read_text(file)
    unwritten = [Parameter(name) for name in document.get("unwritten", ())]
    marks = _validation(document["validation"])
    return read_twin(xml, scene, estimates, document["notes"], marks, unwritten)


def _validation(marks: dict[str, Any] | None) -> Validation | None:
    if marks is None:
        return None
    twin, template = marks["residual_twin"], marks["residual_template"]
    return Validation(marks["settled"], marks["drift_m"], _residual(twin), _residual(template))


def _residual(document: dict[str, Any]) -> ReplayResidual:
    return ReplayResidual(document["force_N"], document["position_m"], document["note"])
