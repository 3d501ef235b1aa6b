"""Effects of an arm's errors on its joint torques along a recorded motion: one column for every number
that the noise model draws.

Errors without a figure for the arm's owner (zeros, links, levels of friction) have a wide prior, the
others their standard deviation. Errors that are left out (curvature and hysteresis of the sensors, lost
samples) could only raise a bound.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from bench.bounds.blocks import Blocks, Column
from palpate.common.pose import Array
from palpate.robots.description import RobotDescription
from palpate.robots.simulated.noise.disturbances import NEW_APPROACH, REACH, REST_SPEED
from palpate.robots.simulated.noise.model import (
    DrawnValue,
    FrictionNoise,
    ModelErrors,
    NoiseModel,
    Ripple,
    Sticking,
    Torque,
)
from palpate.trace.samples import Samples

ZERO = 10.0
"""N m: wide prior of a sensor's zero."""
ANY_PLACE = 0.1
"""m: wide prior of a link's centre of mass."""
VERTICAL = 2


@dataclass(frozen=True, slots=True, eq=False)
class Hanging:
    """Load of the hand in each block.

    Attributes:
        torque: (n, 7) N m in the joints.
        mass: (n,) kg.
    """

    torque: Array
    mass: Array


@dataclass(frozen=True, slots=True, eq=False)
class _Links:
    """The arm's own weight along a motion.

    Attributes:
        shift: (n, 3, 7) N m of an acceleration of 1 m/s² of all bodies, base axes.
        mass: (n, k, 7) N m of one more kilogram at the centre of body k.
        com: (n, k, 3, 7) N m of a shift of its centre by a metre, in its own axes.
        nominal: (k,) kg.
    """

    shift: Array
    mass: Array
    com: Array
    nominal: Array


def errors(
    blocks: Blocks,
    samples: Samples,
    load: Hanging,
    arm: RobotDescription,
    noise: NoiseModel,
    gravity: float,
) -> list[Column]:
    """Columns of all errors of the arm, with their effect on a load."""
    links = _links(arm, blocks.q, gravity)
    weight = gravity * links.shift[:, VERTICAL]
    return [
        *_each_joint(np.ones_like(blocks.q), ZERO * np.ones(blocks.q.shape[1])),
        *_gains(noise.torque, weight - weight[0] + load.torque),
        *_rippled(noise.torque.ripple, samples, blocks),
        *_of_links(links),
        *_frame(noise.model, links, blocks, load, gravity),
        *_rubbing(noise.friction, samples, blocks, np.abs(weight + load.torque)),
        *_stuck(noise.sticking, samples, blocks),
        *_cable(noise.model.payload_cable, blocks),
    ]


def deviation(drawn: DrawnValue) -> Array:
    """Standard deviation of a drawn number."""
    return drawn.size / math.sqrt(3.0) if drawn.law == "uniform" else drawn.size


def _each_joint(torque: Array, sizes: Array) -> Iterator[Column]:
    """Columns of one unknown for each joint, `torque` (n, 7) N m a unit."""
    for joint, size in enumerate(sizes.tolist()):
        alone = np.zeros_like(torque)
        alone[:, joint] = torque[:, joint]
        yield Column(alone, size)


def _gains(torque: Torque, shown: Array) -> Iterator[Column]:
    """Gain of each sensor, and cross-talk from every other joint, for the torques `shown` (n, 7)."""
    # A sensor is zeroed at the beginning, with the arm's weight there.
    yield from _each_joint(shown, deviation(torque.gain_max))
    crossed = deviation(torque.crosstalk) * (1.0 - np.eye(shown.shape[1]))
    for sensor, source in np.argwhere(crossed > 0.0).tolist():
        alone = np.zeros_like(shown)
        alone[:, sensor] = shown[:, source]
        yield Column(alone, float(crossed[sensor, source]))


def _rippled(ripple: Ripple, samples: Samples, blocks: Blocks) -> Iterator[Column]:
    """Ripple of the sensors, with unknown phase: sine and cosine."""
    for wave in (np.sin, np.cos):
        yield from _each_joint(blocks.mean(wave(ripple.cycles * samples.q)), ripple.size)


def _of_links(links: _Links) -> Iterator[Column]:
    """Masses and centres of the links and the hand, with wide priors: no datasheet states their error."""
    for k, nominal in enumerate(links.nominal.tolist()):
        yield Column(links.mass[:, k], nominal)
        for axis in range(3):
            yield Column(links.com[:, k, axis], ANY_PLACE)


def _frame(
    model: ModelErrors, links: _Links, blocks: Blocks, load: Hanging, gravity: float
) -> Iterator[Column]:
    """Direction of gravity in the base's axes, and its magnitude."""
    tilt = gravity * deviation(model.base_tilt)
    for axis, size in enumerate([*tilt.tolist(), float(deviation(model.gravity))]):
        pulled = blocks.maps[:, :, :3] @ blocks.turn[:, axis]
        yield Column(links.shift[:, axis] + load.mass[:, None] * pulled, size)


