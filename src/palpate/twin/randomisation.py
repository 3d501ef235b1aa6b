"""Ranges for domain randomisation: the distributions of the worlds in training.

A policy trained with them does not rely on more than was measured. `ranges.json` has every measured
number with its interval, and the covariance of all of them. `mjlab_events.py` and
`isaaclab_events.py` have the ranges as event terms of these two libraries, which draw each number
independently.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from palpate.common.pose import Array
from palpate.estimation.estimate import Z95, Estimate, axes_of

RANGES = "ranges.json"
Range = tuple[float, float]
# Parameters that select parts of an entity.
ENTITY_PARTS = ("body_names", "geom_names", "joint_names")
# Function of a library that changes an entity, and its parameters without the entity.
Term = tuple[str, dict[str, Any]]
HEADER = '''"""Domain randomisation by palpate: the central 95 % intervals of what was measured.

Each body is an entity of the scene by its name in the MJCF. `events()` goes into the events of an environment.
"""

{imports}


def events() -> dict[str, EventTermCfg]:
    """Event terms by name."""
    return {{
{terms}
    }}
'''
MJLAB = """from mjlab.envs.mdp import dr
from mjlab.managers.event_manager import EventTermCfg
from mjlab.managers.scene_entity_config import SceneEntityCfg"""
# Functions of mjlab for the joint of a fixture, by quantity.
MJLAB_JOINT = {
    "frictionloss": "dr.joint_friction",
    "damping": "dr.joint_damping",
    "spring": "dr.joint_stiffness",
}
ISAACLAB = """import isaaclab.envs.mdp as mdp
from isaaclab.managers import EventTermCfg, SceneEntityCfg"""


def write_randomisation(estimates: Sequence[Estimate], folder: Path) -> tuple[Path, list[str]]:
    """Write the three files; return `ranges.json`, and a note for each parameter that a library has no term for."""
    file = folder / RANGES
    file.write_text(json.dumps(ranges(estimates), indent=2, allow_nan=False) + "\n", "utf-8")
    notes: list[str] = []
    for name, imports, terms in (
        ("mjlab", MJLAB, mjlab_terms),
        ("isaaclab", ISAACLAB, isaaclab_terms),
    ):
        text, left = _module(imports, estimates, terms)
        (folder / f"{name}_events.py").write_text(text, "utf-8")
        notes += [f"{name} has no term for {parameter}: see {RANGES}" for parameter in left]
    return file, notes


def ranges(estimates: Sequence[Estimate]) -> dict[str, Any]:
    """Content of `ranges.json`: numbers by name, and their covariance in the same order."""
    # One number for each component, in the order of the covariance.
    numbers: list[dict[str, Any]] = []
    for estimate in estimates:
        axes = axes_of(len(estimate.values))
        columns = (axes, estimate.values, estimate.stds, estimate.intervals.tolist())
        for axis, value, std, interval in zip(*columns, strict=True):
            name = f"{estimate.parameter} {axis}".strip()
            figures = {"value": float(value), "std": float(std), "ci95": interval}
            numbers.append({"name": name, "unit": estimate.unit, **figures})
    return {"numbers": numbers, "covariance": covariance(estimates).tolist()}


def covariance(estimates: Sequence[Estimate]) -> Array:
    """Covariance (n, n) of all components.

    Off the diagonal, C_ij is the sum over shared causes k of e_ki e_kj. The diagonal has the
    variances. Causes are those of `Estimate.shared`, as the gain of a joint.
    """
    if not estimates:
        return np.zeros((0, 0))
    # Stack the effects of each cause over the components of all estimates, zero where it does not
    # act.
    stds = np.concatenate([estimate.stds for estimate in estimates])
    causes: dict[str, Array] = {}
    first = 0
    for estimate in estimates:
        last = first + len(estimate.stds)
        for error in estimate.shared:
            causes.setdefault(error.cause, np.zeros(len(stds)))[first:last] = error.effect
        first = last
    effects = np.array(list(causes.values())).reshape(-1, len(stds))
    # C = E^T E, with the total variances on the diagonal.
    matrix = effects.T @ effects
    np.fill_diagonal(matrix, stds**2)
    return matrix


def mjlab_terms(estimate: Estimate) -> Iterator[Term]:
    """Yield the terms of mjlab (`mjlab.envs.mdp.dr`)."""
    match estimate.parameter.quantity:
        case "mass":
            # Mass and inertia are scaled together, by e^(2 alpha).
            low, high = _bounds(estimate)
            mass = float(estimate)
            alpha = _range(math.log(max(low / mass, 1e-6)) / 2, math.log(high / mass) / 2)
            yield "dr.pseudo_inertia", {"body_names": ".*", "alpha_range": alpha}
        case "friction":
            # One coefficient for all geoms: without `shared_random` each geom draws another one.
            bounds = {"ranges": _bounds(estimate), "operation": "abs", "shared_random": True}
            yield "dr.geom_friction", {"geom_names": ".*", **bounds}
        case "com" | "com_3d":
            offsets = dict(enumerate(_offsets(estimate)))
            yield "dr.body_com_offset", {"body_names": ".*", "ranges": offsets, "operation": "add"}
        case "height":
            (offset,) = _offsets(estimate)
            # Select the body by its name: mjlab puts fixed bodies below an extra body, which would
            # move as well.
            name = re.escape(estimate.parameter.object)
            yield "dr.body_pos", {"body_names": name, "ranges": {2: offset}, "operation": "add"}
        case "frictionloss" | "damping" | "spring" as quantity:
            bounds = {"ranges": _bounds(estimate), "operation": "abs"}
            yield MJLAB_JOINT[quantity], {"joint_names": ".*", **bounds}
        case "range":
            ends = {"ranges": _limits(estimate), "operation": "abs"}
            yield "dr.joint_limits", {"joint_names": ".*", **ends}
        case _:
            return


def isaaclab_terms(estimate: Estimate) -> Iterator[Term]:
    """Yield the terms of Isaac Lab (`isaaclab.envs.mdp`)."""
    match estimate.parameter.quantity:
        case "mass":
            bounds = {"mass_distribution_params": _bounds(estimate), "operation": "abs"}
            yield "mdp.randomize_rigid_body_mass", {"body_names": ".*", **bounds}
        case "friction":
            # Static friction has its own interval where it was measured.
            ranges = {"dynamic_friction_range": _bounds(estimate)}
            static = estimate.parts.get("static")
            widest = ranges["dynamic_friction_range"]
            if static is not None:
                half = Z95 * static.std
                widest = _range(max(static.value - half, 0.0), static.value + half)
            ranges |= {"static_friction_range": widest, "restitution_range": (0.0, 0.0)}
            yield (
                "mdp.randomize_rigid_body_material",
                {"body_names": ".*", **ranges, "num_buckets": 64, "make_consistent": True},
            )
        case "com" | "com_3d":
            offsets = dict(zip("xyz", _offsets(estimate), strict=True))
            yield "mdp.randomize_rigid_body_com", {"body_names": ".*", "com_range": offsets}
        case "range":
            sides = ("lower", "upper")
            ends = {
                f"{sides[side]}_limit_distribution_params": limit
                for side, limit in _limits(estimate).items()
            }
            yield (
                "mdp.randomize_joint_parameters",
                {"joint_names": ".*", **ends, "operation": "abs"},
            )
        case _:
            return


def _bounds(estimate: Estimate) -> Range:
    """Ends of a scalar's interval, both at least zero."""
    low, high = estimate.intervals[0].tolist()
    return _range(max(low, 0.0), high)


