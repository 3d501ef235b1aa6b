"""The hidden world: the scene's physics with the true robot in it.

Nothing here passes through the robot's protocol. The controller gives set-points and gets joint
signals; truth and pictures are for observers outside, after the estimates are made.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import mujoco
import numpy as np
from mujoco.rollout import Rollout

from palpate.common.errors import ExecutionAborted, InputError, unknown_name
from palpate.common.pose import Array, Pose
from palpate.mjcf.contacts import CCD_TOLERANCE
from palpate.robots.description import PREFIX, RobotDescription, neighbours
from palpate.robots.simulated.actuators import (
    DRIVE,
    Actuators,
    add_actuators,
    add_drive,
    round_fingers,
)
from palpate.robots.simulated.contacts import declared_stiction, keep_softness, let_touch
from palpate.robots.simulated.guard import Guard, Reaction
from palpate.robots.simulated.noise.true_arm import TrueArm
from palpate.robots.simulated.timing import (
    BLOCK,
    LONGEST_RUN,
    PERIOD,
    SUBSTEPS,
    TIMESTEP,
    Watch,
    mark_steps,
    takes_many,
)

FRAME_PERIOD = 1.0 / 30.0  # s between camera frames
LEVEL = 0.01  # rad, largest inclination of gravity
ASLEEP = 1e-4
"""m/s: slower objects rest, and take no time until something that moves touches them. A cylinder on its end
goes on trembling at some 5e-5 m/s for ever, by the rounding of its contacts."""
PHYSICS = mujoco.mjtState.mjSTATE_FULLPHYSICS
MOTOR, PUSH, TOUCHING = PREFIX + "motor{}", PREFIX + "push", PREFIX + "touching"  # names of sensors
SENSED = 10  # values of these: motor torques, and the force of the hand
NET_FORCE = 3  # of MuJoCo's reductions of several contacts
NEEDED = (
    *("gravity", "contact", "constraint", "equality", "limit"),
    *("frictionloss", "actuation", "spring", "damper"),
)
"""Features of MuJoCo that a robot needs."""


class Steps(NamedTuple):
    """Record of the robot over some blocks of control cycles."""

    q: Array  # (n, 7) rad at the end of each block
    dq: Array  # (n, 7) rad/s, likewise
    torque: Array  # (n, 7) N m, mean commanded joint torques, at the beginning of each physics step
    push: Array  # (n, 3) N, mean force with which the hand pushes on things, world axes
    fingers: Array  # (n, 2) m at the end of each block
    finger_speed: Array  # (n, 2) m/s, likewise
    step: float  # s, a step of the physics


class World:
    """The physics of one run. `model`, `data` and `frames` are for pictures, `true_*` for the
    report.

    Attributes:
        model: the compiled world, robot included (its names start with `robot/`).
        frames: (t, qpos) every 1/30 s, as a 30 Hz camera sees it.
        t: s, time of the world.
        actuators: the controller's.
        rest_control: (nu,) initial value of each row of controls, for actuators without a command.
        watch: called with the data after every physics step, if set.
    """

    def __init__(
        self,
        spec: mujoco.MjSpec,
        pose_world_base: Pose,
        arm: RobotDescription,
        truth: TrueArm,
        substeps: int = SUBSTEPS,
        q: Array | None = None,
    ) -> None:
        """Put the true arm into `spec`, which is changed, at its stated place `pose_world_base` with joint angles `q`
        (7,), rad, or at home; with `substeps` physics steps in a control cycle while anything touches, or moves beside
        the arm, else one.

        Raises:
            InputError: it does not compile, or lacks physics that weighing and touching need.
        """
        self._arm, self._finest, self._substeps = arm, substeps, substeps
        self.model = compile_world(spec, pose_world_base, arm, truth, substeps)
        self._data = mujoco.MjData(self.model)
        joints = [self.model.joint(PREFIX + name) for name in arm.joints]
        self._q, self._v = run_of(joints[0].qposadr[0], 7), run_of(joints[0].dofadr[0], 7)
        finger = self.model.joint(PREFIX + arm.hand.fingers[0])
        self._finger_q, self._finger_v = run_of(finger.qposadr[0], 2), run_of(finger.dofadr[0], 2)
        self._tcp = int(self.model.site(PREFIX + arm.tcp).id)
        self._hand = int(self.model.body(PREFIX + arm.hand.body).id)
        self._drive = int(self.model.actuator(PREFIX + DRIVE).id)
        self._fingers_control = int(self.model.actuator_ctrladr[self._drive])
        self._data.qpos[self._q], self._data.qpos[self._finger_q] = (
            arm.home if q is None else q,
            arm.hand.opening / 2,
        )
        self._seen, self._before = mujoco.MjData(self.model), mujoco.MjData(self.model)
        self._dq = self._data.qvel[self._v]
        self._sensors = run_of(self.model.sensor(MOTOR.format(1)).adr[0], SENSED)
        self._touching = int(self.model.sensor(TOUCHING).adr[0])
        self._rollout = Rollout(nthread=0)
        steps = LONGEST_RUN * BLOCK * substeps
        self._states = np.empty((1, steps, mujoco.mj_stateSize(self.model, PHYSICS)))
        self._signals = np.empty((1, steps, self.model.nsensordata))
        self._at, self._warm = np.empty_like(self._states[:, 0]), np.empty((1, self.model.nv))
        self.actuators = Actuators(self.model)
        self.rest_control = np.zeros(self.model.nu)
        self.rest_control[self.actuators.orientation.start] = 1.0
        self._stiction = declared_stiction(self.model)
        self.frames: list[tuple[float, Array]] = [(0.0, self._data.qpos.copy())]
        self.t = 0.0
        self.watch: Watch | None = None

    def step(self, control: Array, guard: Guard) -> Steps:
        """Step a cycle per row of `control` (n * BLOCK, nu), or until the guard fires: then the arm
        yields for the rest of that block, and the run ends with it; or until the end of the tick in which
        it feels something.

        Raises:
            ExecutionAborted: the physics became unstable.
        """
        count = len(control)
        if self._is_free() and not guard.yielding:
            self._pace(1)
        if guard.yielding:
            self._cycle(control, 0, count, guard.reaction)
        else:
            look = self._all_at_once if takes_many(self.watch) else self._one_by_one
            fired = look(control, guard)
            if fired is None:
                count = min(count, guard.felt or count)
            else:
                self.actuators.set(guard.reaction.gains)
                count = (fired // BLOCK + 1) * BLOCK
                self._cycle(control, fired + 1, count, guard.reaction)
        blocks = self._states[0, self._ends(count, BLOCK), 1:].copy()
        qvel = blocks[:, self.model.nq :]
        self._film(blocks[:, : self.model.nq])
        self.t = round(self.t + count * TIMESTEP, 9)
        if abs(self._data.time - self.t) > TIMESTEP / 2:  # MuJoCo starts over when it diverges
            raise ExecutionAborted(
                f"the simulated world became unstable before {self.t:.2f} s of robot time: "
                "check its masses, sizes and contact parameters"
            )
        means = self._means(0, count, BLOCK)
        steps = Steps(
            q=blocks[:, self._q],
            dq=qvel[:, self._v],
            torque=means[:, :7],
            push=means[:, 7:],
            fingers=blocks[:, self._finger_q],
            finger_speed=qvel[:, self._finger_v],
            step=TIMESTEP / self._substeps,
        )
        self._pace(self._finest)
        return steps

    def _is_free(self) -> bool:
        """True if nothing but the arm moves, and nothing touches: one step of the physics a cycle will do, until
        something does."""
        return takes_many(self.watch) and self._data.ncon == 0 and self._data.ntree_awake <= 1

    def _pace(self, substeps: int) -> None:
        """Set the number of physics steps in a control cycle."""
        self._substeps, self.model.opt.timestep = substeps, TIMESTEP / substeps

    def _ends(self, count: int, every: int = 1) -> slice:
        """Return the rows of the physics steps that end each cycle of `count`, or `every` so many."""
        length = every * self._substeps
        return slice(length - 1, count * self._substeps, length)

    def _means(self, first: int, last: int, every: int = 1) -> Array:
        """Compute means (n, SENSED) of the sensors over each cycle, or `every` so many, from `first` to `last`."""
        rows = slice(first * self._substeps, last * self._substeps)
        each = every * self._substeps
        sensed = self._signals[0, rows, self._sensors].reshape(-1, each, SENSED)
        return np.add.reduce(sensed, axis=1) / each

    def _all_at_once(self, control: Array, guard: Guard) -> int | None:
        """Step all cycles before the guard observes them, which is faster than one by one; return
        the cycle in which it fires. Later cycles are undone, as are those after what it feels."""
        mujoco.mj_copyData(self._before, self.model, self._data)
        before, count = self.compensation, len(control)
        undo = mark_steps(self.watch)
        self._roll(control)
        if self._substeps < self._finest and self._is_touching(count):  # once more, in finer steps
            mujoco.mj_copyData(self._data, self.model, self._before)
            undo()
            undo = mark_steps(self.watch)
            self._pace(self._finest)
            self._roll(control)
        # The weight that the motors hold is the nominal arm's, followed from end to end of the run.
        share = np.arange(1.0, count + 1)[:, None] / count
        weight = before + share * (self.compensation - before)
        rates = self._states[0, self._ends(count), 1 + self.model.nq :][:, self._v].copy()
        fired = guard.observe(
            self._means(0, count)[:, :7] - weight, rates, TIMESTEP / self._substeps
        )
        last = (guard.felt or count) if fired is None else fired + 1
        if last < count:
            mujoco.mj_copyData(self._data, self.model, self._before)
            undo()
            self._roll(control[:last])
        return fired

    def _is_touching(self, count: int) -> bool:
        """True if anything touched something in `count` cycles."""
        return bool(self._signals[0, : count * self._substeps, self._touching].any())

    def _one_by_one(self, control: Array, guard: Guard) -> int | None:
        """Step as `_all_at_once`, for a `watch` that cannot undo what it saw."""
        for i in range(len(control)):
            self._cycle(control, i, i + 1)
            effort = self._means(i, i + 1)[:, :7] - self.compensation
            step = TIMESTEP / self._substeps
            if guard.observe(effort, self._dq[None].copy(), step) is not None:
                return i
            if guard.felt is not None and guard.felt <= i + 1:
                break
        return None

    def _roll(self, control: Array) -> None:
        """Step all cycles in one call, or block by block where friction changes; one by one for `watch`."""
        if self.watch is not None:
            self._cycle(control, 0, len(control))
            return
        model, data = self.model, self._data
        control = np.repeat(control, self._substeps, axis=0)[None]
        count = control.shape[1]
        length = BLOCK * self._substeps if self._stiction else count
        for first in range(0, count, length):
            for stiction in self._stiction:
                stiction.apply(model, data)
            mujoco.mj_getState(model, data, self._at[0], PHYSICS)
            self._warm[0] = data.qacc_warmstart
            steps = slice(first, min(first + length, count))
            self._rollout.rollout(
                [model],
                [data],
                self._at,
                control[:, steps],
                skip_checks=True,
                nstep=steps.stop - first,
                initial_warmstart=self._warm,
                state=self._states[:, steps],
                sensordata=self._signals[:, steps],
            )

    def _cycle(
        self, control: Array, first: int, last: int, reaction: Reaction | None = None
    ) -> None:
        """Step the cycles from `first` to `last`; with a `reaction` the arm yields."""
        data = self._data
        for i in range(first, last):
            if i % BLOCK == 0:
                for stiction in self._stiction:
                    stiction.apply(self.model, data)
            data.ctrl[:] = control[i]
            if reaction is not None:
                data.ctrl[self.actuators.drives] = reaction.torque(self._dq)
            for row in range(i * self._substeps, (i + 1) * self._substeps):
                mujoco.mj_step(self.model, data)
                mujoco.mj_getState(self.model, data, self._states[0, row], PHYSICS)
                self._signals[0, row] = data.sensordata
                if self.watch is not None:
                    self.watch(data)

    def set_fingers(self, control: Array, opening: Array | float) -> None:
        """Command each finger's distance from the middle, m, in the rows of `control`."""
        control[:, self._fingers_control] = opening

    def limit_fingers(self, force: float) -> None:
        """Limit the force of the fingers' drive, N."""
        self.model.actuator_forcerange[self._drive] = (-force, force)

    def true_gravity_torque(self) -> Array:
        """Compute the torques (7,), N m, that hold the true arm up now, at rest."""
        return self.data().qfrc_bias[self._v].copy()

    @property
    def qpos(self) -> Array:
        """(nq,) now."""
        return self._data.qpos.copy()

    @property
    def compensation(self) -> Array:
        """(7,) N m with which MuJoCo holds the nominal arm up now."""
        data = self._data if self.t else self.data()
        return data.qfrc_gravcomp[self._v].copy()

    def data(self, qpos: Array | None = None) -> mujoco.MjData:
        """Return the world now, or at `qpos` (one of `frames`), forwarded. Reused by the next call."""
        self._seen.qpos[:] = self._data.qpos if qpos is None else qpos
        mujoco.mj_forward(self.model, self._seen)
        return self._seen

    def true_pose(self, body: str) -> Pose:
        """Return the true pose of a body now, in the world.

        Raises:
            InputError: there is no such body.
        """
        names = [self.model.body(i).name for i in range(self.model.nbody)]
        if body not in names:
            raise unknown_name("body", body, [n for n in names if not n.startswith(PREFIX)])
        frame = self.data().body(body)
        return Pose(frame.xpos.copy(), frame.xquat.copy())

    def true_poses(self, bodies: Iterable[str]) -> dict[str, Pose]:
        """Return the true poses now, in the world, of those of the `bodies` that there are."""
        names, data = {self.model.body(i).name for i in range(self.model.nbody)}, self.data()
        found = {name: data.body(name) for name in bodies if name in names}
        return {name: Pose(body.xpos.copy(), body.xquat.copy()) for name, body in found.items()}

    def weights(self) -> dict[str, float]:
        """Return the weights of the bodies, N, each with what is fixed to it."""
        model, gravity = self.model, float(np.linalg.norm(self.model.opt.gravity))
        return {
            model.body(i).name: gravity * float(model.body_subtreemass[i])
            for i in range(model.nbody)
        }

    def true_tcp(self) -> Pose:
        """Return the true pose of the TCP now, in the world."""
        data = self._seen
        data.qpos[:] = self._data.qpos
        mujoco.mj_kinematics(self.model, data)
        return Pose(data.site_xpos[self._tcp].copy(), data.xquat[self._hand].copy())

    def _film(self, qpos: Array) -> None:
        """Keep the configurations (at ends of log periods) that are nearest to the camera's frames."""
        while (row := round((len(self.frames) * FRAME_PERIOD - self.t) / PERIOD) - 1) < len(qpos):
            self.frames.append((self.t + (row + 1) * PERIOD, qpos[row].copy()))


