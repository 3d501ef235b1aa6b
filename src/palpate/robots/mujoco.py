"""The embedded robot: a simulated FR3 in a hidden world, behind the protocol of a real one.

Each `advance` computes the set-points of the steps ahead, lets the world run them, and makes of the recorded joint
signals what the robot's sensors would say: the controller's 1 kHz loop itself is the world's actuators
(`impedance`), so that Python runs once per tick and not once per step.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from palpate.pose import Array, Pose
from palpate.robots import trajectory
from palpate.robots.gripper import Gripper
from palpate.robots.impedance import (
    JOINT_STIFFNESS,
    STIFFNESS,
    TURNING_STIFFNESS,
    Damping,
    critical_damping,
    posture_torque,
)
from palpate.robots.model import HAND, NominalArm, limits
from palpate.robots.robot import HOME, Limits, RobotState
from palpate.robots.sensors import Noise, Sensors, imperfections
from palpate.robots.world import TIMESTEP, Steps, World
from palpate.trace import Hand, Samples

if TYPE_CHECKING:
    import mujoco

SPEED = 0.25
"""m/s, at the TCP, of joint motions."""
TURNING_SPEED = 1.0
"""rad/s, of the TCP."""
JOINT_SPEED = 1.0
"""rad/s."""
ACCELERATION, TURNING_ACCELERATION, JOINT_ACCELERATION = 1.0, 4.0, 2.5
"""m/s^2, rad/s^2, rad/s^2: far below the datasheet's."""

BLOCK = 5
"""Steps of 1 ms per logged sample: 200 Hz."""
PERIOD = BLOCK * TIMESTEP
POSTURE = np.array(HOME)
"""rad: where the null space tends to."""
LONGEST_RUN = 4
"""Log periods that pass between two updates of the feed-forward torques, at most: 50 Hz."""


