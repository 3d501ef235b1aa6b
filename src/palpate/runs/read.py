"""Reading a run from its folder."""

from __future__ import annotations

import logging
import math
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import TypeAdapter

from palpate.common.belief import Belief, BeliefTouch
from palpate.common.errors import InputError
from palpate.common.parameter import Parameter
from palpate.common.pose import Array, Pose
from palpate.common.version import __version__
from palpate.estimation.estimate import UNBOUNDED, Estimate, FitTest, FurtherValue, Shared
from palpate.mjcf.document import read_text
from palpate.planning.check.finding import Finding
from palpate.planning.model.conversation import read_conversation
from palpate.planning.registry import load_proposal
from palpate.robots.owner import load_description
from palpate.runs.folder import read_json
from palpate.runs.held_out import HeldOut
from palpate.runs.reproduce import use_seen_poses
from palpate.runs.run import TRACE, Ending, Run
from palpate.scene.detections import SceneObject
from palpate.scene.load import parse_scene, scene_from_text
from palpate.scene.picture_scene import DetectedScene, SceneBuilder
from palpate.scene.poses import Poses, read_poses
from palpate.scene.scene import Scene
from palpate.trace.recording import Recording
from palpate.twin.twin import Twin, read_twin
from palpate.twin.validate import ReplayResidual, Validation

if TYPE_CHECKING:
    from palpate.runs.settings import Settings


log = logging.getLogger(__name__)

EMPTY_SCENE = "<mujoco><worldbody/></mujoco>"  # Scene of a run without a scene file


@cache
def _adapter(kind: Any) -> TypeAdapter[Any]:
    """Pydantic's reader of a type, made when it is first used."""
    return TypeAdapter(kind)


UNFINISHED: dict[str, Any] = {
    "status": "running",
    "stage": "executing",
    "parameters": (),
    "plan": {"findings": ()},
    "rehearsal": None,
    "execution": None,
    "twin": None,
    "provenance": {"world": None},
}
"""Result of a run whose `result.json` is damaged: request, plan and trace are left."""


def read_run(folder: Path, settings: Settings, made_again: bool = False) -> Run:
    """Read the run in `folder`, made with `settings`. Its trace is read at first use.

    A folder keeps neither the symbolic state nor the camera's footage. The scene is empty if its
    file was removed. With `made_again`, the run of a damaged `result.json` begins after its
    execution. Raises InputError: a file is missing or is not of a run.
    """
    # A wrong type or a missing key anywhere means that it is not a run.
    try:
        result = read_json(folder / "result.json")
    except InputError:
        if not made_again or not (folder / TRACE).exists():
            raise
        log.warning("result.json is damaged, and is made again from the request, plan and trace")
        result = UNFINISHED
    settings = use_seen_poses(settings, folder)
    try:
        return _run(folder, settings, result)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(
            f"'{folder}' is not a run's folder: result.json: {type(error).__name__}: {error}"
        ) from None


def require_own_version(folder: Path) -> None:
    """Require that this version of palpate recorded the run: formats may differ between versions.
    Raises InputError: another version recorded it."""
    recorded = read_json(folder / "request.json").get("palpate")
    if recorded != __version__:
        raise InputError(
            f"'{folder}' was recorded by palpate {recorded or 'of an unknown version'}, and this is "
            f"{__version__}: estimate from its trace with the version that recorded it"
        )


def _run(folder: Path, settings: Settings, result: dict[str, Any]) -> Run:
    from palpate.execution.rehearsal import Rehearsal

    # Read plan and scene first: estimates and twin refer to them.
    proposal = load_proposal(folder / "plan.json")
    scene, seen = _find_scene(folder, settings, proposal.scene)
    estimates = tuple(estimate_from(row) for row in result["parameters"])
    # A complete run without execution had nothing to measure.
    plan, done, conversation = proposal.plan, result["execution"], folder / "conversation.json"
    rehearsed = result["rehearsal"]
    if plan.tree is None and result["status"] == "complete" and done is None:
        plan = replace(plan, declared="nothing_missing")
    return Run(
        settings,
        scene,
        plan,
        tuple(Finding(**finding) for finding in result["plan"]["findings"]),
        conversation=read_conversation(conversation) if conversation.exists() else None,
        seen=seen,
        rehearsal=None if rehearsed is None else Rehearsal(**rehearsed),
        world=result["provenance"]["world"],
        simulated=result.get("simulated", settings.robot is None),
        execution=_ending(done),
        beliefs={row["object"]: belief_from(row) for row in result.get("poses", ())},
        estimates=estimates,
        truth=_truth(result["parameters"]),
        held_out=held_out_from(result.get("validation", {}).get("held_out")),
        finished=_twin(folder / "twin.xml", scene, estimates, result["twin"]),
        folder=folder,
        stage=result.get("stage"),
        interrupted=result.get("interrupted"),
        shortfalls=tuple(result.get("shortfalls", ())),
        total_seconds=None if done is None else done.get("total_seconds"),
    )


