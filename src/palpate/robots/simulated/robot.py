"""The embedded robot: a simulated arm in a hidden world, behind the protocol of a real one.

Each `advance` computes the set-points of the steps ahead, lets the world run them, and converts the
recorded joint signals into sensor readings. The world's actuators execute the controller's 1 kHz loop
(module `actuators`), so that Python runs once per tick and not once per step.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from palpate.common.pose import Array, Pose
from palpate.robots.description import RobotDescription
from palpate.robots.nominal import NominalArm, explain_torque
from palpate.robots.owner import owner_arm, without_calibration_figures
from palpate.robots.robot import Commanded, PoseMaker, PoseStart, RobotState
from palpate.robots.robot_config import RobotConfig
from palpate.robots.sheet import Reflex
from palpate.robots.simulated.actuators import Gripper
from palpate.robots.simulated.guard import Guard, Reaction
from palpate.robots.simulated.noise.line import Stamps
from palpate.robots.simulated.noise.model import Streams, WristErrors
from palpate.robots.simulated.noise.models import noise_models
from palpate.robots.simulated.noise.sensors import Encoders, Sensors, WristSensor
from palpate.robots.simulated.noise.true_arm import TrueArm
from palpate.robots.simulated.readout import Readout, Wrist
from palpate.robots.simulated.setpoints import (
    Correction,
    Setpoints,
    joint_setpoints,
    pose_setpoints,
)
from palpate.robots.simulated.timing import BLOCK, LONGEST_RUN, PERIOD, SUBSTEPS, TIMESTEP
from palpate.robots.simulated.world import World
from palpate.robots.springs import SpringGains, SpringInertia, Swivel
from palpate.robots.trajectory import MotionState, PosePath, PositionPath, still
from palpate.robots.wrist import HandLoad
from palpate.trace.samples import Samples

if TYPE_CHECKING:
    import mujoco


ZEROING = 0.5  # s of rest over which a six-axis sensor is zeroed
STANDSTILL = 0.005  # rad/s: slower joints have stopped yielding
SHORTEST_YIELD, LONGEST_YIELD = 0.1, 0.5  # s after a reflex


class MujocoRobot(Commanded):
    """An arm with its hand, simulated. Implements `palpate.robots.robot.Robot`.

    It starts at rest, with open fingers and zeroed torque sensors.
    """

    def __init__(
        self,
        world: mujoco.MjSpec,
        pose_world_base: Pose,
        arm: RobotDescription,
        noise: str = "none",
        seed: int = 0,
        *,
        stands: Pose | None = None,
        gravity: Array | None = None,
        visit: int = 0,
        substeps: int = SUBSTEPS,
        q: Array | None = None,
    ) -> None:
        """Put the true `arm` of the noise model into `world`, which is changed.

        Args:
            pose_world_base: stated pose of the base.
            stands: pose of the base in `world`, to which the noise model adds its error; by default
                the stated one.
            gravity: (3,) m/s^2, stated gravity; the world's, by default. A value measured with the
                arm has precedence.
            visit: number of the robot's run, which seeds all errors that differ from run to run.
            substeps: physics steps in a control cycle of 1 ms while anything touches, or moves apart from the
                arm.
            q: (7,) rad, where the arm begins; home by default.

        Raises:
            InputError: no such noise model, or the world does not compile with the robot in it.
        """
        # Draw the individual robot; its owner knows only the stated figures.
        model, streams = noise_models().load(noise, arm), Streams(seed, visit)
        arm, truth = owner_arm(arm, model.datasheet), TrueArm(model.model, streams)
        assumed = np.array(world.option.gravity if gravity is None else gravity)
        if arm.gravity is not None:
            assumed = np.array([0.0, 0.0, -arm.gravity])
        # The controller's model of the arm and the hidden world with the true arm.
        nominal = NominalArm(arm, arm.stands(pose_world_base), assumed)
        super().__init__(arm, nominal, float(-assumed[2]))
        self._world = World(
            world, stands or pose_world_base, without_calibration_figures(arm), truth, substeps, q
        )
        # Errors of the sensors, and the acquisition of their samples.
        self._sensors = Sensors(model, arm.limits.tau_max, streams)
        self._encoders = Encoders(model, self._sensors.rests, streams)
        self._stamps = Stamps(model.acquisition, streams)
        self._wider = truth.width()
        self._gripper = Gripper(arm.hand)
        self._guard = Guard(len(arm.joints))
        self._thresholds = arm.limits.reflexes.contact
        self._reflex: str | None = None
        self._due, self._tick = 0.0, LONGEST_RUN * BLOCK
        self._logged: list[Samples] = []
        # Zero the torque sensors at rest.
        config = arm.config or RobotConfig()
        self._readout = Readout(
            nominal=nominal,
            sensors=self._sensors,
            encoders=self._encoders,
            stamps=self._stamps,
            q=arm.home if q is None else q,
            torque=self._world.true_gravity_torque(),
            gains=np.zeros(len(arm.joints))
            if config.torque_gain is None
            else config.torque_gain.value,
            wrist=self._zeroed_wrist(assumed, model.sensor, streams),
        )
        # The controller compensates the measured arm, MuJoCo the described one.
        measured = config.gravity or config.end_effector or config.base_lean
        askew = truth.askew or measured is not None
        self._correction = Correction(self._world, self._readout, self._encoders, askew)
        self._target = self._readout.pose_world_tcp.vector
        self._cached: RobotState | None = None
        self._follow_joints(still(0.0, self._readout.q))

    def _zeroed_wrist(self, gravity: Array, errors: WristErrors, streams: Streams) -> Wrist | None:
        """Make the arm's six-axis sensor, zeroed at rest with an empty hand; None without one."""
        arm, sheet = self._arm, self._arm.wrench_sensor
        if sheet is None:
            return None
        sensor, hand = WristSensor(sheet, errors, streams), HandLoad(arm, gravity)
        attitude = self._world.true_tcp().quaternion
        hand.zero(sensor.rest(self._world.true_hand_weight(), ZEROING), attitude)
        return Wrist(sensor, hand)

    @property
    def world(self) -> World:
        """The hidden world: for pictures, and for the truth after the estimates are made."""
        return self._world

    @property
    def state(self) -> RobotState:
        """State as of the last `advance`."""
        if self._cached is None:
            readout, gripper, t = self._readout, self._gripper, self._world.t
            q, pose = readout.reported
            self._cached = RobotState(
                t=t * self._stamps.rate,
                stamp=readout.stamp,
                q=q,
                dq=readout.dq,
                tau=readout.tau,
                tau_ext=readout.tau_ext,
                pose_world_tcp=pose,
                target_world_tcp=Pose(self._target[:3], self._target[3:]),
                twist=readout.twist,
                wrench=readout.wrench,
                contact=readout.contact,
                width=gripper.width,
                gripping=gripper.gripping,
                moving=self._path.end > t,
                gripper_moving=gripper.moving,
                reflex=self._reflex,
                unexplained=explain_torque(readout.jacobian, readout.contact_torque),
            )
        return self._cached

    def move_joints(self, q: Array, speed: float = 1.0) -> None:
        """Move the joints; no joint exceeds the speed of the arm's description."""
        self._reflex = None
        goal = np.asarray(q, dtype=float)
        self._follow_joints(self._joint_path(self._world.t, self._joint_motion(), goal, speed))

    def _start(self, make: PoseMaker) -> None:
        self._reflex = None
        t, q = self._world.t, self._readout.q
        path, posture = make(t, self._pose_begin(), q)
        self._follow_pose(path, posture or still(t, q))

    def open_gripper(self, width: float | None = None) -> None:
        self._gripper.open(self._world.t, width)
        self._world.limit_fingers(self._gripper.force)
        self._cached = None

    def close_gripper(self, force: float | None = None) -> None:
        self._gripper.close(self._world.t, force)
        self._world.limit_fingers(self._gripper.force)
        self._cached = None

    def hold(self) -> None:
        """Stop the motion. The commanded equilibrium stays, so that a contact keeps its force."""
        t, path = self._world.t, self._path
        if path.end <= t:
            return
        if isinstance(path, PositionPath):
            self._follow_joints(self._stopped_joints(t, path.at(t)))
        else:
            stopping = self._stopped_pose(t, self._pose_begin())
            self._follow_pose(stopping, still(t, self._readout.q))

    def set_reflex(self, thresholds: Reflex) -> None:
        self._thresholds = thresholds

    def advance(self, duration: float) -> None:
        """Step the world for `duration` s, to the next log period."""
        self._pass(duration, LONGEST_RUN)
        self._read()

    def _pass(self, duration: float, tick: int) -> None:
        """Step the world as `advance` does. End early, with the tick of `tick` log periods in which the guard notices a
        change of the force.
        """
        self._tick = tick * BLOCK
        # Requested time accumulates, so that rounding to log periods does not drift.
        self._due += duration / self._stamps.rate
        periods = round((self._due - self._world.t) / PERIOD)
        while periods > 0:
            if self._readout.full:
                self._read()
            self._run(min(periods, LONGEST_RUN))
            periods = round((self._due - self._world.t) / PERIOD)
            # The time after a noticed change is not owed any more.
            if tick < LONGEST_RUN and self._guard.felt is not None:
                self._due -= max(periods, 0) * PERIOD
                return

    def run_on(self, ticks: int, tick: float) -> None:
        """Let up to `ticks` ticks pass; see `robots.robot.RunsOn`."""
        t, gripper = self._world.t, self._gripper
        # A motion that ends earlier limits the number of ticks.
        if self._path.end > t:
            ticks = max(1, min(ticks, math.ceil((self._path.end - t) / tick - 1e-9)))
        # Run many ticks at once only while neither the hand nor a contact needs attention.
        hand, periods = (gripper.moving, gripper.gripping), max(1, round(tick / PERIOD))
        looks = self._yielding or gripper.moving or self._guard.felt is not None
        at_once = 1 if looks else max(1, LONGEST_RUN // periods)
        while ticks > 0:
            self._pass(min(ticks, at_once) * tick, periods)
            ticks -= at_once
            # Stop where the tree may have to react: a reflex, a noticed force, or a change of the hand.
            if self._yielding or self._guard.felt is not None:
                break
            if hand != (gripper.moving, gripper.gripping):
                break
        self._read()

    def _read(self) -> None:
        """Read the sensors of all runs since the last call."""
        if self._readout.pending:
            samples = self._readout.read(self._world.t)
            samples.width[:] += self._wider
            self._logged.append(samples)
        self._cached = None

    def drain(self) -> Samples:
        logged, self._logged = self._logged, []
        return logged[0] if len(logged) == 1 else Samples.concatenate(logged)

    def close(self) -> None:
        """Do nothing: there is no connection to close."""

    @property
    def _path(self) -> PositionPath | PosePath:
        return self._setpoints.path

    def _follow_joints(self, path: PositionPath) -> None:
        gains = SpringGains.of_joints(self._arm.stiffness, self._inertia(path))
        self._follow(joint_setpoints(path, self._world.t, gains, self._nominal.poses), gains)

    def _follow_pose(self, path: PosePath, posture: PositionPath) -> None:
        gains = SpringGains.of_tcp(self._arm.stiffness, self._inertia(posture))
        self._follow(pose_setpoints(path, posture, self._world.t, gains), gains)

    def _follow(self, setpoints: Setpoints, gains: SpringGains) -> None:
        self._setpoints, self._gains, self._cached = setpoints, gains, None
        self._yielding = False
        self._world.actuators.set(gains)

    def _inertia(self, path: PositionPath) -> SpringInertia:
        """Return the inertia for a whole motion: that of the mean of its first and last configurations."""
        nominal, q = self._nominal, path.sample(path.knots[[0, -1]]).mean(0)
        return SpringInertia.of(nominal.mass_matrix(q), nominal.kinematics(q[None]).jacobian[0])

    def _joint_motion(self) -> MotionState:
        """Return the start of a joint motion: the state of the present joint motion, or set-points at which the
        joints' springs exert the torques that the TCP's springs exert now.
        """
        t, path, readout = self._world.t, self._path, self._readout
        if isinstance(path, PositionPath) and not self._yielding:
            return path.at(t)
        none = np.zeros(len(self._arm.joints))
        return MotionState(self._leading(), readout.rate if path.end > t else none, none)

    def _leading(self) -> Array:
        """Compute the joint set-points (7,), rad, at which the joints' springs exert the present torques.

        q_set = q + tau / k, so that the change of springs is free of jerks.
        """
        return self._readout.q + self._sprung() / self._arm.stiffness.joints

    def _pose_begin(self) -> PoseStart:
        """Return the start of a Cartesian motion.

        The start is the state of the present Cartesian motion, or set-points at which the TCP's springs exert
        the torques that the joints' springs exert now.
        """
        t, path = self._world.t, self._path
        if isinstance(path, PosePath):
            return path.motion(t), path.pose(t).quaternion
        readout = self._readout
        twist = readout.twist if path.end > t else np.zeros(6)
        return self._ahead_of(readout.pose_world_tcp, readout.jacobian, self._sprung(), twist)

    def _sprung(self) -> Array:
        """Return the joint torques of the springs now (7,), N m."""
        return self._readout.commanded - self._readout.gravity_torque

    def _run(self, periods: int) -> None:
        """Step the world for some log periods, and update the controller's state."""
        world, n = self._world, periods * BLOCK
        readout = self._readout
        # Dynamics and null space are those of the run's beginning.
        self._dynamics = self._nominal.dynamics(readout.q, readout.rate)
        self._swivel = Swivel.of(readout.jacobian, self._gains.own)
        control = np.empty((n, len(world.rest_control)))
        # Write the set-points of arm and fingers for every cycle ahead.
        control[:] = world.rest_control
        self._correction.follow()
        target = self._command(control)
        times = world.t + TIMESTEP * np.arange(n, dtype=float)
        world.set_fingers(control, self._gripper.setpoints(times) - self._wider / 2)
        # Step the world while the guard observes it.
        self._begin_guard(n)
        steps = world.step(control, self._guard)
        target = target[: len(steps.q)]
        self._correction.reached(len(steps.q) / periods)
        # Update the readout and the gripper from the recorded steps.
        readout.follow(steps, self._gains, self._swivel, target)
        self._target = target[-1]
        fingers, speeds = steps.fingers[-1] + self._wider / 2, steps.finger_speed[-1]
        self._gripper.observe(world.t, fingers.tolist(), speeds.tolist())
        # After a reflex the arm yields until it is slow, or for the longest time.
        if self._guard.fired:
            self._yield(self._guard.fired)
        elif self._yielding:
            yielded = world.t - self._since
            slow = float(np.abs(readout.rate).max()) < STANDSTILL
            if yielded > LONGEST_YIELD or (slow and yielded > SHORTEST_YIELD):
                self._follow_joints(still(world.t, self._leading()))

    def _begin_guard(self, cycles: int) -> None:
        """Prepare the contact reflex for the next run of `cycles`."""
        readout, thresholds = self._readout, self._thresholds
        mass_matrix, velocity_torque = self._dynamics
        jacobian = readout.jacobian
        # Deviation of the sensed from the commanded torque that the model explains.
        known = readout.deviation - velocity_torque - self._correction.torque

        def reaction(back: Array) -> Reaction:
            load = min(max(readout.load, 0.0), thresholds.load)
            return Reaction(mass_matrix, jacobian[2] * load, self._arm.limits.tau_max, back)

        self._guard.begin(
            thresholds=None if self._yielding else thresholds,
            reaction=reaction,
            jacobian=jacobian,
            mass_matrix=mass_matrix,
            dampers=self._gains.dampers(jacobian, self._swivel),
            dq=readout.speed,
            deviation=self._sensors.looks(cycles) + known,
            tick=self._tick,
        )

    def _yield(self, why: str) -> None:
        """Yield without springs until the arm rests."""
        self._reflex, self._since = why, self._world.t
        self._follow_joints(still(self._world.t, self._readout.q))
        self._gains, self._yielding = self._guard.reaction.gains, True
        self._world.actuators.set(self._gains)

    def _command(self, control: Array) -> Array:
        """Write the arm's set-points into `control` (n, nu); return the commanded TCP poses, one per log period."""
        actuators, readout, setpoints = self._world.actuators, self._readout, self._setpoints
        # Select the rows of the run from the precomputed set-points.
        first = setpoints.first(self._world.t)
        block, last = first // BLOCK, first + len(control)
        rows, target = setpoints.rows[first:last], setpoints.poses[block : last // BLOCK]
        if self._yielding:
            return target
        # Joint motion: the joints' springs take the corrected angles, with the weight's error as an offset.
        correction = self._correction
        if not self._gains.cartesian:
            control[:, actuators.drives] = correction.joints(rows)
            control[:, actuators.drives] += correction.torque / self._gains.stiffness
            return target
        # Cartesian motion: the TCP's springs take the pose, the joint drives the feed-forward torques.
        control[:, actuators.position] = correction.positions(rows[:, :3])
        control[:, actuators.orientation] = correction.orientations(rows[:, 3:])
        control[:, actuators.drives] = self._dynamics[1] + correction.torque
        # The null space follows its posture with one torque per log period.
        posture = setpoints.posture[block : last // BLOCK]
        joints = len(readout.q)
        swivel = self._swivel.torque(posture[0, :joints] - readout.q, posture[:, joints:])
        control[:, actuators.swivel] = np.repeat(swivel, BLOCK)
        actuators.damp(self._swivel)
        return target
