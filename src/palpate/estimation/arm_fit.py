"""Fit of an arm's torques: links, hand, friction and sensors as causes of torque."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from palpate.common.pose import Array
from palpate.estimation.arm_motion import (
    DIFFERENCE,
    REPEAT,
    SMALLEST_RESIDUAL,
    EqualMotions,
    JointMotion,
    ResidualSpectrum,
    SpectralNoise,
    frequencies,
    transform_signal,
)
from palpate.estimation.joint_causes import build_gain, label_link, per_joint, response_columns
from palpate.estimation.motion import Mask
from palpate.estimation.regression import Cause, Posterior, PriorScale, fit
from palpate.estimation.rigid_bodies import (
    PARAMETERS,
    inertia_about_centre,
    own_motion,
    parameters,
    placed_at,
    regressor,
)
from palpate.estimation.wrench_observation import CROSSTALK, GAIN
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
HAND, COMMON = "hand", "common gain"
WEIGHT, INERTIA = "weight", "inertia"
PARTS = {WEIGHT: slice(0, 4), INERTIA: slice(4, PARAMETERS)}
"""Parameters of the links: masses and first moments, observable by gravity, and inertias."""


@dataclass(frozen=True, slots=True, eq=False)
class Bodies:
    """Inertial parameters of an arm by its description."""

    links: Array  # (7, 10) of each link, without bodies fixed to the last one
    hand: Array  # (10,) of all that the last joint moves except its own link
    # (7, 10) standard deviations of mass, first moment and inertia about each link's centre.
    errors: Array
    anchors: Array  # (7, 3) m, positions of the joints at zero angles, in base axes
    reach: Array  # (3,) m, centre of the described hand from the last anchor
    load: float  # kg, payload of the arm

    @classmethod
    def of(
        cls,
        chain: Chain,
        link_mass: float,
        link_com: float,
        load: float,
        is_hand_known: bool = False,
    ) -> Bodies:
        """Read the inertial parameters of a chain.

        `link_mass` is the relative error of link masses, `link_com` the error of their centres, m (1 sigma each).
        `load` is the payload, kg. The error of a known hand is a part of that of the last link.
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
        errors, whole = np.empty_like(links), links.copy()
        whole[-1] += is_hand_known * hand
        for error, link in zip(errors, whole, strict=True):
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
    """Arm at its installation."""

    chain: Chain  # kinematics
    bodies: Bodies  # inertial parameters by the description
    home: Array  # (7,) rad, usual angles
    gravity: Array  # (3,) m/s², in base axes
    held: bool = False  # True if the logged torques exclude the described arm's gravity


@dataclass(frozen=True, slots=True, eq=False)
class FeltTorque:
    """Torque that the joints bear in a stretch of n rows, and what grows with it."""

    step: float  # s, time between rows
    torque: Array  # (n, 7) N m, of the described arm and of the load
    friction: Array  # (n, 7) Dahl friction of unit level
    usual: Array  # (7,) N m, size of the torque at home, where the joints have their usual friction

    def columns(self) -> dict[str, Array]:
        """Columns (k, 7, …) of sensor gains, cross-talk and delay, and of friction that grows with the torque."""
        torque = transform_signal(self.torque, self.step)
        change = np.gradient(self.torque, self.step, axis=0)
        loads = self.friction * (np.abs(self.torque) - self.usual)
        return {
            GAIN: per_joint(torque),
            CROSSTALK: response_columns(torque),
            "delay": transform_signal(change, self.step)[:, :, None],
            "loaded": per_joint(transform_signal(loads, self.step)),
        }


