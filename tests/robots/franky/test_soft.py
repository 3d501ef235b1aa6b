"""A real arm's springs, on the embedded one: heavy things sag by more than a pose's tolerance."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

import palpate as pp
from palpate.execution.simulated_cell import simulated_cell
from palpate.robots.owner import own_arm
from palpate.runs.executing import perform
from palpate.scene.scene import with_real_arm

DESK = """<mujoco><worldbody>
  <geom name="desk" type="box" size=".3 .4 .1" pos=".5 0 .1"/>
  <body name="mug" pos=".5 0 .28"><freejoint/><geom type="box" size=".03 .03 .08"{mass}/></body>
</worldbody></mujoco>"""


def test_two_kilograms_are_lifted_and_set_down_on_800_newtons_a_metre() -> None:
    scene = with_real_arm(pp.load(DESK.format(mass="")))
    assert scene.arm.stiffness.translation == 800.0
    plan = pp.load(DESK.format(mass="")).plan("how heavy is the mug?")
    world = with_real_arm(pp.load(DESK.format(mass=' mass="2"')))
    done = perform(plan, scene, simulated_cell(scene, world, noise="lab").robot())
    assert (done.status, done.stopped_by) == ("complete", None)
    lifted = next(leaf for leaf in done.trace.leaves if "z_offset" in leaf.label and leaf.context)
    assert lifted.status == "SUCCESS"
    tcp = done.trace.samples.pose_world_tcp[:, 2] - done.trace.samples.target_world_tcp[:, 2]
    assert tcp.min() == pytest.approx(-2 * 9.81 / 800, rel=0.2)


def test_springs_set_in_robot_yaml_stay() -> None:
    arm = pp.load(DESK.format(mass="")).arm
    assert arm.hardware is not None
    assert arm.real().stiffness == arm.hardware.stiffness
    assert replace(arm, hardware=None).real().stiffness == arm.stiffness


def test_a_real_arm_knows_its_height_as_well_as_somebody_has_measured_it(tmp_path: Path) -> None:
    """10 mm in z are reported of arms as they come (libfranka issue 198)."""
    assert own_arm("fr3", False, None).nominal.tip_offset_std == 2e-4
    assert own_arm("fr3", False, None, real=True).nominal.tip_offset_std == 5e-3
    measured = tmp_path / "robot.yaml"
    measured.write_text("tip_offset: {value: 0.0091, std: 0.00004}\n")
    arm = own_arm("fr3", False, measured, real=True)
    assert arm.real().nominal.tip_offset_std == 4e-5
