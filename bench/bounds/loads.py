"""The least that can be known of what hung on the hand: its mass, its centre of mass, and what it
rubbed with along its support."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from bench.bounds.blocks import Blocks, blocks
from bench.bounds.errors import Hanging, deviation, errors
from bench.bounds.information import Column, covariance
from palpate.estimation.load.blocks import apart, lifted
from palpate.estimation.load.segments import load_rows
from palpate.estimation.motion import Mask, runs
from palpate.geometry.pose import Array
from palpate.robots.description import RobotDescription
from palpate.robots.simulated.noise.model import Model, NoiseModel
from palpate.trace.samples import Trace

ANY_MASS, ANY_LEVER, ANY_FORCE, ANY_RATIO = 10.0, 1.0, 1e3, 10.0
"""kg, m, N or N m, and of a coefficient: so much that nothing is known beforehand."""
SLIDES, PRESSED = 5e-3, 1.0
"""m/s and N from which a thing slides along its support."""
LEVEL = 1e-2
"""square of the part of the fingers' way that is not known yet, below which it tells nothing more."""
UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, slots=True, eq=False)
class Carried:
    """A trace in which an object was carried, in blocks.

    Attributes:
        pull: (n, 3) N that a kilogram of it pulls with while it hangs free, else nothing.
        axes: (n, 3, 3) the object's axes in the world, as far as it was held.
        free: (n,) blocks in which the hand is empty or the object hangs, and nothing is touched.
        held: (n,) blocks in which it is held.
    """

    blocks: Blocks
    pull: Array
    axes: Array
    free: Mask
    held: Mask


def of_load(
    trace: Trace,
    name: str,
    standing: Array,
    mass: float,
    arm: RobotDescription,
    noise: NoiseModel,
    place: float = 0.0,
) -> tuple[float, Array] | None:
    """Least standard deviations of the mass (kg) and of the centre of mass (3,) (m, in the axes
    that the object has when it stands with the rotation matrix `standing`); None where the trace
    does not say what joint torques come from.

    `mass`: the true one, kg, where the equations are linearised. `place`: m (1 sigma), each way, that it may
    have stood elsewhere on the level than the scene has it.
    """
    carried = _carried(trace, name, standing)
    if carried is None:
        return None
    sought = _of_weight(carried, mass)
    found = covariance(
        sought,
        _errors(trace, carried, mass, arm, noise),
        carried.blocks,
        carried.free,
        noise.torque,
    )
    stds = np.sqrt(np.diag(found))
    return float(stds[0]), np.hypot(stds[1:], place * _unfelt(carried, standing))


def _unfelt(carried: Carried, standing: Array) -> Array:
    """(3,) along the object's axes: the part of a step aside on the level that nothing tells; fingers
    that close on it tell what is along their way."""
    unknown = standing.T @ np.diag([1.0, 1.0, 0.0]) @ standing
    for rows in runs(carried.held):
        closing = carried.axes[rows.start].T @ carried.blocks.rotation[rows.start][:, 1]
        told = unknown @ closing
        if (size := float(closing @ told)) > LEVEL:
            unknown = unknown - np.outer(told, told) / size
    return np.sqrt(np.clip(np.diag(unknown), 0.0, None))


def of_friction(
    trace: Trace,
    name: str,
    standing: Array,
    about: tuple[float, float],
    arm: RobotDescription,
    noise: NoiseModel,
) -> float | None:
    """Least standard deviation of the coefficient with which an object slid, beside its weight and
    all that the support did to it but the force along the motion; None where it did not slide.

    It is that of one who knows that nothing else holds the object, that friction is even, and that the support
    is level, of which no estimator is told; but not how the arm's own frame leans.

    `about`: the true mass (kg) and friction, where the equations are linearised.
    """
    mass, friction = about
    carried = _carried(trace, name, standing)
    if carried is None:
        return None
    blocks, samples = carried.blocks, trace.samples
    speed = blocks.mean(samples.twist[:, :2])
    pressed = mass * trace.gravity - blocks.mean(samples.wrench[:, 2])
    fast = np.linalg.norm(speed, axis=1) > SLIDES
    sliding = carried.held & ~carried.free & fast & (pressed > PRESSED)
    if not sliding.any():
        return None
    way = np.zeros((len(speed), 3))
    way[sliding, :2] = speed[sliding] / np.linalg.norm(speed[sliding], axis=1)[:, None]
    rubbed = Column(_torques(blocks, pressed[:, None] * way), ANY_RATIO)
    support: list[Column] = []
    for place in np.flatnonzero(sliding):
        support += _supported(blocks, int(place), way[place], friction)
    borne = _torques(blocks, pressed[:, None] * (friction * way - sliding[:, None] * UP))
    found = covariance(
        [rubbed, *_of_weight(carried, mass, sliding * trace.gravity), *support],
        [
            *_errors(trace, carried, mass, arm, noise, sliding * trace.gravity, borne),
            *_leaning(blocks, pressed, way, noise.model),
        ],
        blocks,
        carried.free | sliding,
        noise.torque,
    )
    return float(np.sqrt(found[0, 0]))