@dataclass(frozen=True, slots=True, eq=False)
class SpectrumRows:
    """Torques and their causes in the frequency domain: k coefficients of each of 7 joints."""

    tau: Array  # (k, 7) N m
    tau_ext: Array | None  # (k, 7) N m, the controller's own estimate; None where not logged
    columns: Mapping[str, Array]  # (k, 7, c) columns of each cause, by name
    frequency: Array  # (k,) Hz
    kind: Array  # (k,) kind of each row, see `EqualMotions`. Each kind has a residual of its own.
    samples: int  # number of rows of the stretches, in the time domain
    felt: tuple[FeltTorque, ...]  # torque of the arm in each stretch, in the time domain
    # Combination of the stretches; None where each has its own rows.
    equal: EqualMotions | None = None

    @classmethod
    def of(
        cls, motions: Sequence[JointMotion], setup: Setup, equal: EqualMotions | None = None
    ) -> SpectrumRows:
        """Transform stretches of a recording; those of one motion are combined."""
        return cls.concatenate([_stretch(motion, setup) for motion in motions], equal)

    @classmethod
    def concatenate(
        cls, parts: Sequence[SpectrumRows], equal: EqualMotions | None = None
    ) -> SpectrumRows:
        """Concatenate the rows of several stretches; those of one motion are combined."""
        external = [part.tau_ext for part in parts if part.tau_ext is not None]
        frequency, kind = [part.frequency for part in parts], [part.kind for part in parts]
        combine = np.concatenate if equal is None else equal.combine
        return cls(
            tau=combine([part.tau for part in parts]),
            tau_ext=combine(external) if external else None,
            columns={
                name: combine([part.columns[name] for part in parts]) for name in parts[0].columns
            },
            frequency=np.concatenate(frequency) if equal is None else equal.spread(frequency)[0],
            kind=np.concatenate(kind) if equal is None else equal.spread(frequency)[1],
            samples=sum(part.samples for part in parts),
            felt=tuple(one for part in parts for one in part.felt),
            equal=equal,
        )

    def bearing(self, torques: Sequence[Array]) -> SpectrumRows:
        """Copy in which the sensors feel, and friction grows with, a further torque (n, 7), N m, in each stretch."""
        pairs = zip(self.felt, torques, strict=True)
        more = (replace(felt, torque=felt.torque + torque) for felt, torque in pairs)
        found = [felt.columns() for felt in more]
        combine = np.concatenate if self.equal is None else self.equal.combine
        changed = {name: combine([one[name] for one in found]) for name in found[0]}
        return replace(self, columns={**self.columns, **changed})


def _stretch(motion: JointMotion, setup: Setup) -> SpectrumRows:
    """Compute the rows of one stretch: the columns of every cause, transformed to frequencies."""
    chain, bodies, home = setup.chain, setup.bodies, setup.home
    step = motion.step
    q, dq = motion.q, motion.dq

    def static_torque(angles: Array, gravity: Array) -> Array:
        """Gravity torques (n, 7), N m, of the described arm with its hand."""
        return own_motion(chain, angles, np.zeros_like(angles), np.zeros_like(angles), gravity)

    # Measured torque without sensor errors; joint friction grows with its load beyond that at home.
    felt = FeltTorque(
        step,
        own_motion(chain, q, dq, motion.ddq, setup.gravity),
        motion.dahl[:, :, 0],
        np.abs(static_torque(home[None], setup.gravity)[0]),
    )
    # Torques of the links per unit parameter: about the joints' anchors, and about the links' centres.
    links = transform_signal(regressor(chain, q, dq, motion.ddq, setup.gravity), step)
    frames = np.array([bodies.link_frame(i) for i in range(len(bodies.links))])
    centred = np.einsum("kjlp,lpx->kjlx", links, frames, optimize=True)
    own = {"offset": [np.ones_like(q)], "viscous": [dq], "armature": [motion.ddq]}
    own |= {"cable": [q - home], **_frictions(motion)}
    lean = [static_torque(q, aside) for aside in STANDARD_GRAVITY * np.eye(3)[:2]]
    columns = felt.columns() | {
        LINKS: links.reshape(*links.shape[:2], -1),
        "lean": transform_signal(np.stack(lean, axis=2), step),
        **{
            name: per_joint(*(transform_signal(one, step) for one in some))
            for name, some in own.items()
        },
        **{name: centred[..., part].reshape(*links.shape[:2], -1) for name, part in PARTS.items()},
    }
    # Torques logged without gravity get the described arm's gravity back.
    external = motion.tau_ext
    tau = transform_signal(
        motion.tau + static_torque(q, setup.gravity) if setup.held else motion.tau, step
    )
    return SpectrumRows(
        tau=tau,
        tau_ext=None if external is None else transform_signal(external, step),
        columns=columns,
        frequency=frequencies(len(tau), len(q), step),
        kind=np.zeros(len(tau)),
        samples=len(q),
        felt=(felt,),
    )


