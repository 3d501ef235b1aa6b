"""A Franka robot without its network: what it does with commands."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from palpate.common.pose import Array
from palpate.robots.description import RobotDescription
from palpate.robots.simulated.timing import TIMESTEP

from .arrivals import Arrivals
from .believed import BelievedArm, Body
from .control import Controller
from .plant import Plant
from .sensing import Sensing
from .told import Teller
from .urdf import urdf
from .watch import Watch
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

MOST_LOST = 20
"""Lost cycles in a row that end a motion (libfranka's documentation, "communication_constraints")."""

Answer = tuple[Request, bytes]


class FrankaRobot:
    """Modes, motions, settings and errors of one arm.

    Attributes:
        mode: a `RobotMode`. commanded: cycles in motion. lost: those without a command, in all.
        unanswered: states of a motion that were told before its first command.
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
        self._finger = finger
        self._urdf = urdf(arm, believed).encode()
        self.controller = Controller(believed, sensing)
        self._watch = Watch(arm, self.controller, sensing)
        self._teller = Teller(believed, sensing, self.controller, self._watch)
        self.mode = RobotMode.IDLE
        self._motion, self._controls = MotionMode.IDLE, ControllerMode.OTHER
        self._move: Request | None = None
        self._answers: list[Answer] = []
        self._torque, self._told, self._led_to = np.zeros(7), np.zeros(7), np.zeros(7)
        self._ids, self._arrivals = 0, Arrivals()
        self.lost = self.commanded = 0
        self.loses, self._chance = 0.0, np.random.default_rng(seed)
        self._awaits_first, self.unanswered = False, 0
        self._tell()

    @property
    def state(self) -> StateBuffer:
        """What is sent."""
        return self._teller.state

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
        self._teller.feel()
        if self.mode is RobotMode.MOVE:
            self._look()
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
        self._teller.configured()

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
        self._awaits_first, self.unanswered = True, 0
        self._arrivals.begin()
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
            return self._watch.set_thresholds(values)
        if command is Command.SET_JOINT_IMPEDANCE:
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
        self._teller.configured()
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
            self.unanswered += 1
            self._stay()
            return
        self._awaits_first = False
        self.commanded += 1
        if command is not None and self.loses and self._chance.random() < self.loses:
            command = None
        self._arrivals.note(command is not None)
        if command is None:
            self._miss()
            return
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
        if self._arrivals.missed >= MOST_LOST:
            self.reflex(Error.COMMUNICATION)
        elif self._controls is not ControllerMode.EXTERNAL:
            desired = self.controller.desired
            desired.become(desired.q + desired.dq * TIMESTEP)
            self._drive()

    def _take_torque(self, command: NDArray[np.void]) -> None:
        torque = np.array(command["tau_J_d"])
        if self._watch.jumps(torque, self._told, 1 + self._arrivals.gap):
            self.reflex(Error.TORQUE_DISCONTINUITY)
        else:
            self._torque = self._told = torque

    def _take_motion(self, command: NDArray[np.void]) -> None:
        watch, error = self._watch, self._watch.impossible(self._motion, command)
        if error is None:
            target = matrix(command["O_T_EE_c"])
            self.controller.pursue(
                self._motion, command["q_c"], command["dq_c"], target, command["O_dP_EE_c"]
            )
            error = watch.too_fast(self._motion, 1 + self._arrivals.gap)
        if error is not None:
            self.reflex(error)
        elif self._controls is not ControllerMode.EXTERNAL:
            self._drive()

    def _drive(self) -> None:
        """The arm's own controllers make torques of a motion."""
        cartesian = self._controls is ControllerMode.CARTESIAN_IMPEDANCE
        controller = self.controller
        self._torque = self._told = controller.cartesian() if cartesian else controller.joints()

    def _look(self) -> None:
        """The arm's own limits and reflexes, every cycle."""
        found = self._watch.broken(self._motion, self._teller.felt)
        if found:
            self.reflex(*found)

    def _tell(self) -> None:
        rate = self._arrivals.rate if self.moving else 0.0
        self._teller.tell(self._ids, self.mode, self._motion, self._controls, self._told, rate)
