"""Fit of an arm's torques: links, hand, friction and sensors as causes of torque."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from palpate.common.pose import Array
from palpate.estimation.arm_motion import (
    SMALLEST_RESIDUAL,
    JointMotion,
    ResidualSpectrum,
    SpectralNoise,
    frequencies,
    transform_signal,
)
from palpate.estimation.regression import Cause, Posterior, PriorScale, fit
from palpate.estimation.rigid_bodies import (
    PARAMETERS,
    inertia_about_centre,
    parameters,
    placed_at,
    regressor,
)
from palpate.trace.recording import Chain
from palpate.trace.samples import STANDARD_GRAVITY

STRIBECK_SPEEDS = (0.05, 0.2)
"""rad/s. Speeds below which slow friction differs. Sensitive: hand 0.1 σ, std ×1.0–1.1; others at most 1.8 σ, std
×0.8–1.3."""
LINK_INERTIA = 0.5
"""Fraction (1 sigma) of a link's mean moment of inertia. Those of a real FR3 differ from its description by more than
0.3 (evidence e^15 against 0.1). Sensitive: hand 1.4 σ, std ×0.9–3.1."""
HAND_REACH = 0.1
"""m (1 sigma). Distance between the centre of an unknown hand and the described one's, and its radius of gyration.
Sensitive: hand 0.1 σ, std ×1.0–1.0; others at most 1.0 σ, std ×0.8–1.0."""

LINKS, COULOMB = "links", "coulomb"


@dataclass(frozen=True, slots=True, eq=False)
class Bodies:
    """Inertial parameters of an arm by its description.

    Attributes:
        links: (7, 10) of each link, without bodies fixed to the last one.
        hand: (10,) of all that the last joint moves except its own link.
        errors: (7, 10) standard deviations of mass, first moment and inertia about each link's centre.
        anchors: (7, 3) m, positions of the joints at zero angles, in base axes.
        reach: (3,) m, centre of the described hand from the last anchor.
        load: kg, payload of the arm.
    """

    links: Array
    hand: Array
    errors: Array
    anchors: Array
    reach: Array
    load: float

    @classmethod
    def of(cls, chain: Chain, link_mass: float, link_com: float, load: float) -> Bodies:
        """Read the inertial parameters of a chain.

        `link_mass` is the relative error of link masses, `link_com` the error of their centres, m (1 sigma each).
        `load` is the payload, kg.
        """
        # One own link per joint, about the joint's anchor.
        anchors = np.array(chain.anchors)
        own = [next(link for link in chain.links if link.joint == i) for i in range(len(anchors))]
        links = np.array([parameters([o], a) for o, a in zip(own, anchors, strict=True)])
        # Add the bodies fixed to a link, such as a separate flange.
        for link in chain.links:
            if link not in own and link.joint < len(anchors) - 1:
                links[link.joint] += parameters([link], anchors[link.joint])
        # The hand: all bodies on the last joint but its own link.
        beside = [link for link in chain.links if link.joint == len(anchors) - 1]
        hand = parameters([link for link in beside if link is not own[-1]], anchors[-1])
        # Prior deviations of mass, first moment, and inertia about the centre.
        errors = np.empty_like(links)
        for error, link in zip(errors, links, strict=True):
            error[0] = link_mass * link[0]
            error[1:4] = link_com * link[0]
            error[4:] = LINK_INERTIA * np.trace(inertia_about_centre(link)) / 3.0
        # Centre of the hand, or of the last link where no hand is described.
        reach = hand[1:4] / hand[0] if hand[0] > 0.0 else links[-1, 1:4] / links[-1, 0]
        return cls(links, hand, errors, anchors, reach, load)

    def link_frame(self, joint: int) -> Array:
        """Matrix (10, 10) from mass, first moment and inertia about the link's centre to those about its anchor."""
        return placed_at(self.links[joint, 1:4] / self.links[joint, 0])

    def hand_prior(self) -> Array:
        """(10,) standard deviations of mass, first moment and inertia of an unknown hand about `reach`."""
        size = HAND_REACH
        return self.load * np.array([1.0, *[size] * 3, *[size**2] * 3, *[size**2 / 2.0] * 3])


