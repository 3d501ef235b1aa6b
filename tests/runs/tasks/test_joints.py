"""Tasks with a drawer and a door, planned in prior and twin, carried out in a truth."""

from __future__ import annotations

import pytest

from palpate.common.errors import InputError
from palpate.common.parameter import Parameter
from palpate.estimation.estimate import Estimate
from palpate.runs.proof import prove
from palpate.runs.tasks import DIRECTIONS, Coast, Steady, joint_trial_of
from palpate.scene.load import parse_scene
from palpate.scene.scene import Scene

JOINTS = {
    "slide": 'type="slide" axis="-1 0 0" range="0 .3"',
    "hinge": 'type="hinge" axis="0 0 1" pos="0 .3 0" range="-1.5 0"',
}
SCENE = """<mujoco><option timestep="0.001"/><compiler angle="radian"/><worldbody>
  <site name="robot_base"/>
  <body name="cabinet" pos="0.8 0 0.2"><geom type="box" size=".1 .2 .1"/>
    <body name="thing" pos="-0.15 0 0">
      <joint {joint} damping="?" frictionloss="?"/>
      <geom name="handle" type="box" size=".01 .01 .02" mass="2"/>
    </body>
  </body>
</worldbody></mujoco>"""
DAMPING, FRICTION = Parameter("thing.damping"), Parameter("thing.frictionloss")
DRAWER = {DAMPING: (5.0,), FRICTION: (3.0,)}


def scene(kind: str = "slide") -> Scene:
    return parse_scene(SCENE.format(joint=JOINTS[kind]))


def measured(damping: float, friction: float) -> list[Estimate]:
    return [
        Estimate.normal(DAMPING, "N·s/m", damping, 0.2, "moved"),
        Estimate.normal(FRICTION, "N", friction, 0.1, "moved"),
    ]


def test_a_drawer_coasts_as_far_as_friction_lets_it() -> None:
    """After a push F for T, v = (F - f) T / m, and s = v T / 2 + m v^2 / (2 f)."""
    world = joint_trial_of(scene(), "thing", {DAMPING: (0.0,), FRICTION: (3.0,)})
    v = (7.0 - 3.0) * 0.2 / 2.0
    expected = v * 0.2 / 2 + 2.0 * v**2 / (2 * 3.0)
    assert Coast(DIRECTIONS[0]).outcome(world, 7.0) == pytest.approx(expected, rel=0.05)


def test_a_drawer_opens_steadily_against_friction_and_damping() -> None:
    """Once it has its speed (2 kg over 20 N s/m: in 0.1 s): f + b v."""
    world = joint_trial_of(scene(), "thing", {DAMPING: (20.0,), FRICTION: (3.0,)})
    assert Steady(DIRECTIONS[0]).plan(world) == pytest.approx(3.0 + 20.0 * 0.1, rel=0.02)


def test_a_door_has_the_same_forces_at_its_handle() -> None:
    """0.3 m from its hinge; it opens the other way, to its lower limit."""
    values = {DAMPING: (20.0 * 0.3**2,), FRICTION: (3.0 * 0.3,)}
    world = joint_trial_of(scene("hinge"), "thing", values)
    assert Steady(DIRECTIONS[0]).plan(world) == pytest.approx(5.0, rel=0.02)


@pytest.mark.parametrize("kind", JOINTS)
def test_a_twin_of_a_joint_plans_better_than_its_prior(kind: str) -> None:
    share = 1.0 if kind == "slide" else 0.09
    true = {DAMPING: (5.0 * share,), FRICTION: (3.0 * share**0.5,)}
    proof = prove(scene(kind), measured(5.1 * share, 3.02 * share**0.5), true, draws=2)
    assert [row.task for row in proof.rows] == ["coast to an opening", "open steadily"]
    for row in proof.rows:
        assert row.depends
        assert abs(row.twin[0]) < abs(row.prior[0]) / 3


def test_a_friction_below_zero_is_drawn_again() -> None:
    with pytest.raises(InputError, match="no joint has a frictionloss"):
        joint_trial_of(scene(), "thing", {FRICTION: (-0.1,)})