def _offsets(estimate: Estimate) -> list[Range]:
    """Ends of each component's interval, relative to its value."""
    offsets = estimate.intervals - estimate.values[:, None]
    return [_range(low, high) for low, high in offsets.tolist()]


def _limits(estimate: Estimate) -> dict[int, Range]:
    """Intervals of the measured limits of a joint, by side: 0 is the lower one."""
    # A deviation of zero marks a limit that was not measured.
    columns = zip(estimate.intervals.tolist(), estimate.stds, strict=True)
    return {side: _range(*ends) for side, (ends, std) in enumerate(columns) if std > 0}


def _module(
    imports: str, estimates: Sequence[Estimate], terms: Callable[[Estimate], Iterator[Term]]
) -> tuple[str, list[str]]:
    """Write the text of a module with the terms; list the parameters without one."""
    lines: list[str] = []
    left: list[str] = []
    # Mass first: `pseudo_inertia` resets the centre of mass to that of the model.
    for estimate in sorted(estimates, key=lambda estimate: estimate.parameter.quantity != "mass"):
        calls = list(terms(estimate))
        if not calls:
            left.append(str(estimate.parameter))
        for function, parameters in calls:
            lines.append(_term(estimate, function, dict(parameters)))
    return HEADER.format(imports=imports, terms="\n".join(lines)), left


def _term(estimate: Estimate, function: str, parameters: dict[str, Any]) -> str:
    """Write an entry of the dictionary. Names are literals with any content."""
    which = next(name for name in ENTITY_PARTS if name in parameters)
    entity = f"SceneEntityCfg({estimate.parameter.object!r}, {which}={parameters.pop(which)!r})"
    others = "".join(f", {name!r}: {value!r}" for name, value in parameters.items())
    return (
        f"        {str(estimate.parameter)!r}: EventTermCfg(\n"
        f"            func={function},\n"
        '            mode="startup",\n'
        f'            params={{"asset_cfg": {entity}{others}}},\n'
        "        ),"
    )


def _range(low: float, high: float) -> Range:
    """Round both ends to six digits."""
    return float(f"{low:.6g}"), float(f"{high:.6g}")
