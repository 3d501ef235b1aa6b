"""The nominal FR3: the manufacturer's kinematics and inertias, which the controller and the wrench
rely on."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.linalg.lapack import dposv

from palpate.geometry.pose import Array, Pose
from palpate.robots.kinematics import FR3
from palpate.robots.robot import PAYLOAD, Limits
from palpate.trace.recording import Hand

ARM = tuple(f"fr3_joint{i}" for i in range(1, 8))
FINGERS = ("finger_joint1", "finger_joint2")

HAND = Hand(
    tip_offset=0.009,
    force_resolution=0.05,
    force_repeatability=0.15,
    torque_gain=0.01,
    pose_repeatability=1e-4,
)
"""The tip is the end of the pad in fr3.xml. Force resolution 0.05 N, force repeatability 0.15 N and
pose repeatability 0.1 mm: Franka Research 3 datasheet (R02212). Its relative force accuracy of 0.8
N is about what 1 % of the joints' gravity torques comes to at the TCP."""

REGULARISATION = 1e-9
"""Added to J J^T (m^2), far below its smallest eigenvalue in the workspace, so that a singular pose
stays finite."""


SEARCH_STEPS, SEARCH_RATE, SEARCH_DAMPING, SEARCH_DONE = 60, 0.3, 1e-4, 1e-3
"""Of `NominalArm.reach`: most iterations, share of the way to the posture per step, m^2, rad."""


def limits() -> Limits:
    """Joint ranges, speeds and torques: Franka Research 3 datasheet (R02212), as in
    franka_description."""
    ranges = np.array(
        [
            [-2.9007, 2.9007],
            [-1.8361, 1.8361],
            [-2.9007, 2.9007],
            [-3.077, -0.1169],
            [-2.8763, 2.8763],
            [0.4398, 4.6216],
            [-3.0508, 3.0508],
        ]
    )
    return Limits(
        q_min=ranges[:, 0],
        q_max=ranges[:, 1],
        dq_max=np.array([2.62, 2.62, 2.62, 2.62, 5.26, 4.18, 5.26]),
        tau_max=np.array([87.0, 87.0, 87.0, 87.0, 12.0, 12.0, 12.0]),
        force_max=60.0,
        torque_max=15.0,
        speed_max=0.40,  # 0.25 m/s commanded, and what an impedance overshoots by
        tracking_max=0.05,
        payload=PAYLOAD,
        opening=0.08,
        workspace_min=np.array([-0.855, -0.855, -0.90]),
        workspace_max=np.array([0.855, 0.855, 1.19]),
        stale_after=0.1,
    )


def robot_spec(gravity: Array | None = None) -> mujoco.MjSpec:
    """An editable copy of the robot, its options those of every world it is put in."""
    spec = mujoco.MjSpec.from_file(str(FR3))
    spec.option.timestep = 0.001
    if gravity is not None:
        spec.option.gravity = gravity
    return spec


@dataclass(frozen=True, slots=True, eq=False)
class Kinematics:
    """Where the nominal arm is, n configurations at once.

    Attributes:
        pose_world_tcp: (n, 7). jacobian: (n, 6, 7), world axes about the TCP.
        gravity_torque: (n, 7), N m, what holds the arm up.
    """

    pose_world_tcp: Array
    jacobian: Array
    gravity_torque: Array


def wrench(jacobian: Array, torque: Array) -> Array:
    """(J^T)^+ tau: the wrench (6,) at the TCP of joint torques (7,). `jacobian` is (6, 7)."""
    return dposv(jacobian @ jacobian.T + _RIDGE, jacobian @ torque)[1]


def wrenches(jacobian: Array, torque: Array) -> Array:
    """`wrench` (n, 6) of n Jacobians (n, 6, 7) and torques (n, 7)."""
    square = np.matmul(jacobian, jacobian.transpose(0, 2, 1))
    square += _RIDGE
    right, out = np.matmul(jacobian, torque[:, :, None]), np.empty((len(torque), 6))
    for i in range(
        len(out)
    ):  # LAPACK without the checks of numpy.linalg, which cost more than the solving
        out[i] = dposv(square[i], right[i])[1][:, 0]
    return out


_RIDGE = REGULARISATION * np.eye(6)