def _leaning(blocks: Blocks, pressed: Array, way: Array, model: Model) -> Iterator[Column]:
    """What a support adds along the motion that seems to lean, as the base is tilted, or encoders have
    other zeros."""
    zeros = zip(
        blocks.maps[:, :, 3:].transpose(1, 0, 2), deviation(model.joint_offset), strict=True
    )
    tilts = zip(blocks.turn.T, deviation(model.base_tilt), strict=False)
    for axis, size in (*zeros, *tilts):
        along = (way * np.cross(axis, UP)).sum(axis=1)
        yield Column(_torques(blocks, (pressed * along)[:, None] * way), float(size))


def _supported(blocks: Blocks, place: int, way: Array, friction: float) -> Iterator[Column]:
    """What a support may do in one block: press, and rub with that; push aside, and turn."""
    aside = np.cross(UP, way)
    forces = [(UP - friction * way, np.zeros(3)), (aside, np.zeros(3))]
    forces += [(np.zeros(3), axis) for axis in np.eye(3)]
    for force, moment in forces:
        torque = np.zeros_like(blocks.q)
        torque[place] = blocks.maps[place] @ np.concatenate([force, moment])
        yield Column(torque, ANY_FORCE)


def _of_weight(carried: Carried, mass: float, also: Array | None = None) -> Sequence[Column]:
    """Of a kilogram, and of a metre of its lever along each of the object's axes; `also` (n,) N/kg:
    where its weight is borne by the hand and the support together."""
    pull = carried.pull if also is None else carried.pull + also[:, None] * UP
    columns = [Column(_torques(carried.blocks, pull), ANY_MASS)]
    for axis in range(3):
        moment = np.cross(carried.axes[:, :, axis], mass * carried.pull)
        columns.append(Column(_torques(carried.blocks, np.zeros_like(pull), moment), ANY_LEVER))
    return columns


def _torques(blocks: Blocks, force: Array, moment: Array | None = None) -> Array:
    """(n, 7) N m of forces (n, 3) N, and moments (n, 3) N m, at the TCP."""
    turned = np.zeros_like(force) if moment is None else moment
    wrench = np.concatenate([force, turned], axis=1)
    return np.einsum("njk,nk->nj", blocks.maps, wrench)


def _errors(
    trace: Trace,
    carried: Carried,
    mass: float,
    arm: RobotDescription,
    noise: NoiseModel,
    also: Array | float = 0.0,
    borne: Array | float = 0.0,
) -> Sequence[Column]:
    """`also` as in `_of_weight`; `borne` (n, 7) N m that a support makes of what it bears."""
    pull = carried.pull + np.reshape(also, (-1, 1)) * UP
    torque = _torques(carried.blocks, mass * pull) + borne
    load = Hanging(torque, mass * (np.abs(pull).max(axis=1) > 0.0))
    return errors(carried.blocks, trace.samples, load, arm, noise, trace.gravity)


def _carried(trace: Trace, name: str, standing: Array) -> Carried | None:
    found = blocks(trace)
    if found is None:
        return None
    load = load_rows(trace, name)
    away = apart(trace)
    hangs = load.loaded & away & lifted(trace, load)
    empty, held = found.all(load.empty & away), found.all(load.loaded)
    hanging = found.all(hangs)
    pull = hanging[:, None] * (found.acceleration + trace.gravity * UP)
    return Carried(found, pull, _axes(found, held, standing), hanging | empty, held)


def _axes(blocks: Blocks, held: Mask, standing: Array) -> Array:
    """(n, 3, 3) the object's axes: they turn with the hand while it is held."""
    axes = np.broadcast_to(standing, blocks.rotation.shape).copy()
    now = standing
    for rows in runs(held):
        in_hand = blocks.rotation[rows.start].T @ now
        axes[rows] = blocks.rotation[rows] @ in_hand
        now = axes[rows.stop - 1]
    return axes