@contextmanager
def _naming(file: Path) -> Generator[None]:
    """Add the name of the file to errors in its content."""
    try:
        yield
    except (InputError, KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(f"'{file}' is damaged, restore it: {error}") from None


def _find_scene(
    folder: Path, settings: Settings, objects: tuple[SceneObject, ...]
) -> tuple[Scene, DetectedScene | None]:
    """Find the scene, and the objects in a picture that it was built from.

    It is in the folder, else in its own file, else empty.
    """
    # Use the poses that the run used.
    own, poses = folder / "scene.xml", Poses()
    arm, robots = load_description(settings.arm, settings.cautious), settings.robot_body
    if settings.poses is not None and settings.poses.exists():
        poses = read_poses(settings.poses)
    # A scene from a picture keeps the detected objects in the plan.
    if own.exists() and objects:
        seen = DetectedScene(SceneBuilder(poses, arm), objects)
        with _naming(own):
            return scene_from_text(read_text(own), like=seen.scene()), seen
    if own.exists():
        with _naming(own):
            return parse_scene(read_text(own), poses=poses, arm=arm, robot_body=robots), None
    if settings.scene is not None and settings.scene.exists():
        return settings.read_scene(arm), None
    return parse_scene(EMPTY_SCENE, arm=arm), None


def _ending(document: dict[str, Any] | None) -> Ending | None:
    if document is None:
        return None
    status = "complete" if document["stopped_by"] is None else "stopped"
    return _adapter(Ending).validate_python({**document, "status": status})


def held_out_from(document: Mapping[str, Any] | None) -> HeldOut | None:
    """Read the output of `held_out_json`."""
    if document is None:
        return None
    motions = [motion | {"tests": _tests(motion["tests"])} for motion in document["motions"]]
    return _adapter(HeldOut).validate_python({**document, "motions": motions})


def _tests(rows: Sequence[Mapping[str, Any]]) -> tuple[FitTest, ...]:
    """Read tests of fit; null means a statistic that is not a number."""
    complete = [{**row, "statistic": _default(row["statistic"], math.nan)} for row in rows]
    return _adapter(tuple[FitTest, ...]).validate_python(complete)


def _default(number: float | None, default: float) -> float:
    return default if number is None else number


def estimate_from(row: Mapping[str, Any]) -> Estimate:
    """Read the output of `parameter_json`. Raises ValueError: a standard deviation is negative."""
    # Refuse impossible deviations before they reach a fusion.
    stds = _numbers(row["std"])
    if (stds < 0.0).any():
        raise ValueError(f"std of {row['object']}.{row['quantity']} is negative: {row['std']}")
    return Estimate(
        Parameter(row["object"], row["quantity"]),
        row["unit"],
        _numbers(row["value"]),
        stds,
        _numbers(row["ci95"]),
        row["method"],
        _adapter(tuple[Recording, ...]).validate_python(row.get("evidence", ())),
        row["verdict"],
        parts=_adapter(dict[str, FurtherValue]).validate_python(row["components"]),
        tests=_tests(row.get("tests", ())),
        shared=_adapter(tuple[Shared, ...]).validate_python(row.get("shared", ())),
        freedom=_default(row.get("freedom"), math.inf),
        unseen=tuple(row["unseen"]) if "unseen" in row else _unseen(row),
        reason=row.get("reason") or "",
        bounds=_bounds(row.get("bounds")),
    )


def belief_from(row: Mapping[str, Any]) -> Belief:
    """Read the output of `belief_json`."""
    sight, both, before = row["sight"], row["both"], row["stood"]
    return Belief(
        Pose.of(sight["pos"], sight["quat"]),
        _numbers(sight["covariance"]),
        Pose.of(before["pos"], before["quat"]),
        Pose.of(both["pos"], both["quat"]),
        _numbers(both["covariance"]),
        _adapter(tuple[BeliefTouch, ...]).validate_python(row["touch"]),
    )


def _truth(rows: Sequence[Mapping[str, Any]]) -> dict[Parameter, tuple[float, ...]]:
    """Read the true values of a simulated world, if the run holds them."""
    truth: dict[Parameter, tuple[float, ...]] = {}
    for row in rows:
        true = _numbers(row.get("true_value")).reshape(-1).tolist()
        if true:
            truth[Parameter(row["object"], row["quantity"])] = tuple(true)
    return truth


def _unseen(row: Mapping[str, Any]) -> tuple[int, ...]:
    """Indices of the unseen components in folders of earlier versions: their verdict differs from
    that of the whole.
    """
    verdicts = enumerate(row.get("verdicts") or ())
    return tuple(place for place, verdict in verdicts if verdict != row["verdict"])


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
    marks = document["validation"]
    if marks is not None:
        twin, template = (
            ReplayResidual(row["force_N"], row["position_m"], row["note"])
            for row in (marks["residual_twin"], marks["residual_template"])
        )
        marks = Validation(marks["settled"], marks["drift_m"], twin, template)
    with _naming(file):
        return read_twin(xml, scene, estimates, document["notes"], marks, unwritten)
