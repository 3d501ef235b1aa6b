"""Result of the judgement by held-out motions."""

from __future__ import annotations

from dataclasses import dataclass

from palpate.estimation.agreement import FitTest

WEIGHT = "held-out weight"
BALANCE = "held-out balance"
TORQUES = "held-out torques"
JUDGED = {WEIGHT: "mass", BALANCE: "com"}
"""Quantities that tests judge; the test of the remaining torques judges none."""


@dataclass(frozen=True, slots=True)
class Curve:
    """Effect of the load on the signals of a motion, bin by bin, for the plot, N m (N of a force).

    Attributes:
        signals: (m,) names.
        t: (k,) s, the middle of each bin.
        measured: (m, k).
        std: (m, k) of the measured ones.
        twin: (m, k) as predicted from the estimates.
        template: (m, k) as predicted from the priors.
    """

    signals: tuple[str, ...]
    t: tuple[float, ...]
    measured: tuple[tuple[float, ...], ...]
    std: tuple[tuple[float, ...], ...]
    twin: tuple[tuple[float, ...], ...]
    template: tuple[tuple[float, ...], ...]


@dataclass(frozen=True, slots=True)
class Motion:
    """A held-out motion with its prediction.

    Attributes:
        object: in the hand.
        motion: in words.
        start, end: s.
        chi2, dof, p: of the joint torques, over all joints and bins.
        chi2_template: the same for the mass of the prior.
        rms, rms_template: root mean square of measured less predicted torques, N m.
        weight, weight_std: kg, measured less predicted mass, and its standard deviation.
        tests: of weight, balance and torques.
        curve: for the plot.
    """

    object: str
    motion: str
    start: float
    end: float
    chi2: float
    dof: int
    p: float
    chi2_template: float
    rms: float
    rms_template: float
    weight: float
    weight_std: float
    tests: tuple[FitTest, ...]
    curve: Curve

    @property
    def agrees(self) -> bool:
        """True if weight and balance are as predicted; remaining torques may be the arm's own."""
        return all(test.passed for test in self.tests if test.name in JUDGED)

    @property
    def disagreement(self) -> str:
        """Deviation from the prediction, in words, with the residual torque."""
        return " ".join(test.finding for test in self.tests if not test.passed)


@dataclass(frozen=True, slots=True)
class HeldOut:
    """Held-out motions, one an object; `notes`: reasons why there is none of an object."""

    motions: tuple[Motion, ...]
    notes: tuple[str, ...] = ()

    @property
    def agrees(self) -> bool:
        """True if all are as predicted."""
        return all(motion.agrees for motion in self.motions)
