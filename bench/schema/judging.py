"""What has to be so of a scene that is read, filled and written again; judged without palpate's own
reading of it, by MuJoCo and by the text."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from random import Random

import mujoco
import numpy as np

from bench.schema.growing import Grower
from bench.schema.leaving import opened, written
from palpate.errors import InputError
from palpate.estimation.estimate import Estimate
from palpate.parameter import Parameter
from palpate.scene.load import parse_scene
from palpate.scene.scene import Scene
from palpate.twin.inject import complete

STD = 1e-5
"""Relative: so many digits are written."""


@dataclass(slots=True)
class Verdict:
    """What became of one file.

    Attributes:
        text: the file. refused: why it was not read, or empty. values: how many were read back.
        unwritten: what the twin has no place for. wrong: what must not be.
        used: what of the schema was in it.
    """

    text: str
    refused: str = ""
    values: int = 0
    unwritten: list[str] = field(default_factory=list)
    wrong: list[str] = field(default_factory=list)
    used: set[tuple[str, str]] = field(default_factory=set)


def judge(random: Random, steps: int = 30) -> Verdict:
    """Grow a scene, leave some of it open, read it, fill it, and look at the twin."""
    grower = Grower(random)
    grower.grow(steps)
    root, left = opened(grower.root, random)
    verdict = Verdict(written(root, random), used=grower.used)
    try:
        scene = parse_scene(verdict.text)
    except InputError as error:
        verdict.refused = str(error)
        return verdict
    missing = {str(parameter) for parameter in scene.missing}
    for name in left:
        body = scene.bodies.get(name.split(".")[0])
        # What was to carry things and has grown a free joint is an object, which has no height.
        is_moot = body is None or (body.role == "object" and name.endswith(".height"))
        if not is_moot and name not in missing:
            verdict.wrong.append(f"{name} was left open and is not missing")
    estimates = list(_measured(scene, random))
    made = complete(scene, estimates)
    verdict.unwritten = [str(parameter) for parameter in made.unwritten]
    for name in verdict.unwritten:
        if not any(name in note for note in made.notes):
            verdict.wrong.append(f"{name} is not in the twin, and no note says so")
    verdict.wrong += _changed_besides(verdict.text, made.texts.main)
    verdict.wrong += _misread(made.texts.main, estimates, verdict)
    return verdict


def _measured(scene: Scene, random: Random) -> Iterator[Estimate]:
    """Some value of everything that is missing."""
    for parameter in scene.missing:
        prior = np.array(scene.priors[parameter])
        if parameter.quantity in ("height", "com", "position"):
            value = prior + np.array([random.uniform(-0.004, 0.004) for _ in prior])
        else:
            value = prior * random.uniform(0.8, 1.25)
        std = tuple(max(STD * abs(v), 1e-9) for v in value.tolist())
        interval = tuple((v - 2 * s, v + 2 * s) for v, s in zip(value.tolist(), std, strict=True))
        unit = scene.catalogue[parameter.quantity].unit
        yield Estimate(parameter, unit, tuple(value.tolist()), std, interval, "made up", ())


_TOKEN = re.compile(r"<!--.*?-->|<[^>]*>|[^<]+", re.DOTALL)
_NAME = re.compile(r"</?\s*([\w:.-]+)")
_ATTRIBUTE = re.compile(r"([\w:.-]+)\s*=\s*(\"[^\"]*\"|'[^']*')")
MAY_CHANGE = {
    "geom": {"mass", "density", "friction", "pos", "size", "priority", "fromto"},
    "body": {"pos"},
    "inertial": {"mass", "pos", "diaginertia", "fullinertia", "quat", "euler", "axisangle"}
    | {"xyaxes", "zaxis"},
    "numeric": {"data"},
    "text": {"data"},
}
"""Attributes in which a quantity is stated."""
MAY_COME = ("inertial", "custom", "numeric", "text")


def _changed_besides(before: str, after: str) -> Iterator[str]:
    """What is not as it was and states no quantity: white space, comments and order included."""
    old, new = _TOKEN.findall(before), _TOKEN.findall(after)
    matcher = difflib.SequenceMatcher(None, old, new, autojunk=False)
    for operation, i1, i2, j1, j2 in matcher.get_opcodes():
        if operation != "equal":
            yield from _changes(old[i1:i2], new[j1:j2])


def _changes(old: list[str], new: list[str]) -> Iterator[str]:
    """Of one place: every old piece is there in its order, as it was or with other numbers."""
    left = list(new)
    for piece in old:
        while left and not _same_piece(piece, left[0]):
            extra = left.pop(0)
            if not _may_come(extra):
                yield f"{extra!r} has come"
        if not left:
            yield f"{piece!r} has gone"
            return
        left.pop(0)
    for extra in left:
        if not _may_come(extra):
            yield f"{extra!r} has come"


def _same_piece(piece: str, other: str) -> bool:
    if piece == other:
        return True
    name = _NAME.match(piece)
    its = _NAME.match(other)
    if name is None or its is None or name[1] != its[1] or piece.startswith("<!"):
        return False
    free = MAY_CHANGE.get(name[1], set())
    if name[1] == "custom":
        return True  # an empty one is opened
    return _fixed(piece, free) == _fixed(other, free)


def _fixed(tag: str, free: set[str]) -> str:
    """A tag without the attributes that state a quantity, and the white space before them."""
    for match in list(_ATTRIBUTE.finditer(tag))[::-1]:
        if match[1] in free:
            start = len(tag[: match.start()].rstrip())
            tag = tag[:start] + tag[match.end() :]
    return tag


def _may_come(piece: str) -> bool:
    name = _NAME.match(piece)
    return not piece.strip() or (name is not None and name[1] in MAY_COME)


def _misread(text: str, estimates: list[Estimate], verdict: Verdict) -> Iterator[str]:
    """What MuJoCo does not read in the twin as it was measured."""
    try:
        spec = mujoco.MjSpec.from_string(text)
        model = spec.compile()
    except (ValueError, mujoco.FatalError) as error:
        yield f"the twin does not compile: {' '.join(str(error).split())}"
        return
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    for estimate in estimates:
        name = str(estimate.parameter)
        if name in verdict.unwritten:
            continue
        read = _read(model, data, spec, estimate.parameter)
        if read is None:
            continue
        verdict.values += 1
        if not np.allclose(read, estimate.values, rtol=1e-4, atol=2e-6):
            yield f"{name}: {estimate.values.tolist()} written, {read.tolist()} read"


def _read(
    model: mujoco.MjModel, data: mujoco.MjData, spec: mujoco.MjSpec, parameter: Parameter
) -> np.ndarray | None:
    """A quantity as MuJoCo has it; None where it has not got the name. Places in the body's own
    frame are the file's: `alignfree` moves the compiled one."""
    kind = mujoco.mjtObj.mjOBJ_BODY
    body = mujoco.mj_name2id(model, kind, parameter.object)
    if parameter.quantity == "height":
        return _top(model, data, parameter.object)
    if body < 0:
        return None
    if parameter.quantity == "mass":
        return np.array([model.body_subtreemass[body]])
    if parameter.quantity == "com":
        return np.array(spec.body(parameter.object).ipos)
    if parameter.quantity == "position":
        return np.array(spec.body(parameter.object).pos[:2])
    if parameter.quantity == "friction":
        return _friction(model, body)
    return None


