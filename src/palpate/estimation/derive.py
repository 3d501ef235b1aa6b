"""What a plan promised, from the trace: by the conversions in it, else derived from what was logged."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

from palpate.errors import unknown_name
from palpate.estimation.estimate import Estimate, not_identified
from palpate.estimation.friction import estimate_friction
from palpate.estimation.inertial import estimate_com
from palpate.estimation.kinematic import estimate_momentum, estimate_position, estimate_velocity
from palpate.estimation.mass import estimate_mass
from palpate.estimation.surface import estimate_height
from palpate.quantities import Gap
from palpate.scene.scene import Scene
from palpate.trace import Conversion, Trace

Estimator = Callable[[Trace, Conversion], Estimate]

CONVERTED: Mapping[str, Estimator] = {
    "mass": estimate_mass, "height": estimate_height, "position": estimate_position,
    "velocity": estimate_velocity, "momentum": estimate_momentum,
}
"""The estimator behind each quantity that a conversion of palpate's own stands for."""

DERIVED = ("friction", "com", "inertia")


def estimate_all(gaps: Iterable[Gap], trace: Trace, scene: Scene,
                 estimators: Mapping[str, Estimator] | None = None) -> tuple[Estimate, ...]:
    """An estimate for every gap, from the whole trace; a gap that nothing was recorded for is `not identified`.

    Args:
        estimators: by the name of the conversion primitive, for quantities that palpate does not know itself.
    """
    return tuple(_estimate(gap, trace, scene, estimators or {}) for gap in gaps)


def _estimate(gap: Gap, trace: Trace, scene: Scene, estimators: Mapping[str, Estimator]) -> Estimate:
    made = [c for c in trace.conversions if Gap(c.object, c.quantity) == gap]
    if gap.quantity in DERIVED:
        return derive(gap, trace, scene)
    if not made:
        return not_identified(gap, f"The run ended before the {gap.quantity} of {gap.object} was measured.")
    estimator = estimators.get(made[-1].primitive) or CONVERTED.get(gap.quantity)
    if estimator is None:
        return not_identified(gap, f"No estimator is known for {made[-1].primitive}.")
    return estimator(trace, made[-1])


def derive(gap: Gap, trace: Trace, scene: Scene) -> Estimate:
    """The estimate for a gap without a conversion.

    Raises:
        InputError: the quantity is not a derived one; the message lists those that are.
    """
    match gap.quantity:
        case "friction":
            return estimate_friction(trace, gap)
        case "com":
            return estimate_com(trace, gap, scene)
        case "inertia":
            return not_identified(gap, "The recordings hold no rotation of the object, so its inertia is not excited.")
        case _:
            raise unknown_name("derived quantity", gap.quantity, DERIVED)
