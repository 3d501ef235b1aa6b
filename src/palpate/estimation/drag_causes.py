"""Causes of the force along a drag: friction, the support, and the arm.

In a row of a drag, w is the direction (a unit vector), r the position of the hand, v the speed:

    f_t = mu N                                  friction, the unknown of interest; N is the normal force
        + N (w·θ)                               tilt θ of the support
        + N (a cos 2φ + a' sin 2φ)              anisotropic friction; φ is the angle of w
        + N (z·r) + N c log2 v                  friction that changes with position or speed
        + A                                     a force independent of the normal force, such as adhesion
        + w·(b + K r + ∇E3(r))                  a bias, and forces that change with position: springs, cables
        + Σ_j l_j s_j t_j + h_i                 friction in the arm's joints, with an own part h_i of drag i
        + Σ_j l_j τ_j g_j                       gains of the joints' sensors

The lever l_j is the force that a torque in joint j adds to f_t - mu N. The sign s_j is the direction of the
joint's last motion, t_j its friction torque, and τ_j its measured torque.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from palpate.common.pose import Array
from palpate.estimation.drags import Drag
from palpate.estimation.joint_causes import build_gain
from palpate.estimation.regression import Cause, PriorScale
from palpate.estimation.wrench_observation import WrenchObservation, gain_root
from palpate.trace.recording import NominalHand

FRICTION_PRIOR = 10.0
"""1 sigma of a friction coefficient: an uninformative prior. Sensitive: no."""
PULL = 20.0
"""N/m (1 sigma). Stiffness of a position-dependent force, such as a cable or a leash. A varying normal force reveals
it. Sensitive: friction 0.1 σ."""
BIAS_CURVATURE_STD = 0.02
"""N (1 sigma) at `HALF_WAY`. Curvature of the arm's bias along a slide. Sensitive: friction 0.2 σ, std ×0.9–1.1."""
HALF_WAY = 0.03
"""m. Half of the shortest slide planned for a friction. Sensitive: friction 0.3 σ, std ×0.9–1.1."""
SAME_LINE = 0.95
"""Cosine between the directions of two drags above which they share one line. Sensitive: no."""
ANOTHER = 0.2
"""Fraction (1 sigma) by which a joint's friction differs at the place of the drags. Sensitive: friction 0.1 σ, std
×0.9–1.1."""
ANOTHER_DRAG = 0.1
"""Fraction (1 sigma) by which a joint's friction differs in each drag. Sensitive: friction 0.1 σ, std ×0.9–1.1."""
DRAG_BIAS = 0.01
"""N (1 sigma). Bias of a single drag. Sensitive: hardly."""
HELD_FORCE_STD = 0.1
"""N (1 sigma). Force that holds an object independently of the normal force. Sensitive: friction 0.2 σ."""
SUPPORT_LEAN_STD = 0.005
"""rad (1 sigma). Tilt of a support. Floors may deviate by 3 mm/m (DIN 18202, quoted from memory), and tables rest on
floors. Sensitive: friction 0.3 σ, std ×0.8–1.2."""
REFERRED = 0.2
"""N (1 sigma). Bias of a force on the support relative to a reference some cm above. The link model is wrong by half
a per cent of some 40 N m at levers of half a metre. Between the two heights this error changes by about a fifth.
Sensitive: friction 0.1 σ, std ×0.9–1.2."""
KIND_BIAS = 0.3
"""N (1 sigma). Deviation of one segment kind's bias from the common one, with its slope and curvature along the path
(friction hysteresis). Sensitive: mass 0.08 σ; com 0.1 σ."""
SENSOR_BIAS = 0.05
"""N (1 sigma). Bias of a six-axis sensor on one line of motion: its drift, and cables of the hand. It has no joint
friction. Chosen, without a source. Sensitive: not tried."""
GAIN_RATIO = 0.8
"""Error (1 sigma) of a quotient of two forces, in half widths of a gain. Different joints carry the two forces, so the
error is sqrt(2) times a uniform one, 1/sqrt(3). Sensitive: friction std ×0.6–1.9."""
UNEVEN_SHARES = (0.0, 0.03, 0.1, 0.3)
"""Fractions (1 sigma) by which friction may vary with direction, position or speed. Sensitive: friction 0.07 σ, std
×0.7–1.2."""
LIKELY_UNEVEN = (0.91, 0.03, 0.03, 0.03)
"""Prior probabilities of `UNEVEN_SHARES`. Sensitive: friction 0.1 σ, std ×0.8–1.2."""

