"""Centre of mass of a held object, from the torque it puts on the hand at several grasps."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from palpate.estimation import tuning
from palpate.estimation.estimate import Estimate, Part, not_identified
from palpate.estimation.load import FORCE_Z, TORQUE_X, TORQUE_Y, fit_load
from palpate.estimation.segments import segments
from palpate.estimation.weighing import uniform_std, weigh
from palpate.estimation.windows import load_of, mean_pose
from palpate.geometry.pose import Array, Pose
from palpate.mjcf.body import Body, BodyDescription
from palpate.mjcf.document import UNKNOWN, tokens
from palpate.mjcf.edits import Slot
from palpate.mjcf.inertial import Statement, lacks
from palpate.mjcf.roles import Elements
from palpate.parameter import Parameter
from palpate.quantities.evidence import Evidence
from palpate.quantities.quantity import Prior, Quantity, Status, Values
from palpate.trace.recording import Recording
from palpate.trace.samples import FORCES, Trace

UNIT = "m"

TRUE_SHIFT = 0.1
"""Part of the object's extent by which a hidden centre of mass is off, at most, per axis."""


class CentreOfMass(Quantity):
    """Centre of mass in the body frame, where `<inertial>` has it."""

    id = "com"
    unit = UNIT
    subject = "object"
    label = "centre of mass"
    words: ClassVar = {
        "en": (
            "centre of mass",
            "center of mass",
            "centre of gravity",
            "center of gravity",
            "com",
            "cog",
            "balance point",
        )
    }
    size = 3
    evidence = (
        Evidence(
            FORCES,
            "MeasureForces while held still at three grasp offsets along its long axis",
            activity=("still",),
            holding=True,
            distinct="grasp",
            count=3,
        ),
    )
    derived = True
    estimators: ClassVar = {"torque": "palpate.quantities.com:estimate_com"}

    def status(self, body: BodyDescription) -> Status:
        if body.elements.inertial is None:
            return "assumed"
        return "missing" if lacks(body.elements.inertial, "pos") else "known"

    def known(self, body: BodyDescription) -> tuple[float, ...]:
        return tuple(float(v) for v in body.shapes.model.body(body.name).ipos)

    def slots(self, elements: Elements) -> Iterator[Slot]:
        if elements.inertial is not None:
            yield Slot(elements.inertial, "pos", "0")

    def prior(self, body: BodyDescription, believed: Values) -> Prior:
        """The middle of the geoms, except for the numbers that are stated."""
        stated = [UNKNOWN] * 3
        if body.elements.inertial is not None:
            stated = tokens(body.elements.inertial.get("pos")) or stated
        mean: list[float] = []
        std: list[float] = []
        for part, centre, extent in zip(stated, *body.box(), strict=True):
            if part == UNKNOWN:
                mean.append(float(centre))
                std.append(tuning.COM_PRIOR * max(float(extent), 1e-3))
            else:
                mean.append(float(part))
                std.append(0.0)
        return Prior(tuple(mean), tuple(std))

    def draw(self, body: Body, prior: Prior, random: np.random.Generator) -> tuple[float, ...]:
        """Up to `TRUE_SHIFT` of the object's extents off."""
        scale = TRUE_SHIFT * body.size
        shift = random.uniform(-scale, scale) * (np.array(prior.std) > 0)
        return tuple(float(v) for v in np.array(prior.mean) + shift)

    def write(
        self, body: BodyDescription, value: tuple[float, ...], std: float | None
    ) -> Iterator[Statement]:
        """Into `<inertial>`, made when absent, with the inertia of the geoms about the new
        centre."""
        yield Statement(com=value, std=std)


@dataclass(frozen=True, slots=True, eq=False)
class _Grasp:
    """What one still recording says.

    Attributes:
        recording: the evidence.
        torque: N m, magnitude of the load's horizontal moment about the TCP.
        rows: (2, 3) and right: (2,): linear equations for the centre of mass in the body frame, m.
        std: (2,) m, of each.
    """

    recording: Recording
    torque: float
    rows: Array
    right: Array
    std: Array


def estimate_com(trace: Trace, parameter: Parameter, body: Body | None) -> Estimate:
    """Centre of mass in the body frame from all recordings of the object held still in the air.

    A still grasp tells where the centre of mass is horizontally, not along gravity: that coordinate
    keeps the geometric centre with its prior spread, and the method says so. `parts` holds `mass`
    from the grasp with the least torque, and that `least torque`.
    """
    held = _held_still(trace, parameter.object)
    if body is None or not held:
        return not_identified(
            parameter, UNIT, "No recording shows the object held still in the air."
        )
    grasps = [_grasp(trace, recording, body) for recording in held]
    centre, covariance = _solve(grasps, body)
    # Unequal gains of the joints shift all grasps alike, so that more of them do not help.
    common = uniform_std(tuning.GAIN_LEVER * trace.hand.torque_gain)
    std = np.sqrt(np.diag(covariance) + common**2)
    best = min(grasps, key=lambda grasp: grasp.torque)
    parts = {
        "mass": weigh(trace, best.recording).part,
        "least torque": Part(best.torque, 0.0, "N·m"),
    }
    return _estimate(parameter, body, grasps, (centre, std), parts)


