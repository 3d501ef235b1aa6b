"""The gains of the joints' torque sensors, from the weight of the arm itself.

In n configurations at rest a joint's sensor shows 1 + g times what the arm weighs there, against the
configuration in which it was zeroed. What the nominal arm weighs is known but for its links' masses
and centres, whose accuracy the description states:

    tau - tau_0 = g (G(q) - G(q_0)) + sum_i dm_i dG/dm_i + dc_i dG/dc_i + friction

All unknowns have the prior that the description states, so that the posterior says how much of a gain
can be told from heavier links. Friction is another at every rest.
"""

from __future__ import annotations

import math

import mujoco
import numpy as np

from palpate.calibration.gains import GainBelief, require
from palpate.errors import InputError
from palpate.estimation.agreement import chi_squared
from palpate.estimation.load.observation import gain_root, observe
from palpate.geometry.pose import Array, Pose
from palpate.planning.plan import Node
from palpate.robots.description import RobotDescription
from palpate.robots.nominal import NominalArm
from palpate.robots.owner.config import JOINTS
from palpate.trace.recording import Hand
from palpate.trace.samples import Trace
from palpate.vocabulary.state import HOME_CONFIG

CONFIGURATIONS = 30
"""How many: friction is about as large as what is looked for, and averages out."""
SPREAD = np.array([0.8, 0.6, 0.6, 0.7, 1.0, 0.8, 1.2])
"""rad about home, evenly."""
CLEAR = 0.25
"""m that the TCP stays above the plane on which the arm stands."""
WIDE = 0.1
"""Relative (1 sigma): no sensor's gain is off by more."""
MARGIN = 0.1
"""rad to the joints' limits."""
UP = np.array([0.0, 0.0, 1.0])
DOWN = -9.81 * UP
OFFSET = 1.0
"""N m (1 sigma): what zeroing and friction left at the start."""
ROUNDS = 4
"""Of the fit: how far friction scatters is seen in what the last one left."""


def tree(arm: RobotDescription) -> Node:
    """Rests in configurations all around, the same ones every time, from home and back."""
    random, nominal = np.random.default_rng(0), NominalArm(arm, Pose.of([0, 0, 0]), DOWN)
    low, high = arm.limits.q_min + MARGIN, arm.limits.q_max - MARGIN
    home = Node("MoveJoints", (("joints", HOME_CONFIG),))
    steps = [home]
    while len(steps) <= 2 * CONFIGURATIONS:
        q = np.clip(arm.home + SPREAD * random.uniform(-1.0, 1.0, JOINTS), low, high)
        x, y, z = nominal.poses(q[None])[0, :3].tolist()
        if z > CLEAR and math.hypot(x, y) > arm.reach.nearest:
            steps.append(Node("MoveJoints", (("joints", q.round(4).tolist()),)))
            steps.append(Node("MeasureForces"))
    return Node("Sequence", children=(*steps, home))


def weighed_itself(trace: Trace, arm: RobotDescription) -> GainBelief:
    """Compute the posterior of the gains from the arm's own weight at rest in many configurations; the
    readings are corrected by the earlier calibration.

    Raises:
        InputError: too few rests, or what was felt is not what such an arm may weigh.
    """
    q, observed, maps = _rests(trace)
    root = gain_root(trace.hand, JOINTS)
    heavy, others = _columns(trace, arm, q)
    # How far rests scatter is seen where a wrong belief in the gains cannot pass for it.
    free, noise = _scattering(
        np.concatenate([WIDE * heavy, others], axis=2), observed, _noise(arm, trace.hand, maps)
    )
    _require_agreement(WIDE * free.mean, WIDE**2 * free.covariance, root @ root.T)
    found = _solved(np.concatenate([heavy @ root, others], axis=2), observed, noise)
    return GainBelief(root @ found.mean, root @ found.covariance @ root.T)


def _noise(arm: RobotDescription, hand: Hand, maps: Array) -> Array:
    """(n, 7, 7) N² m²: what is another at every rest, by the description."""
    own = arm.sensors.friction**2 + arm.sensors.drift**2
    stuck = hand.force_repeatability * maps[:, :, :3]
    return np.diag(own) + stuck @ stuck.transpose(0, 2, 1)


def _scattering(columns: Array, observed: Array, noise: Array) -> tuple[GainBelief, Array]:
    """The gains, and the `noise` (n, 7, 7) as large in each joint as what the fit leaves."""
    size = np.ones(JOINTS)
    for _ in range(ROUNDS):
        roots: Array = np.linalg.cholesky(noise * np.outer(size, size)).astype(np.float64)
        white, seen = _white(roots, columns, observed)
        mean, covariance = _posterior(white, seen)
        left = seen - white @ mean
        told = np.einsum("nip,pq,niq->i", white, covariance, white)
        free = np.maximum(len(observed) - told, 1.0)
        size = size * np.sqrt((left**2).sum(axis=0) / free)
    noise = noise * np.outer(size, size)
    return _solved(columns, observed, noise), noise


def _solved(columns: Array, observed: Array, noise: Array) -> GainBelief:
    """The first unknowns, in units of their prior deviations, of which `columns` (n, 7, p) make `observed`
    (n, 7)."""
    roots: Array = np.linalg.cholesky(noise).astype(np.float64)
    mean, covariance = _posterior(*_white(roots, columns, observed))
    return GainBelief(mean[:JOINTS], covariance[:JOINTS, :JOINTS])