def _frictions(motion: JointMotion) -> dict[str, list[Array]]:
    """Signals (n, 7) of each joint's friction: its level, and its deviations from Dahl's law."""
    q, speed, usual = motion.q, np.abs(motion.dq), motion.dahl[:, :, 0]
    # Deviations: position (harmonics of a turn), presliding distance, speed (Stribeck), and the initial state.
    waves = [wave(times * q) for times in UNEVEN_TURNS for wave in (np.cos, np.sin)]
    others = np.moveaxis(motion.dahl[:, :, 1:], 2, 0)
    return {
        COULOMB: [usual],
        "presliding": [other - usual for other in others],
        "uneven": [usual * wave for wave in waves],
        "stribeck": [usual * np.exp(-speed / slow) for slow in STRIBECK_SPEEDS],
        "strained": [*np.moveaxis(motion.strained, 2, 0)],
    }


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
"""Fraction (1 sigma) of a joint's friction that varies with the angle, by sine and cosine of each of `UNEVEN_TURNS`.
Chosen, without a source. Sensitive: hand 0.2 σ, std ×1.0–1.0; others at most 1.2 σ, std ×0.6–1.9."""
UNEVEN_TURNS = (1, 2, 4, 8)
"""Periods a turn of a friction that varies with the angle. On a real FR3 the first two alone leave 12.3 g in place of
8.4 g (rms) of a load that is not there. Not sensitive on simulated arms."""
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
WELL_KEPT = ((0.02, 0.02, 0.05), (0.2, 0.1, 1.0), (0.5, 0.2, 1.0), (1.0, 0.5, 1.0))
"""Factors on the errors of link masses, of their centres and of sensor gains, of arms that are better known than the
datasheet says: a calibrated one, and others with more exact links. Weights show first moments, and less of the masses,
which stay wider. They are as likely as factors of 1. Sensitive: mass 0.4 σ, std ×1.0–1.5; without them 1.7 σ, std ×1.1
at 0.25 kg and `measured`, ×14 at 2 kg and `lab`."""
FIRST_RESIDUAL = 0.1
"""N m. Residual in the first round of fitting. Sensitive: hand 0.1 σ, std ×1.0–1.0; others at most 1.0 σ, std
×0.9–1.0."""
NOISE_ROUNDS = 4
"""Number of fitting rounds that learn the residual. Sensitive: hand 0.1 σ, std ×1.0–1.0; others at most 1.7 σ, std
×0.8–1.1."""

FRICTION = ("offset", COULOMB, "strained", "viscous")
DETAILS = ("presliding", "uneven", "loaded", "stribeck", "armature", "cable", GAIN, "lean", "delay")
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
LINK_LABELS = tuple(label for joint in range(7) for label in label_link(joint))
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
        crosstalk: standard deviation of a sensor's response to the torque of another joint.
    """

    bodies: Bodies
    hand: Array | None
    gains: Array
    common: float = 0.0
    crosstalk: float = 0.0

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
        if name == GAIN:
            return build_gain((rows.columns[GAIN] @ self.gains).reshape(rows.tau.size, -1))
        if name == COMMON:
            common = rows.columns[GAIN].sum(axis=2, keepdims=True)
            return Cause.build(name, common, self.common, "arm", ("gain of all joints",))
        if name == HAND:
            columns = rows.columns[LINKS][:, :, -PARAMETERS:] @ placed_at(self.bodies.reach)
            return Cause.build(name, columns, self.bodies.hand_prior())
        columns, of = rows.columns[name], "arm" if name == WEIGHT else None
        if name in PARTS:
            prior = self.bodies.errors[:, PARTS[name]].ravel()
        elif name in RELATIVE:
            # Scale relative priors by the friction of each joint.
            prior = PRIORS[name] * np.tile(level, columns.shape[2] // len(level))
        else:
            prior = self.crosstalk if name == CROSSTALK else PRIORS[name]
        return Cause.build(name, columns, prior, of, LINK_LABELS if of else ())


@dataclass(frozen=True, slots=True, eq=False)
class ArmFit:
    """Fit of an arm's torques."""

    assumed: Assumed  # prior knowledge
    posterior: Posterior  # posterior of the causes
    level: Array  # (7,) N m, joint friction that scales the relative priors

    def predicted(self, rows: SpectrumRows) -> Array:
        """(k, 7) torques, N m, predicted for other rows."""
        names = [cause.name for cause in self.posterior.causes]
        causes = self.assumed.causes(rows, names, self.level)
        caused = sum(cause.columns @ self.posterior[cause.name][0] for cause in causes)
        return self.assumed.described(rows, self.assumed.hand) + np.reshape(caused, rows.tau.shape)


