"""Dynamics of an arm from a recording: joint friction, links and hand, with a test on a held-out part."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from palpate.common.errors import InputError
from palpate.common.pose import Array
from palpate.estimation.arm_fit import (
    COULOMB,
    DETAILS,
    FRICTION,
    HAND,
    PARTS,
    PRIORS,
    ArmFit,
    Assumed,
    Bodies,
    Setup,
    SpectrumRows,
    fit_arm,
)
from palpate.estimation.arm_motion import LEARNT, JointMotion, stretches
from palpate.estimation.estimate import Z95
from palpate.estimation.joint_friction import turned_round
from palpate.estimation.motion import Mask
from palpate.estimation.recording_check import explained_upright
from palpate.estimation.rigid_bodies import placed_at
from palpate.estimation.wrench_observation import gain_root
from palpate.robots.description import RobotDescription
from palpate.trace.recording import ArmLog
from palpate.trace.samples import STANDARD_GRAVITY

UNEVEN_CLOCK = 0.03
"""Relative difference of velocities and the slope of the angles. A real FR3 showed 1 % at 1 kHz, and a recording at
30 Hz with even stamps 11 %. Sensitive: no."""
OBSERVED = 0.5
"""Ratio of posterior to prior deviation below which a figure counts as observed. Sensitive: no."""
FRICTION_BELOW = (0.05, 0.1)
"""N m and N m s/rad. Negative friction and damping up to these sizes are tolerated. The simulated arm's damping is
-0.03, and a controller may compensate for some. Sensitive: no."""
HAND_SIZE = 0.3
"""m. Largest distance of a hand's centre from the TCP. Sensitive: no."""
SURELY = 3.7
"""Standard deviations by which a mass or a friction certainly exceeds a limit; chance exceeds them once in 10 000.
Sensitive: no."""

FIGURES = ("coulomb", "viscous", "armature", "offset")


@dataclass(frozen=True, slots=True, eq=False)
class JointFigure:
    """Identified quantity of each of n joints."""

    # value, std: (n,)
    value: Array
    std: Array
    prior: float  # prior standard deviation
    shown: Mask  # (n,) True for joints whose motion makes it observable

    @property
    def observed(self) -> tuple[bool, ...]:
        """(n,) True where the motion makes it observable and the fit narrows the prior."""
        return tuple((self.shown & (self.std < OBSERVED * self.prior)).tolist())

    def record(self, joint: int) -> dict[str, float] | None:
        """Value and standard deviation of a joint for JSON; None if not observed."""
        if not self.observed[joint]:
            return None
        return {"value": float(self.value[joint]), "std": float(self.std[joint])}


