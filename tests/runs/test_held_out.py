"""A twin is judged on a motion that it was not fitted to, at the noise of `lab`."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

import palpate as pp
from palpate.common.parameter import Parameter
from palpate.estimation.estimate import Estimate, FitTest
from palpate.runs.held_out import BALANCE, TORQUES, WEIGHT, HeldOutMotion, held_out, with_tests
from palpate.runs.read import held_out_from
from palpate.runs.report.sections import predictions
from palpate.runs.result import held_out_json
from palpate.scene.load import parse_scene
from palpate.trace.samples import Trace

TEXT = """<mujoco><worldbody>
  <site name="robot_base"/>
  <body name="desk" pos="0.4 0 -0.03"><geom type="box" size=".6 .6 .03" friction="0.6 0.005 0.0001"/></body>
  <body name="mug" pos="0.5 0.1 0.05"><freejoint/>{inertial}
    <geom type="box" size=".03 .02 .05" friction="0.6 0.005 0.0001"{mass}/></body>
</worldbody></mujoco>
"""
MASS = 0.34
INERTIAL = '<inertial pos="{x} 0 0" mass="{mass}" diaginertia="4e-4 5e-4 2e-4"/>'


def text(mass: float | None = None, x: float | None = None) -> str:
    """The scene as it states the mug's mass and, with `x` in m, its centre of mass."""
    if x is not None:
        return TEXT.format(inertial=INERTIAL.format(x=x, mass=mass), mass="")
    return TEXT.format(inertial="", mass="" if mass is None else f' mass="{mass}"')


@pytest.fixture(scope="module")
def run() -> pp.Run:
    return pp.run(text(), "how heavy is the mug?", world=text(MASS), noise="lab", seed=3, fast=True)


def judged(trace: Trace | None, mass: float, x: float | None = None) -> HeldOutMotion:
    """The motion that was held out, by a scene that states the mug's mass."""
    assert trace is not None
    motions = held_out(parse_scene(text(mass, x)), trace, ())
    assert motions is not None
    return motions.motions[0]


def test_the_way_down_is_predicted_from_the_recordings_before(run: pp.Run) -> None:
    assert run.held_out is not None
    (motion,) = run.held_out.motions
    assert motion.motion == "the way down with the mug, after it was measured"
    assert motion.agrees
    assert motion.p > 0.001
    assert motion.dof >= 7
    assert abs(motion.weight) < 4 * motion.weight_std
    assert motion.weight_std < 0.03 * MASS
    # The scene as given holds a guess of the mass.
    assert motion.rms_template > 5 * motion.rms
    assert motion.chi2_template > 3 * motion.chi2


def test_the_prediction_uses_no_sample_of_the_held_out_motion(run: pp.Run) -> None:
    """Loads that act in it alone are found, whatever the estimate was made of."""
    assert run.held_out is not None
    motion = run.held_out.motions[0]
    samples = run.trace.samples
    torques = samples.tau_ext.copy()
    inside = (samples.t >= motion.start) & (samples.t <= motion.end)
    torques[inside] *= 1.1
    heavier = replace(run.trace, samples=replace(samples, tau_ext=torques))
    motions = held_out(run.scene, heavier, run.estimates)
    assert motions is not None
    assert not motions.agrees
    assert "heavier than the twin predicts" in motions.motions[0].disagreement


def test_a_mass_that_is_a_tenth_off_is_found(run: pp.Run) -> None:
    assert judged(run.trace, MASS).agrees
    wrong = judged(run.trace, 1.1 * MASS)
    assert not wrong.agrees
    assert next(test.name for test in wrong.tests if not test.passed) == WEIGHT
    assert wrong.weight == pytest.approx(-0.1 * MASS, abs=4 * wrong.weight_std)


