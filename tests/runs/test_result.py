"""`result.json` at every stage at which a run may end."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from palpate import __version__
from palpate.common.belief import Belief
from palpate.common.parameter import Parameter
from palpate.common.pose import Pose
from palpate.estimation.estimate import Estimate, FitTest, FurtherValue, Shared, not_identified
from palpate.execution.rehearsal import Rehearsal
from palpate.planning.check.finding import Finding
from palpate.planning.plan import Node, Plan
from palpate.runs.read import EMPTY_SCENE, belief_from, estimate_from
from palpate.runs.result import belief_json, parameter_json, result_json
from palpate.runs.run import Ending, Run, Status
from palpate.runs.settings import Settings
from palpate.scene.load import parse_scene
from palpate.trace.recording import Context, Recording
from palpate.twin.twin import Twin
from palpate.twin.validate import ReplayResidual, Validation

SCENE = parse_scene("<mujoco><worldbody/></mujoco>")
MASS, COM = Parameter("cup", "mass"), Parameter("cup", "com")
TREE = Node(
    "Sequence",
    (),
    (Node("OpenGripper"), Node("Parallel", (), (Node("MeasureForces"), Node("MovePose")))),
)
PLAN = Plan((MASS,), TREE, "The cup is weighed.", "symbolic", ("the friction is known",))
WEIGHED = Estimate(
    MASS,
    "kg",
    (0.2541,),
    (0.0008,),
    ((0.2525, 0.2557),),
    "Weighed.",
    (),
    parts={"single-shot": FurtherValue(0.262, 0.02)},
)
PULLED = FitTest("along the lift", 30.1, 4.2, "Something pulls on it: the force grows by 30 N/m.")
CONTRADICTED = replace(WEIGHED, tests=(PULLED,))
EXECUTION = Ending("complete", None, 3, 31.20004, 4.00006, ("bad luck",))
TWIN = Twin(
    "<mujoco/>",
    "",
    ("a note",),
    Validation(True, 1e-5, ReplayResidual(0.02, None), ReplayResidual(None, None, "stopped")),
)
REJECTED = Run(
    Settings(request="the mass of the cup", seed=7), SCENE, replace(PLAN, tree=None, parameters=())
)
COMPLETE = replace(
    REJECTED, plan=PLAN, execution=EXECUTION, estimates=(WEIGHED,), finished=TWIN, total_seconds=5.5
)


def result(run: Run, folder: Path | None = None) -> dict[str, Any]:
    """As a script reads it."""
    return json.loads(json.dumps(result_json(run, folder), allow_nan=False))


def test_a_noise_model_goes_by_its_own_name(tmp_path: Path) -> None:
    (tmp_path / "loud.yaml").write_text("name: loud one")
    asked = replace(COMPLETE.settings, noise=str(tmp_path / "loud.yaml"))
    document = result_json(replace(COMPLETE, settings=asked), None)
    assert document["provenance"]["noise"] == "loud one"


def test_a_complete_run(tmp_path: Path) -> None:
    document = result(COMPLETE, tmp_path / "run")
    assert document["status"] == "complete"
    assert document["request"] == "the mass of the cup"
    assert document["plan"] == {
        "planner": "symbolic",
        "actions": 3,
        "explanation": "The cup is weighed.",
        "notes": ["the friction is known"],
        "findings": [],
    }
    assert document["execution"] == {
        "actions": 3,
        "robot_seconds": 31.2,
        "wall_seconds": 4.0,
        "total_seconds": 5.5,
        "stopped_by": None,
        "setbacks": ["bad luck"],
        "held": None,
    }
    assert document["twin"] == {
        "notes": ["a note"],
        "unwritten": [],
        "validation": {
            "settled": True,
            "drift_m": 1e-5,
            "residual_twin": {"force_N": 0.02, "position_m": None, "note": ""},
            "residual_template": {"force_N": None, "position_m": None, "note": "stopped"},
        },
    }
    assert document["provenance"] == {
        "palpate": __version__,
        "seed": 7,
        "noise": "measured",
        "world": None,
    }
    assert document["files"] == {
        name: str(tmp_path / "run" / file)
        for name, file in (
            ("request", "request.json"),
            ("plan", "plan.json"),
            ("report", "report.html"),
            ("tree", "tree.xml"),
            ("trace", "trace.mcap"),
            ("twin", "twin.xml"),
        )
    }


def test_a_rejection_has_no_execution_and_no_twin(tmp_path: Path) -> None:
    finding = Finding("tree.children[0]", "unreachable", "it is out of reach")
    document = result(replace(REJECTED, findings=(finding,)), tmp_path)
    assert (
        document["status"],
        document["parameters"],
        document["execution"],
        document["twin"],
    ) == (
        "rejected",
        [],
        None,
        None,
    )
    assert document["plan"]["findings"] == [
        {"path": "tree.children[0]", "rule": "unreachable", "message": "it is out of reach"}
    ]
    assert set(document["files"]) == {"request", "plan", "report"}


def test_a_pose_is_stated_by_sight_touch_and_both_and_a_contradiction_is_no_success() -> None:
    seen = Belief.of(Pose.of((0.5, 0.1, 0.4)), np.diag([1e-5] * 3 + [1e-4] * 3))
    along = np.array([1.0, 0.0, 0.0])
    felt = seen.update("probe", along, np.array([0.47, 0.1, 0.4]), 0.002)
    document = result(replace(COMPLETE, beliefs={"cup": felt}))
    assert document["status"] == "complete"
    (pose,) = document["poses"]
    assert pose["object"] == "cup"
    assert pose["touch"][0]["apart"] == 0.002
    assert 0.0 < pose["both"]["pos"][0] - pose["sight"]["pos"][0] < 0.002
    assert pose["both"]["covariance"][0][0] < pose["sight"]["covariance"][0][0]
    assert belief_json("cup", belief_from(pose)) == belief_json("cup", felt)
    off = seen.update("probe", along, np.array([0.47, 0.1, 0.4]), 0.02)
    document = result(replace(COMPLETE, beliefs={"cup": off}))
    assert document["status"] == "failed"
    assert "+20.0 ± 1.0 mm along +x" in document["poses"][0]["contradiction"]


def test_a_rehearsal_is_in_the_result() -> None:
    assert result(replace(REJECTED, rehearsal=Rehearsal(3, 12.5, 9.9, "it slips")))[
        "rehearsal"
    ] == {
        "actions": 3,
        "robot_seconds": 12.5,
        "peak_force": 9.9,
        "failure": "it slips",
        "draws": 1,
        "path": "tree",
    }
    assert result(REJECTED)["rehearsal"] is None


def test_a_result_without_a_folder_lists_no_files() -> None:
    assert result(COMPLETE)["files"] == {}


def test_a_scalar_is_a_number_and_a_vector_a_list() -> None:
    row = parameter_json(WEIGHED)
    assert row == {
        "object": "cup",
        "quantity": "mass",
        "value": 0.2541,
        "unit": "kg",
        "std": 0.0008,
        "ci95": [0.2525, 0.2557],
        "method": "Weighed.",
        "verdict": "identified",
        "verdicts": None,
        "unseen": [],
        "whole": "identified",
        "reason": None,
        "bounds": [None, None],
        "at_most": None,
        "at_least": None,
        "axes": None,
        "contradiction": None,
        "tests": [],
        "components": {"single-shot": {"value": 0.262, "std": 0.02, "unit": None}},
        "shared": [],
        "freedom": None,
        "evidence": [],
    }
    com = parameter_json(
        Estimate(COM, "m", (0.1, 0.0, 0.2), (0.01,) * 3, ((0.0, 0.2),) * 3, "", ())
    )
    assert com["value"] == [0.1, 0.0, 0.2]
    assert com["ci95"] == [[0.0, 0.2]] * 3
    assert com["verdicts"] == ["identified"] * 3


def test_an_unobserved_component_has_its_own_verdict() -> None:
    com = Estimate(COM, "m", (0.1, 0.0, 0.2), (0.01,) * 3, ((0.0, 0.2),) * 3, "", (), unseen=(2,))
    row = parameter_json(com)
    assert row["verdict"] == "identified"
    assert row["verdicts"] == ["identified", "identified", "prior-dominated"]
    assert row["whole"] == "prior-dominated"
    assert row["axes"] == {"x": "identified", "y": "identified", "z": "prior-dominated"}
    assert estimate_from(row) == com
    guessed = parameter_json(replace(com, verdict="prior-dominated"))
    assert guessed["verdicts"] == ["prior-dominated"] * 3


def test_a_value_at_a_bound_is_read_back_with_its_limit() -> None:
    light = Estimate.normal(MASS, "kg", -0.002, 0.004, "Weighed.").bounded((0.0, math.inf))
    document = json.loads(json.dumps(parameter_json(light)))
    assert (document["value"], document["bounds"], document["verdict"]) == (
        -0.002,
        [0.0, None],
        "prior-dominated",
    )
    assert document["at_most"] == pytest.approx(0.0062, abs=5e-4)
    assert document["at_least"] is None
    assert document["reason"] == "the 95 % interval reaches a physical bound"
    again = estimate_from(document)
    assert again == light
    assert again.is_evidence
    # A vector, with an unseen component and one at its bound.
    inertia = Estimate.normal(
        Parameter("cup", "inertia"),
        "kg·m²",
        (3e-3, 2e-4, 3e-3, 0, 0, 0),
        (3e-4,) * 6,
        "",
        unseen=(5,),
    ).bounded(((0.0, math.inf),) * 3 + ((-math.inf, math.inf),) * 3)
    document = json.loads(json.dumps(parameter_json(inertia)))
    assert [limit is None for limit in document["at_most"]] == [True, False, True, True, True, True]
    assert estimate_from(document) == inertia


def test_a_result_of_an_earlier_version_is_read() -> None:
    row = parameter_json(WEIGHED)
    for name in ("reason", "bounds", "at_most", "at_least", "unseen"):
        del row[name]
    assert estimate_from(row) == WEIGHED


def test_the_evidence_of_an_estimate_is_read_back() -> None:
    window = Recording("gripper_forces", 1.25, 2.5, Context("still", holding="cup"), "tree", (0.5,))
    weighed = replace(WEIGHED, evidence=(window,), parts={"held": FurtherValue(0.1, 0.01, "s")})
    assert estimate_from(json.loads(json.dumps(parameter_json(weighed)))) == weighed


def test_a_contradicted_estimate_names_the_disagreement() -> None:
    row = parameter_json(CONTRADICTED)
    assert (row["value"], row["verdict"]) == (0.2541, "contradicted")
    assert row["contradiction"] == "Something pulls on it: the force grows by 30 N/m."
    assert row["tests"] == [
        {
            "name": "along the lift",
            "statistic": 30.1,
            "limit": 4.2,
            "finding": "Something pulls on it: the force grows by 30 N/m.",
            "passed": False,
        }
    ]


def test_the_truth_of_a_simulated_world_is_kept() -> None:
    assert result(COMPLETE)["parameters"][0]["true_value"] is None
    assert result(replace(COMPLETE, truth={MASS: (0.25,)}))["parameters"][0]["true_value"] == 0.25


def test_an_estimate_is_read_back_with_its_tests() -> None:
    senseless = replace(PULLED, statistic=math.nan)
    for estimate in (WEIGHED, CONTRADICTED, replace(WEIGHED, tests=(senseless,))):
        document = result(replace(COMPLETE, estimates=(estimate,)))["parameters"][0]
        again = estimate_from(document)
        assert repr(again) == repr(estimate)
        assert again.contradiction == estimate.contradiction


def test_shared_errors_of_an_estimate_are_written_and_read_back() -> None:
    gain = Shared("gain of joint 4", "arm", (-0.0005,))
    estimate = replace(WEIGHED, shared=(gain,), freedom=7.5)
    document = result(replace(COMPLETE, estimates=(estimate,)))["parameters"][0]
    assert document["shared"] == [{"cause": "gain of joint 4", "of": "arm", "effect": [-0.0005]}]
    again = estimate_from(document)
    assert (again.shared, again.freedom) == ((gain,), 7.5)
    assert again.shared_std == pytest.approx([0.0005])
    assert estimate_from(parameter_json(WEIGHED)).freedom == math.inf


@pytest.mark.parametrize("parameter", [MASS, COM])
def test_an_unidentified_parameter_has_no_value(parameter: Parameter) -> None:
    row = parameter_json(not_identified(parameter, "1", "It slipped."))
    assert (row["value"], row["std"], row["ci95"]) == (None, None, None)
    assert (row["verdict"], row["method"]) == ("not identified", "It slipped.")


@pytest.mark.parametrize(
    ("changes", "status"),
    [
        ({}, "complete"),
        ({"estimates": (not_identified(MASS, "kg", ""),)}, "failed"),
        ({"estimates": ()}, "failed"),
        ({"estimates": (replace(WEIGHED, verdict="prior-dominated"),)}, "failed"),
        ({"estimates": (CONTRADICTED,)}, "failed"),
        ({"execution": replace(EXECUTION, status="stopped", stopped_by="slip")}, "aborted"),
        ({"execution": None}, "rejected"),
    ],
)
def test_the_status_says_how_it_ended(changes: dict[str, Any], status: Status) -> None:
    assert replace(COMPLETE, **changes).status == status


@pytest.mark.parametrize(("quantity", "status"), [("com", "complete"), ("com_3d", "failed")])
def test_a_centre_of_mass_in_all_axes_is_complete_only_with_all(
    quantity: str, status: Status
) -> None:
    parameter = Parameter("hammer", quantity)
    values = (0.1, 0.0, 0.2), (0.01,) * 3, ((0.0, 0.2),) * 3
    plan = replace(COMPLETE.plan, parameters=(parameter,))
    blind = Estimate(parameter, "m", *values, "", (), unseen=(2,))
    assert replace(COMPLETE, plan=plan, estimates=(blind,)).status == status
    seen = replace(blind, unseen=())
    assert replace(COMPLETE, plan=plan, estimates=(seen,)).status == "complete"


def test_a_negative_standard_deviation_is_refused() -> None:
    mass = Estimate(
        Parameter("mug", "mass"), "kg", 0.3, 0.01, (0.28, 0.32), "contrast", (), "identified"
    )
    row = parameter_json(mass)
    assert estimate_from(row).stds.tolist() == [0.01]
    with pytest.raises(ValueError, match=r"std of mug.mass is negative: -0.01"):
        estimate_from({**row, "std": -0.01})


@pytest.mark.parametrize("simulated", [True, False])
def test_estimates_of_a_simulated_run_say_so(simulated: bool) -> None:
    mass = Estimate.normal(Parameter("mug", "mass"), "kg", 0.34, 0.01, "Weighed.")
    plan = Plan((mass.parameter,), None, "")
    run = Run(Settings(), parse_scene(EMPTY_SCENE), plan, estimates=(mass,), simulated=simulated)
    (outcome,) = run.estimates
    assert outcome == mass, "the label is no part of the result"
    assert repr(outcome).endswith(", simulated>") == simulated
    assert outcome.cells()[-1] == "identified" + ", simulated" * simulated
