"""What a held object weighs: shared by mass, momentum and centre of mass."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from palpate.estimation import tuning
from palpate.estimation.estimate import Part, Verdict
from palpate.estimation.load import FORCE_Z, Contrast, fit_load
from palpate.estimation.segments import Segment, referenced, segments
from palpate.trace.recording import Recording
from palpate.trace.samples import Trace


@dataclass(frozen=True, slots=True, eq=False)
class Weight:
    """The mass of the object that was held during a recording.

    Attributes:
        mass, std, ci95: kg.
        verdict: `prior-dominated` where the object is so light that it is positive says as much
            about its mass as the forces.
        segments: the rests and passes it rests on.
    """

    mass: float
    std: float
    ci95: tuple[float, float]
    verdict: Verdict
    segments: Sequence[Segment]

    @property
    def part(self) -> Part:
        """As a part of another estimate."""
        return Part(self.mass, self.std, "kg")


def weigh(trace: Trace, recording: Recording) -> Weight:
    """The load's vertical force over g, against the same rests and passes without the object.

    Raises:
        ValueError: the recording holds no samples or no held object.
    """
    found = segments(trace, recording)
    force = fit_load(found, FORCE_Z, trace.gravity, trace.hand)
    gain = uniform_std(tuning.GAIN_AVERAGE * trace.hand.torque_gain)
    g = trace.gravity
    mass, std = force.value / g, float(np.hypot(force.std, gain * force.value)) / g
    low, high = _widened(force, mass, std)
    if low > 0.0:
        return Weight(mass, std, (low, high), "identified", found)
    mass, std = positive(mass, std)
    return Weight(mass, std, (0.0, max(high, 2.0 * mass)), "prior-dominated", found)


def _widened(force: Contrast, mass: float, std: float) -> tuple[float, float]:
    """The force's interval about the mass, as much wider as the gain makes the deviation."""
    widen = std / force.std
    low, high = (mass + widen * (bound - force.value) for bound in force.ci95)
    return low, high


def single_shot(trace: Trace, recording: Recording) -> Part:
    """Mean and spread of F_z / g of a recording's samples, in kg: the paper's Force2Mass."""
    force = trace.of(recording).wrench[:, FORCE_Z]
    return Part(float(force.mean()) / trace.gravity, float(force.std()) / trace.gravity, "kg")


def alone(trace: Trace, found: Sequence[Segment]) -> Mapping[str, Part]:
    """What `rests` and `passes` say on their own, kg, where they have a reference."""
    groups = {
        "rests": [segment for segment in found if segment.at_rest],
        "passes": [segment for segment in found if not segment.at_rest],
    }
    parts: dict[str, Part] = {}
    for name, group in groups.items():
        if referenced(group):
            force = fit_load(group, FORCE_Z, trace.gravity, trace.hand)
            parts[name] = Part(force.value / trace.gravity, force.std / trace.gravity, "kg")
    return parts


def uniform_std(half_width: float) -> float:
    """Standard deviation of what is known to lie within a half width and no more (JCGM 100:2008,
    GUM, 4.3.7)."""
    return half_width / float(np.sqrt(3.0))


def positive(mean: float, std: float) -> tuple[float, float]:
    """Mean and standard deviation of a normal, given that it is positive.

    With alpha = -mean/std and hazard h = pdf(alpha) / (1 - cdf(alpha)) of the standard normal, they
    are mean + std h and std sqrt(1 + alpha h - h²) (Johnson, Kotz and Balakrishnan, Continuous
    Univariate Distributions 1, section 10.1).
    """
    unit = NormalDist()
    alpha = -mean / std
    hazard = unit.pdf(alpha) / max(1.0 - unit.cdf(alpha), 1e-12)
    narrower = float(np.sqrt(max(1.0 + alpha * hazard - hazard**2, 1e-6)))
    return mean + std * hazard, std * narrower
