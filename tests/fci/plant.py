"""The hidden world, one control cycle at a time."""

from __future__ import annotations

import math

import mujoco
import numpy as np

from palpate.common.errors import ExecutionAborted
from palpate.common.pose import Array, Pose
from palpate.robots.description import PREFIX, RobotDescription
from palpate.robots.simulated.actuators import LAG, STANDSTILL
from palpate.robots.simulated.noise.true_arm import TrueArm
from palpate.robots.simulated.timing import BLOCK, PERIOD, TIMESTEP
from palpate.robots.simulated.world import World
from palpate.robots.springs import SpringGains


class Plant(World):
    """The embedded robot's world, whose joints take torques.

    Attributes:
        q, dq: (7,) rad, rad/s, true. motor: (7,) N m that the motors exerted. link: (7,) N m behind
            the gears. contact: (7,) N m that contacts exert at the joints.
        cycles: how many there were. fell: m/s, the fastest that any object went down so far.
    """

    def __init__(
        self,
        spec: mujoco.MjSpec,
        pose_world_base: Pose,
        arm: RobotDescription,
        truth: TrueArm,
        q: Array | None = None,
    ) -> None:
        """As a `World`, with the arm at rest at `q` (7,), rad; at home by default."""
        super().__init__(spec, pose_world_base, arm, truth)
        if q is not None:
            self._data.qpos[self._q] = q
        self.actuators.set(SpringGains.of_torques(np.eye(7)))
        self.cycles, self._tcp, self._hand = 0, arm.tcp, arm.hand.body
        self.q, self.dq = self._data.qpos[self._q], self._data.qvel[self._v]
        self.motor, self.contact = (
            self._data.qfrc_actuator[self._v],
            self._data.qfrc_constraint[self._v],
        )
        self._armature = self.model.dof_armature[self._v].copy()
        self.link, self.ddq = self.true_gravity_torque(), np.zeros(7)
        self._before = np.zeros(7)
        self.fell, self._sinking = 0.0, self._vertical()
        mujoco.mj_forward(self.model, self._data)

    def _vertical(self) -> list[int]:
        """Where the vertical velocities of free objects stand in `qvel`."""
        free = self.model.jnt_type == mujoco.mjtJoint.mjJNT_FREE
        return (self.model.jnt_dofadr[free] + 2).tolist()

    @property
    def compensated(self) -> Array:
        """(7,) N m with which MuJoCo holds the nominal arm up at the true angles, by itself."""
        return self._data.qfrc_gravcomp[self._v]

    def cycle(self, torque: Array, finger: float) -> None:
        """1 ms with joint torques (7,), N m, besides `compensated`, and each finger sent `finger` m
        from the middle.

        Raises:
            ExecutionAborted: the physics became unstable.
        """
        data = self._data
        if self.cycles % BLOCK == 0:
            for stiction in self._stiction:
                stiction.apply(self.model, data)
        data.ctrl[self.actuators.drives] = torque
        data.ctrl[self._fingers_control] = finger
        self._before[:] = self.dq
        mujoco.mj_step(self.model, data, nstep=self._substeps)
        self.cycles += 1
        for i in self._sinking:
            self.fell = max(self.fell, -float(data.qvel[i]))
        self.ddq = (self.dq - self._before) / TIMESTEP
        self.link = self.motor - self._armature * self.ddq
        if self.cycles % BLOCK == 0:
            self._film(self.qpos[None])
            self.t = round(self.t + PERIOD, 9)
            if abs(data.time - self.t) > TIMESTEP / 2:
                raise ExecutionAborted("the simulated world became unstable")

    @property
    def fingers(self) -> tuple[float, float]:
        """m between the fingers, and m/s of the faster one."""
        data = self._data
        width = float(data.qpos[self._finger_q].sum())
        return width, float(np.abs(data.qvel[self._finger_v]).max())

    def pull(self, force: Array) -> None:
        """From now on a force (3,), N, world axes, pulls at the TCP."""
        data, tcp = self._data, self._data.site(PREFIX + self._tcp).xpos
        hand = int(self.model.body(PREFIX + self._hand).id)
        arm = tcp - data.xipos[hand]
        data.xfrc_applied[hand] = [*force, *np.cross(arm, force)]

    def touching(self) -> float:
        """N, the largest contact force between the arm and anything else now."""
        model, data, force, most = self.model, self._data, np.empty(6), 0.0
        for i in range(data.ncon):
            owners = [model.body(model.geom_bodyid[g]).name for g in data.contact.geom[i]]
            if sum(name.startswith(PREFIX) for name in owners) == 1:
                mujoco.mj_contactForce(model, data, i, force)
                most = max(most, math.hypot(*force[:3]))
        return most


class Fingers:
    """Sends the hand's fingers to a width, with a speed and a force: Franka's own servo.

    Attributes:
        width: m between the fingers, as reported. speed: m/s of the faster one.
        still: s for which they have stood.
    """

    def __init__(self, plant: Plant, arm: RobotDescription, wider: float) -> None:
        """`wider`: m that the reported width is more than the true one."""
        hand = arm.hand
        self._plant, self._wider = plant, wider
        self._closed, self._strongest, self._fastest = -hand.overclose, hand.force, hand.speed
        self._damping = hand.force / hand.speed
        self.opening = hand.opening
        self._setpoint = self._goal = hand.opening / 2
        self._speed, self.force = hand.speed, hand.force
        self.still, self._waits = 0.0, True
        self.observe()

    def go(self, width: float | None, speed: float, force: float | None = None) -> None:
        """Go to a width, m; None: close on what is there with a force, N."""
        goal = self._closed if width is None else width / 2
        self._goal = min(max(goal, self._closed), self.opening / 2)
        self._speed = min(max(speed / 2, 1e-4), self._fastest)
        self.force = min(self._strongest if force is None else force, self._strongest)
        self._plant.limit_fingers(self.force)
        self.still = 0.0

    def let_go(self) -> None:
        """Stand here, pressing on nothing."""
        self.go(self.width, 2 * self._fastest)
        self._setpoint = self._goal

    def command(self) -> float:
        """Each finger's way from the middle for the next cycle, m."""
        step = self._speed * TIMESTEP
        way = min(max(self._goal - self._setpoint, -step), step)
        middle, lead = self.width / 2, LAG * (self.force / self._damping + self.speed)
        wanted = self._setpoint + way
        self._setpoint = min(max(wanted, middle - lead), middle + lead)
        self._waits = self._setpoint == self._goal or self._setpoint != wanted
        return self._setpoint - self._wider / 2

    def observe(self) -> None:
        """After a cycle."""
        width, self.speed = self._plant.fingers
        self.width = max(0.0, width + self._wider)
        if self.speed > STANDSTILL or not self._waits:
            self.still = 0.0
        self.still += TIMESTEP