@dataclass(frozen=True, slots=True, eq=False)
class Setup:
    """Arm at its installation.

    Attributes:
        chain: kinematics.
        bodies: inertial parameters by the description.
        home: (7,) rad, usual angles.
        gravity: (3,) m/s², in base axes.
        held: True if the logged torques exclude the described arm's gravity.
    """

    chain: Chain
    bodies: Bodies
    home: Array
    gravity: Array
    held: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class SpectrumRows:
    """Torques and their causes in the frequency domain: k coefficients of each of 7 joints.

    Attributes:
        tau: (k, 7) N m.
        tau_ext: (k, 7) N m, the controller's own estimate; None where not logged.
        columns: (k, 7, c) columns of each cause, by name.
        frequency: (k,) Hz.
        samples: number of rows of the stretches, in the time domain.
    """

    tau: Array
    tau_ext: Array | None
    columns: Mapping[str, Array]
    frequency: Array
    samples: int

    @classmethod
    def of(cls, motions: Sequence[JointMotion], setup: Setup) -> SpectrumRows:
        """Transform stretches of a recording."""
        return cls.concatenate([_stretch(motion, setup) for motion in motions])

    @classmethod
    def concatenate(cls, parts: Sequence[SpectrumRows]) -> SpectrumRows:
        """Concatenate the rows of several stretches."""
        external = [part.tau_ext for part in parts if part.tau_ext is not None]
        return cls(
            tau=np.concatenate([part.tau for part in parts]),
            tau_ext=np.concatenate(external) if external else None,
            columns={
                name: np.concatenate([part.columns[name] for part in parts])
                for name in parts[0].columns
            },
            frequency=np.concatenate([part.frequency for part in parts]),
            samples=sum(part.samples for part in parts),
        )

    def bearing(self, torque: Array) -> SpectrumRows:
        """Copy in which the sensors' gains also act on a further `torque` (7 k,), N m."""
        gain = self.columns["gain"] + each(torque.reshape(self.tau.shape))
        return replace(self, columns={**self.columns, "gain": gain})

    def of_bodies(self, bodies: Bodies) -> Array:
        """Columns (k, 7, 7, 10) of mass, first moment and inertia about each link's centre."""
        by_link = self.columns[LINKS].reshape(*self.tau.shape, -1, PARAMETERS)
        frames = np.array([bodies.link_frame(i) for i in range(len(bodies.links))])
        return np.einsum("kjlp,lpx->kjlx", by_link, frames)


def _stretch(motion: JointMotion, setup: Setup) -> SpectrumRows:
    """Compute the rows of one stretch: the columns of every cause, transformed to frequencies."""
    chain, bodies, home = setup.chain, setup.bodies, setup.home
    step = motion.step
    q, dq = motion.q, motion.dq
    # Torques of the links per unit parameter, and of the described arm with its hand.
    links = regressor(chain, q, dq, motion.ddq, setup.gravity)
    weight = bodies.links.copy()
    weight[-1] += bodies.hand

    def static_torque(angles: Array, gravity: Array) -> Array:
        """Gravity torques (n, 7), N m, of the described arm with its hand."""
        still = np.zeros_like(angles)
        return np.einsum("njlp,lp->nj", regressor(chain, angles, still, still, gravity), weight)

    # Measured torque without sensor errors; joint friction grows with its load beyond that at home.
    felt = np.einsum("njlp,lp->nj", links, weight)
    loads = np.abs(felt) - np.abs(static_torque(home[None], setup.gravity))
    # Columns by cause; a gain scales the torque, a delay adds its time derivative.
    columns = {
        LINKS: links.reshape(len(q), 7, -1),
        **_frictions(motion, loads),
        "offset": each(np.ones_like(q)),
        "viscous": each(dq),
        "armature": each(motion.ddq),
        "cable": each(q - home),
        "gain": each(felt),
        "lean": np.stack(
            [static_torque(q, aside) for aside in STANDARD_GRAVITY * np.eye(3)[:2]], axis=2
        ),
        "delay": np.gradient(felt, step, axis=0)[:, :, None],
    }
    # Torques logged without gravity get the described arm's gravity back.
    external = motion.tau_ext
    tau = transform_signal(
        motion.tau + static_torque(q, setup.gravity) if setup.held else motion.tau, step
    )
    return SpectrumRows(
        tau=tau,
        tau_ext=None if external is None else transform_signal(external, step),
        columns={name: transform_signal(signal, step) for name, signal in columns.items()},
        frequency=frequencies(len(tau), len(q), step),
        samples=len(q),
    )


