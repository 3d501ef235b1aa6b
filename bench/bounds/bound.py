"""Cramér-Rao bounds of estimates: the least standard deviation of any estimator on a recording, from the
noise model's figures, which estimators do not know."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from bench.bounds.heights import of_height
from bench.bounds.loads import of_friction, of_load
from palpate.common.parameter import Parameter
from palpate.common.pose import Array
from palpate.estimation.balance import accuracy
from palpate.estimation.estimate import Estimate
from palpate.robots.description import RobotDescription
from palpate.robots.simulated.noise.model import NoiseModel
from palpate.robots.simulated.noise.models import noise_models
from palpate.runs.run import Run
from palpate.trace.samples import Trace

Bounds = tuple[float | None, ...]
"""Bound of each component, in the quantity's SI unit."""


@dataclass(frozen=True)
class _Seen:
    """A run, and one estimate of it."""

    run: Run
    trace: Trace
    estimate: Estimate

    @property
    def parameter(self) -> Parameter:
        return self.estimate.parameter

    @property
    def arm(self) -> RobotDescription:
        return self.run.scene.arm

    @property
    def noise(self) -> NoiseModel:
        return noise_models().load(self.run.settings.noise, self.arm)

    @property
    def standing(self) -> Array:
        """Initial rotation matrix of the object, (3, 3)."""
        return self.run.scene.bodies[self.parameter.object].pose_world.rotation

    def about(self, quantity: str) -> float | None:
        """Value at which equations are linearised: the truth, else the scene's, else another estimate."""
        other = Parameter(self.parameter.object, quantity)
        known = self.run.scene.bodies[self.parameter.object].known.get(quantity)
        true = self.run.truth.get(other) or known
        if true:
            return true[0]
        part = self.estimate.parts.get(quantity)
        return part.value if part else None


def bounds_of(run: Run, estimate: Estimate) -> Bounds | None:
    """Bound of each component of an estimate; None for quantities without a bound, and for runs on a
    real robot."""
    bound = BOUNDS.get(estimate.parameter.quantity)
    if bound is None or run.trace_if_any is None or not run.simulated:
        return None
    if estimate.parameter.object not in run.scene.bodies:
        return None
    return bound(_Seen(run, run.trace, estimate))


def _mass(seen: _Seen) -> Bounds | None:
    found = _load(seen)
    return None if found is None else (found[0],)


def _com(seen: _Seen) -> Bounds | None:
    found = _load(seen)
    return None if found is None else tuple(found[1].tolist())


def _load(seen: _Seen) -> tuple[float, Array] | None:
    """Bounds of mass and centre of mass of the held object."""
    mass = seen.about("mass")
    if mass is None:
        return None
    name = seen.parameter.object
    place = accuracy(seen.run.scene.bodies[name])
    return of_load(seen.trace, name, seen.standing, mass, seen.arm, seen.noise, place)


def _friction(seen: _Seen) -> Bounds | None:
    mass, friction = seen.about("mass"), seen.about("friction")
    if mass is None or friction is None:
        return None
    name, about = seen.parameter.object, (mass, friction)
    found = of_friction(seen.trace, name, seen.standing, about, seen.arm, seen.noise)
    return None if found is None else (found,)


def _height(seen: _Seen) -> Bounds | None:
    base = seen.run.scene.pose_world_base
    found = of_height(seen.trace, seen.parameter, base, seen.arm, seen.noise)
    return None if found is None else (found,)


BOUNDS: Mapping[str, Callable[[_Seen], Bounds | None]] = {
    "mass": _mass,
    "com": _com,
    "friction": _friction,
    "height": _height,
}
"""By quantity."""