def _friction(model: mujoco.MjModel, body: int) -> np.ndarray | None:
    """Of all geoms of a body and below it that touch; one number, or all of them."""
    inside = [i for i in range(model.nbody) if body in _above(model, i)]
    geoms = [g for g in range(model.ngeom) if model.geom_bodyid[g] in inside]
    touching = [g for g in geoms if model.geom_contype[g] or model.geom_conaffinity[g]]
    values = model.geom_friction[touching or geoms, 0]
    return np.unique(values) if len(values) else None


def _above(model: mujoco.MjModel, body: int) -> Iterator[int]:
    while body:
        yield body
        body = int(model.body_parentid[body])


def _top(model: mujoco.MjModel, data: mujoco.MjData, name: str) -> np.ndarray | None:
    """The highest point of a box that stands level."""
    geom = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, name)
    body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name)
    if body >= 0:
        if model.body_geomnum[body] != 1:
            return None
        geom = int(model.body_geomadr[body])
    if geom < 0 or model.geom_type[geom] != mujoco.mjtGeom.mjGEOM_BOX:
        return None
    turned = data.geom_xmat[geom].reshape(3, 3)
    reach = np.abs(turned[2]) @ model.geom_size[geom]
    return np.array([data.geom_xpos[geom, 2] + reach])
