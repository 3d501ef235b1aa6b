"""A Franka robot without its network: what it does with commands, and what its states say."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from palpate.geometry.pose import Array
from palpate.robots.description import RobotDescription
from palpate.robots.simulated.timing import TIMESTEP

from .believed import BelievedArm, Body
from .control import Controller
from .plant import Plant
from .sensing import Sensing
from .urdf import urdf
from .wire import (
    MOVE,
    Command,
    ControllerMode,
    Error,
    MotionMode,
    MoveStatus,
    RecoveryStatus,
    Request,
    RobotMode,
    SetStatus,
    StateBuffer,
    StopStatus,
    matrix,
)

TORQUE_RATE = 1.0
"""N m that a commanded torque may change in a cycle (franka/rate_limiting.h: 1000 N m/s)."""
ACCELERATION, JERK = 10.0, 5000.0
"""rad/s^2, rad/s^3 of commanded joint motions."""
CARTESIAN = ((3.0, 2.5), (9.0, 17.0))
"""m/s, rad/s and m/s^2, rad/s^2 of commanded Cartesian motions."""
SLACK = 1.01
"""A little above every limit: states are told in single precision."""
START = (1e-2, 5e-3)
"""rad, m: how far a first command may be from where the arm is."""
MOST_LOST = 20
"""Lost cycles in a row that end a motion (libfranka's documentation, "communication_constraints")."""
REMEMBERED = 100
"""Cycles that the success rate is told of."""
MOVING = 0.1
"""rad/s^2: with more of it the thresholds for phases of acceleration hold."""
DEFAULT_TORQUE, DEFAULT_FORCE = 20.0, 20.0
"""N m, N of collisions, until a client says something else."""

Answer = tuple[Request, bytes]


class FrankaRobot:
    """Modes, motions, settings and errors of one arm.

    Attributes:
        state: what is sent. mode: a `RobotMode`.
        commanded: cycles in motion. lost: those without a command, in all.
        loses: share of commands that get lost on the way.
    """

    def __init__(
        self,
        plant: Plant,
        believed: BelievedArm,
        sensing: Sensing,
        arm: RobotDescription,
        finger: Callable[[], float],
        seed: int = 0,
    ) -> None:
        """`finger`: what the hand sends its fingers to in the next cycle, m."""
        self._plant, self._believed, self._sensing = plant, believed, sensing
        self._limits, self._finger = arm.limits, finger
        self._urdf = urdf(arm, believed).encode()
        self.controller = Controller(believed, sensing)
        self.state = StateBuffer()
        self.mode = RobotMode.IDLE
        self._motion, self._controls = MotionMode.IDLE, ControllerMode.OTHER
        self._move: Request | None = None
        self._answers: list[Answer] = []
        self._torque, self._told, self._before = np.zeros(7), np.zeros(7), np.zeros(7)
        self._upper = np.full((2, 13), DEFAULT_TORQUE)
        self._lower = self._upper.copy()
        self._ids, self._missed = 0, 0
        self._felt, self._led_to = np.zeros(13), np.zeros(7)
        self._history: deque[bool] = deque([True] * REMEMBERED, REMEMBERED)
        self._succeeded = REMEMBERED
        self.lost = self.commanded = 0
        self.loses, self._chance = 0.0, np.random.default_rng(seed)
        self._awaits_first = False
        self._configured()
        self._tell()

    @property
    def message_id(self) -> int:
        """Of the present state: ms since the robot was started."""
        return self._ids

    @property
    def moving(self) -> bool:
        """A client is in command."""
        return self.mode is RobotMode.MOVE

    def answers(self) -> list[Answer]:
        """What is to be answered now, each only once."""
        out, self._answers = self._answers, []
        return out

    def cycle(self, command: NDArray[np.void] | None) -> None:
        """1 ms, with what the client answered to the last state, if it did."""
        if self.mode is RobotMode.MOVE:
            self._obey(command)
        if self.mode is not RobotMode.MOVE:
            self._stay()
        believed = self._believed
        weight = believed.gravity - self._plant.compensated
        self._plant.cycle(self._torque + weight, self._finger())
        self._sensing.update()
        self._ids += 1
        self._feel()
        if self.mode is RobotMode.MOVE:
            self._watch()
        self._tell()

    def request(self, asked: Request) -> None:
        """Do what a client asks over TCP."""
        handlers = {
            Command.MOVE: self._start,
            Command.STOP_MOVE: self._stop,
            Command.AUTOMATIC_ERROR_RECOVERY: self._recover,
            Command.GET_ROBOT_MODEL: self._model,
        }
        handlers.get(Command(asked.command), self._set)(asked)

    def user_stop(self, pressed: bool) -> None:
        """Somebody presses the button, or turns it back."""
        if pressed:
            self._end(MoveStatus.EMERGENCY, RobotMode.USER_STOPPED)
        elif self.mode is RobotMode.USER_STOPPED:
            self.mode = RobotMode.IDLE
        self._tell()

    def reflex(self, *errors: Error) -> None:
        """Stop for these reasons."""
        reasons = self.state.fields["reflex_reason"]
        reasons[:] = 0
        reasons[list(errors)] = 1
        self.state.fields["errors"][list(errors)] = 1
        self._end(MoveStatus.REFLEX, RobotMode.REFLEX)

    def guide(self, q: Array) -> None:
        """Somebody takes the arm and leads it to `q` (7,), rad."""
        if self.mode is RobotMode.IDLE:
            self._led_to, self.mode = q, RobotMode.GUIDING

    def lock(self, locked: bool) -> None:
        """Somebody closes the brakes in Desk, or opens them."""
        if locked:
            self._end(MoveStatus.ABORTED, RobotMode.OTHER)
        elif self.mode is RobotMode.OTHER:
            self.mode = RobotMode.IDLE
        self._tell()

    def recover(self) -> None:
        """Forget a reflex."""
        self.state.fields["errors"][:] = 0
        if self.mode is RobotMode.REFLEX:
            self.mode = RobotMode.IDLE
        self._tell()

    def abandoned(self) -> None:
        """The client is gone."""
        if self.mode is RobotMode.MOVE:
            self._move = None
            self.reflex(Error.COMMUNICATION)

    def configure(self, ee: Body) -> None:
        """What somebody typed into Desk as the end effector."""
        self._believed.configure(ee, self._believed.load)
        self._configured()

    def _answer(self, asked: Request, status: int, more: bytes = b"") -> None:
        self._answers.append((asked, bytes([status]) + more))

    def _start(self, asked: Request) -> None:
        controls, motion, *rest = MOVE.unpack(asked.payload)
        if self.mode is not RobotMode.IDLE:
            self._answer(asked, MoveStatus.NOT_POSSIBLE)
            return
        self._motion, self._controls = MotionMode(motion + 1), ControllerMode(controls)
        unknown = self._motion is MotionMode.NONE and self._controls is not ControllerMode.EXTERNAL
        if unknown or rest[6]:  # without any rate: a kind of motion that no client of ours asks for
            self._motion, self._controls = MotionMode.IDLE, ControllerMode.OTHER
            self._answer(asked, MoveStatus.INVALID)
            return
        self._move, self.mode = asked, RobotMode.MOVE
        self._awaits_first, self._missed = True, 0
        self.controller.start()
        self._answer(asked, MoveStatus.STARTED)
        self._tell()

    def _stop(self, asked: Request) -> None:
        refusals = {
            RobotMode.REFLEX: StopStatus.REFLEX,
            RobotMode.USER_STOPPED: StopStatus.EMERGENCY,
        }
        self._end(MoveStatus.PREEMPTED, self.mode)
        if self.mode is RobotMode.MOVE:
            self.mode = RobotMode.IDLE
        self._answer(asked, refusals.get(self.mode, StopStatus.SUCCESS))
        self._tell()

    def _recover(self, asked: Request) -> None:
        if self.mode is RobotMode.USER_STOPPED:
            self._answer(asked, RecoveryStatus.EMERGENCY)
        elif self.mode is RobotMode.MOVE:
            self._answer(asked, RecoveryStatus.NOT_POSSIBLE)
        else:
            self.recover()
            self._answer(asked, RecoveryStatus.SUCCESS)

    def _model(self, asked: Request) -> None:
        self._answer(asked, SetStatus.SUCCESS, self._urdf)

    def _set(self, asked: Request) -> None:
        if self.mode is not RobotMode.IDLE:
            self._answer(asked, SetStatus.NOT_POSSIBLE)
            return
        status = SetStatus.SUCCESS
        if asked.command != Command.SET_GUIDING_MODE:
            values = np.frombuffer(asked.payload, "<f8")
            good = np.isfinite(values).all() and self._apply(Command(asked.command), values)
            status = SetStatus.SUCCESS if good else SetStatus.INVALID
        self._answer(asked, status)

    def _apply(self, command: Command, values: Array) -> bool:
        """Whether these settings are taken."""
        believed, controller = self._believed, self.controller
        if command is Command.SET_COLLISION_BEHAVIOR:
            lower, upper = _thresholds(values)
            if (values < 0).any() or (lower > upper).any():
                return False
            self._lower, self._upper = lower, upper
        elif command is Command.SET_JOINT_IMPEDANCE:
            controller.K_theta = np.array(values)
        elif command is Command.SET_CARTESIAN_IMPEDANCE:
            controller.K_x = np.array(values)
        elif command is Command.SET_EE_TO_K:
            believed.EE_T_K = matrix(values)
        elif command is Command.SET_NE_TO_EE:
            believed.NE_T_EE = matrix(values)
        elif command is Command.SET_LOAD:
            if values[0] < 0:
                return False
            load = Body(float(values[0]), np.array(values[1:4]), values[4:].reshape(3, 3).T)
            believed.configure(believed.ee, load)
        self._configured()
        return True

    def _end(self, status: MoveStatus, mode: RobotMode) -> None:
        """What moves comes to rest, and whoever moved it is told."""
        if self._move is not None:
            self._answer(self._move, status)
        if self.mode is RobotMode.MOVE:
            self.controller.hold(at_once=status is MoveStatus.REFLEX)
        self._move, self.mode = None, mode
        self._motion, self._controls = MotionMode.IDLE, ControllerMode.OTHER

    def _obey(self, command: NDArray[np.void] | None) -> None:
        """Make a torque of a command, or of what was commanded last."""
        if self._awaits_first and command is None:
            self._stay()
            return
        self._awaits_first = False
        self.commanded += 1
        if command is not None and self.loses and self._chance.random() < self.loses:
            command = None
        self._succeeded += (command is not None) - self._history[0]
        self._history.append(command is not None)
        if command is None:
            self._miss()
            return
        self._missed = 0
        if self._controls is ControllerMode.EXTERNAL:
            self._take_torque(command)
        if self.mode is RobotMode.MOVE and self._motion is not MotionMode.NONE:
            self._take_motion(command)
        if self.mode is RobotMode.MOVE and (
            command["motion_finished"] or command["torque_finished"]
        ):
            self._end(MoveStatus.SUCCESS, RobotMode.IDLE)

    def _stay(self) -> None:
        """No client is in command: come to rest, and tell of no desired torque, as a Franka does."""
        desired = self.controller.desired
        if self.mode is not RobotMode.GUIDING:
            desired.brake()
        elif desired.approach(self._led_to):
            self.mode = RobotMode.IDLE
        self._torque, self._told = self.controller.joints(), np.zeros(7)

    def _miss(self) -> None:
        """A cycle without a command: go on as before."""
        self.lost += 1
        self._missed += 1
        if self._missed >= MOST_LOST:
            self.reflex(Error.COMMUNICATION)
        elif self._motion is not MotionMode.NONE:
            desired = self.controller.desired
            desired.become(desired.q + desired.dq * TIMESTEP)
            self._torque = self._told = self.controller.joints()

    def _take_torque(self, command: NDArray[np.void]) -> None:
        torque = np.array(command["tau_J_d"])
        step = float(np.abs(torque - self._told).max())
        if not step <= TORQUE_RATE * SLACK * (1 + self._gap()):
            self.reflex(Error.TORQUE_DISCONTINUITY)
            return
        self._torque = self._told = torque

    def _gap(self) -> int:
        """Cycles that were lost just before the present one."""
        gap = 0
        for arrived in list(self._history)[-2::-1]:
            if arrived:
                break
            gap += 1
        return gap

    def _take_motion(self, command: NDArray[np.void]) -> None:
        controller = self.controller
        error = self._impossible(command)
        if error is None:
            controller.pursue(
                self._motion,
                command["q_c"],
                command["dq_c"],
                matrix(command["O_T_EE_c"]),
                command["O_dP_EE_c"],
            )
            error = self._too_fast()
        if error is not None:
            self.reflex(error)
        elif self._controls is ControllerMode.CARTESIAN_IMPEDANCE:
            self._torque = self._told = controller.cartesian()
        elif self._controls is ControllerMode.JOINT_IMPEDANCE:
            self._torque = self._told = controller.joints()

    def _impossible(self, command: NDArray[np.void]) -> Error | None:
        """Why a motion cannot go on so."""
        controller, limits = self.controller, self._limits
        if self._motion is MotionMode.JOINT_POSITION:
            q = command["q_c"]
            if not np.abs(q - controller.desired.q).max() < START[0]:
                return Error.JOINT_START_POSE_INVALID
            if ((q < limits.q_min) | (q > limits.q_max)).any():
                return Error.JOINT_MOTION_POSITION_LIMITS
        if self._motion is MotionMode.CARTESIAN_POSITION:
            way = matrix(command["O_T_EE_c"])[:3, 3] - controller.target[:3, 3]
            if not np.linalg.norm(way) < START[1]:
                return Error.CARTESIAN_START_POSE_INVALID
        return None

    def _too_fast(self) -> Error | None:
        """Why what was just commanded is more than an arm can do."""
        controller, gap = self.controller, 1 + self._gap()
        desired = controller.desired
        if self._motion in (MotionMode.JOINT_POSITION, MotionMode.JOINT_VELOCITY):
            if (np.abs(desired.dq) > SLACK * self._limits.dq_max).any():
                return Error.JOINT_MOTION_VELOCITY_LIMITS
            if (np.abs(desired.ddq) > SLACK * ACCELERATION * gap).any():
                return Error.JOINT_VELOCITY_DISCONTINUITY
            return None
        speeds, accelerations = CARTESIAN
        for limit, half in zip(speeds, (controller.twist[:3], controller.twist[3:]), strict=True):
            if np.linalg.norm(half) > SLACK * limit:
                return Error.CARTESIAN_VELOCITY_LIMITS
        rates = (controller.acceleration[:3], controller.acceleration[3:])
        for limit, half in zip(accelerations, rates, strict=True):
            if np.linalg.norm(half) > SLACK * limit * gap:
                return Error.CARTESIAN_VELOCITY_DISCONTINUITY
        return None

    def _watch(self) -> None:
        """The arm's own limits and reflexes, every cycle."""
        sensing, limits = self._sensing, self._limits
        found: list[Error] = []
        if (np.abs(sensing.dq) > limits.dq_max).any():
            found.append(Error.JOINT_VELOCITY)
        if (sensing.q < limits.q_min).any() or (sensing.q > limits.q_max).any():
            found.append(Error.JOINT_POSITION_LIMITS)
        if (np.abs(sensing.tau) > limits.tau_max).any():
            found.append(Error.TORQUE_RANGE)
        collided = self._felt > self._upper[self._phase()]
        if collided[:7].any():
            found.append(Error.JOINT_REFLEX)
        if collided[7:].any():
            found.append(Error.CARTESIAN_REFLEX)
        if found:
            self.reflex(*found)

    def _phase(self) -> int:
        """Which thresholds hold: 0 while accelerating, 1 otherwise."""
        accelerating = self._motion is not MotionMode.NONE and (
            np.abs(self.controller.desired.ddq).max() > MOVING
        )
        return 0 if accelerating else 1

    def _feel(self) -> None:
        """What acts on the arm from outside: at the joints, and in the stiffness frame."""
        fields = self.state.fields
        believed, external = self._believed, self._sensing.external
        wrench = believed.wrench(external)
        turn = believed.O_T_K[:3, :3]
        fields["tau_ext_hat_filtered"][:] = self._felt[:7] = external
        fields["O_F_ext_hat_K"][:] = wrench
        self._felt[7:10], self._felt[10:] = wrench[:3] @ turn, wrench[3:] @ turn
        fields["K_F_ext_hat_K"][:] = self._felt[7:]
        np.abs(self._felt, out=self._felt)

    def _configured(self) -> None:
        """Tell what is set."""
        fields, believed = self.state.fields, self._believed
        for name in ("F_T_NE", "NE_T_EE", "F_T_EE", "EE_T_K"):
            fields[name][:] = getattr(believed, name).T.ravel()
        for name, body in (("ee", believed.ee), ("load", believed.load)):
            fields[f"m_{name}"][:] = body.mass
            fields[f"F_x_C{name}"][:] = body.centre
            fields[f"I_{name}"][:] = body.inertia.ravel()
        fields["O_ddP_O"][:] = (0.0, 0.0, -9.81)

    def _tell(self) -> None:
        """Write the state."""
        state, fields = self.state, self.state.fields
        believed, sensing, controller = self._believed, self._sensing, self.controller
        desired, moves = controller.desired, self._motion not in (MotionMode.IDLE, MotionMode.NONE)
        felt, phase = self._felt, self._phase()
        pose = believed.O_T_EE.T.ravel()
        following = moves or self.mode is not RobotMode.MOVE
        fields["O_T_EE"][:] = pose
        cartesian = self._motion in (MotionMode.CARTESIAN_POSITION, MotionMode.CARTESIAN_VELOCITY)
        commanded = controller.target.T.ravel() if cartesian else pose
        fields["O_T_EE_d"][:] = fields["O_T_EE_c"][:] = commanded
        fields["q"][:], fields["dq"][:] = sensing.q, sensing.dq
        fields["theta"][:], fields["dtheta"][:] = sensing.q, sensing.dq
        fields["q_d"][:] = desired.q if following else sensing.q
        fields["dq_d"][:] = desired.dq if moves else 0.0
        fields["ddq_d"][:] = desired.ddq if moves else 0.0
        if cartesian:
            fields["O_dP_EE_c"][:] = fields["O_dP_EE_d"][:] = controller.twist
            fields["O_ddP_EE_c"][:] = controller.acceleration
        for name, angles in (("elbow", sensing.q), ("elbow_d", desired.q), ("elbow_c", desired.q)):
            fields[name][:] = (angles[2], -1.0 if angles[3] < 0 else 1.0)
        fields["dtau_J"][:] = (sensing.tau - self._before) * 1e3
        fields["tau_J"][:] = self._before = sensing.tau
        fields["tau_J_d"][:] = self._told
        touched, hit = felt > self._lower[phase], felt > self._upper[phase]
        fields["joint_contact"][:], fields["cartesian_contact"][:] = touched[:7], touched[7:]
        fields["joint_collision"][:], fields["cartesian_collision"][:] = hit[:7], hit[7:]
        rate = self._succeeded / REMEMBERED if self.mode is RobotMode.MOVE else 0.0
        state.put(self._ids, self._motion, self._controls, self.mode, rate)


def _thresholds(values: Array) -> tuple[Array, Array]:
    """Lower and upper ones, (2, 13) each: accelerating and else, joints and Cartesian."""
    torques, forces = values[:28].reshape(4, 7), values[28:].reshape(4, 6)
    lower = np.concatenate([torques[[0, 2]], forces[[0, 2]]], axis=1)
    upper = np.concatenate([torques[[1, 3]], forces[[1, 3]]], axis=1)
    return lower, upper
