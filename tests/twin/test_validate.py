"""Does a twin rest, and does it give back the touch? On small worlds and hand-made traces."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.common.errors import ExecutionAborted
from palpate.scene.load import parse_scene
from palpate.scene.scene import Scene
from palpate.trace.recording import Context, LeafRun, NominalHand, Recording
from palpate.trace.samples import FORCES, POSE, Samples, Trace
from palpate.twin.validate import (
    FINEST_STEP,
    SETTLE_TIME,
    ReplayResidual,
    compare,
    mean_recordings,
    settle,
    validate,
)

HAND = NominalHand(0.009, 0.15, 0.01, 1e-4)
TABLE = '<body name="table" pos="0.5 0 -0.02"><geom type="box" size=".3 .3 .02" friction="0.6 0.005 0.0001"/></body>'
CUP = (
    '<body name="cup" pos="0.5 0 {z}"><freejoint/>'
    '<geom type="box" size=".03 .02 .05" mass="0.2" friction="0.5"/></body>'
)
DOOR = '<body pos="0.5 1 0.5"><joint type="hinge" axis="1 0 0"/><geom size=".05" pos="0 0.1 0"/></body>'


def scene(*bodies: str, option: str = "") -> Scene:
    return parse_scene(f"<mujoco>{option}<worldbody>{''.join(bodies)}</worldbody></mujoco>")


def trace(force: float, z: float, bias: float = 0.0, empty: bool = True) -> Trace:
    """Empty at the pose, then loaded there, then in contact: each for a second."""
    t = np.arange(0.0, 3.0, 0.01)
    wrench, pose = np.zeros((300, 6)), np.tile([0.5, 0, z, 0, 1, 0, 0], (300, 1)).astype(float)
    wrench[:, 2] = bias + np.where((t >= 1) & (t < 2), force, 0.0)
    signals = {name: np.zeros((300, 7)) for name in ("q", "dq", "tau_ext", "target_world_tcp")}
    samples = Samples(
        t=t,
        wrench=wrench,
        pose_world_tcp=pose,
        twist=np.zeros((300, 6)),
        width=np.zeros(300),
        **signals,
    )
    leaves = (
        LeafRun(
            "tree.children[0]",
            "MovePose",
            "",
            0.0,
            0.99,
            "SUCCESS",
            "",
            Context("still", at="here"),
        ),
    )
    recordings = (
        Recording(FORCES, 1.0, 1.99, Context("still", at="here", holding="cup")),
        Recording(POSE, 2.0, 2.99, Context("contact", at="there", support="table")),
    )
    return Trace(samples, leaves if empty else (), recordings, (), HAND)


def test_a_standing_object_rests_and_one_in_the_air_falls() -> None:
    rests, drift = settle(scene(TABLE, CUP.format(z=0.05)))
    assert rests
    assert drift < 1e-3
    rests, drift = settle(scene(TABLE, CUP.format(z=0.55)))
    assert drift == pytest.approx(0.5, abs=0.01)
    assert rests, "it has come to rest on the table"
    rests, drift = settle(scene(TABLE, CUP.format(z=0.05).replace("0.5 0 0.05", "1.5 0 0.05")))
    assert not rests
    assert drift == pytest.approx(9.81 / 2 * SETTLE_TIME**2, rel=0.02)


def test_objects_alone_must_rest() -> None:
    assert settle(scene(TABLE, CUP.format(z=0.05), DOOR))[0]
    assert settle(scene(TABLE)) == (True, 0.0)


def test_settling_is_bounded_in_time() -> None:
    tiny = '<option timestep="1e-8"/>'
    rests, drift = settle(scene(TABLE, CUP.format(z=0.05), option=tiny))
    assert rests
    assert drift < 1e-3
    assert SETTLE_TIME / FINEST_STEP <= 20_000


def test_the_arms_own_bias_is_no_residual() -> None:
    comparison = compare(
        trace(force=2.0, z=0.1, bias=0.7), mean_recordings(trace(force=2.0, z=0.1))
    )
    assert comparison.force == pytest.approx(0.0, abs=1e-12)
    assert comparison.position == pytest.approx(0.0, abs=1e-12)
    without_rest = compare(
        trace(force=2.0, z=0.1, bias=0.7, empty=False),
        mean_recordings(trace(force=2.0, z=0.1, empty=False)),
    )
    assert without_rest.force == pytest.approx(0.7)


def test_a_residual_is_the_difference_of_means() -> None:
    comparison = compare(trace(force=2.5, z=0.100), mean_recordings(trace(force=2.0, z=0.103)))
    assert comparison.force == pytest.approx(0.5)
    assert comparison.position == pytest.approx(0.003)


def test_a_trace_without_recordings_has_no_figures() -> None:
    bare = Trace(Samples.empty(), (), (), (), HAND)
    assert compare(bare, mean_recordings(bare)) == ReplayResidual(None, None)


def test_the_twin_and_the_template_are_both_marked() -> None:
    twin, template = scene(TABLE, CUP.format(z=0.05)), scene(TABLE, CUP.format(z=0.051))
    recorded = trace(force=0.2 * 9.81, z=0.1)

    def replay(world: Scene):
        """Heavier by half in the template."""
        z = world.body("cup").pose_world.position[2]
        return mean_recordings(trace(force=0.2 * 9.81 * (1.0 if z == 0.05 else 1.5), z=0.1))

    marks = validate(twin, template, recorded, replay)
    assert marks.settled
    assert marks.twin.force == pytest.approx(0.0, abs=1e-12)
    assert marks.template.force == pytest.approx(0.981)


def test_a_replay_that_stops_says_why() -> None:
    twin = scene(TABLE, CUP.format(z=0.05))

    def unstable(world):
        raise ExecutionAborted("the simulated world became unstable")

    assert validate(twin, twin, trace(1.0, 0.1), unstable).twin == ReplayResidual(
        None, None, "the simulated world became unstable"
    )
    half = trace(1.0, 0.1)
    short = Trace(half.samples, half.leaves, half.recordings[:1], (), HAND)
    assert (
        validate(twin, twin, half, lambda world: mean_recordings(short)).twin.note
        == "the replay stopped after 1 of 2 recordings"
    )