def _rubbing(
    friction: FrictionNoise, samples: Samples, blocks: Blocks, borne: Array
) -> Iterator[Column]:
    """Friction behind the sensors (Dahl): level, initial state, viscous part, variation with the angle,
    Stribeck increase at low speed, and increase with the torque `borne` (n, 7)."""
    turned, left = np.zeros_like(samples.q), np.ones_like(samples.q)
    steps = np.diff(samples.q, axis=0)
    for row, step in enumerate(steps, start=1):
        keep = np.exp(-np.abs(step) / friction.presliding)
        turned[row] = keep * turned[row - 1] + np.copysign(1.0 - keep, step)
        left[row] = keep * left[row - 1]
    ones = np.ones(samples.q.shape[1])
    yield from _each_joint(friction.coulomb * blocks.mean(turned), ones)
    yield from _each_joint(friction.coulomb * blocks.mean(left), ones / math.sqrt(3.0))
    yield from _each_joint(friction.viscous * blocks.dq, ones)
    level = friction.coulomb * blocks.mean(turned)
    for wave in (np.sin, np.cos):
        yield from _each_joint(level * wave(blocks.q), friction.position)
    slow = np.exp(-((samples.dq / friction.stribeck_speed) ** 2))
    more = (friction.static - 1.0) * friction.coulomb
    yield from _each_joint(more * blocks.mean(turned * slow), ones)
    yield from _each_joint(blocks.mean(turned) * borne, friction.load)


def _stuck(sticking: Sticking, samples: Samples, blocks: Blocks) -> Iterator[Column]:
    """Residual of each rest in the joints: a force at the TCP, and a torque of each joint."""
    forces, torques = deviation(sticking.force), deviation(sticking.torque)
    if not (forces.any() or torques.any()):
        return
    shares, begins = _approaches(sticking, samples)
    means = blocks.mean(shares)
    memory = sticking.memory
    for i, row in enumerate(begins):
        # A rest shares a part of its residual with the following ones.
        common = math.sqrt(1.0 - memory**2) if i else 1.0
        faded = common * memory ** np.arange(len(begins) - i)
        share = means[:, i:] @ faded
        jacobian = blocks.maps[blocks.place[row]]
        for axis, size in enumerate(forces.tolist()):
            yield Column(share[:, None] * jacobian[:, axis], size)
        yield from _each_joint(share[:, None] * np.ones(samples.q.shape[1]), torques)


def _approaches(sticking: Sticking, samples: Samples) -> tuple[Array, Sequence[int]]:
    """Share of the residual of each of k rests, (rows, k), and the rows at which they began, as
    `robots.simulated.noise.disturbances` draws them."""
    period = float(np.median(np.diff(samples.t)))
    steps = np.linalg.norm(samples.dq, axis=1) * period
    builds, stays = min(1.0, period / sticking.settling), math.exp(-period / sticking.relaxation)
    begins: list[int] = []
    moved, resting = math.inf, False
    for row, slid in enumerate(steps.tolist()):
        moved += slid
        still = slid < REST_SPEED * period
        if still and not resting and moved > NEW_APPROACH:
            begins.append(row)
            moved = 0.0
        resting = still or (resting and moved <= NEW_APPROACH)
    shares = np.zeros((len(steps), len(begins)))
    now, goal, current = np.zeros(len(begins)), 1.0, -1
    for row, slid in enumerate(steps.tolist()):
        now *= math.exp(-slid / sticking.release)
        if current + 1 < len(begins) and row == begins[current + 1]:
            current, goal = current + 1, 1.0
        if slid < REST_SPEED * period and current >= 0:
            now *= 1.0 - builds
            now[current] += goal * builds
            goal *= stays
        shares[row] = now
    return shares, begins


def _cable(size: float, blocks: Blocks) -> Iterator[Column]:
    """Pull of a cable: a force at the TCP that varies over `REACH` m, to first order about the middle."""
    away = (blocks.position - blocks.position.mean(axis=0)) / REACH
    for share in (np.ones(len(away)), *away.T):
        for axis in range(3):
            yield Column(share[:, None] * blocks.maps[:, :, axis], size)


def _links(arm: RobotDescription, q: Array, gravity: float) -> _Links:
    """Weight of every link, and last of the hand, at joint angles `q` (n, 7)."""
    model = arm.spec().compile()
    data = mujoco.MjData(model)
    qpos = [int(model.jnt_qposadr[model.joint(name).id]) for name in arm.joints]
    dofs = [int(model.jnt_dofadr[model.joint(name).id]) for name in arm.joints]
    bodies = [int(model.jnt_bodyid[model.joint(name).id]) for name in arm.joints]
    bodies.append(int(model.body(arm.hand.body).id))
    heavy = [body for body in range(model.nbody) if model.body_mass[body] > 0.0]
    shift = np.zeros((len(q), 3, len(dofs)))
    mass = np.zeros((len(q), len(bodies), len(dofs)))
    com = np.zeros((len(q), len(bodies), 3, len(dofs)))
    linear, angular = np.zeros((3, model.nv)), np.zeros((3, model.nv))
    for i, angles in enumerate(q):
        data.qpos[qpos] = angles
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        for body in heavy:
            mujoco.mj_jac(model, data, linear, angular, data.xipos[body], body)
            shift[i] += model.body_mass[body] * linear[:, dofs]
        for k, body in enumerate(bodies):
            mujoco.mj_jac(model, data, linear, angular, data.xipos[body], body)
            mass[i, k] = gravity * linear[VERTICAL, dofs]
            weight = gravity * float(model.body_mass[body])
            for axis, way in enumerate(data.xmat[body].reshape(3, 3).T):
                com[i, k, axis] = weight * np.cross(angular[:, dofs].T, way)[:, VERTICAL]
    return _Links(shift, mass, com, np.array([model.body_mass[body] for body in bodies]))