FRICTION, LEAN, AXES, PLACES, SPEED = (
    "friction",
    "lean of support",
    "friction by direction",
    "friction by place",
    "friction by speed",
)
HOLDS, PULLS, BIAS, BEND = (
    "what holds the object",
    "what pulls with the place",
    "bias",
    "bend of the bias along the way",
)
JOINTS, ONE_DRAG, CROSSED = "friction of joint", "friction of a drag", "cross-talk of the sensor"
"""Names of causes."""
UNEVEN = (AXES, PLACES, SPEED)
"""Causes of a friction that varies. Their prior is a share of the coefficient, which is learned."""
SUPPORT: tuple[tuple[str, slice, float, Literal["arm", "scene"] | None], ...] = (
    (FRICTION, slice(0, 1), FRICTION_PRIOR, None),
    (LEAN, slice(1, 3), SUPPORT_LEAN_STD, "scene"),
    (AXES, slice(3, 5), 1.0, None),
    (PLACES, slice(5, 7), 1.0, None),
    (SPEED, slice(7, 8), 1.0, None),
    (HOLDS, slice(8, 9), HELD_FORCE_STD, "scene"),
    (PULLS, slice(9, 12), PULL, "scene"),
    (BIAS, slice(12, 14), REFERRED, None),
    (BEND, slice(14, 18), BIAS_CURVATURE_STD, "arm"),
)
"""Name, columns of `support_columns`, prior deviation, and origin of each cause along a drag."""
UNEVEN_SCALE = PriorScale(UNEVEN, UNEVEN_SHARES, LIKELY_UNEVEN)


def middle_of(drags: Sequence[Drag]) -> Array:
    """Middle (2,), m, of the bounding box of all positions of steady sliding."""
    places = np.vstack([drag.place[drag.steady] for drag in drags])
    middle: Array = (places.max(axis=0) + places.min(axis=0)) / 2
    return middle


def usual_speed(drags: Sequence[Drag]) -> float:
    """Geometric mean of the commanded speeds in steady sliding, m/s."""
    speeds = np.concatenate([np.log2(drag.speed[drag.steady]) for drag in drags])
    return float(np.exp2(speeds.mean()))


def support_columns(drag: Drag, middle: Array, usual: float) -> Array:
    """Columns (n, 18) of `SUPPORT`; positions relative to `middle` (2,), m, speeds to `usual`, m/s."""
    # Position in units of half a slide, and the factors of direction: tilt, anisotropy, speed.
    x, y = ((drag.place - middle) / HALF_WAY).T
    wx, wy = drag.way
    normal, ones = drag.pressing[0], np.ones(len(drag.t))
    axes = [wx**2 - wy**2, 2.0 * wx * wy]
    speed = np.log2(drag.speed / usual)
    # Gradients of a quadratic and a cubic potential, projected on the drag: springs, and curvature of the bias.
    spring = [wx * x, wy * y, wx * y + wy * x]
    curve = [wx * x**2, wx * x * y + wy * x**2 / 2, wy * x * y + wx * y**2 / 2, wy * y**2]
    pressed = [normal, *(normal * c for c in (wx, wy, *axes, x, y, speed))]
    return np.column_stack(
        [*pressed, ones, *(HALF_WAY * c for c in spring), wx * ones, wy * ones, *curve]
    )


def build_support(columns: Array, mu: float) -> list[Cause]:
    """Build the causes of `SUPPORT` from their columns (n, 18), near a coefficient `mu`."""
    found: list[Cause] = []
    for name, which, prior, of in SUPPORT:
        std = prior * mu if name in UNEVEN else prior
        found.append(Cause.build(name, columns[:, which], std, of))
    return found