def _turn(start: Array, goal: Array) -> Array:
    """(3,) rad, world axes, of the shortest turn from one quaternion to another."""
    turn, out = np.empty(3), np.empty(3)
    mujoco.mju_subQuat(turn, goal, start)
    mujoco.mju_rotVecQuat(out, turn, start)
    return out


class NominalArm:
    """The unperturbed robot alone, at its place in the world, fingers half open."""

    def __init__(self, pose_world_base: Pose, gravity: Array) -> None:
        spec = robot_spec(gravity)
        self._pose_world_base = pose_world_base
        base = spec.body("fr3_link0")
        base.pos, base.quat = pose_world_base.position, pose_world_base.quaternion
        for geom in list(spec.geoms):
            spec.delete(geom)
        self._model = spec.compile()
        self._data = mujoco.MjData(self._model)
        self._tcp = self._model.site("tcp").id
        self._q, self._dq = self._data.qpos[:7], self._data.qvel[:7]
        self._position = self._data.site_xpos[self._tcp]
        self._quaternion = self._data.xquat[self._model.body("hand").id]
        self._data.qpos[7:] = 0.02

    def kinematics(self, q: Array) -> Kinematics:
        """At configurations `q` (n, 7)."""
        n, model, data = len(q), self._model, self._data
        pose, jacobian, gravity = (
            np.empty((n, 7)),
            np.empty((n, 6, model.nv)),
            np.empty((n, model.nv)),
        )
        self._dq[:] = 0.0
        for i in range(n):
            self._q[:] = q[i]
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            mujoco.mj_jacSite(model, data, jacobian[i, :3], jacobian[i, 3:], self._tcp)
            mujoco.mj_rne(model, data, 0, gravity[i])
            pose[i, :3], pose[i, 3:] = self._position, self._quaternion
        return Kinematics(pose, jacobian[:, :, :7], gravity[:, :7])

    def poses(self, q: Array) -> Array:
        """The TCP's poses (n, 7) at configurations `q` (n, 7)."""
        out = np.empty((len(q), 7))
        for i in range(len(q)):
            self._q[:] = q[i]
            mujoco.mj_kinematics(self._model, self._data)
            out[i, :3], out[i, 3:] = self._position, self._quaternion
        return out

    def reach(self, goal: Pose, posture: Array) -> Array:
        """Configuration (7,) that puts the TCP at `goal` with the null space at rest near
        `posture`, which is first turned about the base towards the goal.

        It depends on nothing else, so the arm comes back to a pose with the elbow where it was
        before: a wrench's bias is that of a configuration, not of a pose. Where there is none, the
        search ends as near as it came: it is a tendency, no promise of reachability.
        """
        ahead = self._pose_world_base.local(goal.position)
        posture = posture + np.arctan2(ahead[1], ahead[0]) * np.eye(7)[0]
        q = posture
        for _ in range(SEARCH_STEPS):
            here = self.kinematics(q[None])
            jacobian: Array = here.jacobian[0]
            pose = Pose(here.pose_world_tcp[0, :3], here.pose_world_tcp[0, 3:])
            error = np.concatenate(
                [goal.position - pose.position, _turn(pose.quaternion, goal.quaternion)]
            )
            inverse = np.linalg.solve(
                jacobian @ jacobian.T + SEARCH_DAMPING * np.eye(6), jacobian
            ).T
            away = SEARCH_RATE * (posture - q)
            step = inverse @ (error - jacobian @ away) + away
            q = q + np.clip(step, -0.2, 0.2)
            if np.abs(step).max() < SEARCH_DONE:
                break
        return q

    def bias_torque(self, q: Array, dq: Array) -> Array:
        """Gravity, Coriolis and centrifugal torques (7,), N m."""
        model, data = self._model, self._data
        self._q[:], self._dq[:] = q, dq
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_comVel(model, data)
        out = np.empty(model.nv)
        mujoco.mj_rne(model, data, 0, out)
        return out[:7]

    def mass_matrix(self, q: Array) -> Array:
        """Joint-space inertia (7, 7) with the motors' reflected one, kg m^2."""
        model, data = self._model, self._data
        self._q[:] = q
        mujoco.mj_fwdPosition(model, data)
        full = np.empty((model.nv, model.nv))
        mujoco.mj_fullM(model, data, full)
        return full[:7, :7]

    @property
    def armature(self) -> Array:
        """The motors' reflected inertia (7,), kg m^2."""
        return self._model.dof_armature[:7].copy()
