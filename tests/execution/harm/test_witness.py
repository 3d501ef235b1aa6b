"""The record of a run, in which steps are undone."""

from __future__ import annotations

from palpate.execution.simulated_cell import simulated_cell
from palpate.execution.witness import LOOK, Witness
from palpate.robots.sheet import Reflex
from palpate.robots.simulated.robot import MujocoRobot
from palpate.scene.load import parse_scene

SCENE = parse_scene("""<mujoco><worldbody><site name="robot_base"/>
  <body name="post" pos=".4 0 .3"><geom type="box" size=".02 .05 .3"/></body>
  <body name="box" pos=".5 .3 .03"><freejoint/><geom type="box" size=".03 .03 .03" mass=".2"/></body>
  <geom name="floor" type="plane" size="2 2 .1"/>
</worldbody></mujoco>""")


def met(watched: bool) -> tuple[Witness | None, MujocoRobot]:
    """The hand runs into the post, stops itself, and yields."""
    robot = simulated_cell(SCENE, SCENE, noise="none").robot()
    witness = Witness.of(robot.world) if watched else None
    robot.set_reflex(Reflex(8.0, 4.0))
    start = robot.state.pose_world_tcp
    robot.move_pose(start.translate((0.2, 0.0, 0.0)), 0.1)
    while robot.state.reflex is None and robot.state.t < 3.0:
        robot.run_on(4, 0.02)
    robot.run_on(4, 0.02)
    robot.close()
    return witness, robot


def test_a_witness_sees_what_happens_and_changes_nothing() -> None:
    """The world goes back to where the arm stops itself, and the witness with it."""
    (witness, arm), (_, alone) = met(True), met(False)
    assert witness is not None
    assert arm.state.reflex is not None
    assert arm.state.reflex == alone.state.reflex
    assert arm.state.t == alone.state.t
    assert abs(arm.state.q - alone.state.q).max() == 0.0
    assert witness.steps == round(arm.state.t / witness.period)
    assert [look.step for look in witness.looks] == [*range(0, witness.steps + 1, LOOK)]
    (forces,) = (one for pair, one in witness.forces.items() if pair.thing == "post")
    assert list(forces.steps) == sorted(set(forces.steps))
    assert len(forces.vectors) == 3 * len(forces.steps)


def test_a_mark_takes_back_what_is_held_and_pressed() -> None:
    witness, _ = met(True)
    assert witness is not None
    undo = witness.mark()
    kept = {pair: (list(f.steps), list(f.vectors)) for pair, f in witness.forces.items()}
    steps, looks = witness.steps, len(witness.looks)
    for forces in witness.forces.values():
        forces.steps.append(steps)
        forces.vectors.extend((1.0, 2.0, 3.0))
        forces.blocked.add(steps)
    witness.steps += 10
    witness.looks.append(witness.looks[-1])
    undo()
    assert {pair: (list(f.steps), list(f.vectors)) for pair, f in witness.forces.items()} == kept
    assert (witness.steps, len(witness.looks)) == (steps, looks)
    assert not any(forces.blocked for forces in witness.forces.values())