def compile_world(
    spec: mujoco.MjSpec,
    pose_world_base: Pose,
    arm: RobotDescription,
    truth: TrueArm,
    substeps: int,
) -> mujoco.MjModel:
    """Compile the world with the true robot in it, with `substeps` physics steps in a control cycle.

    Raises:
        InputError: it does not compile, or lacks physics that weighing and touching need.
    """
    require_physics(spec)
    robot = arm.spec()
    for pair in sorted(map(sorted, neighbours(robot, arm))):
        robot.add_exclude(bodyname1=pair[0], bodyname2=pair[1])
    add_drive(robot, arm.hand)
    truth.build(robot, arm)
    round_fingers(robot, arm.hand)
    spec.option.timestep = TIMESTEP / substeps
    spec.option.enableflags |= int(mujoco.mjtEnableBit.mjENBL_SLEEP)
    spec.option.sleep_tolerance = ASLEEP
    spec.option.gravity = truth.gravity(spec.option.gravity)
    for name in ("integrator", "cone", "impratio", "solver"):
        setattr(spec.option, name, getattr(robot.option, name))
    # The solver is at least as accurate as the arm needs it: accuracy is no physics of the scene.
    for name in ("iterations", "ls_iterations", "ccd_iterations"):
        setattr(spec.option, name, max(getattr(spec.option, name), getattr(robot.option, name)))
    for name in ("tolerance", "ls_tolerance"):
        setattr(spec.option, name, min(getattr(spec.option, name), getattr(robot.option, name)))
    spec.option.ccd_tolerance = min(spec.option.ccd_tolerance, CCD_TOLERANCE)
    robot.option.gravity, robot.option.timestep = spec.option.gravity, spec.option.timestep
    for key in list(spec.keys):  # states of a world without this robot
        spec.delete(key)
    try:
        base = truth.base(pose_world_base)
        frame = spec.worldbody.add_frame(pos=base.position, quat=base.quaternion)
        spec.attach(robot, frame=frame, prefix=PREFIX)
        add_actuators(spec, arm)
        add_sensors(spec, arm)
        let_touch(spec)
        keep_softness(spec, arm)
        # `settotalmass` is of the scene's bodies: with the robot among them it would scale both.
        total, spec.compiler.settotalmass = spec.compiler.settotalmass, -1.0
        model = spec.compile()
        if total > 0.0:
            scale_scene(model, total)
        return model
    except ValueError as error:
        raise InputError(
            f"the simulated world does not compile with the robot in it: {error}"
        ) from error


