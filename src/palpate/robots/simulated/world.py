"""The hidden world: the physics of the scene with the true robot in it.

Nothing here passes through the robot's protocol. The controller sends set-points and receives joint
signals. Truth and pictures serve outside observers, after the estimates are made.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple, cast

import mujoco
import numpy as np
from mujoco.rollout import Rollout

from palpate.common.errors import ExecutionAborted, InputError
from palpate.common.pose import Array, Pose
from palpate.mjcf.contacts import CCD_TOLERANCE
from palpate.robots.description import PREFIX, SENSOR, RobotDescription, neighbours, require_physics
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
    Undoing,
    Watch,
    takes_many,
)

FRAME_PERIOD = 1.0 / 30.0  # s between camera frames
# m/s: objects slower than this sleep, and cost no computing time until a moving object touches
# them. A cylinder on its end trembles at about 5e-5 m/s for ever, by the rounding of its contacts.
ASLEEP = 1e-4
PHYSICS = mujoco.mjtState.mjSTATE_FULLPHYSICS
MOTOR, PUSH, TOUCHING = PREFIX + "motor{}", PREFIX + "push", PREFIX + "touching"  # names of sensors
# Values of the hand's force, and of a six-axis sensor, which follow the motors' torques.
HAND_FORCE, WRENCH = 3, 6
RUNAWAY = 100.0  # m/s, sideways or upwards: nothing on a table is as fast
NET_FORCE = 3  # MuJoCo's reduction of several contacts to their net force


class Steps(NamedTuple):
    """Record of the robot over some blocks of control cycles."""

    q: Array  # (n, 7) rad at the end of each block
    dq: Array  # (n, 7) rad/s at the end of each block
    torque: Array  # (n, 7) N m, mean commanded joint torques, at the beginning of each physics step
    push: Array  # (n, 3) N, mean force of the hand on the objects it touches, world axes
    # (n, 6) N and N m, mean wrench of the flange on the hand, in the sensor's axes; (n, 0) without one
    wrench: Array
    fingers: Array  # (n, 2) m at the end of each block
    finger_speed: Array  # (n, 2) m/s at the end of each block
    step: float  # s, a step of the physics


class World:
    """Physics of one run. `model`, `data` and `frames` serve pictures; `true_*` serve the report."""

    def __init__(
        self,
        spec: mujoco.MjSpec,
        pose_world_base: Pose,
        arm: RobotDescription,
        truth: TrueArm,
        substeps: int = SUBSTEPS,
        q: Array | None = None,
    ) -> None:
        """Put the true arm into `spec`, which is changed, with its base at `pose_world_base` and its joints at `q`
        (7,), rad; home by default.

        A control cycle has `substeps` physics steps while anything touches, or moves apart from the arm; otherwise
        one.
        """
        self._arm, self._finest, self._substeps = arm, substeps, substeps
        # The compiled world, robot included (its names start with `robot/`).
        self.model = compile_world(spec, pose_world_base, arm, truth, substeps)
        self._data = mujoco.MjData(self.model)
        # Addresses of the robot's joints, fingers and frames in the model's arrays.
        joints = [self.model.joint(PREFIX + name) for name in arm.joints]
        n = self._joints = len(joints)
        self._q, self._v = run_of(joints[0].qposadr[0], n), run_of(joints[0].dofadr[0], n)
        finger = self.model.joint(PREFIX + arm.hand.fingers[0])
        self._finger_q, self._finger_v = run_of(finger.qposadr[0], 2), run_of(finger.dofadr[0], 2)
        self._tcp = int(self.model.site(PREFIX + arm.tcp).id)
        self._hand = int(self.model.body(PREFIX + arm.hand.body).id)
        self._drive = int(self.model.actuator(PREFIX + DRIVE).id)
        self._fingers_control = int(self.model.actuator_ctrladr[self._drive])
        # The run begins at rest, with the fingers open.
        self._data.qpos[self._q], self._data.qpos[self._finger_q] = (
            arm.home if q is None else q,
            arm.hand.opening / 2,
        )
        self._seen, self._before = mujoco.MjData(self.model), mujoco.MjData(self.model)
        self._dq = self._data.qvel[self._v]
        # Free bodies, and the addresses (n, 3) of their velocities.
        is_free = self.model.jnt_type == mujoco.mjtJoint.mjJNT_FREE
        self._free_bodies: list[int] = self.model.jnt_bodyid[is_free].tolist()
        self._free = self.model.jnt_dofadr[is_free][:, None] + np.arange(3)
        # Buffers for the longest run: the state and the sensors after each physics step.
        count = n + HAND_FORCE + WRENCH * (arm.wrench_sensor is not None)
        self._sensors = run_of(self.model.sensor(MOTOR.format(1)).adr[0], count)
        self._touching = int(self.model.sensor(TOUCHING).adr[0])
        self._rollout = Rollout(nthread=0)
        steps = LONGEST_RUN * BLOCK * substeps
        self._states = np.empty((1, steps, mujoco.mj_stateSize(self.model, PHYSICS)))
        self._signals = np.empty((1, steps, self.model.nsensordata))
        self._at, self._warm = np.empty_like(self._states[:, 0]), np.empty((1, self.model.nv))
        self.actuators = Actuators(self.model, n)  # actuators of the controller
        # (nu,) initial value of each row of controls, for actuators without a command.
        self.rest_control = np.zeros(self.model.nu)
        self.rest_control[self.actuators.orientation.start] = 1.0
        self._stiction = declared_stiction(self.model)
        # (t, qpos) every 1/30 s, as a 30 Hz camera sees it.
        self.frames: list[tuple[float, Array]] = [(0.0, self._data.qpos.copy())]
        self.t = 0.0  # s, time of the world
        # Observer that is called with the data after every physics step, if set.
        self.watch: Watch | None = None

    def step(self, control: Array, guard: Guard) -> Steps:
        """Step one control cycle per row of `control` (n * BLOCK, nu).

        A contact reflex of the guard ends the run early: the arm yields for the rest of that block. A change of
        the force that the guard notices ends the run with the tick in which it occurs.
        Raises ExecutionAborted: the physics became unstable.
        """
        count = len(control)
        # One physics step a cycle suffices while the arm moves alone.
        if self._is_free() and not guard.yielding:
            self._pace(1)
        if guard.yielding:
            self._cycle(control, 0, count, guard.reaction)
        else:
            # Find the cycle in which the guard fires; the arm yields to the end of that block.
            look = self._all_at_once if takes_many(self.watch) else self._one_by_one
            fired = look(control, guard)
            if fired is None:
                count = min(count, guard.felt or count)
            else:
                self.actuators.set(guard.reaction.gains)
                count = (fired // BLOCK + 1) * BLOCK
                self._cycle(control, fired + 1, count, guard.reaction)
        # Read the state at the end of each block.
        blocks = self._states[0, self._ends(count, BLOCK), 1:].copy()
        qvel = blocks[:, self.model.nq :]
        self._film(blocks[:, : self.model.nq])
        self.t = round(self.t + count * TIMESTEP, 9)
        if abs(self._data.time - self.t) > TIMESTEP / 2:  # MuJoCo starts over when it diverges
            raise ExecutionAborted(
                f"the simulated world became unstable before {self.t:.2f} s of robot time: "
                "check its masses, sizes and contact parameters"
            )
        self._require_stable_bodies()
        # The motors' torques and the hand's force are means over each block.
        means, sensed = self._means(0, count, BLOCK), self._joints + HAND_FORCE
        steps = Steps(
            q=blocks[:, self._q],
            dq=qvel[:, self._v],
            torque=means[:, : self._joints],
            push=means[:, self._joints : sensed],
            wrench=means[:, sensed:],
            fingers=blocks[:, self._finger_q],
            finger_speed=qvel[:, self._finger_v],
            step=TIMESTEP / self._substeps,
        )
        self._pace(self._finest)
        return steps

    def _is_free(self) -> bool:
        """Test if only the arm moves and nothing touches: one physics step a cycle then suffices."""
        return takes_many(self.watch) and self._data.ncon == 0 and self.is_settled

    @property
    def is_settled(self) -> bool:
        """Test if no body but the arm moves, until something touches one."""
        return self._data.ntree_awake <= 1

    def _pace(self, substeps: int) -> None:
        """Set the number of physics steps in a control cycle."""
        self._substeps, self.model.opt.timestep = substeps, TIMESTEP / substeps

    def _ends(self, count: int, every: int = 1) -> slice:
        """Return the rows of the physics steps that end each group of `every` cycles among `count` cycles."""
        length = every * self._substeps
        return slice(length - 1, count * self._substeps, length)

    def _means(self, first: int, last: int, every: int = 1) -> Array:
        """Compute means (n, k) of the k sensor values over groups of `every` cycles, from cycle `first` to `last`."""
        rows = slice(first * self._substeps, last * self._substeps)
        each = every * self._substeps
        sensed = self._signals[0, rows, self._sensors]
        sensed = sensed.reshape(-1, each, sensed.shape[1])
        return np.add.reduce(sensed, axis=1) / each

    def _all_at_once(self, control: Array, guard: Guard) -> int | None:
        """Step all cycles before the guard observes them, which is faster than one by one.

        Return the cycle in which the guard fires; None if it does not. Cycles after it are undone, as are
        cycles after a change of the force that the guard notices.
        """
        mujoco.mj_copyData(self._before, self.model, self._data)
        before, count = self.compensation, len(control)
        # The watch sees single steps; of a run in which nothing touches only the configurations, at its end.
        watch = self.watch if isinstance(self.watch, Undoing) else None
        undo = None if watch is None else watch.mark()
        free = self._substeps < self._finest
        self._roll(control, watched=not free)
        if free and self._is_touching(count):  # repeat with finer steps
            mujoco.mj_copyData(self._data, self.model, self._before)
            self._pace(self._finest)
            free = False
            self._roll(control, watched=True)
        # The motors hold the nominal arm's weight, which is interpolated over the run.
        share = np.arange(1.0, count + 1)[:, None] / count
        weight = before + share * (self.compensation - before)
        # The guard tests the effort (motor torque less weight) of every cycle.
        rates = self._states[0, self._ends(count), 1 + self.model.nq :][:, self._v].copy()
        fired = guard.observe(
            self._means(0, count)[:, : self._joints] - weight, rates, TIMESTEP / self._substeps
        )
        # Undo the cycles after the end of the run: restore the state, and repeat the cycles before.
        last = (guard.felt or count) if fired is None else fired + 1
        if last < count:
            mujoco.mj_copyData(self._data, self.model, self._before)
            if undo is not None:
                undo()
            self._roll(control[:last], watched=not free)
        if free and watch is not None:
            watch.pass_untouched(self._states[0, : last * self._substeps, 1 : 1 + self.model.nq])
        return fired

    def _is_touching(self, count: int) -> bool:
        """Test if any contact existed in `count` cycles."""
        return bool(self._signals[0, : count * self._substeps, self._touching].any())

    def _one_by_one(self, control: Array, guard: Guard) -> int | None:
        """Step like `_all_at_once`, for a `watch` that cannot undo its steps."""
        for i in range(len(control)):
            # The guard tests each cycle before the next one begins.
            self._cycle(control, i, i + 1)
            effort = self._means(i, i + 1)[:, : self._joints] - self.compensation
            step = TIMESTEP / self._substeps
            if guard.observe(effort, self._dq[None].copy(), step) is not None:
                return i
            if guard.felt is not None and guard.felt <= i + 1:
                break
        return None

    def _roll(self, control: Array, watched: bool) -> None:
        """Step all cycles in one call, block by block where friction changes; `watched` one by one for the watch."""
        if watched and self.watch is not None:
            self._cycle(control, 0, len(control))
            return
        model, data = self.model, self._data
        # A rollout takes one row of controls per physics step.
        control = np.repeat(control, self._substeps, axis=0)[None]
        count = control.shape[1]
        length = BLOCK * self._substeps if self._stiction else count
        for first in range(0, count, length):
            # Static friction depends on the slip at the beginning of each block.
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
        model, data, watch, substeps = self.model, self._data, self.watch, self._substeps
        states, signals = self._states[0], self._signals[0]
        for i in range(first, last):
            if i % BLOCK == 0:
                for stiction in self._stiction:
                    stiction.apply(model, data)
            data.ctrl[:] = control[i]
            if reaction is not None:
                data.ctrl[self.actuators.drives] = reaction.torque(self._dq)
            for row in range(i * substeps, (i + 1) * substeps):
                mujoco.mj_step(model, data)
                mujoco.mj_getState(model, data, states[row], PHYSICS)
                signals[row] = data.sensordata
                if watch is not None:
                    watch(data)

    def set_fingers(self, control: Array, opening: Array | float) -> None:
        """Command each finger's distance from the middle, m, in the rows of `control`."""
        control[:, self._fingers_control] = opening

    def limit_fingers(self, force: float) -> None:
        """Limit the force of the fingers' drive, N."""
        self.model.actuator_forcerange[self._drive] = (-force, force)

    def true_gravity_torque(self) -> Array:
        """Compute the torques (7,), N m, that hold the true arm up now, at rest."""
        return self.data().qfrc_bias[self._v].copy()

    def _require_stable_bodies(self) -> None:
        """Require plausible speeds of free bodies. Raises ExecutionAborted: one is too fast; the message names it."""
        # An object that falls from the table may be fast downwards, and nothing else is so fast.
        speeds = self._data.qvel[self._free]
        speeds[:, 2] = speeds[:, 2].clip(min=0.0)
        sizes = np.linalg.norm(speeds, axis=1)
        if sizes.max(initial=0.0) > RUNAWAY:
            body = self.model.body(self._free_bodies[int(sizes.argmax())]).name
            raise ExecutionAborted(
                f"the simulated world became unstable at {self.t:.2f} s of robot time: '{body}' is faster than "
                f"{RUNAWAY:g} m/s; check masses, sizes, overlaps and contact parameters"
            )

    def true_hand_weight(self) -> Array:
        """Compute the wrench (6,) of a six-axis sensor now, at rest and with an empty hand, in its axes."""
        model, data = self.model, self.data()
        site, hand = data.site(PREFIX + SENSOR), cast("Any", data.body(self._hand))
        weight: Array = -float(model.body_subtreemass[self._hand]) * model.opt.gravity
        lever: Array = np.asarray(hand.subtree_com, dtype=np.float64) - site.xpos
        moment: Array = np.cross(lever, weight)
        into = site.xmat.reshape(3, 3).T
        return np.concatenate([into @ weight, into @ moment])

    @property
    def qpos(self) -> Array:
        """Configuration (nq,) now."""
        return self._data.qpos.copy()

    @property
    def compensation(self) -> Array:
        """Torques (7,), N m, with which MuJoCo holds the nominal arm up now."""
        data = self._data if self.t else self.data()
        return data.qfrc_gravcomp[self._v].copy()

    def data(self, qpos: Array | None = None) -> mujoco.MjData:
        """Return the world now, or at `qpos` (one of `frames`), forwarded. Reused by the next call."""
        self._seen.qpos[:] = self._data.qpos if qpos is None else qpos
        mujoco.mj_forward(self.model, self._seen)
        return self._seen

    def deepest_overlap(self) -> tuple[str, float]:
        """Return the body that overlaps the arm most now, and the depth, m; "" and 0 without one.

        The first link turns in its place, and a table around the base may reach into it.
        """
        model, contacts, found = self.model, self.data().contact, [(0.0, "")]
        still = {PREFIX + name for name in self._arm.links[:2]}
        pairs = zip(contacts.geom.tolist(), contacts.dist.tolist(), strict=True)
        for pair, distance in pairs:
            names = {model.body(model.geom_bodyid[geom]).name for geom in pair}
            arm = {name for name in names if name.startswith(PREFIX)}
            if len(arm) == 1 and not arm & still:
                found.append((-distance, (names - arm).pop()))
        depth, name = max(found)
        return name, depth

    def true_poses(self, bodies: Iterable[str]) -> dict[str, Pose]:
        """Return the true poses now, in the world, of the `bodies` that exist; omit other names."""
        names, data = {self.model.body(i).name for i in range(self.model.nbody)}, self.data()
        found = {name: data.body(name) for name in bodies if name in names}
        return {name: Pose(body.xpos.copy(), body.xquat.copy()) for name, body in found.items()}

    def weights(self) -> dict[str, float]:
        """Return the weights of the bodies, N, each with all bodies fixed to it."""
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
        """Keep the configurations, at ends of log periods, that are nearest to the camera's frames."""
        while (row := round((len(self.frames) * FRAME_PERIOD - self.t) / PERIOD) - 1) < len(qpos):
            self.frames.append((self.t + (row + 1) * PERIOD, qpos[row].copy()))


