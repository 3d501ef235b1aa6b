"""Pose of an object in the hand, after put-downs elsewhere."""

from dataclasses import replace

import numpy as np
import pytest

from palpate.common.pose import Pose
from palpate.estimation.holds import pose_in_hand
from palpate.scene.load import parse_scene

SCENE = """
<mujoco>
  <worldbody>
    <body name="table" pos="0.4 0 -0.02"><geom type="box" size=".5 .5 .02"/></body>
    <body name="jar" pos="0.45 0.1 0.05">
      <freejoint/><geom type="cylinder" size=".03 .05"/>
    </body>
  </worldbody>
</mujoco>
"""


@pytest.mark.parametrize("turn", [0.0, 1.2, -2.5])
def test_an_object_stands_where_the_commanded_hand_has_put_it(bench, noises, turn):
    """The hand carries the jar by 0.1 m and turns it. It takes it 10 mm aside, and presses 3 mm into the table."""
    jar = parse_scene(SCENE).bodies["jar"]
    b = bench(noises["none"], 0)
    for x, end in ((0.45, (0.55, 0.2, 0.057)), (0.56, (0.56, 0.2, 0.06))):
        y = 0.1 if x == 0.45 else 0.2
        b.go("a", (x, y, 0.2))
        b.go("g", (x, y, 0.06))
        b.close("jar", 0.3)
        b.go("a", (x, y, 0.2))
        b.measure()
        b.go("a", (*end[:2], 0.2))
        b.go("g", end)
        b.open()
        b.go("a", (*end[:2], 0.2))
    trace = b.trace()
    # Turn the commanded and the measured hand about the vertical from the first lift on.
    first, second = trace.recordings
    samples, turned = trace.samples, trace.samples.t > first.end
    hand = Pose.of(np.zeros(3), samples.target_world_tcp[0, 3:])
    quaternion = (Pose.turn((0.0, 0.0, turn)) @ hand).quaternion
    target, pose = samples.target_world_tcp.copy(), samples.pose_world_tcp.copy()
    target[turned, 3:] = pose[turned, 3:] = quaternion
    trace = replace(trace, samples=replace(samples, target_world_tcp=target, pose_world_tcp=pose))
    before, after = (pose_in_hand(trace, one, jar) for one in (first, second))
    # In the world, the jar is 10 mm beside the hand in the second grasp.
    there = Pose.of((0.56, 0.2, 0.06), quaternion) @ after
    np.testing.assert_allclose(before.position, (0.0, 0.0, 0.01), atol=1e-4)
    np.testing.assert_allclose(there.position, (0.55, 0.2, 0.05), atol=1e-4)
    assert after.angle_to(before) < 1e-6
