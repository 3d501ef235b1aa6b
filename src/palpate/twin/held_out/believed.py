"""Believed wrench of an object on the hand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from palpate.estimation import tuning
from palpate.estimation.balance import BELIEVED, accuracy
from palpate.estimation.estimate import Estimate
from palpate.estimation.holds import pose_in_hand
from palpate.estimation.load.causes import LINK
from palpate.estimation.motion import mean_pose
from palpate.geometry.pose import Array, Pose
from palpate.mjcf.inertial import whole
from palpate.scene.scene import Scene
from palpate.trace.recording import Recording
from palpate.trace.samples import Trace
from palpate.twin.held_out.prediction import Wrench


@dataclass(frozen=True, slots=True, eq=False)
class Known:
    """A value (n,), the standard deviation (n,) of its own, and what one of each gain did (n, m)."""

    value: Array
    own: Array
    gains: Array


@dataclass(frozen=True, slots=True, eq=False)
class Hanging:
    """Horizontal lever of the load from the TCP: (2,) m, its covariance (2, 2), and the effect of
    gains on it (2, m)."""

    offset: Array
    covariance: Array
    gains: Array


def known(
    estimate: Estimate | None, stated: tuple[float, ...] | None, signals: int
) -> Known | None:
    """Value fitted without the motion, else the one that the scene states."""
    if estimate is None and stated is not None:
        return Known(np.array(stated), np.zeros(len(stated)), np.zeros((len(stated), signals)))
    if estimate is None or not estimate.identified:
        return None
    # What all grasps have in common is in the motion as well, but for what was believed before, and
    # what the links weigh, which the empty hand's motion shows.
    apart = (BELIEVED, LINK)
    common = tuple(one for one in estimate.shared if not one.cause.startswith(apart))
    alike = replace(estimate, shared=common).shared_std
    own = np.sqrt(np.maximum(estimate.stds**2 - alike**2, 0.0))
    effects = {shared.cause: shared.effect for shared in estimate.shared}
    nothing = (0.0,) * len(own)
    columns = [effects.get(f"gain of joint {i + 1}", nothing) for i in range(signals)]
    return Known(estimate.values, own, np.array(columns).T)


def besides(fitted: Sequence[Estimate], signals: int) -> Known | None:
    """The mass that was found together with a centre of mass or an inertia."""
    for estimate in fitted:
        found = estimate.parts.get("mass")
        if estimate.identified and found is not None:
            return Known(np.array([found.value]), np.array([found.std]), np.zeros((1, signals)))
    return None


def hanging_of(
    scene: Scene, trace: Trace, name: str, recording: Recording, fitted: Estimate | None
) -> Hanging:
    """By the centre of mass that was fitted or is stated, else by the one that MuJoCo would infer,
    which then is known no better than before it was measured."""
    body, signals = scene.bodies[name], len(trace.hand.joints)
    pose_world_tcp = mean_pose(trace.of(recording))
    pose_world_body: Pose = pose_world_tcp @ pose_in_hand(trace, recording, body)
    across = pose_world_body.rotation[:2]
    # Where grasps were compared, what they have in common is in none of the differences.
    place = tuning.GRASP_SHIFT**2 + 2.0 * trace.hand.pose_repeatability**2
    centre = known(fitted, body.known.get("com"), signals)
    if fitted is None or centre is None:
        place += accuracy(body) ** 2 + trace.hand.tip_offset_std**2
    if centre is None:
        spread = tuning.COM_PRIOR * np.maximum(body.size, 1e-3)
        inferred = whole(scene.spec().compile(), name).com
        centre = Known(inferred, spread, np.zeros((3, signals)))
    offset = (pose_world_body.position - pose_world_tcp.position)[:2] + across @ centre.value
    covariance = across @ np.diag(centre.own**2) @ across.T + place * np.eye(2)
    return Hanging(offset, covariance, across @ centre.gains)


def wrench_of(mass: Known, hanging: Hanging, gravity: float) -> Wrench:
    """The weight F at r = (x, y) from the TCP has the moment (y F, -x F)."""
    force = float(mass.value[0]) * gravity
    x, y = hanging.offset.tolist()
    of_force = np.array([1.0, y, -x])
    of_offset = force * np.array([[0.0, 0.0], [0.0, 1.0], [-1.0, 0.0]])
    own = (float(mass.own[0]) * gravity) ** 2 * np.outer(of_force, of_force)
    gains = np.outer(of_force, gravity * mass.gains[0]) + of_offset @ hanging.gains
    return Wrench(force * of_force, own + of_offset @ hanging.covariance @ of_offset.T, gains)
