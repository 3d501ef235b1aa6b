"""Random scenes over MuJoCo's schema: read, filled with values, written, and judged by MuJoCo and by
the text, independently of palpate's own reading."""

from __future__ import annotations

import difflib
import re
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from random import Random

import mujoco
import numpy as np

from bench.campaign.ledger import Drawn, Row
from bench.schema.growing import Grower
from bench.schema.leaving import opened, written
from palpate.common.errors import InputError
from palpate.common.parameter import Parameter
from palpate.estimation.estimate import Estimate
from palpate.scene.load import parse_scene
from palpate.scene.scene import Scene
from palpate.twin.inject import complete

STD = 1e-5
"""Relative standard deviation of made-up values: decides how many digits are written."""
STEPS = 60
"""Attempts to add an element or an attribute to a scene."""
QUOTED = re.compile(r"'[^']*'|\"[^\"]*\"|[\d.]+")
"""Names and numbers in a message, so that refusals for the same reason are counted together."""


@dataclass(slots=True)
class Verdict:
    """Result of one file.

    Attributes:
        text: the file.
        refused: reason why it was not read, or empty.
        values: number of values that were read back.
        unwritten: parameters without a place in the twin.
        wrong: violations.
        used: elements and attributes of the schema in it.
    """

    text: str
    refused: str = ""
    values: int = 0
    unwritten: list[str] = field(default_factory=list)
    wrong: list[str] = field(default_factory=list)
    used: set[tuple[str, str]] = field(default_factory=set)


def judge_scene(case: Drawn, blank: Row) -> Row:
    """Judge one random scene."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        verdict = judge(Random(case.seed + case.number), STEPS)
    reason = QUOTED.sub("…", verdict.refused)[:160]
    return replace(
        blank,
        outcome="refused" if verdict.refused else "accepted",
        said=(reason,) if reason else (),
        beyond=tuple(verdict.wrong),
        figures={"read back": verdict.values, "without a place": len(verdict.unwritten)},
    )


def judge(random: Random, steps: int = 30) -> Verdict:
    """Grow a scene, remove some of its values, read it, fill it, and judge the twin."""
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
        # A stand that has grown a free joint is an object, which has no height.
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
    """Make up a value for every missing parameter."""
    for parameter in scene.missing:
        prior = np.array(scene.priors[parameter])
        if parameter.quantity in ("height", "com", "position"):
            value = prior + np.array([random.uniform(-0.004, 0.004) for _ in prior])
        else:
            value = prior * random.uniform(0.8, 1.25)
        std = np.maximum(STD * np.abs(value), 1e-9)
        interval = np.column_stack([value - 2 * std, value + 2 * std])
        unit = scene.catalogue[parameter.quantity].unit
        yield Estimate(parameter, unit, value, std, interval, "made up", ())


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
    """List changes of the text outside the attributes of quantities, white space and comments included."""
    old, new = _TOKEN.findall(before), _TOKEN.findall(after)
    matcher = difflib.SequenceMatcher(None, old, new, autojunk=False)
    for operation, i1, i2, j1, j2 in matcher.get_opcodes():
        if operation != "equal":
            yield from _changes(old[i1:i2], new[j1:j2])


def _changes(old: list[str], new: list[str]) -> Iterator[str]:
    """List changes in one place: old pieces must remain in order, equal or with other numbers."""
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
    """List values that MuJoCo reads from the twin differently from how they were written."""
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
    """A quantity as MuJoCo reads it; None if it does not know the name. Positions in the body's frame
    are read from the spec: `alignfree` moves the compiled frame."""
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
    """Distinct sliding frictions of the colliding geoms of a body and its descendants."""
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
    """Height of a box's highest point."""
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
