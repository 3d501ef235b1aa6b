"""Ranges for domain randomisation: their figures, and that the modules are Python whatever the names."""

from __future__ import annotations

import ast
import json
import math
from pathlib import Path

import numpy as np
import pytest

from palpate.common.parameter import Parameter
from palpate.estimation.estimate import Estimate, FurtherValue, Shared
from palpate.twin.randomisation import covariance, write_randomisation

ODD = 'it\'s "a" mug\n'


SIGNATURES = {
    "dr.pseudo_inertia": {"alpha_range"},
    "dr.geom_friction": {"ranges", "operation", "shared_random"},
    "dr.body_com_offset": {"ranges", "operation"},
    "dr.body_pos": {"ranges", "operation"},
    "dr.joint_friction": {"ranges", "operation"},
    "dr.joint_damping": {"ranges", "operation"},
    "dr.joint_stiffness": {"ranges", "operation"},
    "dr.joint_limits": {"ranges", "operation"},
    "mdp.randomize_rigid_body_mass": {"mass_distribution_params", "operation"},
    "mdp.randomize_rigid_body_material": {
        *("static_friction_range", "dynamic_friction_range", "restitution_range"),
        *("num_buckets", "make_consistent"),
    },
    "mdp.randomize_rigid_body_com": {"com_range"},
    "mdp.randomize_joint_parameters": {
        *("lower_limit_distribution_params", "upper_limit_distribution_params", "operation")
    },
}
"""Parameters, beside `asset_cfg`, of functions of mjlab 1.6.0 and of Isaac Lab's main branch of 2026."""


def measured() -> list[Estimate]:
    parts = {"static": FurtherValue(0.5, 0.01)}
    return [
        Estimate.normal(Parameter(ODD, "mass"), "kg", 0.3, 0.01, "weighed"),
        Estimate.normal(Parameter(ODD, "friction"), "1", 0.4, 0.02, "dragged", parts=parts),
        Estimate.normal(Parameter(ODD, "com"), "m", [0.1, 0, 0], [1e-3, 2e-3, 3e-3], "balanced"),
        Estimate.normal(Parameter("desk", "height"), "m", 0.7, 0.001, "touched"),
        Estimate.normal(Parameter("door", "frictionloss"), "N m", 3.0, 0.1, "moved"),
        Estimate.normal(Parameter("door", "damping"), "N m s/rad", 5.0, 4.0, "moved"),
        Estimate.normal(Parameter("door", "spring"), "N m/rad", 5.0, 1.0, "moved"),
        Estimate.normal(Parameter("door", "range"), "rad", [0.0, 1.5], [0.0, 0.01], "pressed"),
        Estimate.normal(Parameter("mat", "stiffness"), "N/m", 900.0, 20.0, "pressed"),
    ]


def terms(file: Path) -> dict[str, tuple[str, dict[str, ast.expr]]]:
    """Functions and parameters by the name of the term, as the module states them."""
    (returned,) = [n for n in ast.walk(ast.parse(file.read_text())) if isinstance(n, ast.Return)]
    assert isinstance(returned.value, ast.Dict)
    result: dict[str, tuple[str, dict[str, ast.expr]]] = {}
    for key, call in zip(returned.value.keys, returned.value.values, strict=True):
        assert isinstance(key, ast.Constant)
        assert isinstance(call, ast.Call)
        given = {word.arg: word.value for word in call.keywords}
        params = given["params"]
        assert isinstance(params, ast.Dict)
        names = [ast.literal_eval(name) for name in params.keys if name is not None]
        rows = dict(zip(names, params.values, strict=True))
        result[key.value] = ast.unparse(given["func"]), rows
    return result


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    _, notes = write_randomisation(measured(), tmp_path)
    joint = [f"door.{quantity}" for quantity in ("frictionloss", "damping", "spring")]
    assert notes == [
        "mjlab has no term for mat.stiffness: see ranges.json",
        *(
            f"isaaclab has no term for {name}: see ranges.json"
            for name in ("desk.height", *joint, "mat.stiffness")
        ),
    ]
    return tmp_path


