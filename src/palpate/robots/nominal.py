"""The nominal arm: the manufacturer's kinematics and inertias, for the controller and for wrenches."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import mujoco
import numpy as np

from palpate.common.pose import CONJUGATE, Array, Pose
from palpate.robots.description import RobotDescription
from palpate.robots.trajectory import rotation_vector

# m^2: regularisation added to J J^T, far below its smallest eigenvalue in the workspace. A singular
# pose stays finite.
RIDGE = 1e-9 * np.eye(6)
# Parameters of `NominalArm.reach`: most iterations; share of the distance to the posture per step;
# damping, m^2; largest step of a converged search, rad.
SEARCH_STEPS, SEARCH_RATE, SEARCH_DAMPING, SEARCH_DONE = 60, 0.3, 1e-4, 1e-3
SEARCH_TURN = 0.2  # rad: largest turn of a joint in one iteration
PLACES = 8  # Number of arms, each at its place, whose models are kept
# Cosine of the angle between tool axes below which the tool swings far: a level hand, not a tilted
# one.
SWUNG = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class Kinematics:
    """Kinematics of the nominal arm in n configurations."""

    pose_world_tcp: Array  # (n, 7)
    jacobian: Array  # (n, 6, 7), world axes about the TCP
    gravity_torque: Array  # (n, 7), N m, that holds the arm up
    inertia_torque: Array  # (n, 7), N m, M ddq + C dq, without the motors' own inertia


def wrench(jacobian: Array, torque: Array) -> Array:
    """Compute the wrench (6,) at the TCP of joint torques (7,): (J^T)^+ tau = (J J^T)^-1 J tau. `jacobian` is
    (6, 7).
    """
    from scipy.linalg.lapack import dposv

    return dposv(jacobian @ jacobian.T + RIDGE, jacobian @ torque)[1]


def wrenches(jacobian: Array, torque: Array) -> Array:
    """Compute `wrench` (n, 6, k) for n Jacobians (n, 6, 7) and k torques each (n, 7, k)."""
    from scipy.linalg.lapack import dposv

    # Solve (J J^T + R) w = J tau for each row.
    square = np.matmul(jacobian, jacobian.transpose(0, 2, 1))
    square += RIDGE
    right, out = np.matmul(jacobian, torque), np.empty((len(torque), 6, torque.shape[2]))
    # LAPACK without the checks of numpy.linalg, which cost more than the solution.
    for i in range(len(out)):
        out[i] = dposv(square[i], right[i])[1]
    return out


def explain_torque(
    jacobian: Array, torque: Array, to_force: Array | None = None
) -> tuple[float, float]:
    """Split external joint torques (7,), N m, by the force at the TCP that explains most of them.

    The force is f = (J_v^T)^+ tau, with the upper rows J_v of `jacobian` (6, 7), world axes. Return the norm
    of the remainder tau - J_v^T f, N m, and the norm of f, N. A force on a link leaves a large remainder: it
    turns no joint beyond that link. `to_force` (3, 7) is `force_of(jacobian)`, where it is known.
    """
    force = (force_of(jacobian) if to_force is None else to_force) @ torque
    left = torque - jacobian[:3].T @ force
    return math.sqrt(left @ left), math.sqrt(force @ force)


def force_of(jacobian: Array) -> Array:
    """Compute the matrix (3, 7) from joint torques to the force at the TCP that explains most of them.

    It is (J_v J_v^T)^-1 J_v, with the translational rows J_v (3, 7) of the Jacobian.
    """
    from scipy.linalg.lapack import dposv

    moving = jacobian[:3]
    return dposv(moving @ moving.T + RIDGE[:3, :3], moving)[1]


@lru_cache(PLACES)
def _bare(arm: RobotDescription, *numbers: float) -> mujoco.MjModel:
    """Compile an arm without shapes; `numbers` are the position and quaternion of its base, and gravity."""
    place, gravity = np.array(numbers[:7]), np.array(numbers[7:])
    spec = arm.spec(gravity)
    base = spec.body(arm.base)
    base.pos, base.quat = place[:3], place[3:]
    for geom in list(spec.geoms):
        spec.delete(geom)
    return spec.compile()


class NominalArm:
    """The nominal arm alone, at its place in the world, fingers half open."""

    def __init__(self, arm: RobotDescription, pose_world_base: Pose, gravity: Array) -> None:
        self._pose_world_base = pose_world_base
        self._model = _bare(arm, *pose_world_base.vector.tolist(), *gravity.tolist())
        self._data = mujoco.MjData(self._model)
        self._tcp = self._model.site(arm.tcp).id
        self._elbow = int(self._model.jnt_bodyid[self._model.joint(arm.joints[3]).id])
        self._joints = n = len(arm.joints)
        self._q, self._dq = self._data.qpos[:n], self._data.qvel[:n]
        self._ddq, self._cvel = self._data.qacc[:n], self._data.cvel
        self._position = self._data.site_xpos[self._tcp]
        self._quaternion = self._data.xquat[self._model.body(arm.hand.body).id]
        self._data.qpos[n:] = arm.hand.opening / 4

    def kinematics(self, q: Array, dq: Array | None = None, ddq: Array | None = None) -> Kinematics:
        """Compute the kinematics at `q` (n, 7), rad; at rest, or moving at `dq` and `ddq` (n, 7)."""
        n, model, data = len(q), self._model, self._data
        pose, jacobian = np.empty((n, 7)), np.empty((n, 6, model.nv))
        gravity, inertia = np.empty((n, model.nv)), np.zeros((n, model.nv))
        for i in range(n):
            # Kinematics, Jacobian and gravity torque at rest.
            self._q[:], self._dq[:], self._cvel[:] = q[i], 0.0, 0.0
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            mujoco.mj_jacSite(model, data, jacobian[i, :3], jacobian[i, 3:], self._tcp)
            mujoco.mj_rne(model, data, 0, gravity[i])
            pose[i, :3], pose[i, 3:] = self._position, self._quaternion
            # Inertia torque M ddq + C dq: the recursive Newton-Euler torque less gravity's.
            if dq is not None and ddq is not None:
                self._dq[:], self._ddq[:] = dq[i], ddq[i]
                mujoco.mj_comVel(model, data)
                mujoco.mj_rne(model, data, 1, inertia[i])
                inertia[i] -= gravity[i]
        joints = slice(self._joints)
        return Kinematics(pose, jacobian[:, :, joints], gravity[:, joints], inertia[:, joints])

    def poses(self, q: Array) -> Array:
        """Compute the TCP's poses (n, 7) at configurations `q` (n, 7), rad."""
        out = np.empty((len(q), 7))
        for i in range(len(q)):
            self._q[:] = q[i]
            mujoco.mj_kinematics(self._model, self._data)
            out[i, :3], out[i, 3:] = self._position, self._quaternion
        return out

    def stances(self, q: Array) -> tuple[Array, Array]:
        """Compute the TCP's poses (n, 7) and Jacobians (n, 6, 7) at configurations `q` (n, 7), rad."""
        pose, jacobian = np.empty((len(q), 7)), np.empty((len(q), 6, self._joints))
        for i in range(len(q)):
            jacobian[i] = self.jacobian(q[i])
            pose[i, :3], pose[i, 3:] = self._position, self._quaternion
        return pose, jacobian

    def offsets(self, q: Array) -> Array:
        """Compute the sensitivity (n, 3, 3 m) of the TCP position to position errors of the links, at `q` (n,
        7), rad.

        A column is the motion of the TCP, world axes, per m of position error of a link. The error is
        along one axis of the link's parent. There are three columns a link.
        """
        n = self._joints
        out = np.empty((len(q), 3, n, 3))
        bodies = self._model.jnt_bodyid[:n]
        for i in range(len(q)):
            self._q[:] = q[i]
            mujoco.mj_kinematics(self._model, self._data)
            # A shift of a link moves the TCP by the same vector: the parent's axes in the world.
            turns = self._data.xmat[self._model.body_parentid[bodies]].reshape(n, 3, 3)
            out[i] = turns.transpose(1, 0, 2)
        return out.reshape(len(q), 3, 3 * n)

    def reach(self, goal: Pose, posture: Array) -> Array:
        """Compute the configuration (7,) with the TCP at `goal` and the null space at rest near `posture`.

        The posture is first turned about the base towards the goal and, for a level hand, about the
        tool. The result depends on these arguments alone, so that the arm returns to a pose with the
        same elbow: the bias of a wrench belongs to a configuration, not to a pose. For a pose out of
        reach it is the nearest configuration of the search.

        `kinematics.inverse_kinematics`, which decides if a pose is reachable, is another search (mink's, with
        joint limits). Here it would bend the elbow by up to 0.14 rad more, and every force would have another
        bias. Friction of the bundled scenario would read 0.3460 instead of 0.3456 (std 0.011).
        """
        # Start from the posture, turned towards the goal.
        ahead = self._pose_world_base.local(goal.position)
        posture = self._level_tool(
            posture + np.arctan2(ahead[1], ahead[0]) * np.eye(self._joints)[0], goal
        )
        q, damping = posture, SEARCH_DAMPING * np.eye(6)
        error, scaled = np.empty((2, 6))
        for _ in range(SEARCH_STEPS):
            # Error of the pose: position, and rotation vector in world axes.
            jacobian = self.jacobian(q)
            error[:3] = goal.position - self._position
            turn = rotation_vector(self._quaternion, goal.quaternion)
            mujoco.mju_rotVecQuat(error[3:], turn, self._quaternion)
            # Pull of the null space towards the posture.
            away = SEARCH_RATE * (posture - q)
            # Damped least squares, J^T (J J^T + λ I)^-1, plus the motion to the posture.
            square = jacobian @ jacobian.T + damping
            mujoco.mju_cholFactor(square, 0.0)
            mujoco.mju_cholSolve(scaled, square, error - jacobian @ away)
            step = jacobian.T @ scaled + away
            # Limit the step of any joint; stop when it is small.
            turns: list[float] = step.tolist()
            largest = max(map(abs, turns))
            q = q + (step if largest < SEARCH_TURN else step.clip(-SEARCH_TURN, SEARCH_TURN))
            if largest < SEARCH_DONE:
                break
        return q

    def _level_tool(self, posture: Array, goal: Pose) -> Array:
        """Turn the wrist's joints as the tool swings and twists on its way to a level `goal`.

        A search that starts elsewhere may fold the wrist.
        """
        # Relative rotation from the present to the goal orientation.
        axes = self.jacobian(posture)[3:]
        relative, inverse = np.empty(4), self._quaternion * CONJUGATE
        mujoco.mju_mulQuat(relative, inverse, goal.quaternion)
        w, x, y, z = relative
        # Swing-twist decomposition about the tool axis: cosine of the swing, then the twist.
        swung = 1.0 - 2.0 * (x**2 + y**2)
        if swung > SWUNG:
            return posture
        now = np.empty(3)
        mujoco.mju_rotVecQuat(now, np.eye(3)[2], self._quaternion)
        twist = (2.0 * np.arctan2(z, w) + np.pi) % (2.0 * np.pi) - np.pi
        # The swing is about the axis before the last one that is nearest to it; signs follow the axes.
        along = np.cross(now, goal.rotation[:, 2]) @ axes
        swinging = self._joints - 3 + int(np.abs(along[-3:-1]).argmax())
        turned = posture.copy()
        turned[swinging] += np.arccos(max(swung, -1.0)) * np.sign(along[swinging])
        turned[-1] += twist * np.sign(now @ axes[:, -1])
        return turned

    def dynamics(self, q: Array, dq: Array) -> tuple[Array, Array]:
        """Compute the mass matrix (7, 7), kg m^2, and Coriolis and centrifugal torques (7,), N m."""
        model, data = self._model, self._data
        mass_matrix, gravity, bias = self.mass_matrix(q), np.empty(model.nv), np.empty(model.nv)
        # Newton-Euler torques at rest are gravity; the difference at speed is Coriolis and centrifugal.
        self._dq[:], self._cvel[:] = 0.0, 0.0
        mujoco.mj_rne(model, data, 0, gravity)
        self._dq[:] = dq
        mujoco.mj_comVel(model, data)
        mujoco.mj_rne(model, data, 0, bias)
        return mass_matrix, (bias - gravity)[: self._joints]

    def mass_matrix(self, q: Array) -> Array:
        """Compute the joint-space inertia (7, 7), kg m^2, including the motors' reflected inertia."""
        model, data = self._model, self._data
        self._q[:] = q
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_crb(model, data)
        full = np.empty((model.nv, model.nv))
        mujoco.mj_fullM(model, data, full)
        return full[: self._joints, : self._joints]

    def jacobian(self, q: Array) -> Array:
        """Compute the Jacobian (6, 7) of the TCP, world axes."""
        model, data, out = self._model, self._data, np.empty((6, self._model.nv))
        self._q[:] = q
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_jacSite(model, data, out[:3], out[3:], self._tcp)
        return out[:, : self._joints]

    def elbow_jacobian(self) -> Array:
        """Compute the Jacobian (3, 7) of the fourth joint's position, world axes, at the configuration
        of the last call.
        """
        out = np.empty((3, self._model.nv))
        mujoco.mj_jacBody(self._model, self._data, out, None, self._elbow)
        return out[:, : self._joints]

    @property
    def armature(self) -> Array:
        """The motors' reflected inertia (7,), kg m^2."""
        return self._model.dof_armature[: self._joints].copy()
