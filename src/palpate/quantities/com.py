"""Centre of mass of a held object, from the torque it puts on the hand at several grasps."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import ClassVar

import numpy as np

from palpate.estimation import tuning
from palpate.estimation.agreement import FitTest
from palpate.estimation.balance import Grasps, accuracy, balance, balance_views, grasps_of
from palpate.estimation.estimate import Estimate, Part, half95, not_identified
from palpate.estimation.holds import held
from palpate.geometry.pose import Array
from palpate.mjcf.body import Body, BodyDescription
from palpate.mjcf.document import UNKNOWN, tokens
from palpate.mjcf.edits import Slot
from palpate.mjcf.inertial.stated import com_of, lacks
from palpate.mjcf.inertial.written import Statement
from palpate.mjcf.roles.elements import Elements
from palpate.parameter import Parameter
from palpate.quantities.contacts import tied_to
from palpate.quantities.evidence import Evidence
from palpate.quantities.quantity import Logged, Prior, Quantity, Status, Values
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
        ),
        "de": ("schwerpunkt", "massenmittelpunkt", "massenschwerpunkt"),
        "es": ("centro de masa", "centro de masas", "centro de gravedad"),
        "fr": ("centre de masse", "centre de gravité"),
        "it": ("centro di massa", "baricentro", "centro di gravità"),
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
        Evidence(
            FORCES,
            "in a Parallel with Turn while it is held in free air",
            activity=("turning",),
            holding=True,
            optional=True,
        ),
        Evidence(
            FORCES,
            "in a Parallel with Turn at the same pose with the empty hand",
            activity=("turning",),
            empty=True,
            optional=True,
        ),
    )
    how = evidence[0].how
    derived = True
    estimators: ClassVar = {"torque": "palpate.quantities.com:estimate_com"}

    def status(self, body: BodyDescription) -> Status:
        if body.elements.inertial is None:
            return "assumed"
        return "missing" if lacks(body.elements.inertial, "pos") else "known"

    def known(self, body: BodyDescription) -> tuple[float, ...]:
        return com_of(body)

    def overruled(self, body: BodyDescription) -> str:
        return tied_to(body)

    def slots(self, elements: Elements) -> Iterator[Slot]:
        if elements.inertial is not None:
            yield Slot(elements.inertial, "pos", "0", required=3)

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


def _in_space(centres: tuple[str, ...]) -> Iterator[str]:
    """Names of a centre of mass that include its height."""
    for centre in centres:
        for whose in ("its", "the"):
            yield f"height of {whose} {centre}"
        for where in ("in 3d", "in three dimensions", "in all three axes", "along all three axes"):
            yield f"{centre} {where}"
        for kind in ("3d", "three dimensional", "full"):
            yield f"{kind} {centre}"


class CentreOfMassInSpace(CentreOfMass):
    """Centre of mass along gravity, too, which takes holds at a tilt; it stands where `com`
    does."""

    id = "com_3d"
    label = "centre of mass in all three axes"
    words: ClassVar = {"en": tuple(_in_space(CentreOfMass.words["en"]))}
    evidence = (
        CentreOfMass.evidence[0],
        Evidence(
            FORCES,
            "in a Parallel with Tilt while it is held in free air",
            activity=("tilting",),
            holding=True,
        ),
        Evidence(
            FORCES,
            "in a Parallel with Tilt at the same pose with the empty hand",
            activity=("tilting",),
            empty=True,
        ),
    )
    how = f"{evidence[0].how}, and in a Parallel with Tilt, held in free air and empty"
    stands_for = "com"

    def status(self, body: BodyDescription) -> Status:
        """The file's centre of mass is `com`'s."""
        return "not applicable"

    def slots(self, elements: Elements) -> Iterator[Slot]:
        yield from ()

    def is_told_in_part(self, parameter: Parameter, logged: Iterable[Logged]) -> bool:
        """Without tilts, all but where it lies along gravity."""
        return CentreOfMass().is_evidenced(parameter, logged)


def estimate_com(trace: Trace, parameter: Parameter, body: Body | None) -> Estimate:
    """Centre of mass in the body frame from all recordings of the object held still in the air.

    A still grasp tells where the centre of mass is horizontally, not along gravity: that coordinate
    keeps the geometric centre with its prior spread, and the method says so. `parts` holds the `mass`
    from all grasps, and the `least torque`.
    """
    found = None if body is None else held(trace, body)
    if body is None or found is None:
        return not_identified(
            parameter, UNIT, "No recording shows the object held still in the air."
        )
    load = found.load
    grasps = grasps_of(trace, found, body, body.centre)
    for _ in range(tuning.COM_ITERATIONS):
        # What a turn in the grip does depends on where the centre of mass is.
        centre, *_ = balance(grasps, body)
        grasps = grasps_of(trace, found, body, centre)
    centre, covariance, agree, shared = balance(grasps, body)
    weight, std = load.force / trace.gravity, load.force_std / trace.gravity
    torques = [float(np.hypot(*moment)) for moment in load.value[1:].reshape(-1, 2)]
    parts = {
        "mass": Part(weight, std, "kg"),
        "least torque": Part(min(torques), 0.0, "N·m"),
    }
    value = centre, np.sqrt(np.diag(covariance))
    tests = (*load.tests, agree)
    level = len({hold.grasp for hold in found.holds})
    where = _where(level, len(found.holds) - level, found.turned)
    made = _estimate(parameter, body, grasps, where, value, parts, tests)
    method = made.method + WHOLE * bool(found.links)
    views = tuple(balance_views(grasps, found, centre))
    return replace(made, method=method, shared=shared, freedom=grasps.freedom, views=views)


WHOLE = (
    " Moments are from all that the arm did in free air around that: its noise alone accounts for what a model "
    "of its links, sensors and friction leaves there."
)


def _estimate(
    parameter: Parameter,
    body: Body,
    grasps: Grasps,
    where: str,
    found: tuple[Array, Array],
    parts: Mapping[str, Part],
    tests: tuple[FitTest, ...],
) -> Estimate:
    centre, std = found
    blind = std > tuning.BLIND * tuning.COM_PRIOR * body.size
    value = np.where(blind, body.centre, centre)
    half = std * half95(grasps.freedom)
    return Estimate(
        parameter,
        UNIT,
        value,
        std,
        np.column_stack([value - half, value + half]),
        _method(where, blind.tolist(), body),
        tuple(grasps.recordings),
        "prior-dominated" if bool(blind.all()) else "identified",
        parts,
        tests,
        unseen=tuple(np.flatnonzero(blind).tolist()),
    )


def _where(grasps: int, tilts: int, turned: bool) -> str:
    """Of so many grasps held level, and so many bits of tilts of what was held in one of them."""
    held = f"at {grasps} grasp{'s' * (grasps > 1)}"
    if turned:
        held += ", and along a turn about the vertical"
    if tilts:
        held += f", and in {tilts} bits of tilts"
    return held


def _method(where: str, blind: Sequence[bool], body: Body) -> str:
    said = "as stated" if body.accuracy else "assumed, as poses.yaml states no accuracy"
    method = (
        f"Horizontal moment over weight of the object held still {where}, each against the empty hand, and from "
        "where the scene has the object, whose error along the fingers, "
        f"{1e3 * accuracy(body):.2g} mm (1 sigma, {said}), no grasp shows"
    )
    axes = " and ".join(axis for axis, unseen in zip("xyz", blind, strict=True) if unseen)
    if axes:
        method += f"; {axes} lies along gravity in every grasp and keeps the geometric centre (prior-dominated)"
    return method + "."