def _frictions(motion: JointMotion, loads: Array) -> dict[str, Array]:
    """Columns of each joint's friction: its level, and its deviations from Dahl's law.

    `loads` (n, 7), N m, are the torques of the joints beyond those at home.
    """
    q, speed, usual = motion.q, np.abs(motion.dq), motion.dahl[:, :, 0]
    # Deviations: position (two harmonics), presliding distance, load, speed (Stribeck), and the initial state.
    waves = [wave(times * q) for times in (1, 2) for wave in (np.cos, np.sin)]
    others = np.moveaxis(motion.dahl[:, :, 1:], 2, 0)
    return {
        COULOMB: each(usual),
        "presliding": each(*(other - usual for other in others)),
        "uneven": each(*(usual * wave for wave in waves)),
        "loaded": each(usual * loads),
        "stribeck": each(*(usual * np.exp(-speed / slow) for slow in STRIBECK_SPEEDS)),
        "strained": each(*np.moveaxis(motion.strained, 2, 0)),
    }


def each(*signals: Array) -> Array:
    """Columns (k, 7, 7 s) that give each joint its own coefficient of each of s signals (k, 7)."""
    joints = np.eye(signals[0].shape[1])
    return np.concatenate([signal[:, :, None] * joints for signal in signals], axis=2)


# Fit of an arm's torques: causes with priors; noise and presliding are learned from the recording


PRESLIDING_SHARE = 0.3
"""Fractions (1 sigma) of a joint's friction that reverse over the other `PRESLIDINGS`: no real friction follows Dahl's
law alone. Sensitive: hand 0.2 σ, std ×1.0–1.1; others at most 2.0 σ, std ×0.8–1.1."""
COULOMB_PRIOR = 1.0
"""N m (1 sigma) of Coulomb friction; real arms showed 0.15 to 0.5. Sensitive: hand 0 σ, std ×1.0–1.0; others at most
0.2 σ, std ×1.0–1.0."""
USUAL_FRICTION = 0.3
"""N m. Initial value of a joint's friction; real arms showed 0.15 to 0.5. Sensitive: hand 0.1 σ, std ×1.0–1.0; others
at most 1.0 σ, std ×0.9–1.0."""
UNEVEN_FRICTION = 0.1
"""Fraction (1 sigma) of a joint's friction that varies with the angle, by sine and cosine of one and two turns.
Chosen, without a source. Sensitive: hand 0.2 σ, std ×1.0–1.0; others at most 1.2 σ, std ×0.6–1.9."""
LOADED_FRICTION = 3e-3
"""N m of friction per N m of joint load (1 sigma). Chosen, without a source. Sensitive: hand 0 σ, std ×1.0–1.0; others
at most 0.5 σ, std ×0.8–1.2."""
SLOW_FRICTION = 0.2
"""Fraction (1 sigma) of a joint's friction by which slow and fast friction differ, at `STRIBECK_SPEEDS`. Sensitive:
hand 0.1 σ, std ×1.0–1.1; others at most 0.8 σ, std ×0.9–1.1."""
VISCOUS_PRIOR = 0.5
"""N m s/rad (1 sigma) of viscous friction; 0.07 on a Panda's first joint. Sensitive: hand 0 σ, std ×1.0–1.0; others
at most 0.6 σ, std ×0.7–1.2."""
ARMATURE_PRIOR = 0.3
"""kg m² (1 sigma). A Franka's motors have 0.2 to 0.6, seen by sensors before the gears, 0 after them. Sensitive: no."""
OFFSET_PRIOR = 0.3
"""N m (1 sigma) of a sensor's zero; real arms showed 0.01 to 0.48. Sensitive: hand 0.3 σ, std ×1.0–1.2; others at most
1.7 σ, std ×0.8–1.2."""
CABLE_PRIOR = 0.1
"""N m/rad (1 sigma). Stiffness of cables and hoses at a joint. Chosen, without a source. Sensitive: hand 0.7 σ, std
×0.8–1.1."""
DELAY_PRIOR = 3e-3
"""s (1 sigma). Delay between positions and torques: three cycles of a controller. Sensitive: hand 0 σ, std ×1.0–1.0;
others at most 0.1 σ, std ×1.0–1.0."""
LEAN_PRIOR = 2e-3
"""rad (1 sigma). Tilt of the base: a spirit level leaves 2 mm/m. Sensitive: hand 0.2 σ, std ×0.9–1.2; others at most
1.0 σ, std ×0.9–1.2."""
LINK_FACTORS = (1.0, 3.0, 10.0, 30.0)
"""Factors on the errors of the described link weights, for a description of another arm of its kind. Sensitive: hand
0.1 σ, std ×0.7–1.2."""
LIKELY_LINKS = (0.99, 0.006, 0.003, 0.001)
"""Prior probabilities of `LINK_FACTORS`. Chosen, without a source: a description usually belongs to its arm.
Sensitive: hand 0.1 σ, std ×0.9–1.1."""
FIRST_RESIDUAL = 0.1
"""N m. Residual in the first round of fitting. Sensitive: hand 0.1 σ, std ×1.0–1.0; others at most 1.0 σ, std
×0.9–1.0."""
NOISE_ROUNDS = 4
"""Number of fitting rounds that learn the residual. Sensitive: hand 0.1 σ, std ×1.0–1.0; others at most 1.7 σ, std
×0.8–1.1."""