def compile_world(
    spec: mujoco.MjSpec, pose_world_base: Pose, arm: RobotDescription, truth: TrueArm, substeps: int
) -> mujoco.MjModel:
    """Compile the world with the true robot in it, with `substeps` physics steps in a control cycle.

    Raises InputError: it does not compile, or lacks physics that weighing and touching need.
    """
    # Build the true robot: exclude contact of neighbouring links, add the hand's drive, round the fingers.
    require_physics(spec.option)
    robot = arm.spec()
    for pair in sorted(map(sorted, neighbours(robot, arm))):
        robot.add_exclude(bodyname1=pair[0], bodyname2=pair[1])
    add_drive(robot, arm.hand)
    truth.build(robot, arm)
    round_fingers(robot, arm.hand)
    # Set the time step, and let resting objects sleep.
    spec.option.timestep = TIMESTEP / substeps
    spec.option.enableflags |= int(mujoco.mjtEnableBit.mjENBL_SLEEP)
    spec.option.sleep_tolerance = ASLEEP
    spec.option.gravity = truth.gravity(spec.option.gravity)
    for name in ("integrator", "cone", "impratio", "solver"):
        setattr(spec.option, name, getattr(robot.option, name))
    # The solver is at least as accurate as the arm needs: accuracy is no physics of the scene.
    for name in ("iterations", "ls_iterations", "ccd_iterations"):
        setattr(spec.option, name, max(getattr(spec.option, name), getattr(robot.option, name)))
    for name in ("tolerance", "ls_tolerance"):
        setattr(spec.option, name, min(getattr(spec.option, name), getattr(robot.option, name)))
    spec.option.ccd_tolerance = min(spec.option.ccd_tolerance, CCD_TOLERANCE)
    robot.option.gravity, robot.option.timestep = spec.option.gravity, spec.option.timestep
    for key in list(spec.keys):  # keyframes hold states of a world without this robot
        spec.delete(key)
    # Attach the robot at its true base, with actuators, sensors and contact parameters.
    try:
        base = truth.base(pose_world_base)
        frame = spec.worldbody.add_frame(pos=base.position, quat=base.quaternion)
        spec.attach(robot, frame=frame, prefix=PREFIX)
        add_actuators(spec, arm)
        add_sensors(spec, arm)
        let_touch(spec)
        keep_softness(spec, arm)
        # `settotalmass` concerns the scene's bodies: with the robot among them it would scale both.
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
    """Scale mass and inertia of all bodies except the robot's to a total of `total`, kg.

    MuJoCo's `mj_setTotalmass` does the same for all bodies.
    """
    scene = [i for i in range(1, model.nbody) if not model.body(i).name.startswith(PREFIX)]
    scale = total / model.body_mass[scene].sum()
    model.body_mass[scene] *= scale
    model.body_inertia[scene] *= scale
    mujoco.mj_setConst(model, mujoco.MjData(model))


def add_sensors(world: mujoco.MjSpec, arm: RobotDescription) -> None:
    """Add sensors that are recorded in every cycle: the torques of the joints' motors, the net force of the hand
    on the objects it touches, and a flag that any contact exists.
    """
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
    # What the flange exerts on everything below a six-axis sensor.
    for kind in ("FORCE", "TORQUE") if arm.wrench_sensor is not None else ():
        world.add_sensor(
            name=PREFIX + kind.lower(),
            type=getattr(mujoco.mjtSensor, f"mjSENS_{kind}"),
            objtype=mujoco.mjtObj.mjOBJ_SITE,
            objname=PREFIX + SENSOR,
        )
    world.add_sensor(
        name=TOUCHING,
        type=mujoco.mjtSensor.mjSENS_CONTACT,
        intprm=(1 << int(mujoco.mjtConDataField.mjCONDATA_FOUND), 0, 1),
    )


def run_of(first: int, count: int) -> slice:
    """Return the slice of `count` indices from `first`."""
    return slice(int(first), int(first) + count)
