"""Recordings of an arm whose dynamics are known: MuJoCo's inverse dynamics, and friction of a law that palpate
does not fit, Maxwell slip (Lampaert, Al-Bender, Swevers, IEEE ROBIO 2003)."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from palpate.robots.description import RobotDescription
from palpate.trace.recording import ArmLog

Array = NDArray[np.float64]
COULOMB = np.array([0.5, 0.4, 0.3, 0.25, 0.35, 0.25, 0.15])
VISCOUS = np.array([0.1, 0.3, 0.1, 0.2, 0.05, 0.05, 0.02])
OFFSET = np.array([-0.3, 0.2, 0.0, -0.2, 0.1, 0.1, -0.2])
STIFF = (4e-4, 2e-3, 6e-3)
"""rad at which the elements of a joint slip."""
RATE = 250.0


def fourier(
    seconds: float, arm: RobotDescription, seed: int = 0
) -> tuple[Array, Array, Array, Array]:
    """Times, angles, velocities and accelerations of a free motion about home."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, seconds, 1.0 / RATE)
    q, dq, ddq = np.zeros((3, len(t), 7))
    for frequency in (0.07, 0.13, 0.22, 0.37, 0.6):
        size, phase = rng.uniform(0.04, 0.09, 7) / (0.3 + frequency), rng.uniform(0, 2 * np.pi, 7)
        turn = 2 * np.pi * frequency
        angle = turn * t[:, None] + phase
        q += size * np.sin(angle)
        dq += size * turn * np.cos(angle)
        ddq -= size * turn**2 * np.sin(angle)
    return t, arm.home + q, dq, ddq


def inverse(model: mujoco.MjModel, q: Array, dq: Array, ddq: Array) -> Array:
    """Joint torques of the links alone."""
    model.dof_armature[:] = model.dof_damping[:] = model.dof_frictionloss[:] = 0.0
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    data, found = mujoco.MjData(model), np.empty_like(q)
    for row in range(len(q)):
        data.qpos[:7], data.qvel[:7], data.qacc[:7] = q[row], dq[row], ddq[row]
        mujoco.mj_inverse(model, data)
        found[row] = data.qfrc_inverse[:7]
    return found


def friction(q: Array) -> Array:
    """Friction of elements that each follow the joint until they slip."""
    found = np.zeros_like(q)
    for slip in STIFF:
        level = COULOMB / len(STIFF)
        bent = np.zeros(7)
        for row in range(1, len(q)):
            bent = np.clip(bent + q[row] - q[row - 1], -slip, slip)
            found[row] += level * bent / slip
    return found


def recorded(
    arm: RobotDescription,
    hand: float,
    seconds: float = 30.0,
    noise: float = 0.05,
    seed: int = 0,
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.81),
) -> ArmLog:
    """Recording of an arm with `hand` kg on its flange, a sensor noise of `noise` N m, and drift; its base is mounted
    so that `gravity` acts along its axes."""
    rng = np.random.default_rng(seed)
    t, q, dq, ddq = fourier(seconds, arm, seed)
    model = mujoco.MjModel.from_xml_path(str(arm.mjcf))
    model.opt.gravity = gravity
    body = model.body(arm.hand.body).id
    factor = hand / model.body_subtreemass[body]
    for each in range(body, model.nbody):
        model.body_mass[each] *= factor
        model.body_inertia[each] *= factor
    drift = np.cumsum(rng.standard_normal(q.shape), axis=0) * 0.05 / np.sqrt(len(q))
    drift -= drift.mean(axis=0)  # it belongs to the offset
    tau = inverse(model, q, dq, ddq) + friction(q) + VISCOUS * dq + OFFSET
    tau += drift + noise * rng.standard_normal(q.shape)
    return ArmLog(t, q, dq, tau, None, f"arm {seed}")