def _held_still(trace: Trace, name: str) -> list[Recording]:
    found: list[Recording] = []
    for recording in trace.recordings:
        context = recording.context
        still = recording.buffer == FORCES and context.activity == "still"
        if still and context.holding == name:
            found.append(recording)
    return found


def _grasp(trace: Trace, recording: Recording, body: Body) -> _Grasp:
    """Two equations for the centre of mass c in the body frame.

    The load hangs at r = (-M_y, M_x) / F from the TCP, seen from above, because its moment about
    the TCP is M = r x (0, 0, F). That point is p + R c in the world, with p and R the position and
    rotation of the object in the hand: two rows of R c = TCP + r - p.
    """
    found = segments(trace, recording)
    hand, gravity = trace.hand, trace.gravity
    weight, torque_x, torque_y = (
        fit_load(found, axis, gravity, hand) for axis in (FORCE_Z, TORQUE_X, TORQUE_Y)
    )
    pose_world_tcp = mean_pose(trace.of(recording))
    pose_world_body = pose_world_tcp @ _pose_tcp_body(trace, recording, body)
    offset = np.array([-torque_y.value, torque_x.value]) / weight.value
    noise = np.array([torque_y.std / weight.value, torque_x.std / weight.value])
    std = np.hypot(noise, np.abs(offset) * (weight.std / weight.value))
    return _Grasp(
        recording,
        float(np.hypot(torque_x.value, torque_y.value)),
        pose_world_body.rotation[:2],
        pose_world_tcp.position[:2] + offset - pose_world_body.position[:2],
        np.hypot(std, tuning.GRASP_ACCURACY),
    )


def _pose_tcp_body(trace: Trace, recording: Recording, body: Body) -> Pose:
    """The object in the hand: where it was believed to stand when the measured hand closed on
    it."""
    grasps = load_of(trace, body.name).grasps
    before = [time for time in grasps if time <= recording.start]
    if not before:
        return mean_pose(trace.of(recording)).inverse() @ body.pose_world
    at_grasp = trace.samples.between(before[-1] - tuning.AT_GRASP, before[-1] + tuning.AT_GRASP)
    return mean_pose(at_grasp).inverse() @ body.pose_world


def _solve(grasps: Sequence[_Grasp], body: Body) -> tuple[Array, Array]:
    """The centre of mass (3,) m and its covariance: least squares around a prior at the geometric
    centre, with the covariance inflated where the grasps disagree (Birge ratio)."""
    rows = np.vstack([grasp.rows for grasp in grasps])
    right = np.concatenate([grasp.right for grasp in grasps])
    weight = np.concatenate([grasp.std for grasp in grasps]) ** -2.0
    spread = tuning.COM_PRIOR * np.maximum(body.size, 1e-3)
    prior: Array = np.diag(spread**-2.0).astype(np.float64)
    information: Array = (rows.T * weight) @ rows + prior
    covariance: Array = np.linalg.inv(information).astype(np.float64)
    centre = covariance @ ((rows.T * weight) @ right + prior @ body.centre)
    misfit = float(np.sqrt(np.mean((right - rows @ centre) ** 2 * weight)))
    inflated: Array = covariance * max(1.0, misfit) ** 2
    return centre, inflated


def _estimate(
    parameter: Parameter,
    body: Body,
    grasps: Sequence[_Grasp],
    found: tuple[Array, Array],
    parts: Mapping[str, Part],
) -> Estimate:
    centre, std = found
    blind = std > tuning.BLIND * tuning.COM_PRIOR * body.size
    return Estimate.normal(
        parameter,
        UNIT,
        np.where(blind, body.centre, centre),
        std,
        _method(len(grasps), blind.tolist()),
        tuple(grasp.recording for grasp in grasps),
        "prior-dominated" if bool(blind.all()) else "identified",
        parts,
    )


def _method(grasps: int, blind: Sequence[bool]) -> str:
    method = (
        f"Horizontal moment over weight of the object held still at {grasps} "
        f"grasp{'s' * (grasps > 1)}, each against the empty hand"
    )
    axes = " and ".join(axis for axis, unseen in zip("xyz", blind, strict=True) if unseen)
    if axes:
        method += f"; {axes} lies along gravity in every grasp and keeps the geometric centre (prior-dominated)"
    return method + "."
