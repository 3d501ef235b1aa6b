"""The least that can be known of what hung on the hand: its mass, its centre of mass, and what it
rubbed with along its support."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from bench.bounds.blocks import Blocks, Column, blocks, covariance
from bench.bounds.errors import Hanging, deviation, errors
from palpate.common.pose import Array
from palpate.estimation.load_blocks import rows_above_lift, rows_in_free_air
from palpate.estimation.load_noise import load_rows
from palpate.estimation.motion import Mask, runs
from palpate.robots.description import RobotDescription
from palpate.robots.simulated.noise.model import ModelErrors, NoiseModel
from palpate.trace.samples import Trace

ANY_MASS, ANY_LEVER, ANY_FORCE, ANY_RATIO = 10.0, 1.0, 1e3, 10.0
"""kg, m, N or N m, and a coefficient: standard deviations of wide priors."""
SLIDES, PRESSED = 5e-3, 1.0
"""Least speed (m/s) and normal force (N) of an object that slides on its support."""
LEVEL = 1e-2
"""Square of the unknown part of the closing direction, below which a grasp adds no information."""
UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, slots=True, eq=False)
class Carried:
    """Blocks of a trace in which an object was carried.

    Attributes:
        pull: (n, 3) N of a kilogram of it while it hangs free, else zero.
        axes: (n, 3, 3) the object's axes in the world while it is held.
        free: (n,) blocks without contact: the hand is empty, or the object hangs.
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
    """Least standard deviations of the mass (kg) and of the centre of mass (3,) (m, in the object's
    axes with the rotation matrix `standing`); None for a trace without the arm's kinematics.

    Args:
        trace: of the whole run.
        name: of the object.
        standing: rotation matrix of the object before the run.
        mass: true mass, kg, at which the equations are linearised.
        arm: the nominal robot.
        noise: noise model of the run.
        place: horizontal accuracy of the object's pose, m (1 sigma) along each axis.
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
    return float(stds[0]), np.hypot(stds[1:], place * _unmeasured(carried, standing))


def _unmeasured(carried: Carried, standing: Array) -> Array:
    """Share of a horizontal displacement that stays unknown, (3,) along the object's axes: fingers that
    close on it measure the component along their closing direction."""
    unknown = standing.T @ np.diag([1.0, 1.0, 0.0]) @ standing
    for rows in runs(carried.held):
        closing = carried.axes[rows.start].T @ carried.blocks.rotation[rows.start][:, 1]
        measured = unknown @ closing
        if (size := float(closing @ measured)) > LEVEL:
            unknown = unknown - np.outer(measured, measured) / size
    return np.sqrt(np.clip(np.diag(unknown), 0.0, None))


def of_friction(
    trace: Trace,
    name: str,
    standing: Array,
    about: tuple[float, float],
    arm: RobotDescription,
    noise: NoiseModel,
) -> float | None:
    """Least standard deviation of the friction coefficient of an object that slides; None if it did
    not slide.

    Unknown are its weight, and the wrench of the support except for the force along the motion. Known are
    that nothing else holds the object, that friction is uniform, and that the support is level; not
    the tilt of the arm's own frame.

    `about`: true mass (kg) and friction, at which the equations are linearised.
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


def _leaning(blocks: Blocks, pressed: Array, way: Array, model: ModelErrors) -> Iterator[Column]:
    """Force along the motion on a support that appears to lean, by a tilt of the base or by encoder
    zeros."""
    zeros = zip(
        blocks.maps[:, :, 3:].transpose(1, 0, 2), deviation(model.joint_offset), strict=True
    )
    tilts = zip(blocks.turn.T, deviation(model.base_tilt), strict=False)
    for axis, size in (*zeros, *tilts):
        along = (way * np.cross(axis, UP)).sum(axis=1)
        yield Column(_torques(blocks, (pressed * along)[:, None] * way), float(size))


def _supported(blocks: Blocks, place: int, way: Array, friction: float) -> Iterator[Column]:
    """Unknown wrench of the support in one block: normal force with its friction, lateral force, moments."""
    aside = np.cross(UP, way)
    forces = [(UP - friction * way, np.zeros(3)), (aside, np.zeros(3))]
    forces += [(np.zeros(3), axis) for axis in np.eye(3)]
    for force, moment in forces:
        torque = np.zeros_like(blocks.q)
        torque[place] = blocks.maps[place] @ np.concatenate([force, moment])
        yield Column(torque, ANY_FORCE)


def _of_weight(carried: Carried, mass: float, also: Array | None = None) -> Sequence[Column]:
    """Columns of a kilogram, and of a metre of its lever along each of the object's axes; `also` (n,)
    N/kg: weight that hand and support bear together."""
    pull = carried.pull if also is None else carried.pull + also[:, None] * UP
    columns = [Column(_torques(carried.blocks, pull), ANY_MASS)]
    for axis in range(3):
        moment = np.cross(carried.axes[:, :, axis], mass * carried.pull)
        columns.append(Column(_torques(carried.blocks, np.zeros_like(pull), moment), ANY_LEVER))
    return columns


def _torques(blocks: Blocks, force: Array, moment: Array | None = None) -> Array:
    """Joint torques (n, 7) N m of forces (n, 3) N and moments (n, 3) N m at the TCP."""
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
    """Columns of the arm's errors; `also` as in `_of_weight`; `borne` (n, 7) N m from the support."""
    pull = carried.pull + np.reshape(also, (-1, 1)) * UP
    torque = _torques(carried.blocks, mass * pull) + borne
    load = Hanging(torque, mass * (np.abs(pull).max(axis=1) > 0.0))
    return errors(carried.blocks, trace.samples, load, arm, noise, trace.gravity)


def _carried(trace: Trace, name: str, standing: Array) -> Carried | None:
    found = blocks(trace)
    if found is None:
        return None
    load = load_rows(trace, name)
    away = rows_in_free_air(trace)
    hangs = load.loaded & away & rows_above_lift(trace, load)
    empty, held = found.all(load.empty & away), found.all(load.loaded)
    hanging = found.all(hangs)
    pull = hanging[:, None] * (found.acceleration + trace.gravity * UP)
    return Carried(found, pull, _axes(found, held, standing), hanging | empty, held)


def _axes(blocks: Blocks, held: Mask, standing: Array) -> Array:
    """The object's axes (n, 3, 3): they turn with the hand while it is held."""
    axes = np.broadcast_to(standing, blocks.rotation.shape).copy()
    now = standing
    for rows in runs(held):
        in_hand = blocks.rotation[rows.start].T @ now
        axes[rows] = blocks.rotation[rows] @ in_hand
        now = axes[rows.stop - 1]
    return axes