HAND, GAIN, COMMON = "hand", "gain", "common gain"
WEIGHT, INERTIA = "weight", "inertia"
PARTS = {WEIGHT: slice(0, 4), INERTIA: slice(4, PARAMETERS)}
"""Parameters of the links: masses and first moments, observable by gravity, and inertias."""
FRICTION = ("offset", COULOMB, "strained", "viscous")
DETAILS = (
    "presliding",
    "uneven",
    "loaded",
    "stribeck",
    "armature",
    "cable",
    GAIN,
    "lean",
    "delay",
)
PRIORS = {
    "offset": OFFSET_PRIOR,
    COULOMB: COULOMB_PRIOR,
    "strained": OFFSET_PRIOR,
    "viscous": VISCOUS_PRIOR,
    "presliding": PRESLIDING_SHARE,
    "uneven": UNEVEN_FRICTION,
    "loaded": LOADED_FRICTION,
    "stribeck": SLOW_FRICTION,
    "armature": ARMATURE_PRIOR,
    "cable": CABLE_PRIOR,
    "lean": LEAN_PRIOR,
    "delay": DELAY_PRIOR,
}
"""Prior standard deviation, about 0, of each unknown of a cause."""
LABELS = {
    GAIN: tuple(f"gain of joint {joint}" for joint in range(1, 8)),
    COMMON: ("gain of all joints",),
    WEIGHT: tuple(
        f"link {kind} at joint {joint}"
        for joint in range(1, 8)
        for kind in ("mass", *(f"centre along {axis}" for axis in "xyz"))
    ),
}
"""Names of unknowns whose errors are shared with other runs of the arm."""
RELATIVE = ("presliding", "uneven", "stribeck")
"""Causes with priors relative to the joint's friction."""


