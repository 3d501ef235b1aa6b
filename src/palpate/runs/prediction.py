"""Prediction of the joint torques that an object causes in a motion, from its estimates.

The motion consists of loaded rests and passes y. They are predicted from those of the empty hand
along the same path, y_0, and from the load's wrench w = (F, M_x, M_y):

    y = X w + E[bias | y_0] + error,   S = cov(bias | y_0) + X cov(w) X^T + gains

The bias of the arm (friction, drift, noise) has the covariance that a weighing assigns to it
(`estimation.load_equations`). Its part in the signals of the empty hand is subtracted by the
conditional normal distribution (Bishop, Pattern Recognition and Machine Learning, section 2.3.1). A
gain error acts on the belief and on the motion alike: only the difference counts.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.common.pose import Array
from palpate.estimation.balance import BELIEVED, COM_PRIOR, GRASP_SHIFT, accuracy
from palpate.estimation.estimate import Estimate
from palpate.estimation.holds import pose_in_hand
from palpate.estimation.joint_causes import LINK, TILT
from palpate.estimation.joint_friction import FLOOR, JOINT_LEVEL, SLIP_ANGLES
from palpate.estimation.load_equations import (
    FORCE_Z,
    SIDEWAYS,
    TORQUE_X,
    TORQUE_Y,
    WeighingRows,
    equations,
)
from palpate.estimation.motion import STEADY, mean_pose
from palpate.estimation.segments import Segment, Weighing
from palpate.estimation.wrench_observation import TORQUE_LEVER, gain_root
from palpate.mjcf.inertial import total_inertia
from palpate.scene.scene import Scene
from palpate.trace.recording import NominalHand, Recording
from palpate.trace.samples import Trace

# Columns of a wrench that a weight has: the vertical force and two horizontal moments.
LOAD = (FORCE_Z, TORQUE_X, TORQUE_Y)


@dataclass(frozen=True, slots=True, eq=False)
class BelievedValue:
    """A believed value.

    It is a mass, kg; a centre of mass, m; the load's horizontal lever from the TCP, m; or its
    wrench on the hand (F in N, M_x and M_y about the TCP in N m, world axes).
    """

    value: Array  # (n,)
    covariance: Array  # (n, n) of errors that the motion does not share, without the gains
    # (n, m) change of the value by one standard deviation of the gain of each of m signals.
    gains: Array


@dataclass(frozen=True, slots=True, eq=False)
class PredictedSignal:
    """Prediction of a held-out motion in n rows: k bins for each of m signals."""

    t: Array  # (k,) s
    measured: Array  # (m, k) effect of the load on the signals, from the loaded and the empty hand
    expected: Array  # (m, k) effect of the believed load
    residual: Array  # (n,) measured less expected
    covariance: Array  # (n, n) of the residual
    design: Array  # (n, 3) rows of unit wrenches
    freedom: float  # degrees of freedom of the noise

    @property
    def misfit(self) -> float:
        """chi-squared of the residual, r^T S^-1 r."""
        return float(self.residual @ np.linalg.solve(self.covariance, self.residual))

    def missing_wrench(self) -> tuple[Array, Array]:
        """Fit the wrench that the belief lacks to the residual, by generalized least squares:

            dw = (X^T S^-1 X)^-1 X^T S^-1 r

        Returns:
            The wrench (3,) and its covariance (3, 3).
        """
        # Information matrix and score of the wrench.
        information = self.design.T @ np.linalg.solve(self.covariance, self.design)
        covariance: Array = np.linalg.inv(information).astype(np.float64)
        solved = np.linalg.solve(self.covariance, self.residual)
        return covariance @ self.design.T @ solved, covariance

    def instead(self, wrench: Array) -> PredictedSignal:
        """Predict the same motion for another `wrench` (3,) with the same covariance."""
        # Only the expected part changes.
        expected = self.design @ wrench
        residual = self.measured.ravel() - expected
        return replace(self, expected=expected.reshape(self.measured.shape), residual=residual)


def known_value(
    estimate: Estimate | None, stated: tuple[float, ...] | None, signals: int
) -> BelievedValue | None:
    """Convert the estimate made without the motion, else the value that the scene states; None without either."""
    # A stated value counts as exact.
    if estimate is None and stated is not None:
        n = len(stated)
        return BelievedValue(np.array(stated), np.zeros((n, n)), np.zeros((n, signals)))
    if estimate is None or not estimate.identified:
        return None
    # Leave out causes that all grasps share: they act in the motion as well, and cancel. Keep
    # priors, and keep the weights of the links, which the motion of the empty hand contains.
    separate = (BELIEVED, LINK)
    common = tuple(part for part in estimate.shared if not part.cause.startswith(separate))
    alike = replace(estimate, shared=common).shared_std
    own = np.sqrt(np.maximum(estimate.stds**2 - alike**2, 0.0))
    # Effects of the gains stay separate: they correlate the belief with the motion.
    effects = {part.cause: part.effect for part in estimate.shared}
    nothing = (0.0,) * len(own)
    columns = [effects.get(f"gain of joint {i + 1}", nothing) for i in range(signals)]
    return BelievedValue(estimate.values, np.diag(own**2), np.array(columns).T)


def mass_part(fitted: Sequence[Estimate], signals: int) -> BelievedValue | None:
    """Find the mass that is a part of the estimate of a centre of mass or an inertia. The mass
    itself need not be identified.
    """
    for estimate in fitted:
        mass = estimate.parts.get("mass")
        if estimate.verdict != "contradicted" and mass is not None:
            covariance = np.array([[mass.std]]) ** 2
            return BelievedValue(np.array([mass.value]), covariance, np.zeros((1, signals)))
    return None


def lever_of(
    scene: Scene, trace: Trace, name: str, recording: Recording, fitted: Estimate | None
) -> BelievedValue:
    """Horizontal lever of the load, from the fitted or stated centre of mass.

    Without either, it is the centre that MuJoCo would infer, with the accuracy of a prior.
    """
    # Pose of the body in the hand, from the recording.
    body, signals = scene.bodies[name], len(trace.hand.joints)
    pose_world_tcp = mean_pose(trace.of(recording))
    pose_world_body = pose_world_tcp @ pose_in_hand(trace, recording, body)
    horizontal = pose_world_body.rotation[:2]
    # Add the error of the grasp. Errors common to all grasps count only where no grasps were
    # compared.
    place = GRASP_SHIFT**2 + 2.0 * trace.hand.pose_repeatability**2
    centre = known_value(fitted, body.known.get("com"), signals)
    if fitted is None or centre is None:
        place += accuracy(body, pose_world_tcp.rotation[:, 0]) ** 2 + trace.hand.tip_offset_std**2
    # Without an estimate: MuJoCo's centre, with a share of the body's size as deviation.
    if centre is None:
        spread = COM_PRIOR * np.maximum(body.size, 1e-3)
        inferred = total_inertia(scene.spec().compile(), name).com
        centre = BelievedValue(inferred, np.diag(spread**2), np.zeros((3, signals)))
    # Horizontal offset from TCP to centre of mass, and its covariance by linear propagation.
    offset = (pose_world_body.position - pose_world_tcp.position)[:2] + horizontal @ centre.value
    covariance = horizontal @ centre.covariance @ horizontal.T + place * np.eye(2)
    return BelievedValue(offset, covariance, horizontal @ centre.gains)


def wrench_of(mass: BelievedValue, lever: BelievedValue, gravity: float) -> BelievedValue:
    """Wrench of the weight F at r = (x, y) from the TCP: the force F and the moment (y F, -x F)."""
    force = float(mass.value[0]) * gravity
    x, y = lever.value.tolist()
    # Propagate the errors by the derivatives of the wrench with respect to F and r.
    by_force = np.array([1.0, y, -x])
    by_offset = force * np.array([[0.0, 0.0], [0.0, 1.0], [-1.0, 0.0]])
    std = float(np.sqrt(mass.covariance[0, 0])) * gravity
    own = std**2 * np.outer(by_force, by_force)
    gains = np.outer(by_force, gravity * mass.gains[0]) + by_offset @ lever.gains
    return BelievedValue(force * by_force, own + by_offset @ lever.covariance @ by_offset.T, gains)


def predict_segments(
    weighing: Weighing,
    motion: Sequence[Segment],
    wrench: BelievedValue,
    gravity: float,
    hand: NominalHand,
) -> PredictedSignal | None:
    """Predict the segments of `motion` from the empty ones of `weighing`; None without either of them."""
    empty = [segment for segment in weighing.segments if not segment.loaded]
    if not motion or not empty:
        return None
    segments = [*motion, *empty]

    def bins(of: Callable[[Segment], NDArray[Any]]) -> NDArray[Any]:
        """A signal of all segments, bin by bin."""
        return np.concatenate([of(segment) for segment in segments])

    # Equations of the motion and the empty hand together, so that they share their errors.
    rows = equations(replace(weighing, segments=segments), gravity)
    signals = int(rows.signal.max()) + 1
    loaded = bins(lambda s: np.full(len(s.t), s.loaded))
    # Leave out accelerated samples, in which the inertia of the arm acts.
    steady = np.abs(bins(lambda s: s.acceleration)) < STEADY
    target = np.tile(loaded & steady, signals)
    given = np.tile(~loaded, signals)
    if not target.any():
        return None

    # Condition the target rows on the given ones: Bishop, equations 2.81 and 2.82.
    bias = bias_covariance(rows, wrench, hand, signals)
    cross = bias[np.ix_(given, target)]
    gain: Array = np.linalg.solve(bias[np.ix_(given, given)], cross).astype(np.float64).T
    remaining = bias[np.ix_(target, target)] - gain @ cross
    # Subtract the predicted bias from the target rows, and compare the rest with the load's effect.
    measured = rows.observed[target] - gain @ rows.observed[given]
    design = rows.wrench[:, LOAD][target]
    expected = design @ wrench.value
    return PredictedSignal(
        bins(lambda s: s.t)[loaded & steady],
        measured.reshape(signals, -1),
        expected.reshape(signals, -1),
        measured - expected,
        remaining + design @ wrench.covariance @ design.T,
        design=design,
        freedom=rows.freedom,
    )


def bias_covariance(
    rows: WeighingRows, wrench: BelievedValue, hand: NominalHand, signals: int
) -> Array:
    """Covariance of the arm's errors in n rows, (n, n): noise and drift, horizontal forces, gains, friction."""
    # Horizontal force of a tilted support, in proportion to the weight, plus the floor of the noise.
    design = rows.wrench[:, LOAD]
    tilt = TILT * abs(float(wrench.value[0])) + FLOOR
    sideways = rows.wrench[:, SIDEWAYS] * np.array([tilt, tilt, tilt * TORQUE_LEVER])
    # A gain error acts on the load's torques, and it acted on the estimate of the wrench.
    load_part = (design @ wrench.value)[:, None] * gain_root(hand, signals)[rows.signal]
    gained = load_part - design @ wrench.gains
    # Joint friction: the hysteresis of Dahl's model, and the wrench that sticks at rest.
    dahl = JOINT_LEVEL / len(SLIP_ANGLES) ** 0.5 * rows.dahl
    stuck = hand.force_repeatability * rows.stiction.stuck
    # Sum of the white noise and drift, and of all independent causes.
    bias = rows.root @ rows.root.T
    for causes in (sideways, gained, dahl, stuck):
        bias += causes @ causes.T
    return bias