@dataclass(frozen=True, slots=True, eq=False)
class FoundHand:
    """Everything that the last joint moves except its own link."""

    mass: float  # kg
    # mass_std, centre_std: their standard deviations
    mass_std: float
    # (3,) m from the TCP, in tool axes; None where the mass is not significant.
    centre: Array | None
    centre_std: Array
    parameters: Array  # (10,) about the last joint's anchor, as in the regressor

    def record(self) -> dict[str, object]:
        """Figures as plain numbers for JSON."""
        centre = None
        if self.centre is not None:
            centre = {"value": self.centre.tolist(), "std": self.centre_std.tolist()}
        return {"mass": {"value": self.mass, "std": self.mass_std}, "centre": centre}

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval of the mass, kg."""
        return self.mass - Z95 * self.mass_std, self.mass + Z95 * self.mass_std


@dataclass(frozen=True, slots=True, eq=False)
class DynamicsFit:
    """Identified dynamics of an arm."""

    source: str  # name of the recording
    arm: RobotDescription  # description that the fit starts from
    # seconds, held_out: s, duration of the recording and of its held-out part
    seconds: float
    held_out: float
    coulomb: JointFigure  # N m, Coulomb friction
    viscous: JointFigure  # N m s/rad
    # kg m², inertia of a joint without its links: that of a motor, if torque is measured before the gears.
    armature: JointFigure
    offset: JointFigure  # N m, zero error of a sensor
    # links, links_std: (7, 10) corrections of mass, first moment and inertia about the described centre
    links: Array
    links_std: Array
    parameters: Array  # (7, 10) of the corrected links, about their joints' anchors
    hand: FoundHand | None  # identified hand; None where it was stated
    # (7,) N m, torque residual below `BAND` in the held-out part, by model: `described`, `friction`
    # (offset and friction identified), `all`, and `controller` (its own tau_ext) where logged.
    rms: Mapping[str, Array]
    notes: tuple[str, ...]  # repairs and defects of the recording
    # Physically impossible figures, one sentence each with the likely cause. If there are any, nothing is written.
    contradictions: tuple[str, ...] = ()

    def record(self) -> dict[str, object]:
        """All figures as plain numbers, SI units; None where the recording does not show a figure."""
        joints: list[dict[str, object]] = []
        for i, name in enumerate(self.arm.joints):
            figures = {each: getattr(self, each).record(i) for each in FIGURES}
            joints.append({"joint": name, **figures})
        return {
            "log": self.source,
            "arm": self.arm.name,
            "seconds": round(self.seconds, 3),
            "held_out": round(self.held_out, 3),
            "joints": joints,
            "links": [
                {"value": value.tolist(), "std": std.tolist()}
                for value, std in zip(self.links, self.links_std, strict=True)
            ],
            "hand": None if self.hand is None else self.hand.record(),
            "rms": {name: rms.tolist() for name, rms in self.rms.items()},
            "notes": list(self.notes),
            "verdict": "contradicted" if self.contradictions else "identified",
            "contradictions": list(self.contradictions),
        }


def identify(log: ArmLog, arm: RobotDescription, hand: float | None = None) -> DynamicsFit:
    """Identify the dynamics of an arm from a recording of free motion.

    Args:
        log: recording.
        arm: description of the arm.
        hand: kg of all that is mounted on the flange, shaped as the described hand; 0 is a bare flange. None: it is
            identified.

    Raises:
        InputError: The recording is too short, no joint moves, or angles or velocities are impossible for the arm.
    """
    chain, accuracy = arm.nominal.chain, arm.sensors
    assert chain is not None
    bodies = Bodies.of(chain, accuracy.link_mass, accuracy.link_com, arm.limits.payload)
    setup = Setup(chain, bodies, arm.home, np.array([0.0, 0.0, -STANDARD_GRAVITY]))
    # Check the stated hand.
    most = arm.limits.payload + float(bodies.hand[0])
    if hand is not None and not 0.0 <= hand <= most:
        raise InputError(
            f"a hand of {hand:g} kg is not between 0 and {most:.2f} kg, hand and payload"
        )
    # A joint must reverse its motion to show its friction.
    first, rest = stretches(log)
    reversing = turned_round(np.concatenate([motion.dahl[:, :, -1] for motion in (*first, *rest)]))
    if not reversing.any():
        raise InputError(
            f"{log.source}: no joint moves enough to show its friction: record a motion in which each joint turns "
            "round often, by some degrees at least"
        )
    explains = explained_upright(log, arm)
    # Frequency rows of both parts, and prior knowledge: with an unknown hand, and with the described or stated one.
    learnt, held_out = (SpectrumRows.of(motions, setup) for motions in (first, rest))
    known = None if hand is None else bodies.hand * (hand / max(float(bodies.hand[0]), 1e-9))
    assumed = Assumed(bodies, known, gain_root(arm.nominal, len(arm.joints)))
    given = Assumed(bodies, bodies.hand if known is None else known, assumed.gains)
    every = (*FRICTION, *DETAILS, *PARTS, *((HAND,) if known is None else ()))
    # Residuals in the held-out part by model, fitted to the first part alone.
    left = {"described": given.described(held_out, given.hand)}
    left["friction"] = fit_arm(learnt, given, FRICTION).predicted(held_out)
    left["all"] = fit_arm(learnt, assumed, every).predicted(held_out)
    left = {name: held_out.tau - torque for name, torque in left.items()}
    if held_out.tau_ext is not None:
        left["controller"] = held_out.tau_ext
    rms = {name: np.sqrt((e**2).sum(axis=0) / held_out.samples) for name, e in left.items()}
    # The reported figures come from a fit to the whole recording.
    notes = (*log.notes, *_uneven([*first, *rest]))
    found = fit_arm(SpectrumRows.concatenate([learnt, held_out]), assumed, every)
    made = _dynamics(log, arm, found, reversing, rms, notes)
    # An arm that fails to explain its recording has no meaningful figures: report that contradiction alone.
    return made if explains.passed else replace(made, contradictions=(explains.finding,))


def _uneven(motions: Sequence[JointMotion]) -> Iterator[str]:
    """Yield a note if velocities do not agree with angles and times."""
    slip = np.concatenate([motion.slip for motion in motions])
    share = slip.std() / max(float(np.concatenate([motion.dq for motion in motions]).std()), 1e-9)
    if share > UNEVEN_CLOCK:
        yield (
            f"velocities differ from the slope of the angles by {share:.0%}: the clock is uneven, and inertias and "
            "armature may be wrong by more than they say"
        )


def _dynamics(
    log: ArmLog,
    arm: RobotDescription,
    found: ArmFit,
    reversing: Mask,
    rms: Mapping[str, Array],
    notes: tuple[str, ...],
) -> DynamicsFit:
    """Convert a fit to the figures of the arm, with their contradictions."""

    def figure(name: str) -> JointFigure:
        """Mean and standard deviation of a cause with one unknown per joint."""
        mean, covariance = found.posterior[name]
        # Coulomb friction needs motion in both directions; the other figures do not.
        shown = reversing | (name != COULOMB)
        return JointFigure(mean, np.sqrt(np.diag(covariance)), PRIORS[name], shown)

    bodies = found.assumed.bodies
    # Corrections of the links, in the link frame of the errors.
    links, links_std = np.empty_like(bodies.links), np.empty_like(bodies.links)
    for name, part in PARTS.items():
        mean, covariance = found.posterior[name]
        links[:, part] = mean.reshape(len(links), -1)
        links_std[:, part] = np.sqrt(np.diag(covariance)).reshape(len(links), -1)
    turned = [bodies.link_frame(i) @ link for i, link in enumerate(links)]
    # Friction, and the hand if it was fitted.
    coulomb, viscous = figure(COULOMB), figure("viscous")
    seconds = float(log.t[-1] - log.t[0])
    hand = _hand(arm, found) if found.assumed.hand is None else None
    return DynamicsFit(
        source=log.source,
        arm=arm,
        seconds=seconds,
        held_out=seconds * (1.0 - LEARNT),
        coulomb=coulomb,
        viscous=viscous,
        armature=figure("armature"),
        offset=figure("offset"),
        links=links,
        links_std=links_std,
        parameters=bodies.links + turned,
        hand=hand,
        rms=rms,
        notes=notes,
        contradictions=tuple(_contradictions(coulomb, viscous, hand)),
    )


def _contradictions(
    coulomb: JointFigure, viscous: JointFigure, hand: FoundHand | None
) -> Iterator[str]:
    """Yield one sentence for each figure that is certainly impossible for an arm, with its likely cause."""
    # Negative friction or damping.
    for figure, name, least in zip(
        (coulomb, viscous), ("Friction", "Damping"), FRICTION_BELOW, strict=True
    ):
        low = figure.value + SURELY * figure.std < -least
        surely = np.flatnonzero(low & figure.observed)
        if len(surely):
            listed = ", ".join(
                f"{figure.value[i]:.2f} ± {figure.std[i]:.2f} (joint {i + 1})" for i in surely
            )
            yield (
                f"{name} is negative: {listed}: velocities or torques have the opposite sign, or the torques are "
                "without friction."
            )
    if hand is None:
        return
    # Negative mass, or a centre too far from the TCP.
    if hand.mass + SURELY * hand.mass_std < 0.0:
        yield (
            f"The hand weighs {hand.mass:.2f} ± {hand.mass_std:.2f} kg, less than nothing: the links are lighter than "
            "described, as of another arm (arm=NAME or a folder), or the torques are in another unit."
        )
    if hand.centre is not None:
        away = float(np.linalg.norm(hand.centre))
        if away > HAND_SIZE + SURELY * float(np.linalg.norm(hand.centre_std)):
            yield (
                f"The hand's centre of mass is {away:.2f} m from the TCP: something touches the arm, it "
                "carries a load, or it is another arm (arm=NAME or a folder)."
            )


def _hand(arm: RobotDescription, found: ArmFit) -> FoundHand:
    """Mass and centre of the identified hand."""
    chain, reach = arm.nominal.chain, found.assumed.bodies.reach
    assert chain is not None
    mean, covariance = found.posterior[HAND]
    # Centre = first moment over mass; its covariance by the linearised quotient, in tool axes.
    mass, std, shift = float(mean[0]), float(np.sqrt(covariance[0, 0])), mean[1:4] / mean[0]
    tool = np.array(chain.tool)
    slope = np.concatenate([-shift[:, None], np.eye(3)], axis=1) / mass
    spread = tool.T @ slope @ covariance[:4, :4] @ slope.T @ tool
    return FoundHand(
        mass=mass,
        mass_std=std,
        centre=tool.T @ (found.assumed.bodies.anchors[-1] + reach + shift - np.array(chain.tcp))
        if mass > Z95 * std
        else None,
        centre_std=np.sqrt(np.diag(spread)),
        parameters=placed_at(reach) @ mean,
    )