class MujocoRobot:
    """A Franka Research 3 with hand, simulated. Implements `palpate.robots.robot.Robot`.

    It starts at the ready pose, at rest, with open fingers and zeroed torque sensors.
    """

    def __init__(self, world: mujoco.MjSpec, pose_world_base: Pose, noise: Noise = "none", seed: int = 0) -> None:
        """Put the arm into `world` (which is changed) at `pose_world_base`.

        Raises:
            InputError: the world does not compile with the robot in it.
        """
        random = np.random.default_rng(seed)
        kinds = imperfections(noise)
        self._world = World(world, pose_world_base, kinds, random)
        self._nominal = NominalArm(pose_world_base, self._world.gravity)
        self._sensors = Sensors(kinds, PERIOD, BLOCK, random)
        self._limits = limits()
        self._gripper = Gripper()
        self._due = 0.0
        self._logged: list[Samples] = []
        self._start(np.array(HOME))

    def _start(self, q: Array) -> None:
        self._q, self._dq, self._speed = q, np.zeros(7), np.zeros(7)
        self._armature = self._nominal.armature
        self._here = self._nominal.kinematics(q[None])
        self._map, self._acted = self._here.wrench_map()[0], self._here.gravity_torque[0]
        self._sensors.zero(self._world.true_gravity_torque(), self._here.gravity_torque[0])
        self._joint_path: trajectory.Path | None = trajectory.still(0.0, q)
        self._pose_path = trajectory.still_pose(0.0, self._pose())
        self._tau_ext, self._wrench, self._twist = np.zeros(7), np.zeros(6), np.zeros(6)
        self._target = self._pose().vector
        self._gains = self._world.actuators.joints(self._damping())
        self._cached: RobotState | None = None

    @property
    def world(self) -> World:
        """The hidden world, for pictures and, once the estimates are made, for the truth."""
        return self._world

    @property
    def limits(self) -> Limits:
        """The datasheet's."""
        return self._limits

    @property
    def hand(self) -> Hand:
        """The nominal hand."""
        return HAND

    @property
    def gravity(self) -> float:
        """m/s^2."""
        return float(-self._world.gravity[2])

    @property
    def state(self) -> RobotState:
        """As of the last `advance`."""
        if self._cached is None:
            self._cached = RobotState(
                t=self._world.t, stamp=self._world.t, q=self._q, dq=self._dq, tau_ext=self._tau_ext,
                pose_world_tcp=self._pose(), target_world_tcp=Pose(self._target[:3], self._target[3:]),
                twist=self._twist, wrench=self._wrench, width=self._gripper.width, gripping=self._gripper.gripping,
                moving=self._path.end > self._world.t, gripper_moving=self._gripper.moving)
        return self._cached

    def move_joints(self, q: Array, speed: float = 1.0) -> None:
        """See `Robot`. The TCP stays below 0.25 m/s."""
        goal, now = np.asarray(q, dtype=float), self._joint_motion()
        rate = speed / max(float(np.abs(goal - now.p).max()) / JOINT_SPEED, self._sweep(now.p, goal) / SPEED, 1e-6)
        acceleration = JOINT_ACCELERATION / max(float(np.abs(goal - now.p).max()), 1e-6)
        self._joint_path = trajectory.straight(self._world.t, now, goal, rate, acceleration)
        self._gains = self._world.actuators.joints(self._damping())
        self._cached = None

    def move_pose(self, target: Pose, speed: float) -> None:
        """See `Robot`."""
        now, origin = self._pose_motion()
        goal = np.concatenate([target.position, trajectory.rotation_vector(origin, target.quaternion)])
        distance = max(float(np.linalg.norm(goal[:3] - now.p[:3])), 1e-6)
        angle = max(float(np.linalg.norm(goal[3:])), 1e-6)
        rate = min(speed / distance, TURNING_SPEED / angle)
        acceleration = min(ACCELERATION / distance, TURNING_ACCELERATION / angle)
        path = trajectory.straight(self._world.t, now, goal, rate, acceleration)
        self._follow(trajectory.PosePath(path, origin))

    def move_axis(self, direction: Array, speed: float, travel: float) -> None:
        """See `Robot`."""
        now, origin = self._pose_motion()
        ahead = Pose(now.p[:3] + travel * np.asarray(direction, dtype=float), origin)
        self.move_pose(ahead, speed)

    def open_gripper(self) -> None:
        """See `Robot`."""
        self._gripper.open(self._world.t)
        self._cached = None

    def close_gripper(self) -> None:
        """See `Robot`."""
        self._gripper.close(self._world.t)
        self._cached = None

    def hold(self) -> None:
        """See `Robot`. The commanded equilibrium stays, so a contact keeps its force."""
        t = self._world.t
        if self._joint_path is not None:
            self._joint_path = trajectory.stop(t, self._joint_path.at(t), JOINT_ACCELERATION)
        elif self._pose_path.end > t:
            now, origin = self._pose_motion()
            self._follow(trajectory.PosePath(trajectory.stop(t, now, 2 * ACCELERATION), origin))
        self._cached = None

    def advance(self, duration: float) -> None:
        """Step the world for `duration` s, to the next log period."""
        self._due += duration
        periods = round((self._due - self._world.t) / PERIOD)
        while periods > 0:
            self._run(min(periods, LONGEST_RUN))
            periods -= LONGEST_RUN

    def drain(self) -> Samples:
        """See `Robot`."""
        logged, self._logged = self._logged, []
        return logged[0] if len(logged) == 1 else Samples.concatenate(logged)

    def close(self) -> None:
        """Nothing to let go of."""

    @property
    def _path(self) -> trajectory.Path | trajectory.PosePath:
        return self._pose_path if self._joint_path is None else self._joint_path

    def _pose(self) -> Pose:
        """The measured TCP pose."""
        row = self._here.pose_world_tcp[-1]
        return Pose(row[:3] + self._sensors.pose_error, row[3:])

    def _follow(self, path: trajectory.PosePath) -> None:
        self._pose_path, self._joint_path = path, None
        self._gains = self._world.actuators.cartesian(self._damping())
        self._cached = None

    def _joint_motion(self) -> trajectory.Motion:
        """Where a joint motion begins: on the present one, or where the joints' springs pull as the TCP's do now."""
        if self._joint_path is not None:
            return self._joint_path.at(self._world.t)
        rate = self._dq if self._pose_path.end > self._world.t else np.zeros(7)
        return trajectory.Motion(self._q + self._sprung() / JOINT_STIFFNESS, rate, np.zeros(7))

    def _pose_motion(self) -> tuple[trajectory.Motion, Array]:
        """Where a Cartesian motion begins: on the present one, or where the TCP's springs pull as the joints' do now.

        Returns the motion, its rotation vector relative to the orientation (4,) that comes with it.
        """
        t, zero = self._world.t, np.zeros(6)
        if self._joint_path is None:
            return self._pose_path.motion(t), self._pose_path.pose(t).quaternion
        pose, pull = self._pose(), self._map @ self._sprung()
        turn = pose.rotation.T @ pull[3:] / TURNING_STIFFNESS
        twist = self._twist if self._joint_path.end > t else zero
        now = trajectory.Motion(
            np.concatenate([pose.position + pull[:3] / STIFFNESS, np.zeros(3)]),
            np.concatenate([twist[:3], pose.rotation.T @ twist[3:]]), zero)
        return now, trajectory.turned(pose.quaternion, turn[None])[0]

    def _sprung(self) -> Array:
        """What the springs exert at the joints now (7,), N m."""
        return self._acted - self._here.gravity_torque[-1]

    def _damping(self) -> Damping:
        return critical_damping(self._nominal.mass_matrix(self._q), self._here.jacobian[-1])

    def _sweep(self, start: Array, goal: Array) -> float:
        """m that the TCP would travel if it kept its greatest speed all along a joint motion."""
        s = np.linspace(0.0, 1.0, 30)[:, None]
        p = self._nominal.kinematics(start + s * (goal - start)).pose_world_tcp[:, :3]
        return float(np.linalg.norm(np.diff(p, axis=0), axis=1).max() * (len(s) - 1))

    def _run(self, periods: int) -> None:
        """Let the world run for some log periods, and sense what came of it."""
        t = self._world.t + TIMESTEP * np.arange(1, periods * BLOCK + 1)
        control = np.empty((len(t), len(self._world.control)))
        control[:] = self._world.control
        target = self._command_pose(t, control) if self._joint_path is None else self._command_joints(t, control)
        self._world.set_fingers(control, self._gripper.setpoints(t))
        self._sense(self._world.step(control), target)
        self._cached = None

    def _command_pose(self, t: Array, control: Array) -> Array:
        """Set-points of the TCP's springs; returns the commanded pose (7,) or (periods, 7)."""
        actuators = self._world.actuators
        rows = self._pose_path.sample(t)
        control[:, actuators.position] = rows[:, :3] - self._sensors.pose_error
        control[:, actuators.orientation] = rows[:, 3:]
        jacobian = self._here.jacobian[-1]
        torque = posture_torque(self._q, self._dq, POSTURE, jacobian, self._map)
        torque += self._nominal.coriolis_torque(self._q, self._dq)
        control[:, actuators.drives] = torque
        return rows[BLOCK // 2::BLOCK]

    def _command_joints(self, t: Array, control: Array) -> Array:
        """Set-points of the joints' springs; returns the commanded pose (periods, 7)."""
        assert self._joint_path is not None
        rows = self._joint_path.sample(t)
        control[:, self._world.actuators.drives] = rows
        return self._nominal.kinematics(rows[BLOCK // 2::BLOCK]).pose_world_tcp

    def _sense(self, steps: Steps, target: Array) -> None:
        """Block means of what the sensors say, and from them the external wrench."""
        before, here = self._here, self._nominal.kinematics(steps.q[BLOCK - 1::BLOCK])
        q = np.concatenate([self._q[None], steps.q[BLOCK - 1::BLOCK]])
        dq = (q[1:] - q[:-1]) / PERIOD
        measured = self._sensors.measure(self._link_torque(steps, here.jacobian[-1]), dq, here.jacobian[-1])
        tau_ext = measured - _mean_with_previous(before.gravity_torque, here.gravity_torque)
        wrench_map = here.wrench_map()
        wrench = np.matmul(wrench_map, tau_ext[:, :, None])[:, :, 0]
        twist = np.matmul(here.jacobian, dq[:, :, None])[:, :, 0]
        pose = _mean_with_previous(before.pose_world_tcp, here.pose_world_tcp)
        pose[:, :3] += self._sensors.pose_error
        fingers = steps.fingers[BLOCK - 1::BLOCK]
        self._gripper.observe(self._world.t, fingers[-1], float(np.abs(steps.finger_speed[-1]).max()))
        t = self._world.t - PERIOD * np.arange(len(q) - 2, -1, -1)
        self._logged.append(Samples(t, (q[1:] + q[:-1]) / 2, dq, tau_ext, wrench, pose, twist, target,
                                    fingers[:, 0] + fingers[:, 1]))
        self._q, self._dq, self._acted = q[-1], dq[-1], steps.torque[-1]
        self._here, self._map, self._target = here, wrench_map[-1], target[-1]
        self._tau_ext, self._wrench, self._twist = tau_ext[-1], wrench[-1], twist[-1]

    def _link_torque(self, steps: Steps, jacobian: Array) -> Array:
        """Mean torque behind the gears in each log period (periods, 7): less what turns the motors themselves.

        The integrator is implicit in the dampers: they act with the speed at a step's end, not at its beginning.
        """
        ends = np.concatenate([self._speed[None], steps.dq[BLOCK - 1::BLOCK]])
        lag = self._gains.joint_damping(jacobian) + np.diag(self._armature / TIMESTEP)
        self._speed = ends[-1]
        mean = np.add.reduce(steps.torque.reshape(-1, BLOCK, 7), axis=1) / BLOCK
        return mean - (ends[1:] - ends[:-1]) @ lag / BLOCK


def _mean_with_previous(before: Array, rows: Array) -> Array:
    """Mean of each row (n, k) with the one before it; the first one's is the last of `before`."""
    rows = np.concatenate([before[-1:], rows])
    return (rows[1:] + rows[:-1]) / 2