@dataclass(frozen=True, slots=True, eq=False)
class Assumed:
    """Prior knowledge of an arm's parameters.

    Attributes:
        bodies: inertial parameters by the description.
        hand: (10,) known parameters of all that the last joint carries; None if they are fitted.
        gains: (7, 7) effect of one standard deviation of each cause on the relative errors of the torque sensors.
        common: standard deviation of a gain error common to all sensors.
    """

    bodies: Bodies
    hand: Array | None
    gains: Array
    common: float = 0.0

    def described(self, rows: SpectrumRows, hand: Array | None) -> Array:
        """(k, 7) torques, N m, of the described links and of a hand."""
        links = self.bodies.links.copy()
        if hand is not None:
            links[-1] += hand
        return rows.columns[LINKS] @ links.ravel()

    def causes(self, rows: SpectrumRows, names: Sequence[str], level: Array) -> list[Cause]:
        """Build the causes `names`; `level` (7,), N m, is the joints' friction."""
        return [self._cause(rows, name, level) for name in names]

    def _cause(self, rows: SpectrumRows, name: str, level: Array) -> Cause:
        """Build one cause: columns, prior, and labels of shared errors."""
        # Columns and prior of the links, the hand, sensor gains, and all other causes.
        if name in PARTS:
            columns = rows.of_bodies(self.bodies)[..., PARTS[name]]
            prior = self.bodies.errors[:, PARTS[name]].ravel()
        elif name == HAND:
            columns = rows.columns[LINKS][:, :, -PARAMETERS:] @ placed_at(self.bodies.reach)
            prior = self.bodies.hand_prior()
        elif name == GAIN:
            columns, prior = rows.columns[GAIN] @ self.gains, np.ones(len(self.gains))
        elif name == COMMON:
            columns = rows.columns[GAIN].sum(axis=2, keepdims=True)
            prior = np.array([self.common])
        else:
            columns = rows.columns[name]
            prior = np.full(columns.shape[2], PRIORS[name])
        if name in RELATIVE:
            # Scale relative priors by the friction of each joint.
            prior *= np.tile(level, len(prior) // len(level))
        shared = LABELS.get(name)
        of = None if shared is None else "arm"
        return Cause(name, columns.reshape(rows.tau.size, -1), prior, of, shared or ())


@dataclass(frozen=True, slots=True, eq=False)
class ArmFit:
    """Fit of an arm's torques.

    Attributes:
        assumed: prior knowledge.
        posterior: posterior of the causes.
        level: (7,) N m, joint friction that scales the relative priors.
    """

    assumed: Assumed
    posterior: Posterior
    level: Array

    def predicted(self, rows: SpectrumRows) -> Array:
        """(k, 7) torques, N m, predicted for other rows."""
        names = [cause.name for cause in self.posterior.causes]
        causes = self.assumed.causes(rows, names, self.level)
        caused = sum(cause.columns @ self.posterior[cause.name][0] for cause in causes)
        return self.assumed.described(rows, self.assumed.hand) + np.reshape(caused, rows.tau.shape)


def fit_arm(
    rows: SpectrumRows,
    assumed: Assumed,
    names: Sequence[str],
    loads: Sequence[Cause] = (),
    others: Sequence[Cause] = (),
    learned: Sequence[PriorScale] = (),
) -> ArmFit:
    """Fit causes to rows by iteratively reweighted least squares.

    Each round learns the residual's spectrum from the residuals of the previous round.

    Args:
        rows: torques and columns.
        assumed: prior knowledge.
        names: causes of the arm.
        loads: further causes, on which the sensors' gains act as well.
        others: further causes, without gains.
        learned: prior scales of `others` that are learned.
    """
    # The described arm is subtracted, so that the unknowns are corrections to it.
    y = rows.tau - assumed.described(rows, assumed.hand)
    shape, std = ResidualSpectrum(rows.frequency), np.full(y.shape, FIRST_RESIDUAL)
    scales = [*learned]
    if WEIGHT in names:
        scales.append(PriorScale((WEIGHT,), LINK_FACTORS, LIKELY_LINKS))
    level, felt = np.full(y.shape[1], USUAL_FRICTION), rows

    def solve() -> Posterior:
        """Fit all causes with the present residual and friction level."""
        noise = SpectralNoise(std.ravel(), float(y.size))
        causes = [*loads, *others, *assumed.causes(felt, names, level)]
        return fit(causes, noise, y.ravel(), scales)

    for _ in range(NOISE_ROUNDS):
        # Residual spectrum of each joint, friction level, and load torque for the gains, from this round.
        posterior = solve()
        known = posterior.leverage.reshape(y.shape)
        left = posterior.residual.reshape(y.shape) * std
        pairs = zip(left.T, known.T, strict=True)
        std = np.stack([shape.std(*pair) for pair in pairs], axis=1)
        level = np.abs(posterior[COULOMB][0]) + SMALLEST_RESIDUAL
        felt = rows.bearing(
            sum((one.columns @ posterior[one.name][0] for one in loads), np.zeros(y.size))
        )
    return ArmFit(assumed, solve(), level)
