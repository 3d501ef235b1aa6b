"""Judgement of the estimates by a held-out motion."""

from __future__ import annotations

from dataclasses import dataclass

from palpate.estimation.agreement import FitTest

WEIGHT = "held-out weight"
BALANCE = "held-out balance"
TORQUES = "held-out torques"
JUDGED = {WEIGHT: "mass", BALANCE: "com"}
"""Tests that judge a quantity; what is left in the torques besides judges none."""


@dataclass(frozen=True, slots=True)
class Curve:
    """Signals over a motion, bin by bin, for the plot: what the load made of them, N m (N of a force).

    Attributes:
        signals: (m,) their names.
        t: (k,) s, the middle of each bin.
        measured: (m, k).
        std: (m, k) of what was measured.
        twin: (m, k) as predicted by what was estimated.
        template: (m, k) as predicted by what was believed before.
    """

    signals: tuple[str, ...]
    t: tuple[float, ...]
    measured: tuple[tuple[float, ...], ...]
    std: tuple[tuple[float, ...], ...]
    twin: tuple[tuple[float, ...], ...]
    template: tuple[tuple[float, ...], ...]


@dataclass(frozen=True, slots=True)
class Motion:
    """A motion that was held out, and how it was predicted.

    Attributes:
        object: what was in the hand.
        motion: which motion, in words.
        start, end: s.
        chi2, dof, p: of the joint torques, over all joints and bins, and how probable so much is.
        chi2_template: the same, had the object weighed what was believed before.
        rms, rms_template: root mean square of measured less predicted torques, N m.
        weight, weight_std: kg, how much more it weighed than predicted, and 1 sigma of that.
        tests: what was tested.
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
        """True if the object weighs and hangs as predicted. What is left in the torques besides may
        be the arm's own."""
        return all(test.passed for test in self.tests if test.name in JUDGED)

    @property
    def disagreement(self) -> str:
        """Deviation from the prediction, in words, with the residual torque."""
        return " ".join(test.finding for test in self.tests if not test.passed)


@dataclass(frozen=True, slots=True)
class HeldOut:
    """All motions that were held out, one an object; `notes`: why there is none of an object."""

    motions: tuple[Motion, ...]
    notes: tuple[str, ...] = ()

    @property
    def agrees(self) -> bool:
        """True if all were as predicted."""
        return all(motion.agrees for motion in self.motions)
