"""Plausibility rules from the arm's description: each rule sees one state, or one sample and the one
before."""

from __future__ import annotations

import numpy as np

from palpate.geometry.pose import Array
from palpate.robots.description import Limits, RobotDescription
from palpate.robots.robot import RobotState
from palpate.robots.sense.fault import Fault
from palpate.trace.samples import Samples

OVERSPEED = 1.5
"""Times a joint's fastest speed: an encoder that goes faster jumps."""
ENCODER_SLACK = 2e-3
"""rad that two samples of an encoder may differ besides."""
OVERSHOOT = 2.0
"""Times the greatest speed of the TCP: a reported pose that goes faster jumps."""
POSE_SLACK = 0.01
"""m that two reported poses may differ besides."""
OVERLOAD = 2.0
"""Times a joint's torque limit: more than that comes from no joint."""
WIDTH_SLACK = 0.005
"""m that the reported width may lie beyond the closed and the open fingers."""
WIDTH_SPEED = 2.0
"""m/s: no finger is so fast."""
SIGNALS = ("q", "dq", "tau_ext", "wrench", "pose_world_tcp", "twist", "width")


def not_finite(samples: Samples) -> Fault | None:
    """NaN and infinity in what was logged."""
    signals: list[Array] = [getattr(samples, name) for name in SIGNALS]
    if np.isfinite(np.concatenate([values.ravel() for values in signals])).all():
        return None
    for name, values in zip(SIGNALS, signals, strict=True):
        bad = ~np.isfinite(values.reshape(len(samples), -1)).all(axis=1)
        if bad.any():
            count = f"{int(bad.sum())} of {len(samples)} samples of {name}"
            return Fault("not a number", count, float(samples.t[bad.argmax()]))
    return None


def impossible(samples: Samples, last: Samples, limits: Limits) -> Fault | None:
    """Joints that jump, and torques that no joint bears; `last` are the samples before."""
    t = np.concatenate([last.t[-1:], samples.t])
    q = np.concatenate([last.q[-1:], samples.q])
    dt = np.maximum(t[1:] - t[:-1], 0.0)[:, None]
    steps = np.abs(q[1:] - q[:-1])
    beyond = steps - OVERSPEED * limits.dq_max * dt - ENCODER_SLACK
    if beyond.max(initial=-1.0) > 0.0:
        row, i = np.unravel_index(int(beyond.argmax()), beyond.shape)
        what = (
            f"joint {i + 1} by {steps[row, i]:.3f} rad in {1e3 * dt[row, 0]:.0f} ms, more than "
            f"{limits.dq_max[i]:.2f} rad/s allow"
        )
        return Fault("encoders jump", what, float(t[row + 1]))
    share = np.abs(samples.tau_ext) / limits.tau_max
    if share.max(initial=0.0) > OVERLOAD:
        row, i = np.unravel_index(int(share.argmax()), share.shape)
        what = f"{samples.tau_ext[row, i]:.0f} N m in joint {i + 1}, which bears {limits.tau_max[i]:.0f}"
        return Fault("impossible torque", what, float(samples.t[row]))
    return None


def pose_jumps(state: RobotState, before: RobotState, limits: Limits) -> Fault | None:
    """A reported TCP that is elsewhere all at once."""
    way = state.pose_world_tcp.distance_to(before.pose_world_tcp)
    possible = OVERSHOOT * limits.speed_max * (state.t - before.t) + POSE_SLACK
    if way <= possible:
        return None
    what = f"the TCP by {1e3 * way:.0f} mm in {1e3 * (state.t - before.t):.0f} ms"
    return Fault("the pose jumps", what, before.t)


def wrong_width(state: RobotState, before: RobotState, arm: RobotDescription) -> Fault | None:
    """Fingers that are farther apart, or faster, than they can be."""
    width, opening = state.width, arm.hand.opening
    if not -WIDTH_SLACK <= width <= opening + WIDTH_SLACK:
        what = f"{1e3 * width:.1f} mm, of fingers that open {1e3 * opening:.0f} mm"
        return Fault("impossible width", what, before.t)
    way = abs(width - before.width)
    if way > WIDTH_SPEED * (state.t - before.t) + WIDTH_SLACK:
        what = f"by {1e3 * way:.0f} mm in {1e3 * (state.t - before.t):.0f} ms"
        return Fault("the width jumps", what, before.t)
    return None