def scale_scene(model: mujoco.MjModel, total: float) -> None:
    """Scale mass and inertia of all bodies but the robot's to a sum of `total`, kg, as MuJoCo's
    `mj_setTotalmass` does for all bodies."""
    scene = [i for i in range(1, model.nbody) if not model.body(i).name.startswith(PREFIX)]
    scale = total / model.body_mass[scene].sum()
    model.body_mass[scene] *= scale
    model.body_inertia[scene] *= scale
    mujoco.mj_setConst(model, mujoco.MjData(model))


def add_sensors(world: mujoco.MjSpec, arm: RobotDescription) -> None:
    """Add what is recorded of every cycle: torques of the joints' motors, the net force of the hand on what
    it touches, and whether anything touches."""
    for i, name in enumerate(arm.joints, 1):
        world.add_sensor(
            name=MOTOR.format(i),
            type=mujoco.mjtSensor.mjSENS_JOINTACTFRC,
            objtype=mujoco.mjtObj.mjOBJ_JOINT,
            objname=PREFIX + name,
        )
    world.add_sensor(
        name=PUSH,
        type=mujoco.mjtSensor.mjSENS_CONTACT,
        objtype=mujoco.mjtObj.mjOBJ_XBODY,
        objname=PREFIX + arm.hand.body,
        intprm=(1 << int(mujoco.mjtConDataField.mjCONDATA_FORCE), NET_FORCE, 1),
    )
    world.add_sensor(
        name=TOUCHING,
        type=mujoco.mjtSensor.mjSENS_CONTACT,
        intprm=(1 << int(mujoco.mjtConDataField.mjCONDATA_FOUND), 0, 1),
    )


def require_physics(spec: mujoco.MjSpec) -> None:
    """Require gravity that points down, and the features of MuJoCo that a robot needs."""
    x, y, z = spec.option.gravity
    if z >= 0 or max(abs(x), abs(y)) > -LEVEL * z:
        raise InputError(
            f"the world's gravity is ({x:g}, {y:g}, {z:g}) m/s²; it must point down, as in "
            '<option gravity="0 0 -9.81"/>: released objects have to fall, and weighing needs a weight'
        )
    bits = {name: int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{name.upper()}")) for name in NEEDED}
    disabled = [name for name, bit in bits.items() if spec.option.disableflags & bit]
    if disabled:
        raise InputError(
            f"the world's <option><flag> disables {', '.join(disabled)}, without which nothing can be "
            "grasped and weighed; leave it enabled"
        )


def run_of(first: int, count: int) -> slice:
    """Return the slice of `count` indices from `first`."""
    return slice(int(first), int(first) + count)
