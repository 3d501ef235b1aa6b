"""The hidden world: the scene's physics with the true robot in it.

Nothing here passes through the robot's protocol. The controller gives set-points and gets joint
signals; truth and pictures are for those who look at the world from outside, after the estimates
are made.
"""

from __future__ import annotations

from collections.abc import Callable

import mujoco
import numpy as np

from palpate.errors import ExecutionAborted, InputError, unknown_name
from palpate.geometry.pose import Array, Pose
from palpate.robots.description import RobotDescription
from palpate.robots.model import PREFIX, neighbours
from palpate.robots.simulated.gripper import DRIVE, add_drive, round_fingers
from palpate.robots.simulated.guard import Guard, Reaction
from palpate.robots.simulated.impedance import Actuators, add_actuators
from palpate.robots.simulated.noise.true_arm import Truth
from palpate.robots.simulated.softness import keep_softness
from palpate.robots.simulated.steps import Cycles, Steps, block_means
from palpate.robots.simulated.stiction import declared
from palpate.robots.simulated.timing import BLOCK, PERIOD, SUBSTEPS, TIMESTEP
from palpate.robots.simulated.touchable import let_touch

FRAME_PERIOD = 1.0 / 30.0
"""s between camera frames."""
LEVEL = 0.01
"""rad: how far gravity may lean."""
_OFF = mujoco.mjtDisableBit
NEEDED = (
    _OFF.mjDSBL_GRAVITY,
    _OFF.mjDSBL_CONTACT,
    _OFF.mjDSBL_CONSTRAINT,
    _OFF.mjDSBL_EQUALITY,
    _OFF.mjDSBL_LIMIT,
    _OFF.mjDSBL_FRICTIONLOSS,
    _OFF.mjDSBL_ACTUATION,
    _OFF.mjDSBL_SPRING,
    _OFF.mjDSBL_DAMPER,
)
"""MuJoCo features that a robot needs."""


