"""A rehearsal in a run folder, so that the folder's plan is not rehearsed again.

Only what the embedded arm does may rest on such a file, which anybody can write: before a real arm the plan is
always rehearsed. The key is of plan, scene and arm as compiled, with priors, named poses and offsets, and of
palpate's version.
"""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Annotated, Any

import mujoco
import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from palpate import __version__
from palpate.errors import InputError
from palpate.execution.foresight import Foresight
from palpate.execution.rehearsal import Rehearsal
from palpate.files.read import MB, read_bytes
from palpate.geometry.pose import Pose
from palpate.planning.plan import Plan, plan_json
from palpate.scene.scene import Scene
from palpate.vocabulary.admissible.solids import solids

FILE = "rehearsal.json"
MOST = 2 * MB
"""Bytes of such a file; fifteen objects take 0.2 MB."""
FARTHEST = 0.1
"""m: largest shift of an object that is read."""

Finite = Annotated[float, Field(allow_inf_nan=False)]
Row = Annotated[tuple[Finite, ...], Field(min_length=7, max_length=7)]


class Kept(BaseModel):
    """Content of the file; poses as seven numbers, position and quaternion."""

    model_config = ConfigDict(extra="forbid")

    key: str
    actions: int
    robot_seconds: Finite
    peak_force: Finite
    failure: str | None
    draws: int
    path: str
    shifts: dict[str, dict[str, Row]]
    widths: dict[str, Finite]
    weights: dict[str, tuple[Finite, Finite]]

    def rehearsal(self) -> Rehearsal:
        """The rehearsal that was kept."""
        shifts = {
            leaf: {name: _pose(row) for name, row in found.items()}
            for leaf, found in self.shifts.items()
        }
        figures = self.model_dump(exclude={"key", "shifts", "widths", "weights"})
        return Rehearsal(**figures, foresight=Foresight(shifts, self.widths, self.weights))


def keep_rehearsal(folder: Path, plan: Plan, scene: Scene, rehearsal: Rehearsal) -> None:
    """Write the rehearsal of a plan beside it."""
    seen = rehearsal.foresight
    shifts = {
        leaf: {name: pose.vector.tolist() for name, pose in found.items()}
        for leaf, found in seen.shifts.items()
    }
    weights = {name: seen.weights[name] for name in scene.objects if name in seen.weights}
    more = {"shifts": shifts, "widths": dict(seen.widths), "weights": weights}
    document = {"key": key(plan, scene), **rehearsal.figures(), **more}
    (folder / FILE).write_text(json.dumps(document, allow_nan=False), encoding="utf-8")


def kept_rehearsal(folder: Path, plan: Plan, scene: Scene) -> Rehearsal | None:
    """The rehearsal of this plan in this scene that a folder keeps; None without a whole one."""
    try:
        kept = Kept.model_validate_json(read_bytes(folder / FILE, MOST, "a rehearsal"))
        return kept.rehearsal() if kept.key == key(plan, scene) else None
    except (InputError, ValidationError, ValueError):
        return None


def key(plan: Plan, scene: Scene) -> str:
    """Hash of what a rehearsal depends on: plan, scene and arm as compiled, priors, names of poses.yaml,
    version."""
    compiled = _binary(solids(scene).model)
    document: dict[str, Any] = plan_json(plan)
    priors = sorted((str(name), repr(prior)) for name, prior in scene.resolved.priors.items())
    said = [__version__, document["parameters"], document["tree"], priors]
    said += [repr(scene.pose_world_base), _arm(scene), _names(scene)]
    return hashlib.sha256(json.dumps(said).encode() + compiled.tobytes()).hexdigest()


def _binary(model: mujoco.MjModel) -> NDArray[np.uint8]:
    """The compiled model as MuJoCo saves it, meshes included."""
    module: Any = mujoco  # these two are missing in its stubs
    compiled = np.empty(module.mj_sizeModel(model), dtype=np.uint8)
    module.mj_saveModel(model, None, compiled)
    return compiled


def _arm(scene: Scene) -> str:
    """The arm's figures beside its compiled model."""
    arm = scene.arm
    return repr((arm.name, arm.pace, arm.stiffness, arm.limits.reflexes, arm.nominal))


def _names(scene: Scene) -> list[dict[str, Any]]:
    """Poses, joint configurations and offsets that a plan may name; poses.yaml states some of them."""
    symbols = scene.symbols
    poses = {name: pose.vector.tolist() for name, pose in symbols.poses.items()}
    joints, offsets = (
        {name: vector.tolist() for name, vector in named.items()}
        for named in (symbols.configurations, symbols.offsets)
    )
    own = {
        name: {offset: vector.tolist() for offset, vector in named.items()}
        for name, named in symbols.own_offsets.items()
    }
    return [poses, joints, offsets, own]


def _pose(row: Row) -> Pose:
    """Pose of seven numbers.

    Raises:
        ValueError: farther than `FARTHEST`, or no rotation.
    """
    pose = Pose(np.array(row[:3]), np.array(row[3:]))
    if np.linalg.norm(pose.position) > FARTHEST or abs(np.linalg.norm(pose.quaternion) - 1) > 1e-6:
        raise ValueError("no shift of an object")
    return pose
