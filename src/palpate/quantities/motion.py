"""Velocity, momentum and plan position of what the hand does or holds."""

from __future__ import annotations

from dataclasses import replace
from statistics import NormalDist

import numpy as np

from palpate.estimation.estimate import Estimate
from palpate.estimation.windows import mean_pose
from palpate.geometry.pose import Array
from palpate.parameter import Parameter
from palpate.quantities.mass import estimate_mass
from palpate.trace.recording import Conversion
from palpate.trace.samples import Samples, Trace

Z95 = NormalDist().inv_cdf(0.975)


CENTRING = 0.0015
"""m (1 sigma): fingers centre an object on themselves as they close; in simulated grasps it ended
up to 2.5 mm from where it had stood."""


def estimate_velocity(trace: Trace, conversion: Conversion) -> Estimate:
    """Mean linear velocity of the TCP over the recording, m/s, world axes.

    It is the displacement over the duration, which holds less noise than the mean of the sensed
    twist; the latter is in `components` as `mean twist x/y/z`, and `peak speed` beside it.

    Raises:
        ValueError: the recording has fewer than two samples.
    """
    velocity, std, samples = _mean_velocity(trace, conversion)
    twist = samples.twist[:, :3]
    spread = twist.std(axis=0) / np.sqrt(len(samples))
    components = {
        f"mean twist {axis}": (float(v), float(s))
        for axis, v, s in zip("xyz", twist.mean(axis=0), spread, strict=True)
    }
    components["peak speed"] = (float(np.linalg.norm(twist, axis=1).max()), float(std[0]))
    method = (
        f"Displacement of the tool centre over the {samples.t[-1] - samples.t[0]:.2f} s of the recording, "
        "which is its mean velocity."
    )
    return _normal(
        Parameter(conversion.object, "velocity"), velocity, std, method, conversion, components
    )


def estimate_momentum(trace: Trace, conversion: Conversion) -> Estimate:
    """Mean momentum m v of the held object over the recording, kg m/s, world axes.

    The mass comes from the loaded and empty passes and rests of the same trace, so it includes
    nothing of the hand.

    Raises:
        ValueError: the recording has fewer than two samples.
    """
    parameter = Parameter(conversion.object, "momentum")
    velocity, velocity_std, _ = _mean_velocity(trace, conversion)
    weighed = estimate_mass(trace, replace(conversion, quantity="mass"))
    mass, mass_std = weighed.value[0], weighed.std[0]
    std = np.hypot(mass * velocity_std, mass_std * velocity)
    method = f"Mean velocity of the recording times the object's mass from the same trace ({mass:.3f} kg)."
    found = _normal(parameter, mass * velocity, std, method, conversion, {"mass": (mass, mass_std)})
    return replace(found, verdict=weighed.verdict)


def estimate_position(trace: Trace, conversion: Conversion) -> Estimate:
    """World x-y of the midpoint between the fingers while they hold the object, m.

    Along the closing direction that is where the object is centred; across it, where it was
    grasped.

    Raises:
        ValueError: the recording holds no samples.
    """
    samples = trace.of(conversion.recording)
    position = mean_pose(samples).position[:2]
    spread = samples.pose_world_tcp[:, :2].std(axis=0) / np.sqrt(len(samples))
    std = np.hypot(np.hypot(spread, trace.hand.pose_repeatability), CENTRING)
    method = (
        "Mean position of the midpoint between the fingers while they hold the object, which they centre on "
        "themselves as they close."
    )
    return _normal(Parameter(conversion.object, "position"), position, std, method, conversion, {})


def _mean_velocity(trace: Trace, conversion: Conversion) -> tuple[Array, Array, Samples]:
    samples = trace.of(conversion.recording)
    if len(samples) < 2:
        raise ValueError(
            f"the recording of {conversion.object} has {len(samples)} samples, a velocity needs two"
        )
    duration = float(samples.t[-1] - samples.t[0])
    moved = samples.pose_world_tcp[-1, :3] - samples.pose_world_tcp[0, :3]
    return (
        moved / duration,
        np.full(3, np.sqrt(2.0) * trace.hand.pose_repeatability / duration),
        samples,
    )


def _normal(
    parameter: Parameter,
    value: Array,
    std: Array,
    method: str,
    conversion: Conversion,
    components: dict[str, tuple[float, float]],
) -> Estimate:
    pairs = [(float(v), float(s)) for v, s in zip(value, std, strict=True)]
    return Estimate(
        parameter,
        tuple(v for v, _ in pairs),
        tuple(s for _, s in pairs),
        tuple((v - Z95 * s, v + Z95 * s) for v, s in pairs),
        method,
        (conversion.recording,),
        components=components,
    )
