"""Where things really end: a rehearsal corrects the symbolic state, and the run goes by it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from standin import StandIn

from palpate.common.pose import Pose
from palpate.execution.foresight import Foresight, difference, moved_by
from palpate.primitives.base import Blackboard, LeafFailure, Recorder
from palpate.primitives.load import NOTHING, FingerLoad
from palpate.primitives.state import SymbolicState
from palpate.scene.load import parse_scene

SCENE = parse_scene("""<mujoco><worldbody>
  <geom name="floor" type="plane" size="3 3 .1" pos="0 0 -.5"/>
  <site name="robot_base" pos="0 0 0"/>
  <body name="table" pos=".5 0 -.02"><geom type="box" size=".28 .28 .02"/></body>
  <body name="can" pos=".5 .1 .06"><freejoint/>
    <geom type="cylinder" size=".03 .06" mass=".3"/></body>
</worldbody></mujoco>""")
TCP = Pose.top_down((0.5, 0.1, 0.08), 0.0)
HELD = replace(
    SymbolicState(SCENE),
    pose_world_tcp=TCP,
    holding="can",
    pose_tcp_object=TCP.inverse() @ SCENE.body("can").pose_world,
)


GRASPED = Foresight(widths={"tree": 0.060}, weights={"can": (1.5, 4.0)})


def board(state: SymbolicState, width: float = 0.06, load: FingerLoad = NOTHING) -> Blackboard:
    robot = StandIn()
    robot.put(width=width)
    return Blackboard(robot, state, Recorder(robot), load=load)


def apart(one: Pose, other: Pose) -> float:
    return float(np.linalg.norm(one.position - other.position))


def test_agreement_within_a_millimetre_corrects_nothing() -> None:
    near = SCENE.body("can").pose_world.translate((0.0006, 0.0, -0.0006))
    assert difference(SymbolicState(SCENE), "can", near, TCP) is None
    assert moved_by(HELD, {}) is HELD


def test_an_object_that_ended_elsewhere_is_believed_there() -> None:
    state, true = (
        SymbolicState(SCENE),
        SCENE.body("can").pose_world.translate((0.004, -0.008, 0.0)),
    )
    shift = difference(state, "can", true, TCP)
    assert shift is not None
    seen = Foresight({"tree.children[3]": {"can": shift}})
    assert apart(seen.settled("tree.children[3]", board(state)).pose_of("can"), true) < 1e-9
    assert seen.settled("tree.children[4]", board(state)) is state


def test_a_held_object_is_corrected_in_the_hand_and_the_sag_of_the_arm_is_not() -> None:
    """The fingers centre the can by 8 mm; the arm sags by 5 mm."""
    sagged = TCP.translate((0.0, 0.0, -0.005))
    true = SCENE.body("can").pose_world.translate((0.0, 0.008, -0.005))
    shift = difference(HELD, "can", true, sagged)
    assert shift is not None
    after = moved_by(HELD, {"can": shift})
    assert after.pose_tcp_object is not None
    assert apart(after.pose_of("can"), TCP @ after.pose_tcp_object) < 1e-9
    centred = SCENE.body("can").pose_world.translate((0.0, 0.008, 0.0))
    assert apart(TCP @ after.pose_tcp_object, centred) < 1e-9


@pytest.mark.parametrize("rise", [0.0, 0.012])
def test_a_correction_keeps_with_a_support_that_was_found_higher(rise: float) -> None:
    """A rehearsal knows the believed height, the run a measured one: the difference stays."""
    state = SymbolicState(SCENE)
    true = SCENE.body("can").pose_world.translate((0.003, 0.0, 0.0))
    shift = difference(state, "can", true, TCP)
    assert shift is not None
    raised = replace(state, moved={"can": state.pose_of("can").translate((0.0, 0.0, rise))})
    found = moved_by(raised, {"can": shift}).pose_of("can")
    assert found.position == pytest.approx(true.translate((0.0, 0.0, rise)).position)


def test_a_correction_is_in_the_frame_of_the_object() -> None:
    state = SymbolicState(SCENE)
    true = SCENE.body("can").pose_world.translate((0.004, 0.0, 0.0))
    shift = difference(state, "can", true, TCP)
    assert shift is not None
    here = state.pose_of("can")
    quarter = Pose.of(here.position, (np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)))
    found = moved_by(replace(state, moved={"can": quarter}), {"can": shift}).pose_of("can")
    assert found.position - here.position == pytest.approx((0.0, 0.004, 0.0))


@pytest.mark.parametrize(("width", "as_rehearsed"), [(0.068, True), (0.072, False)])
def test_a_shape_that_was_fitted_to_a_picture_may_be_wider_by_two_deviations(
    width: float, as_rehearsed: bool
) -> None:
    seen = replace(SCENE.body("can"), seen=True, accuracy=0.0025)
    bodies = {**SCENE.bodies, "can": seen}
    state = replace(HELD, scene=replace(SCENE, bodies=bodies))
    if as_rehearsed:
        assert GRASPED.settled("tree", board(state, width)) is state
    else:
        with pytest.raises(LeafFailure, match="not as rehearsed"):
            GRASPED.settled("tree", board(state, width))


def test_weights_of_all_worlds_count() -> None:
    others = [Foresight(weights={"can": weights}) for weights in ((1.0, 3.0), (2.0, 6.0))]
    seen = GRASPED.among(*others)
    assert seen.weights == {"can": (1.0, 6.0)}
    assert seen.widths == GRASPED.widths


@pytest.mark.parametrize("weight", [0.3, 3.0, 14.0])
def test_a_grasp_as_rehearsed_goes_on(weight: float) -> None:
    load = FingerLoad(np.zeros(6)).set_hanging_load(
        np.array([0.0, 0.0, weight, 0.0, 0.0, 0.0]), TCP
    )
    assert GRASPED.settled("tree", board(HELD, 0.063, load)) is HELD


def test_an_unknown_weight_contradicts_nothing() -> None:
    bodies = {**SCENE.bodies, "can": replace(SCENE.body("can"), known={})}
    state = replace(HELD, scene=replace(SCENE, bodies=bodies))
    load = FingerLoad(np.zeros(6)).set_hanging_load(np.array([0.0, 0.0, 20.0, 0.0, 0.0, 0.0]), TCP)
    assert GRASPED.settled("tree", board(state, 0.06, load)) is state


def test_an_error_of_the_measured_weight_contradicts_nothing() -> None:
    wrench = np.array([0.0, 0.0, 16.0, 0.0, 0.0, 0.0])
    load = FingerLoad(np.zeros(6)).set_hanging_load(wrench, TCP, error=5.0)
    assert GRASPED.settled("tree", board(HELD, 0.06, load)) is HELD


@pytest.mark.parametrize(
    ("width", "weight", "said"),
    [
        (0.050, 3.0, "hold 'can' at 50 mm, and 60 mm then"),
        (0.060, 16.0, "'can' pulls with 16.0 N, and with 1.5 to 4.0 N then"),
    ],
)
def test_a_deviation_from_the_rehearsal_stops_the_run(
    width: float, weight: float, said: str
) -> None:
    load = FingerLoad(np.zeros(6)).set_hanging_load(
        np.array([0.0, 0.0, weight, 0.0, 0.0, 0.0]), TCP
    )
    with pytest.raises(LeafFailure, match=f"^not as rehearsed: .*{said}"):
        GRASPED.settled("tree", board(HELD, width, load))