class World:
    """The physics of one run. `model`, `data` and `frames` are for pictures, `true_*` for the
    report.

    Attributes:
        model: the compiled world, robot included (its names start with `robot/`).
        frames: (t, qpos) every 1/30 s, what a 30 Hz camera saw.
        actuators: the controller's.
        rest_control: (nu,) what rows of controls start from, valid for actuators that nobody
            commands.
        feels: whether what contacts exert is recorded.
        watch: shown the data after every single physics step, where somebody wants to see it.
    """

    def __init__(
        self,
        spec: mujoco.MjSpec,
        pose_world_base: Pose,
        arm: RobotDescription,
        truth: Truth,
    ) -> None:
        """Put the true arm into `spec`, which is changed, at `pose_world_base`, where it is thought
        to stand.

        Raises:
            InputError: it does not compile, or its physics is none to weigh and touch in.
        """
        self._arm = arm
        self.model = _compile(spec, pose_world_base, arm, truth)
        self._data = mujoco.MjData(self.model)
        joints = [self.model.joint(PREFIX + name) for name in arm.joints]
        self._q, self._v = _run(joints[0].qposadr[0], 7), _run(joints[0].dofadr[0], 7)
        finger = self.model.joint(PREFIX + arm.hand.fingers[0])
        self._finger_q, self._finger_v = _run(finger.qposadr[0], 2), _run(finger.dofadr[0], 2)
        self._drive = int(self.model.actuator(PREFIX + DRIVE).id)
        self._fingers_control = int(self.model.actuator_ctrladr[self._drive])
        self._data.qpos[self._q], self._data.qpos[self._finger_q] = arm.home, arm.hand.opening / 2
        self._seen, self._before = mujoco.MjData(self.model), mujoco.MjData(self.model)
        self._control, self._dq = self._data.ctrl, self._data.qvel[self._v]
        self._torque = self._data.qfrc_actuator[self._v]
        self._weight = self._data.qfrc_gravcomp[self._v]
        self._contact = self._data.qfrc_constraint[self._v]
        self.actuators = Actuators(self.model)
        self.rest_control = np.zeros(self.model.nu)
        self.rest_control[self.actuators.orientation.start] = 1.0
        self._stiction = declared(self.model)
        self.frames: list[tuple[float, Array]] = [(0.0, self._data.qpos.copy())]
        self.t = 0.0
        self.feels = False
        self.watch: Callable[[mujoco.MjData], None] | None = None

    def step(self, control: Array, guard: Guard) -> Steps:
        """Step once per row of `control` (n * BLOCK, nu), or until the guard feels too much: then
        the arm gives way for what is left of that block, and the run ends with it.

        Raises:
            ExecutionAborted: the physics became unstable.
        """
        cycles = Cycles(len(control), self.model.nq, self.model.nv)
        count = self._follow(control, guard, cycles)
        blocks = count // BLOCK
        qpos, qvel = cycles.qpos[:blocks], cycles.qvel[:blocks]
        self._film(qpos)
        self.t = round(self.t + count * TIMESTEP, 9)
        self._require_stable()
        return Steps(
            qpos[:, self._q],
            qvel[:, self._v],
            block_means(cycles.torque[:count]),
            block_means(cycles.contact[:count]),
            qpos[:, self._finger_q],
            qvel[:, self._finger_v],
        )

    def _follow(self, control: Array, guard: Guard, cycles: Cycles) -> int:
        """Go through the cycles of `control` until the guard feels too much, and then give way for what
        is left of that block; returns how many cycles that were."""
        if guard.yielding:
            self._cycle(control, cycles, 0, len(control), guard.reaction)
            return len(control)
        look = self._all_at_once if self.watch is None else self._one_by_one
        fired = look(control, guard, cycles)
        if fired is None:
            return len(control)
        self.actuators.set(guard.reaction.gains)
        end = (fired // BLOCK + 1) * BLOCK
        self._cycle(control, cycles, fired + 1, end, guard.reaction)
        return end

    def _all_at_once(self, control: Array, guard: Guard, cycles: Cycles) -> int | None:
        """Go through all cycles before the guard looks at them; what came after the one in which it
        feels too much, which is returned, is taken back."""
        mujoco.mj_copyData(self._before, self.model, self._data)
        self._cycle(control, cycles, 0, len(control))
        fired = guard.feels(*cycles.felt(0, len(control)))
        if fired is not None:
            mujoco.mj_copyData(self._data, self.model, self._before)
            self._cycle(control, cycles, 0, fired + 1)
        return fired

    def _one_by_one(self, control: Array, guard: Guard, cycles: Cycles) -> int | None:
        """The same for somebody who watches, and would see what is taken back."""
        for i in range(len(control)):
            self._cycle(control, cycles, i, i + 1)
            if guard.feels(*cycles.felt(i, i + 1)) is not None:
                return i
        return None

    def _cycle(
        self,
        control: Array,
        cycles: Cycles,
        first: int,
        last: int,
        reaction: Reaction | None = None,
    ) -> None:
        """Go through the cycles from `first` to `last`, and write down what happens. With a `reaction`
        the arm gives way in them."""
        for i in range(first, last):
            if i % BLOCK == 0:
                for stiction in self._stiction:
                    stiction.apply(self.model, self._data)
            self._control[:] = control[i]
            if reaction is not None:
                self._control[self.actuators.drives] = reaction.torque(self._dq)
            self._substeps()
            cycles.torque[i], cycles.weight[i] = self._torque, self._weight
            cycles.dq[i] = self._dq
            if self.feels:
                cycles.contact[i] = self._contact
            if i % BLOCK == BLOCK - 1:
                cycles.qpos[i // BLOCK], cycles.qvel[i // BLOCK] = self._data.qpos, self._data.qvel

    def _require_stable(self) -> None:
        """MuJoCo starts over when it diverges."""
        if abs(self._data.time - self.t) > TIMESTEP / 2:
            raise ExecutionAborted(
                f"the simulated world became unstable before {self.t:.2f} s of robot time: "
                "check its masses, sizes and contact parameters"
            )

    def _substeps(self) -> None:
        """Step one control cycle, calling `watch` after each physics step."""
        if self.watch is None:
            mujoco.mj_step(self.model, self._data, nstep=SUBSTEPS)
            return
        for _ in range(SUBSTEPS):
            mujoco.mj_step(self.model, self._data)
            self.watch(self._data)

    def set_fingers(self, control: Array, opening: Array | float) -> None:
        """Command each finger's way from the middle, m, in the rows of `control`."""
        control[:, self._fingers_control] = opening

    def limit_fingers(self, force: float) -> None:
        """From now on the fingers' drive exerts at most `force` N."""
        self.model.actuator_forcerange[self._drive] = (-force, force)

    def true_gravity_torque(self) -> Array:
        """(7,) N m that hold the true arm up where it stands now, at rest."""
        data = self._at(self.qpos)
        return data.qfrc_bias[self._v].copy()

    @property
    def qpos(self) -> Array:
        """(nq,) now."""
        return self._data.qpos.copy()

    @property
    def compensation(self) -> Array:
        """(7,) N m with which MuJoCo holds the nominal arm up now."""
        data = self._data if self.t else self._at(self.qpos)
        return data.qfrc_gravcomp[self._v].copy()

    def data(self, qpos: Array | None = None) -> mujoco.MjData:
        """The world now, or at `qpos` (one of `frames`), forwarded: for pictures. Reused by the
        next call."""
        return self._at(self.qpos if qpos is None else qpos)

    def true_pose(self, body: str) -> Pose:
        """Return the true pose of a body now, in the world.

        Raises:
            InputError: there is no such body.
        """
        names = [self.model.body(i).name for i in range(self.model.nbody)]
        if body not in names:
            raise unknown_name("body", body, [n for n in names if not n.startswith(PREFIX)])
        frame = self._at(self.qpos).body(body)
        return Pose(frame.xpos.copy(), frame.xquat.copy())

    def true_tcp(self) -> Pose:
        """Return the true pose of the TCP now, in the world."""
        data = self._seen
        data.qpos[:] = self._data.qpos
        mujoco.mj_kinematics(self.model, data)
        tcp, hand = data.site(PREFIX + self._arm.tcp), data.body(PREFIX + self._arm.hand.body)
        return Pose(tcp.xpos.copy(), hand.xquat.copy())

    def _at(self, qpos: Array) -> mujoco.MjData:
        self._seen.qpos[:] = qpos
        mujoco.mj_forward(self.model, self._seen)
        return self._seen

    def _film(self, qpos: Array) -> None:
        """Keep the configurations, at the end of a log period, that are nearest to when the camera
        takes a frame."""
        while (row := round((len(self.frames) * FRAME_PERIOD - self.t) / PERIOD) - 1) < len(qpos):
            self.frames.append((self.t + (row + 1) * PERIOD, qpos[row].copy()))


def _compile(
    spec: mujoco.MjSpec,
    pose_world_base: Pose,
    arm: RobotDescription,
    truth: Truth,
) -> mujoco.MjModel:
    """The world with the true robot in it.

    Raises:
        InputError: MuJoCo does not accept the result, or the world's physics is none to weigh and
            touch in.
    """
    _require_physics(spec)
    robot = arm.spec()
    for pair in sorted(map(sorted, neighbours(robot, arm))):
        robot.add_exclude(bodyname1=pair[0], bodyname2=pair[1])
    add_drive(robot, arm.hand)
    truth.build(robot, arm)
    round_fingers(robot, arm.hand)
    spec.option.timestep = TIMESTEP / SUBSTEPS
    spec.option.gravity = truth.gravity(spec.option.gravity)
    for name in ("integrator", "cone", "impratio", "solver"):
        setattr(spec.option, name, getattr(robot.option, name))
    _solve_well(spec, robot)
    robot.option.gravity, robot.option.timestep = spec.option.gravity, spec.option.timestep
    for key in list(spec.keys):  # states of a world without this robot
        spec.delete(key)
    try:
        base = truth.base(pose_world_base)
        frame = spec.worldbody.add_frame(pos=base.position, quat=base.quaternion)
        spec.attach(robot, frame=frame, prefix=PREFIX)
        add_actuators(spec, arm)
        let_touch(spec)
        keep_softness(spec, arm)
        return spec.compile()
    except ValueError as error:
        raise InputError(
            f"the simulated world does not compile with the robot in it: {error}"
        ) from error


def _solve_well(world: mujoco.MjSpec, robot: mujoco.MjSpec) -> None:
    """Set the solver as accurately as the arm needs it: the accuracy of contacts is no physics of
    the scene."""
    option, least = world.option, robot.option
    for name in ("iterations", "ls_iterations", "ccd_iterations"):
        setattr(option, name, max(getattr(option, name), getattr(least, name)))
    for name in ("tolerance", "ls_tolerance", "ccd_tolerance"):
        setattr(option, name, min(getattr(option, name), getattr(least, name)))


def _require_physics(spec: mujoco.MjSpec) -> None:
    x, y, z = spec.option.gravity
    if z >= 0 or max(abs(x), abs(y)) > -LEVEL * z:
        raise InputError(
            f"the world's gravity is ({x:g}, {y:g}, {z:g}) m/s²; it must point down, as in "
            '<option gravity="0 0 -9.81"/>: what is let go has to fall, and weighing needs a weight'
        )
    disabled = [
        flag.name.removeprefix("mjDSBL_").lower()
        for flag in NEEDED
        if spec.option.disableflags & int(flag)
    ]
    if disabled:
        raise InputError(
            f"the world's <option><flag> disables {', '.join(disabled)}, without which nothing can be "
            "grasped and weighed; leave it enabled"
        )


def _run(first: int, count: int) -> slice:
    return slice(int(first), int(first) + count)