def build_drag_arm(
    drags: Sequence[Drag], observed: WrenchObservation, hand: NominalHand, mu: float
) -> tuple[list[Cause], Array]:
    """Build the causes of the arm in the rows of all drags, linearised at `mu`; drag after drag.

    Returns:
        Joint friction, friction of each drag, and gains.
        Prior means (k,) of the joint friction.
    """
    parts = [_arm_columns(drag, drags, observed, hand, mu) for drag in drags]
    rubbing, gains = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    hanging = drags[0].hanging
    friction, unsure = hanging.friction, hanging.unsure
    if observed.chain is None:
        # Unknown joints: friction in N on each line of motion, instead of N m in each joint.
        size = SENSOR_BIAS if observed.sensed else KIND_BIAS
        friction, unsure = np.zeros(rubbing.shape[1]), np.full(rubbing.shape[1], size)
    # A joint's friction differs from that in free air, and by a further part in each drag.
    steady = [own[drag.steady].mean(axis=0) for drag, (own, _) in zip(drags, parts, strict=True)]
    each = np.hypot(DRAG_BIAS, ANOTHER_DRAG * (np.array(steady) @ friction))
    own_drag = np.repeat(np.eye(len(drags)), [len(drag.t) for drag in drags], axis=0)
    causes = [
        Cause(JOINTS, rubbing, np.hypot(unsure, ANOTHER * friction), "arm"),
        Cause(ONE_DRAG, own_drag, each),
        build_gain(gains),
    ]
    sensor = hand.wrench_sensor
    if observed.sensed and sensor is not None:
        # A part of the normal force shows along the other axes of a six-axis sensor.
        crossed = np.concatenate([drag.normal[:, None] * drag.way for drag in drags])
        size = float(np.hypot(sensor.crosstalk, sensor.mounting))
        causes.append(Cause.build(CROSSED, crossed, size, "arm"))
    return causes, friction


def _arm_columns(
    drag: Drag, drags: Sequence[Drag], observed: WrenchObservation, hand: NominalHand, mu: float
) -> tuple[Array, Array]:
    """Columns of the arm: joint friction (n, k), N per N m, and gains (n, m), N per standard deviation."""
    if observed.chain is None:
        # Unknown joints: one friction for each line of motion, and one common gain of both forces.
        lines: list[Array] = []
        for other in drags:
            if not any(same_line(line, other.way) for line in lines):
                lines.append(other.way)
        own = np.array([same_line(line, drag.way) for line in lines], dtype=float)
        # The gain of a six-axis sensor is that of both forces: its axes differ by about their cross-talk.
        ratio = GAIN_RATIO * hand.torque_gain
        if observed.sensed and hand.wrench_sensor is not None:
            ratio = hand.wrench_sensor.crosstalk
        gain = ratio * mu * drag.normal
        return np.ones((len(drag.t), 1)) * own, gain[:, None]
    # A drag is referred to the object hanging in air, so that joint friction counts by its change.
    there, hanging = (
        signal_levers(drag.q, drag, observed, mu),
        signal_levers(drag.hanging.q[None], drag, observed, mu),
    )
    friction = there * drag.turned - hanging * drag.hanging.turned
    return friction, (there * drag.torque) @ gain_root(hand, len(there))


def signal_levers(q: Array, drag: Drag, observed: WrenchObservation, mu: float) -> Array:
    """Effect (m,) of a unit of each signal on f_t - mu N of a drag, at the mean of the angles `q` (n, 7)."""
    # The wrench of joint torques is w = (J^T)^+ tau.
    middle: Array = q.mean(axis=0, keepdims=True)
    wrenches = observed.wrenches(middle)[0]
    return drag.way @ wrenches[:2] + mu * wrenches[2]


def same_line(line: Array, way: Array) -> bool:
    """True if two unit vectors lie on one line, in either direction."""
    return abs(float(line @ way)) > SAME_LINE
