"""Ranges for domain randomisation: their figures, and that the modules are Python whatever the names."""

from __future__ import annotations

import ast
import json
import math
from pathlib import Path

import numpy as np
import pytest

from palpate.estimation.estimate import Estimate, Part, Shared
from palpate.parameter import Parameter
from palpate.twin.export.randomisation import covariance, write_randomisation

ODD = 'it\'s "a" mug\n'


def measured() -> list[Estimate]:
    parts = {"static": Part(0.5, 0.01)}
    return [
        Estimate.normal(Parameter(ODD, "mass"), "kg", 0.3, 0.01, "weighed"),
        Estimate.normal(Parameter(ODD, "friction"), "1", 0.4, 0.02, "dragged", parts=parts),
        Estimate.normal(Parameter(ODD, "com"), "m", [0.1, 0, 0], [1e-3, 2e-3, 3e-3], "balanced"),
        Estimate.normal(Parameter("mat", "stiffness"), "N/m", 900.0, 20.0, "pressed"),
    ]


def terms(file: Path) -> dict[str, tuple[str, dict[str, ast.expr]]]:
    """Functions and parameters by the name of the term, as the module states them."""
    (returned,) = [n for n in ast.walk(ast.parse(file.read_text())) if isinstance(n, ast.Return)]
    assert isinstance(returned.value, ast.Dict)
    found: dict[str, tuple[str, dict[str, ast.expr]]] = {}
    for key, call in zip(returned.value.keys, returned.value.values, strict=True):
        assert isinstance(key, ast.Constant)
        assert isinstance(call, ast.Call)
        given = {word.arg: word.value for word in call.keywords}
        params = given["params"]
        assert isinstance(params, ast.Dict)
        names = [ast.literal_eval(name) for name in params.keys if name is not None]
        rows = dict(zip(names, params.values, strict=True))
        found[key.value] = ast.unparse(given["func"]), rows
    return found


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    _, notes = write_randomisation(measured(), tmp_path)
    assert notes == [
        f"{library} has no term for mat.stiffness: see ranges.json"
        for library in ("mjlab", "isaaclab")
    ]
    return tmp_path


def test_mjlab_scales_mass_and_inertia_together(folder: Path) -> None:
    found = terms(folder / "mjlab_events.py")
    function, params = found[f"{ODD}.mass"]
    assert function == "dr.pseudo_inertia"
    low, high = ast.literal_eval(params["alpha_range"])
    assert 0.3 * math.exp(2 * low) == pytest.approx(0.3 - 1.96 * 0.01, rel=1e-5)
    assert 0.3 * math.exp(2 * high) == pytest.approx(0.3 + 1.96 * 0.01, rel=1e-5)
    entity = params["asset_cfg"]
    assert isinstance(entity, ast.Call)
    assert ast.literal_eval(entity.args[0]) == ODD
    offsets = ast.literal_eval(found[f"{ODD}.com"][1]["ranges"])
    assert offsets[2] == pytest.approx((-1.96 * 3e-3, 1.96 * 3e-3))


def test_isaac_lab_has_static_and_dynamic_friction(folder: Path) -> None:
    function, params = terms(folder / "isaaclab_events.py")[f"{ODD}.friction"]
    assert function == "mdp.randomize_rigid_body_material"
    dynamic, static = (
        ast.literal_eval(params[f"{kind}_friction_range"]) for kind in ("dynamic", "static")
    )
    assert dynamic == pytest.approx((0.4 - 1.96 * 0.02, 0.4 + 1.96 * 0.02))
    assert static == pytest.approx((0.5 - 1.96 * 0.01, 0.5 + 1.96 * 0.01))


def test_every_number_has_its_interval(folder: Path) -> None:
    found = json.loads((folder / "ranges.json").read_text())
    assert [row["name"].removeprefix(ODD) for row in found["numbers"]] == [
        *(".mass", ".friction", ".com x", ".com y", ".com z"),
        "mat.stiffness",
    ]
    assert np.sqrt(np.diag(found["covariance"])) == pytest.approx(
        [row["std"] for row in found["numbers"]]
    )


def test_what_two_estimates_share_correlates_them() -> None:
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