def test_mjlab_scales_mass_and_inertia_together(folder: Path) -> None:
    rows = terms(folder / "mjlab_events.py")
    function, params = rows[f"{ODD}.mass"]
    assert function == "dr.pseudo_inertia"
    low, high = ast.literal_eval(params["alpha_range"])
    assert 0.3 * math.exp(2 * low) == pytest.approx(0.3 - 1.96 * 0.01, rel=1e-5)
    assert 0.3 * math.exp(2 * high) == pytest.approx(0.3 + 1.96 * 0.01, rel=1e-5)
    entity = params["asset_cfg"]
    assert isinstance(entity, ast.Call)
    assert ast.literal_eval(entity.args[0]) == ODD
    offsets = ast.literal_eval(rows[f"{ODD}.com"][1]["ranges"])
    assert offsets[2] == pytest.approx((-1.96 * 3e-3, 1.96 * 3e-3))


def test_isaac_lab_has_static_and_dynamic_friction(folder: Path) -> None:
    function, params = terms(folder / "isaaclab_events.py")[f"{ODD}.friction"]
    assert function == "mdp.randomize_rigid_body_material"
    dynamic, static = (
        ast.literal_eval(params[f"{kind}_friction_range"]) for kind in ("dynamic", "static")
    )
    assert dynamic == pytest.approx((0.4 - 1.96 * 0.02, 0.4 + 1.96 * 0.02))
    assert static == pytest.approx((0.5 - 1.96 * 0.01, 0.5 + 1.96 * 0.01))


@pytest.mark.parametrize("library", ["mjlab", "isaaclab"])
def test_terms_are_the_libraries_own(folder: Path, library: str) -> None:
    for function, params in terms(folder / f"{library}_events.py").values():
        assert params.keys() - {"asset_cfg"} <= SIGNATURES[function]


def test_a_mass_is_drawn_before_the_centre_of_mass_in_any_order(tmp_path: Path) -> None:
    write_randomisation(measured()[::-1], tmp_path)
    assert next(iter(terms(tmp_path / "mjlab_events.py"))) == f"{ODD}.mass"


def test_a_fixture_draws_its_joint(folder: Path) -> None:
    rows = terms(folder / "mjlab_events.py")
    function, params = rows["door.damping"]
    assert function == "dr.joint_damping"
    assert ast.literal_eval(params["ranges"]) == pytest.approx((0.0, 5 + 1.96 * 4), rel=1e-4)
    assert "joint_names='.*'" in ast.unparse(params["asset_cfg"])
    limits = ast.literal_eval(rows["door.range"][1]["ranges"])
    assert limits == {1: pytest.approx((1.5 - 1.96 * 0.01, 1.5 + 1.96 * 0.01), rel=1e-4)}


def test_a_surface_moves_by_its_own_name(folder: Path) -> None:
    entity = terms(folder / "mjlab_events.py")["desk.height"][1]["asset_cfg"]
    assert "body_names='desk'" in ast.unparse(entity)


def test_every_number_has_its_interval(folder: Path) -> None:
    document = json.loads((folder / "ranges.json").read_text())
    assert [row["name"].removeprefix(ODD) for row in document["numbers"]] == [
        *(".mass", ".friction", ".com x", ".com y", ".com z"),
        *("desk.height", "door.frictionloss", "door.damping", "door.spring"),
        *("door.range x", "door.range y", "mat.stiffness"),
    ]
    assert np.sqrt(np.diag(document["covariance"])) == pytest.approx(
        [row["std"] for row in document["numbers"]]
    )


def test_shared_errors_correlate_two_estimates() -> None:
    gain = [
        Estimate(
            Parameter(f"{name}.mass"),
            "kg",
            np.array([value]),
            np.array([0.01]),
            np.array([[0.0, 1.0]]),
            "weighed",
            shared=(Shared("gain", "arm", (0.02 * value,)),),
        )
        for name, value in (("mug", 0.3), ("jug", 0.4))
    ]
    assert covariance(gain) == pytest.approx(np.array([[1e-4, 4.8e-5], [4.8e-5, 1e-4]]))
