"""Baseline of a probe: friction and drift in free air, and contacts, which grow."""

from __future__ import annotations

from dataclasses import dataclass, field
from types import SimpleNamespace

import numpy as np
import pytest

from palpate.common.pose import Pose
from palpate.primitives.contact import MoveUntilContact
from palpate.primitives.guarding import CREEPING, DRIFT_MOST, FreeAir, settle
from palpate.primitives.state import SymbolicState
from palpate.scene.load import parse_scene
from palpate.trace.samples import Samples

DOWN = np.array([0.0, 0.0, -1.0])
SPEED, TICK = 0.012, 0.02


@dataclass
class _State:
    t: float = 0.0
    z: float = 0.0

    @property
    def pose_world_tcp(self) -> Pose:
        return Pose.top_down((0.5, 0.0, self.z), 0.0)


@dataclass
class _Arm:
    state: _State = field(default_factory=_State)


def descended(felt, seconds: float = 6.0):
    """Free-air baseline of a descent with the reaction force `felt(travelled)`, N, and the last force."""
    arm = _Arm()
    air = FreeAir(arm, DOWN)
    force = 0.0
    for tick in range(int(seconds / TICK)):
        arm.state.t = tick * TICK
        arm.state.z = -SPEED * arm.state.t
        force = felt(SPEED * arm.state.t)
        air.follow(np.array([0.0, 0.0, -force, 0.0, 0.0, 0.0]))
    return -air.wrench[2], force


def test_friction_that_turns_as_an_arm_sets_out_is_free_air() -> None:
    air, felt = descended(lambda travelled: 4.0 if travelled > 5e-4 else 0.0)
    assert air == felt == 4.0


@pytest.mark.parametrize("slope", [-15.0, 15.0])
def test_drift_with_position_is_free_air(slope) -> None:
    air, felt = descended(lambda travelled: slope * travelled)
    assert air == pytest.approx(felt, abs=0.1)


@pytest.mark.parametrize("stiffness", [100.0, 1000.0, 1e5])
def test_a_soft_contact_is_not_taken_for_drift(stiffness) -> None:
    air, felt = descended(lambda travelled: max(0.0, travelled - 0.02) * stiffness)
    assert felt > 5.0
    assert 0.0 <= air <= DRIFT_MOST[2]


def test_contact_as_an_arm_sets_out_is_no_free_air() -> None:
    air, _ = descended(lambda travelled: 2000.0 * max(0.0, travelled - 5e-4), seconds=0.5)
    assert air <= 0.5


def test_an_arm_whose_elbow_still_creeps_has_not_settled() -> None:
    """Its TCP rests long before the joints of a folded arm do."""
    state = SimpleNamespace(t=0.0, twist=np.zeros(6), dq=np.zeros(7))
    arm = SimpleNamespace(state=state)
    blackboard = SimpleNamespace(robot=arm, recorder=SimpleNamespace(newest=Samples.empty()))
    resting = 0.0
    for _ in settle(blackboard, dwell=0.1):
        state.t += TICK
        state.dq[0] = 0.2 * np.exp(-5.0 * state.t)  # critically damped, nearly
        resting += TICK if state.dq[0] < CREEPING else 0.0
    assert state.t > np.log(0.2 / CREEPING) / 5.0
    assert resting >= 0.1


@pytest.mark.parametrize(
    ("shape", "mass", "refused"),
    [
        ('type="box" size=".03 .03 .03"', 0.6, False),
        ('type="box" size=".03 .03 .03"', 0.3, True),
        ('type="cylinder" size=".03 .03"', 0.6, False),
        ('type="cylinder" size=".03 .03" euler="90 0 0"', 0.6, True),
        ('type="sphere" size=".03"', 0.6, True),
        ('type="box" size=".03 .03 .03"', None, False),
    ],
)
def test_a_probe_from_the_side_does_not_push_its_object_away(shape, mass, refused) -> None:
    """A friction of 0.6 makes 0.6 kg resist with 3.5 N, and 0.3 kg with 1.8 N; what lies round rolls.

    The rehearsal draws an unknown mass.
    """
    weight = f'mass="{mass}"' if mass else ""
    scene = parse_scene(f"""<mujoco><worldbody><site name="robot_base"/>
      <body name="table" pos="0.5 0 -0.02"><geom type="box" size=".4 .5 .02" friction=".1"/></body>
      <body name="thing" pos="0.5 0.1 0.03"><freejoint/><geom {shape} {weight} friction=".6"/></body>
    </worldbody></mujoco>""")
    pose = Pose.top_down((0.6, 0.1, 0.03), 0.0)
    state = SymbolicState(scene, at="thing_pose", pose_world_tcp=pose, gripper="closed")
    found = MoveUntilContact(axis="-x").requires(state)
    assert any("would push 'thing' away" in one.message for one in found) == refused, found
