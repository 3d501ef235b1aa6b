"""What a plan promised, from the trace: by the conversions in it, else derived from what was
logged."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

from palpate.errors import unknown_name
from palpate.estimation.estimate import Estimate, not_identified
from palpate.parameter import Parameter
from palpate.quantities.com import estimate_com
from palpate.quantities.friction import estimate_friction
from palpate.quantities.height import estimate_height
from palpate.quantities.mass import estimate_mass
from palpate.quantities.motion import estimate_momentum, estimate_position, estimate_velocity
from palpate.scene.scene import Scene
from palpate.trace.recording import Conversion
from palpate.trace.samples import Trace

Estimator = Callable[[Trace, Conversion], Estimate]

CONVERTED: Mapping[str, Estimator] = {
    "mass": estimate_mass,
    "height": estimate_height,
    "position": estimate_position,
    "velocity": estimate_velocity,
    "momentum": estimate_momentum,
}
"""The estimator behind each quantity that a conversion of palpate's own stands for."""

DERIVED = ("friction", "com", "inertia")


def estimate_all(
    parameters: Iterable[Parameter],
    trace: Trace,
    scene: Scene,
    estimators: Mapping[str, Estimator] | None = None,
) -> tuple[Estimate, ...]:
    """An estimate for every gap, from the whole trace; a gap that nothing was recorded for is `not
    identified`.

    Args:
        estimators: by the name of the conversion primitive, for quantities that palpate does not
            know itself.
    """
    return tuple(_estimate(parameter, trace, scene, estimators or {}) for parameter in parameters)


def _estimate(
    parameter: Parameter, trace: Trace, scene: Scene, estimators: Mapping[str, Estimator]
) -> Estimate:
    made = [c for c in trace.conversions if Parameter(c.object, c.quantity) == parameter]
    if parameter.quantity in DERIVED:
        return derive(parameter, trace, scene)
    if not made:
        return not_identified(
            parameter,
            f"The run ended before the {parameter.quantity} of {parameter.object} was measured.",
        )
    estimator = estimators.get(made[-1].primitive) or CONVERTED.get(parameter.quantity)
    if estimator is None:
        return not_identified(parameter, f"No estimator is known for {made[-1].primitive}.")
    return estimator(trace, made[-1])


def derive(parameter: Parameter, trace: Trace, scene: Scene) -> Estimate:
    """The estimate for a gap without a conversion.

    Raises:
        InputError: the quantity is not a derived one; the message lists those that are.
    """
    match parameter.quantity:
        case "friction":
            return estimate_friction(trace, parameter)
        case "com":
            return estimate_com(trace, parameter, scene)
        case "inertia":
            return not_identified(
                parameter,
                "The recordings hold no rotation of the object, so its inertia is not excited.",
            )
        case _:
            raise unknown_name("derived quantity", parameter.quantity, DERIVED)