def _arm_scale(assumed: Assumed, is_compared: bool) -> PriorScale:
    """Scale of the errors of the links' weight and of the sensors' gains.

    Small errors are believed only where a load is compared on equal motion, as errors of the friction model do not
    cancel elsewhere.
    """
    levels = [(link, link, 1.0) for link in LINK_FACTORS]
    chances = [*LIKELY_LINKS]
    if is_compared:
        levels += WELL_KEPT
        chances += [LIKELY_LINKS[0]] * len(WELL_KEPT)
    joints = len(assumed.gains)
    factors = [
        np.array([*[mass, centre, centre, centre] * joints, *[gain] * (joints + 1)])
        for mass, centre, gain in levels
    ]
    return PriorScale((WEIGHT, GAIN, COMMON), factors, chances)


def fit_arm(
    rows: SpectrumRows,
    assumed: Assumed,
    names: Sequence[str],
    loads: Sequence[tuple[Cause, Sequence[Array]]] = (),
    others: Sequence[Cause] = (),
    learned: Sequence[PriorScale] = (),
) -> ArmFit:
    """Fit causes to rows by iteratively reweighted least squares.

    Each round learns the residual's spectrum from the residuals of the previous round.

    Args:
        rows: torques and columns.
        assumed: prior knowledge.
        names: causes of the arm.
        loads: further causes, on which the sensors' errors act as well, and their torques (n, 7, p) in each stretch.
        others: further causes, without gains.
        learned: prior scales of `others` that are learned.
    """
    # The described arm is subtracted, so that the unknowns are corrections to it.
    y = rows.tau - assumed.described(rows, assumed.hand)
    std, spectra = np.full(y.shape, FIRST_RESIDUAL), list[tuple[Mask, ResidualSpectrum]]()
    for kind in np.unique(rows.kind):
        here = rows.kind == kind
        spectrum = ResidualSpectrum(rows.frequency[here], bool(kind in (DIFFERENCE, REPEAT)))
        spectra.append((here, spectrum))
    scales = [*learned]
    if COMMON in names:
        is_compared = DIFFERENCE in rows.kind and len(loads) == 1
        scales.append(_arm_scale(assumed, is_compared))
    elif WEIGHT in names:
        scales.append(PriorScale((WEIGHT,), LINK_FACTORS, LIKELY_LINKS))
    level, felt = np.full(y.shape[1], USUAL_FRICTION), rows

    def solve() -> Posterior:
        """Fit all causes with the present residual and friction level."""
        noise = SpectralNoise(std.ravel(), float(y.size))
        causes = [*(one for one, _ in loads), *others, *assumed.causes(felt, names, level)]
        return fit(causes, noise, y.ravel(), scales)

    for _ in range(NOISE_ROUNDS):
        # Residual spectrum of each joint, friction level, and load torque for the gains, from this round.
        posterior = solve()
        known = posterior.leverage.reshape(y.shape)
        left = posterior.residual.reshape(y.shape) * std
        for here, spectrum in spectra:
            pairs = zip(left[here].T, known[here].T, strict=True)
            std[here] = np.stack([spectrum.std(*pair) for pair in pairs], axis=1)
        # A difference with and without the load has at least the noise of differences between repetitions.
        again, loaded = rows.kind == REPEAT, rows.kind == DIFFERENCE
        if again.any():
            f, first = np.unique(rows.frequency[again], return_index=True)
            least: list[Array] = [
                np.interp(rows.frequency[loaded], f, one[again][first]) for one in std.T
            ]
            std[loaded] = np.maximum(std[loaded], np.stack(least, axis=1))
        level = np.abs(posterior[COULOMB][0]) + SMALLEST_RESIDUAL
        if loads:
            means = [posterior[cause.name][0] for cause, _ in loads]
            stretches = zip(*(torques for _, torques in loads), strict=True)
            felt = rows.bearing(
                [np.concatenate(parts, axis=2) @ np.concatenate(means) for parts in stretches]
            )
    return ArmFit(assumed, solve(), level)
