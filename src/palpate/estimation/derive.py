"""Quantities that no conversion primitive yields: derived after the run from what was logged."""

from __future__ import annotations

from palpate.errors import unknown_name
from palpate.estimation.estimate import Estimate
from palpate.estimation.friction import estimate_friction
from palpate.estimation.inertial import estimate_com
from palpate.quantities import QUANTITIES, Gap
from palpate.scene.scene import Scene
from palpate.trace import Trace

DERIVED = ("friction", "com", "inertia")


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
            return _unexcited(gap)
        case _:
            raise unknown_name("derived quantity", gap.quantity, DERIVED)


def _unexcited(gap: Gap) -> Estimate:
    size = QUANTITIES[gap.quantity].size
    nan = float("nan")
    return Estimate(gap, (nan,) * size, (nan,) * size, ((nan, nan),) * size,
                    "The recordings hold no rotation of the object, so its inertia is not excited.", (),
                    "not identified")
