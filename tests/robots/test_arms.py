"""The same programs on other arms: KUKA's iiwa, a folder of one's own, MuJoCo Menagerie's Panda."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from own_arm import write_arm

from palpate.estimation.estimate import Estimate
from palpate.estimation.rigid_bodies import own_motion
from palpate.robots.owner import load_description
from palpate.runs import pipeline
from palpate.runs.run import Run
from palpate.studies.scenarios.catalogue import scenario

PANDA = """like: fr3
label: Franka Emika Panda of MuJoCo Menagerie
mjcf: {mjcf}
joints: [joint1, joint2, joint3, joint4, joint5, joint6, joint7]
home: [0, -0.7853981633974483, 0, -2.356194490192345, 0, 1.5707963267948966, 0.7853981633974483]
velocity: [2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61]
torque: [87, 87, 87, 87, 12, 12, 12]
payload: 3.0
workspace: {{min: [-0.855, -0.855, -0.9], max: [0.855, 0.855, 1.19]}}
hand:
  body: hand
  tcp: [0, 0, 0.1034]
  fingers: [finger_joint1, finger_joint2]
  pads: {{centre: [0, 0.004, 0.045], half: [0.0085, 0.004, 0.009]}}
"""


def measured(name: str, arm: str) -> Run:
    settings = scenario(name).settings(arm=arm, noise="lab", seed=0).check_values()
    made = pipeline.plan(settings, pipeline.load(settings))
    assert made.findings == ()
    return pipeline.measure(made)


def within(estimate: Estimate, truth: float) -> bool:
    """Whether the truth is in the 95 % interval, or 3 standard deviations near."""
    value, std = float(estimate.values[0]), float(estimate.stds[0])
    low, high = estimate.intervals[0]
    return low <= truth <= high or abs(value - truth) <= 3 * std


def judge(made: Run) -> None:
    assert made.execution is not None
    assert made.execution.stopped_by is None
    assert {e.parameter for e in made.estimates} == set(made.plan.parameters)
    assert not made.plan.unmeasured
    for estimate in made.estimates:
        truth = made.truth[estimate.parameter][0]
        assert estimate.verdict == "identified", estimate
        if estimate.parameter.quantity == "height":
            assert abs(float(estimate.values[0]) - truth) < 0.001
        else:
            assert within(estimate, truth), (estimate, truth)


@pytest.mark.long
@pytest.mark.parametrize("name", ["bottle_and_table", "friction"])
def test_a_second_arm_measures_the_same(name: str) -> None:
    made = measured(name, "iiwa14")
    judge(made)
    assert made.trace.hand.joints[0] == "iiwa_joint1"


def test_an_own_arm_measures_the_same(tmp_path: Path) -> None:
    judge(measured("bottle_and_table", f"{write_arm(tmp_path / 'mine')}/"))


def test_menageries_panda_measures_the_same(tmp_path: Path) -> None:
    menagerie = pytest.importorskip("mujoco_menagerie")
    try:
        robot = menagerie.get("franka_emika_panda")
        robot.model("panda")
        mjcf = Path(robot.spec("panda").modelfiledir) / "panda.xml"
    except menagerie.DownloadError as error:
        pytest.skip(f"the package fetches its files when asked: {error}")
    (tmp_path / "description.yaml").write_text(PANDA.format(mjcf=mjcf))
    judge(measured("bottle_and_table", f"{tmp_path}/"))


def test_the_panda_has_the_identified_links_on_the_kinematics_of_an_fr3() -> None:
    """Masses and first moments of Gaz et al., RA-L 2019, by the torque that holds the arm up."""
    panda, fr3 = load_description("panda"), load_description("fr3")
    ours, theirs = panda.nominal.chain, fr3.nominal.chain
    assert ours is not None
    assert theirs is not None
    for signal in ("axes", "anchors", "tcp", "tool"):
        np.testing.assert_allclose(getattr(ours, signal), getattr(theirs, signal), atol=1e-9)
    masses = [link.mass for link in ours.links[:7]]
    assert masses == [4.970684, 0.646926, 3.228604, 3.587895, 1.225946, 1.666555, 0.735522]
    # Two published models of one geometry hold themselves up with nearly the same torques.
    holding, other = (
        own_motion(chain, panda.home[None], *np.zeros((2, 1, 7)), np.array([0, 0, -9.81]))[0]
        for chain in (ours, theirs)
    )
    assert holding[1] == pytest.approx(-3.988, abs=0.01)
    assert np.abs(holding - other).max() < 1.5
    assert panda.limits.q_max.tolist()[5] == 3.7525
    assert panda.limits.dq_max.tolist() == [2.175] * 4 + [2.61] * 3
    assert panda.nominal.joints[0] == "panda_joint1"


@pytest.mark.long
def test_the_panda_measures_the_bottle_of_the_paper() -> None:
    judge(measured("bottle_and_table", "panda"))
