"""The arm as its own controller knows it: kinematics and dynamics at the angles that the encoders
report, with the end effector and the load that were configured, in the frame of its base.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.linalg.lapack import dposv

from palpate.common.pose import Array
from palpate.robots.description import RobotDescription

GRAVITY = 9.81
"""m/s^2 that a Franka's controller compensates, straight down its base (libfranka's default of
`Model::gravity`)."""
RIDGE = 1e-9 * np.eye(6)
"""m^2: a singular pose stays finite."""
EE, LOAD = "configured_ee", "configured_load"


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """A rigid body on the flange.

    Attributes:
        mass: kg. centre: (3,) m in the flange's frame. inertia: (3, 3) kg m^2 about the centre.
    """

    mass: float
    centre: Array
    inertia: Array


NOTHING = Body(0.0, np.zeros(3), np.zeros((3, 3)))


class BelievedArm:
    """Kinematics and dynamics of the nominal arm, updated in place once a cycle.

    Attributes:
        nominal_ee: the hand as the description has it.
        ee, load: what is configured. O_T_F, O_T_EE, O_T_K: (4, 4) of flange, end effector and
            stiffness frame. gravity: (7,) N m that hold the arm up. moving: (7,) N m, what turns
            and accelerates the links besides. jacobian: (6, 7) about the stiffness frame, base axes.
        F_T_NE, NE_T_EE, EE_T_K: (4, 4).
    """

    def __init__(self, arm: RobotDescription) -> None:
        self.flange, self.F_T_NE, self.nominal_ee = _hand(arm)
        self.NE_T_EE, self.EE_T_K = np.eye(4), np.eye(4)
        spec = arm.spec(np.array([0.0, 0.0, -GRAVITY]))
        base = spec.body(arm.base)
        base.pos, base.quat = np.zeros(3), [1.0, 0.0, 0.0, 0.0]
        for geom in list(spec.geoms):
            spec.delete(geom)
        spec.delete(spec.body(arm.hand.body))
        last = spec.body(arm.links[-1])
        for name in (EE, LOAD):
            last.add_body(name=name, mass=1.0, inertia=np.ones(3), explicitinertial=True)
        self.model = spec.compile()
        self._data = mujoco.MjData(self.model)
        self._bodies = [int(self.model.body(name).id) for name in (EE, LOAD)]
        self._last = int(self.model.body(arm.links[-1]).id)
        self._place = self._data.xpos[self._last]
        self._turn = self._data.xmat[self._last].reshape(3, 3)
        self.gravity, self.moving = np.zeros(7), np.zeros(7)
        self.jacobian, self.O_T_F = np.zeros((6, 7)), np.eye(4)
        self.armature = self.model.dof_armature.copy()
        self.configure(self.nominal_ee, NOTHING)

    def configure(self, ee: Body, load: Body) -> None:
        """From now on the flange carries these."""
        self.ee, self.load = ee, load
        model, turn = self.model, self.flange[:3, :3]
        for body, carried in zip(self._bodies, (ee, load), strict=True):
            moments, axes = np.linalg.eigh(carried.inertia)
            axes = turn @ axes * np.sign(np.linalg.det(axes))
            model.body_mass[body] = carried.mass
            model.body_ipos[body] = self.flange[:3, 3] + turn @ carried.centre
            model.body_inertia[body] = moments
            mujoco.mju_mat2Quat(model.body_iquat[body], axes.ravel())
        model.body_sameframe[self._bodies] = 0
        mujoco.mj_setConst(model, mujoco.MjData(model))

    @property
    def F_T_EE(self) -> Array:
        return self.F_T_NE @ self.NE_T_EE

    def update(self, q: Array, dq: Array, ddq: Array) -> None:
        """The arm is at `q`, moving at `dq` and `ddq` (7,)."""
        model, data = self.model, self._data
        data.qpos[:], data.qvel[:], data.qacc[:] = q, 0.0, ddq
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        data.cvel[:] = 0.0
        mujoco.mj_rne(model, data, 0, self.gravity)
        data.qvel[:] = dq
        mujoco.mj_comVel(model, data)
        mujoco.mj_rne(model, data, 1, self.moving)
        self.moving -= self.gravity
        self.O_T_F[:3, :3] = self._turn @ self.flange[:3, :3]
        self.O_T_F[:3, 3] = self._place + self._turn @ self.flange[:3, 3]
        O_T_K = self.O_T_F @ self.F_T_EE @ self.EE_T_K
        mujoco.mj_jac(model, data, self.jacobian[:3], self.jacobian[3:], O_T_K[:3, 3], self._last)
        self.O_T_EE = self.O_T_F @ self.F_T_EE
        self.O_T_K = O_T_K

    @property
    def bias(self) -> Array:
        """(7,) N m of centrifugal and Coriolis forces."""
        out = np.empty(7)
        mujoco.mj_rne(self.model, self._data, 0, out)
        return out - self.gravity

    def mass_matrix(self) -> Array:
        """(7, 7) kg m^2 where it was updated last, with the motors' reflected inertia."""
        model, data, full = self.model, self._data, np.empty((7, 7))
        mujoco.mj_crb(model, data)
        mujoco.mj_fullM(model, data, full)
        return full

    def wrench(self, torque: Array) -> Array:
        """(6,) N, N m at the stiffness frame, base axes, of joint torques (7,): what the robot
        exerts is positive, as in libfranka's `O_F_ext_hat_K`."""
        jacobian = self.jacobian
        return dposv(jacobian @ jacobian.T + RIDGE, jacobian @ torque)[1]

    def ee_jacobian(self) -> Array:
        """(6, 7) about the end effector's frame, base axes."""
        out = np.empty((6, 7))
        mujoco.mj_jac(self.model, self._data, out[:3], out[3:], self.O_T_EE[:3, 3], self._last)
        return out


def _hand(arm: RobotDescription) -> tuple[Array, Array, Body]:
    """The flange in the last link, the nominal end effector in the flange, and the hand's mass.

    A Franka's flange has the last link's orientation, and is where the hand is bolted on.
    """
    model = arm.spec().compile()
    data = mujoco.MjData(model)
    for name in arm.hand.fingers:
        data.qpos[int(model.joint(name).qposadr[0])] = arm.hand.opening / 4
    mujoco.mj_kinematics(model, data)
    last, hand = data.body(arm.links[-1]), data.body(arm.hand.body)
    turn = last.xmat.reshape(3, 3)
    flange = np.eye(4)
    flange[:3, 3] = turn.T @ (hand.xpos - last.xpos)
    nominal = np.eye(4)
    nominal[:3, :3] = turn.T @ hand.xmat.reshape(3, 3)
    nominal[:3, 3] = turn.T @ (data.site(arm.tcp).xpos - hand.xpos)
    carried = [model.body(arm.hand.body).id]
    carried += [int(model.jnt_bodyid[model.joint(name).id]) for name in arm.hand.fingers]
    masses = model.body_mass[carried]
    places = (data.xipos[carried] - hand.xpos) @ turn
    mass = float(masses.sum())
    centre = masses @ places / mass
    inertia = np.zeros((3, 3))
    for body, own, place in zip(carried, masses, places, strict=True):
        axes = turn.T @ data.ximat[body].reshape(3, 3)
        away = place - centre
        inertia += (axes * model.body_inertia[body]) @ axes.T
        inertia += own * (away @ away * np.eye(3) - np.outer(away, away))
    return flange, nominal, Body(mass, centre, inertia)