@pytest.mark.parametrize(("name", "agrees"), [(WEIGHT, False), (BALANCE, False), (TORQUES, True)])
def test_weight_and_balance_decide_and_what_the_arm_adds_does_not(
    run: pp.Run, name: str, agrees: bool
) -> None:
    assert run.held_out is not None
    failed = FitTest(name, 90.0, 4.0, "It is not as predicted.")
    motion = replace(run.held_out.motions[0], tests=(failed,))
    assert motion.agrees == agrees
    assert motion.disagreement.startswith("It is not as predicted.")


def test_a_centre_of_mass_that_is_30_mm_off_is_found(run: pp.Run) -> None:
    assert judged(run.trace, MASS, 0.0).agrees
    wrong = judged(run.trace, MASS, 0.03)
    assert BALANCE in [test.name for test in wrong.tests if not test.passed]
    assert abs(wrong.weight) < 4 * wrong.weight_std


def test_an_estimate_that_another_motion_contradicts_is_not_measured(run: pp.Run) -> None:
    estimate: Estimate = run["mug.mass"]
    wrong = judged(run.trace, 1.1 * MASS)
    assert run.held_out is not None
    held = replace(run.held_out, motions=(wrong,))
    (contradicted,) = with_tests((estimate,), held)
    assert contradicted.verdict == "contradicted"
    assert "held out" in contradicted.contradiction
    assert with_tests((estimate,), run.held_out)[0].identified


def test_held_out_motions_are_written_and_read_back(run: pp.Run) -> None:
    document = json.loads(json.dumps(held_out_json(run.held_out)))
    assert document["motion"].startswith("the way down with the mug")
    assert document["agrees"] is True
    assert document["chi2"] == pytest.approx(document["motions"][0]["chi2"])
    assert document["dof"] == document["motions"][0]["dof"]
    assert held_out_from(document) == run.held_out
    assert held_out_json(None) is None
    assert held_out_from(None) is None


def test_the_report_shows_the_joints_with_most_of_the_load(run: pp.Run) -> None:
    (shown,) = predictions(run.held_out)
    assert shown.agrees
    assert len(shown.panels) == 3
    assert {panel.name for panel in shown.panels} > {"joint 2", "joint 4"}
    assert all(len(panel.points) >= 3 for panel in shown.panels)
    assert "than predicted" in shown.text
    assert predictions(None) == []


def test_a_trace_without_lifts_has_no_held_out_motion(run: pp.Run) -> None:
    assert held_out(run.scene, replace(run.trace, recordings=()), ()) is None
    unknown = held_out(run.scene, run.trace, ())
    assert unknown is not None
    assert unknown.motions == ()
    assert unknown.notes == (
        "mug: neither a mass nor a centre of mass was measured that could predict a motion",
    )


@pytest.mark.parametrize("quantity", ["com", "com_3d"])
def test_other_estimates_of_an_object_do_not_affect_the_test_of_its_weight(
    run: pp.Run, quantity: str
) -> None:
    """One that is not identified without the held-out motion leaves the mass as it was."""
    other = replace(run["mug.mass"], parameter=Parameter("mug", quantity))
    motions = held_out(run.scene, run.trace, (other,))
    assert motions is not None
    assert motions.notes == ()
    assert motions.motions[0].agrees
    assert run.held_out is not None
    assert motions.motions[0].weight == pytest.approx(run.held_out.motions[0].weight, abs=0.002)


def test_a_centre_of_mass_along_gravity_is_judged_by_the_balance(run: pp.Run) -> None:
    wrong = judged(run.trace, MASS, 0.03)
    assert run.held_out is not None
    held = replace(run.held_out, motions=(wrong,))
    centre = replace(run["mug.mass"], parameter=Parameter("mug", "com_3d"))
    assert with_tests((centre,), held)[0].verdict == "contradicted"


def test_a_mass_that_is_not_identified_without_the_motion_says_so(run: pp.Run) -> None:
    (recording,) = (item for item in run.trace.recordings if item.context.activity == "still")
    vague = replace(run.trace, recordings=(replace(recording, end=recording.start + 0.02),))
    motions = held_out(run.scene, vague, run.estimates)
    assert motions is not None
    assert motions.notes == (
        "mug: without the way down with the mug, after it was measured, its mass is not identified",
    )