def _white(roots: Array, columns: Array, observed: Array) -> tuple[Array, Array]:
    """(n, 7, p) and (n, 7) in rows of unit variance."""
    white: Array = np.linalg.solve(roots, columns).astype(np.float64)
    seen: Array = np.linalg.solve(roots, observed[:, :, None]).astype(np.float64)
    return white, seen[:, :, 0]


def _posterior(white: Array, seen: Array) -> tuple[Array, Array]:
    """Mean (p,) and covariance (p, p) of unknowns with a standard normal prior."""
    information = np.einsum("nip,niq->pq", white, white) + np.eye(white.shape[2])
    covariance = _inverse(information)
    return covariance @ np.einsum("nip,ni->p", white, seen), covariance


def _inverse(information: Array) -> Array:
    inverse: Array = np.linalg.inv(information).astype(np.float64)
    return inverse


def _rests(trace: Trace) -> tuple[Array, Array, Array]:
    """Of n rests: joint angles (n, 7), external torques (n, 7) N m, and what unit wrenches make of
    them (n, 7, 6).

    Raises:
        InputError: too few.
    """
    means: list[tuple[Array, Array]] = []
    for recording in trace.recordings:
        here = trace.of(recording)
        if len(here):
            means.append((here.q.mean(axis=0), here.tau_ext.mean(axis=0)))
    if len(means) < CONFIGURATIONS // 2:
        raise InputError(
            f"the arm rested in {len(means)} configurations, too few to tell its weight; nothing is "
            "written"
        )
    q, torque = (np.array(part) for part in zip(*means, strict=True))
    return q, torque, observe(trace).maps(q)


def _columns(trace: Trace, arm: RobotDescription, q: Array) -> tuple[Array, Array]:
    """(n, 7, 7) N m that gains of one make, and (n, 7, p) what one standard deviation of each other
    unknown makes: what zeroing left, links' masses and centres."""
    nominal = Links(arm, trace.gravity)
    start = trace.samples.q[:1]
    weight = nominal.weight(q) - nominal.weight(start)
    links = nominal.sensitivity(q) - nominal.sensitivity(start)
    heavy = weight[:, :, None] * np.eye(JOINTS)
    offset = np.broadcast_to(OFFSET * np.eye(JOINTS), heavy.shape)
    return heavy, np.concatenate([offset, links], axis=2)


def _require_agreement(mean: Array, covariance: Array, believed: Array) -> None:
    """Require that gains estimated without a prior, `mean` (7,) with `covariance` (7, 7), agree with
    zero within the prior covariance `believed` (7, 7)."""
    spread = covariance + believed
    apart = np.abs(mean) / np.sqrt(spread.diagonal())
    worst = int(np.argmax(apart))
    same = chi_squared(
        "own weight",
        float(mean @ np.linalg.solve(spread, mean)),
        JOINTS,
        f"The arm feels its own weight otherwise than what is known of its sensors allows, most of all "
        f"in joint {worst + 1} ({apart[worst]:.1f} standard deviations): they were calibrated wrongly, "
        "or the arm carries something.",
    )
    require([same], "the arm's own weight")


class Links:
    """The nominal arm with its links' weights."""

    def __init__(self, arm: RobotDescription, gravity: float) -> None:
        self._model = arm.spec(gravity * UP * -1.0).compile()
        self._data = mujoco.MjData(self._model)
        self._gravity = -gravity * UP
        self._nominal = NominalArm(arm, Pose.of([0, 0, 0]), self._gravity)
        bodies = [self._model.jnt_bodyid[self._model.joint(name).id] for name in arm.joints]
        self._bodies = [*map(int, bodies), self._model.body(arm.hand.body).id]
        self._joints = [int(self._model.joint(name).qposadr[0]) for name in arm.joints]
        self._dofs = [int(self._model.joint(name).dofadr[0]) for name in arm.joints]
        self._accuracy = arm.sensors.link_mass, arm.sensors.link_com

    def weight(self, q: Array) -> Array:
        """(n, 7) N m that hold the arm up at `q` (n, 7)."""
        return self._nominal.kinematics(q).gravity_torque

    def sensitivity(self, q: Array) -> Array:
        """(n, 7, 4 k) N m: how that changes with the mass of each of the k links, and its centre along
        its three axes, by the standard deviation that the description states."""
        model, data = self._model, self._data
        out: list[Array] = []
        for angles in q:
            data.qpos[self._joints] = angles
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            out.append(np.column_stack([self._of_link(body) for body in self._bodies]))
        return np.array(out)

    def _of_link(self, body: int) -> Array:
        """(7, 4) of one link where the arm is now. A Jacobian is linear in the point that it is of."""
        model, data = self._model, self._data
        mass, (relative, shift) = float(model.body_mass[body]), self._accuracy
        link = data.body(body)
        axes = link.xmat.reshape(3, 3)
        along, about = np.empty((3, model.nv)), np.empty((3, model.nv))
        mujoco.mj_jacBody(model, data, along, about, body)

        def hold(point: Array) -> Array:
            """(7,) N m that hold up a kilogram at a point of the link."""
            jacobian = along + np.cross(about.T, point - link.xpos).T
            return -jacobian[:, self._dofs].T @ self._gravity

        here = hold(link.xipos)
        columns = [relative * mass * here]
        for axis in axes.T:
            columns.append(shift * mass * (hold(link.xipos + axis) - here))
        return np.column_stack(columns)
