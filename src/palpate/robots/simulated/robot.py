"""The embedded robot: a simulated arm in a hidden world, behind the protocol of a real one.

Within a command nothing that is sensed changes the motion but the feed-forward torques. So the world
runs ahead of the present by some runs of cycles, whose sensor readings are then computed together;
`advance` only passes to the end of the next one. A command takes back what is ahead, and so does the
reflex. The controller's 1 kHz loop itself is the world's actuators (`impedance`).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from palpate.errors import ExecutionAborted
from palpate.geometry.pose import Array, Pose
from palpate.robots.commanded import Commanded, swing_path
from palpate.robots.description import RobotDescription
from palpate.robots.nominal import NominalArm
from palpate.robots.owner.arm import known, unmeasured
from palpate.robots.owner.config import RobotConfig
from palpate.robots.reflex import Reflex
from palpate.robots.robot import RobotState
from palpate.robots.simulated.gripper import Gripper
from palpate.robots.simulated.guard import Guard, Reaction, Watched
from palpate.robots.simulated.impedance import Gains, Inertia
from palpate.robots.simulated.memory import Memory
from palpate.robots.simulated.noise.line import Stamps
from palpate.robots.simulated.noise.model import Streams
from palpate.robots.simulated.noise.models import noise_models
from palpate.robots.simulated.noise.sensors import Encoders, Sensors
from palpate.robots.simulated.noise.true_arm import Truth
from palpate.robots.simulated.readout import Felt, Readout, Sensed
from palpate.robots.simulated.setpoints import (
    Correction,
    Setpoints,
    joint_setpoints,
    pose_setpoints,
)
from palpate.robots.simulated.timing import BLOCK, DAMPING_DELAY, LONGEST_RUN, PERIOD, TIMESTEP
from palpate.robots.simulated.world import World
from palpate.robots.trajectory import Motion, Path, PosePath, Stretch, still
from palpate.trace.samples import Samples

if TYPE_CHECKING:
    import mujoco

STANDSTILL = 0.005  # rad/s: slower joints have stopped yielding
SHORTEST_YIELD, LONGEST_YIELD = 0.1, 0.5  # s after a reflex
AHEAD = 8  # runs of cycles, at most, that the world is ahead


class Outlook(NamedTuple):
    """Nominal arm at the beginning of a run of cycles, for the contact reflex."""

    mass_matrix: Array  # (7, 7) kg m^2
    jacobian: Array  # (6, 7)
    dq: Array  # (7,) rad/s
    known: Array  # (7,) N m: Coriolis and centrifugal torques, and correction of the weight
    looks: Array  # (n, 7) N m, white noise of each cycle


class Run(NamedTuple):
    """A run of cycles."""

    outlook: Outlook
    felt: Felt
    fingers: tuple[float, bool, bool]  # width, m, gripping, and moving, at its end


class Moment(NamedTuple):
    """The end of a run of cycles."""

    t: float  # s, world time
    sensed: Sensed
    target: Array  # (7,) commanded pose of the TCP
    fingers: tuple[float, bool, bool]
    fired: str | None = None  # reason that the arm stopped itself


class MujocoRobot(Commanded):
    """An arm with its hand, simulated. Implements `palpate.robots.robot.Robot`.

    It starts at home, at rest, with open fingers and zeroed torque sensors.
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
    ) -> None:
        """Put the true `arm` of the noise model into `world`, which is changed.

        Args:
            pose_world_base: stated pose of the base.
            stands: pose of the base in `world`, to which the noise model adds its error; by default
                the stated one.
            gravity: (3,) m/s^2, stated gravity; the world's, by default. A value measured with the
                arm has precedence.
            visit: number of the robot's run, which seeds all errors that differ from run to run.

        Raises:
            InputError: no such noise model, or the world does not compile with the robot in it.
        """
        model, streams = noise_models().load(noise, arm), Streams(seed, visit)
        arm, truth = known(arm, model.datasheet), Truth(model.model, streams)
        assumed = np.array(world.option.gravity if gravity is None else gravity)
        if arm.gravity is not None:
            assumed = np.array([0.0, 0.0, -arm.gravity])
        nominal = NominalArm(arm, arm.stands(pose_world_base), assumed)
        super().__init__(arm, nominal, float(-assumed[2]))
        self._world = World(world, stands or pose_world_base, unmeasured(arm), truth)
        self._sensors = Sensors(model, arm.limits.tau_max, streams)
        self._encoders = Encoders(model, self._sensors.rests, streams)
        self._stamps = Stamps(model.acquisition, streams)
        self._wider = truth.width()
        self._gripper = Gripper(arm.hand)
        self._guard = Guard()
        self._thresholds = arm.limits.reflexes.contact
        self._reflex: str | None = None
        self._due = 0.0
        self._logged: list[Samples] = []
        config = arm.config or RobotConfig()
        self._readout = Readout(
            nominal=nominal,
            sensors=self._sensors,
            encoders=self._encoders,
            stamps=self._stamps,
            q=arm.home,
            torque=self._world.true_gravity_torque(),
            gains=np.zeros(7) if config.torque_gain is None else config.torque_gain.value,
        )
        # The controller compensates the measured arm, MuJoCo the described one.
        measured = config.gravity or config.end_effector or config.base_lean
        askew = truth.askew or measured is not None
        self._correction = Correction(self._world, self._readout, self._encoders, askew)
        self._noise = Memory(self._sensors, self._encoders, self._stamps)
        # The runs under way: state before the first, and before each; those not yet passed.
        self._start = self._noise.save(), dict(vars(self._readout))
        self._befores: list[list[dict[str, Any]]] = []
        self._guards: list[tuple[Array, Array]] = []
        self._runs: list[Run] = []
        self._ahead: deque[Moment] = deque()
        self._stride = 1
        target = self._readout.pose_world_tcp.vector
        self._now = Moment(0.0, self._readout.sensed, target, self._gripper.now)
        self._cached: RobotState | None = None
        self._follow_joints(still(0.0, self._readout.q))

    @property
    def world(self) -> World:
        """The hidden world now: for pictures, and for the truth after the estimates are made."""
        self._take_back()
        return self._world

    @property
    def sensors(self) -> Sensors:
        """The joint torque sensors: for recordings at 1 kHz."""
        return self._sensors

    @property
    def state(self) -> RobotState:
        """State as of the last `advance`."""
        if self._cached is None:
            now, target = self._now, self._now.target
            sensed, (width, gripping, gripper_moving) = now.sensed, now.fingers
            newest, (q, pose) = sensed.newest, sensed.reported
            self._cached = RobotState(
                t=now.t * self._stamps.rate,
                stamp=newest.stamp,
                q=q,
                dq=newest.dq,
                tau=newest.tau,
                tau_ext=newest.tau_ext,
                pose_world_tcp=pose,
                target_world_tcp=Pose(target[:3], target[3:]),
                twist=newest.twist,
                wrench=newest.wrench,
                contact=newest.contact,
                width=width,
                gripping=gripping,
                moving=self._path.end > now.t,
                gripper_moving=gripper_moving,
                reflex=self._reflex,
            )
        return self._cached

    def move_joints(self, q: Array, speed: float = 1.0) -> None:
        """No part exceeds the description's pace."""
        self._take_back()
        self._reflex = None
        goal = np.asarray(q, dtype=float)
        self._follow_joints(self._joint_path(self._world.t, self._joint_motion(), goal, speed))

    def move_pose(self, target: Pose, speed: float, slower: Sequence[Stretch] = ()) -> None:
        """Slower where the arm's effective mass is large."""
        self._take_back()
        self._reflex = None
        t, begin, q = self._world.t, self._pose_begin(), self._readout.q
        self._follow_pose(*self._pose_path(t, begin, target, speed, slower, q))

    def move_axis(self, direction: Array, speed: float, travel: float) -> None:
        self._take_back()
        super().move_axis(direction, speed, travel)

    def swing(self, about: Array, angle: float, frequency: float, cycles: int) -> None:
        self._take_back()
        self._reflex = None
        t, begin = self._world.t, self._pose_begin()
        path = swing_path(t, begin, about, angle, frequency, cycles)
        self._follow_pose(path, still(t, self._readout.q))

    def open_gripper(self) -> None:
        self._take_back()
        self._gripper.open(self._world.t)
        self._grasp()

    def close_gripper(self, force: float | None = None) -> None:
        self._take_back()
        self._gripper.close(self._world.t, force)
        self._grasp()

    def _grasp(self) -> None:
        self._world.limit_fingers(self._gripper.force)
        self._now, self._cached = self._now._replace(fingers=self._gripper.now), None

    def hold(self) -> None:
        """The commanded equilibrium stays, so a contact keeps its force."""
        t, path = self._now.t, self._path
        if path.end <= t:
            return
        self._take_back()
        if isinstance(path, Path):
            self._follow_joints(self._stopped_joints(t, path.at(t)))
        else:
            stopping = self._stopped_pose(t, self._pose_begin())
            self._follow_pose(stopping, still(t, self._readout.q))

    def set_reflex(self, thresholds: Reflex) -> None:
        self._take_back()
        self._thresholds = thresholds

    def advance(self, duration: float) -> None:
        """Pass `duration` s, to the next log period."""
        tick = duration / self._stamps.rate
        self._due += tick
        while (periods := round((self._due - self._now.t) / PERIOD)) > 0:
            if self._ahead and len(self._upcoming.felt.t) > periods:
                self._take_back()  # the world has run on by other steps
            if not self._ahead:
                self._run_ahead(tick)
            self._pass(self._ahead.popleft())

    def _pass(self, now: Moment) -> None:
        """Pass to the end of a run."""
        self._now, self._cached = now, None
        self._logged.append(now.sensed.samples)
        if now.fired:
            self._yield(now.fired)
        elif self._yielding:
            yielded = now.t - self._since
            slow = float(np.abs(self._readout.dq).max()) < STANDSTILL
            if yielded > LONGEST_YIELD or (slow and yielded > SHORTEST_YIELD):
                self._follow_joints(still(now.t, self._leading()))

    def drain(self) -> Samples:
        logged, self._logged = self._logged, []
        return logged[0] if len(logged) == 1 else Samples.concatenate(logged)

    def close(self) -> None:
        """Do nothing: there is no connection to close."""

    @property
    def _path(self) -> Path | PosePath:
        return self._setpoints.path

    def _follow_joints(self, path: Path) -> None:
        gains = Gains.of_joints(self._arm.stiffness, self._inertia(path))
        self._follow(joint_setpoints(path, self._world.t, gains, self._nominal.poses), gains)

    def _follow_pose(self, path: PosePath, posture: Path) -> None:
        gains = Gains.of_tcp(self._arm.stiffness, self._inertia(posture))
        self._follow(pose_setpoints(path, posture, self._world.t, gains), gains)

    def _follow(self, setpoints: Setpoints, gains: Gains) -> None:
        self._setpoints, self._gains, self._cached = setpoints, gains, None
        self._yielding = False
        self._world.actuators.set(gains)

    def _inertia(self, path: Path) -> Inertia:
        """Return the inertia for a whole motion: halfway between its ends."""
        nominal, q = self._nominal, path.sample(path.knots[[0, -1]]).mean(0)
        return Inertia.of(nominal.mass_matrix(q), nominal.kinematics(q[None]).jacobian[0])

    def _joint_motion(self) -> Motion:
        """Return the start of a joint motion: the present one's state, or the set-points at which
        the joints' springs pull as the TCP's do now."""
        t, path, readout = self._world.t, self._path, self._readout
        if isinstance(path, Path) and not self._yielding:
            return path.at(t)
        rate = readout.dq if path.end > t else np.zeros(7)
        return Motion(self._leading(), rate, np.zeros(7))

    def _leading(self) -> Array:
        """Compute the joint set-points (7,), rad, at which the joints' springs exert the present
        torques: a change to them is free of jerks."""
        return self._readout.q + self._sprung() / self._arm.stiffness.joints

    def _pose_begin(self) -> tuple[Motion, Array]:
        """Return the start of a Cartesian motion: the present one's state, or the set-points at which
        the TCP's springs pull as the joints' do now; and the orientation (4,) that its rotation
        vector is relative to.
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

    @property
    def _upcoming(self) -> Run:
        return self._runs[-len(self._ahead)]

    def _run_ahead(self, tick: float) -> None:
        """Run the world for some ticks of `tick` s, and read the sensors."""
        self._start = self._noise.save(), dict(vars(self._readout))
        self._runs, self._befores = [], []
        for periods in self._lengths(tick):
            try:
                self._runs.append(self._run(periods, under_guard=self._seen))
            except ExecutionAborted:
                if not self._runs:
                    raise
                self._reset(len(self._runs))  # it is raised when its time comes
                break
        sensed = self._readout.read([run.felt for run in self._runs], self._gains)
        near: int | None = None
        if not self._seen:
            before = [self._now.sensed, *sensed[:-1]]
            watched = [self._watched(*one) for one in zip(self._runs, before, strict=True)]
            self._guards, near = self._guard.foresee(self._thresholds, watched)
        for run, after in zip(self._runs[:near], sensed, strict=False):
            self._look(run, after, self._guard.fired)
        if near is not None:
            self._run_again(near)

    @property
    def _seen(self) -> bool:
        """True if no cycle of the world can be taken back, or the arm yields."""
        return self._yielding or self._world.watch is not None

    def _lengths(self, tick: float) -> list[int]:
        """Choose the log periods of each run ahead: the farther, the longer ago the last command, but
        no farther than the commanded motion."""
        lengths: list[int] = []
        t, due = self._now.t, self._due
        end = self._path.end if self._path.end > t else np.inf
        most = 1 if self._seen else self._stride
        while len(lengths) < most and t < end:
            while (periods := round((due - t) / PERIOD)) > 0 and len(lengths) < most:
                lengths.append(min(periods, LONGEST_RUN))
                t = round(t + lengths[-1] * PERIOD, 9)
            due += tick
        self._stride = min(2 * self._stride, AHEAD)
        return lengths

    def _look(self, run: Run, sensed: Sensed, fired: str | None) -> None:
        """Add the end of a run to what is ahead."""
        sensed.samples.width[:] += self._wider
        self._ahead.append(
            Moment(float(run.felt.t[-1]), sensed, run.felt.target[-1], run.fingers, fired)
        )

    def _run_again(self, index: int) -> None:
        """Step a run in which a contact is near again, cycle by cycle, and drop what came after."""
        periods = len(self._runs[index].felt.t)
        self._return(index)
        del self._runs[index:], self._befores[index:]
        run = self._run(periods, under_guard=True)
        self._runs.append(run)
        (sensed,) = self._readout.read([run.felt], self._gains)
        self._look(run, sensed, self._guard.fired)

    def _take_back(self) -> None:
        """Take back what is ahead of the present."""
        self._stride = 1
        if self._ahead:
            self._return(len(self._runs) - len(self._ahead))
            self._ahead.clear()

    def _return(self, index: int) -> None:
        """Return to the state before a run."""
        self._reset(index)
        self._guard.back(self._guards[index])
        noise, readout = self._start
        self._noise.restore(noise)
        vars(self._readout).update(readout)
        felt: list[Felt] = []
        for run in self._runs[:index]:
            self._sensors.looks(len(run.outlook.looks))
            felt.append(self._readout.feel(run.felt.steps, float(run.felt.t[-1]), run.felt.target))
        if felt:
            self._readout.read(felt, self._gains)

    def _reset(self, index: int) -> None:
        """Reset the world, the fingers and the correction to those before a run."""
        self._world.back(index)
        for part, before in zip(
            (self._gripper, self._correction), self._befores[index], strict=True
        ):
            vars(part).update(before)

    def _run(self, periods: int, under_guard: bool) -> Run:
        """Step the world for some log periods, under the guard or ahead of it."""
        world, readout, n = self._world, self._readout, periods * BLOCK
        world.keep(len(self._befores))
        self._befores.append([dict(vars(part)) for part in (self._gripper, self._correction)])
        mass_matrix, velocity_torque = self._nominal.dynamics(readout.q, readout.dq)
        control = np.empty((n, len(world.rest_control)))
        control[:] = world.rest_control
        self._correction.follow()
        target = self._command(control, velocity_torque)
        times = world.t + TIMESTEP * np.arange(n, dtype=float)
        world.set_fingers(control, self._gripper.setpoints(times) - self._wider / 2)
        known, looks = velocity_torque + self._correction.torque, self._sensors.looks(n)
        outlook = Outlook(mass_matrix, readout.jacobian, readout.speed, known, looks)
        if under_guard:
            self._begin_guard(outlook, readout.sensed)
        steps = world.step(control, self._guard if under_guard else None)
        felt = readout.feel(steps, world.t, target[: len(steps.q)])
        fingers, speeds = steps.fingers[-1] + self._wider / 2, steps.finger_speed[-1]
        self._gripper.observe(world.t, fingers.tolist(), speeds.tolist())
        return Run(outlook, felt, self._gripper.now)

    def _inertia_of(self, outlook: Outlook) -> Array:
        """Compute the inertia (7, 7) that the commanded torques move: dampers act late."""
        damping = self._gains.at_joints(self._gains.damping, outlook.jacobian)
        return outlook.mass_matrix + DAMPING_DELAY * damping

    def _watched(self, run: Run, before: Sensed) -> Watched:
        """Return a run for the contact reflex; `before`: what was sensed before it."""
        outlook, steps = run.outlook, run.felt.steps
        deviation = outlook.looks + (before.deviation - outlook.known)
        inertia = self._inertia_of(outlook)
        return Watched(outlook.jacobian, inertia, deviation, steps.effort, steps.rates)

    def _begin_guard(self, outlook: Outlook, sensed: Sensed) -> None:
        """Prepare the contact reflex for a run of cycles; `sensed`: before it."""
        thresholds, jacobian = self._thresholds, outlook.jacobian

        def reaction() -> Reaction:
            load = min(max(sensed.load, 0.0), thresholds.load)
            return Reaction.of(outlook.mass_matrix, jacobian[2] * load, self._arm.limits.tau_max)

        self._guard.begin(
            thresholds=None if self._yielding else thresholds,
            reaction=reaction,
            jacobian=jacobian,
            inertia=self._inertia_of(outlook),
            dq=outlook.dq,
            deviation=outlook.looks + (sensed.deviation - outlook.known),
        )

    def _yield(self, why: str) -> None:
        """Yield without springs until the arm rests."""
        self._reflex, self._since = why, self._world.t
        self._follow_joints(still(self._world.t, self._readout.q))
        self._gains, self._yielding = self._guard.reaction.gains, True
        self._world.actuators.set(self._gains)

    def _command(self, control: Array, velocity_torque: Array) -> Array:
        """Write the arm's set-points into `control` (n, nu); return the commanded TCP poses, one per
        log period."""
        actuators, readout, setpoints = self._world.actuators, self._readout, self._setpoints
        first = setpoints.first(self._world.t)
        block, last = first // BLOCK, first + len(control)
        rows, target = setpoints.rows[first:last], setpoints.poses[block : last // BLOCK]
        if self._yielding:
            return target
        correction = self._correction
        if not self._gains.cartesian:
            control[:, actuators.drives] = correction.joints(rows)
            control[:, actuators.drives] += correction.torque / self._gains.stiffness
            return target
        control[:, actuators.position] = correction.positions(rows[:, :3])
        control[:, actuators.orientation] = correction.orientations(rows[:, 3:])
        posture = setpoints.posture[block]
        torque = self._gains.posture_torque(
            posture[:7] - readout.q, posture[7:] - readout.dq, readout.jacobian
        )
        torque += velocity_torque + correction.torque
        control[:, actuators.drives] = torque
        return target
