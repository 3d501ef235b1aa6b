"""A cell without a simulation: a scripted arm that lifts a mug off a desk."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from standin import StandIn

import palpate as pp

DESK = """<mujoco model="desk"><worldbody>
  <site name="robot_base"/>
  <body name="desk" pos="0.4 0 -0.03"><geom type="box" size=".6 .6 .03" friction="0.6 0.005 0.0001"/></body>
  <body name="mug" pos="0.5 0.1 0.05"><freejoint/>
    <geom type="box" size=".03 .02 .05" friction="0.6 0.005 0.0001"/></body>
</worldbody></mujoco>
"""
MASS = 0.34
"""kg: what the scripted arm pretends to lift."""


class Arm(StandIn):
    """Reaches every goal at once in its own time, and feels a mug of `MASS` between its fingers,
    which is borne where it was grasped."""

    def __init__(self) -> None:
        super().__init__()
        self.weight, self.between = MASS * self.gravity, 0.04

    def close_gripper(self, force: float | None = None) -> None:
        super().close_gripper(force)
        self.support_z = float(self.state.pose_world_tcp.position[2])


class Bench:
    """A cell that simulates nothing, films nothing and knows nothing. Implements `Cell`.

    `wrap` makes of its arm what it hands out.
    """

    simulated = False

    def __init__(
        self, url: str = "scripted://here", wrap: Callable[[Arm], Any] = lambda arm: arm
    ) -> None:
        self.description = f"bench at {url}"
        self.arm = Arm()
        self._robot = wrap(self.arm)

    def picture(self, camera: object = None) -> None:
        return None

    def robot(self) -> Any:
        return self._robot

    def footage(self) -> None:
        return None

    def truth(self, parameter: pp.Parameter) -> None:
        return None
