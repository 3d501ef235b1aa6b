"""Fit of an arm's torques: links, hand, friction and sensors as causes."""

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
"""... within each of these speeds, rad/s. Sensitive: hand 0.1 σ, std ×1.0–1.1; others at most 1.8 σ, std ×0.8–1.3."""
LINK_INERTIA = 0.5
"""part (1 sigma) of a link's mean moment of inertia: those of a real FR3 are off its description by more than 0.3
(evidence e^15 against 0.1). Sensitive: hand 1.4 σ, std ×0.9–3.1."""
HAND_REACH = 0.1
"""m (1 sigma) between the centre of an unknown hand and the described one's, and its radius of gyration.
Sensitive: hand 0.1 σ, std ×1.0–1.0; others at most 1.0 σ, std ×0.8–1.0."""

LINKS, COULOMB = "links", "coulomb"


@dataclass(frozen=True, slots=True, eq=False)
class Bodies:
    """Inertial parameters of an arm as it is described.

    Attributes:
        links: (7, 10) each without what is fixed to it.
        hand: (10,) all that the last joint moves beside its own link.
        errors: (7, 10) standard deviations of mass, first moment and inertia about each link's centre.
        anchors: (7, 3) m, of the joints at angles 0, in the axes of the base.
        reach: (3,) m, centre of the described hand from the last anchor.
        load: kg that the arm may carry.
    """

    links: Array
    hand: Array
    errors: Array
    anchors: Array
    reach: Array
    load: float

    @classmethod
    def of(cls, chain: Chain, link_mass: float, link_com: float, load: float) -> Bodies:
        """Inertial parameters of an arm, whose links' masses are wrong by `link_mass` of them and centres by
        `link_com`, m (1 sigma), and which may carry `load`, kg."""
        anchors = np.array(chain.anchors)
        own = [next(link for link in chain.links if link.joint == i) for i in range(len(anchors))]
        links = np.array([parameters([o], a) for o, a in zip(own, anchors, strict=True)])
        for link in chain.links:  # fixed to a link, as a flange of its own
            if link not in own and link.joint < len(anchors) - 1:
                links[link.joint] += parameters([link], anchors[link.joint])
        beside = [link for link in chain.links if link.joint == len(anchors) - 1]
        hand = parameters([link for link in beside if link is not own[-1]], anchors[-1])
        errors = np.empty_like(links)
        for error, link in zip(errors, links, strict=True):
            error[0] = link_mass * link[0]
            error[1:4] = link_com * link[0]
            error[4:] = LINK_INERTIA * np.trace(inertia_about_centre(link)) / 3.0
        reach = hand[1:4] / hand[0] if hand[0] > 0.0 else links[-1, 1:4] / links[-1, 0]
        return cls(links, hand, errors, anchors, reach, load)

    def link_frame(self, joint: int) -> Array:
        """(10, 10) parameters by the errors' mass, first moment and inertia."""
        return placed_at(self.links[joint, 1:4] / self.links[joint, 0])

    def hand_prior(self) -> Array:
        """(10,) standard deviations of mass, first moment and inertia about `reach` of an unknown hand."""
        size = HAND_REACH
        return self.load * np.array([1.0, *[size] * 3, *[size**2] * 3, *[size**2 / 2.0] * 3])


@dataclass(frozen=True, slots=True, eq=False)
class Setup:
    """An arm where it stands.

    Attributes:
        chain: its kinematics.
        bodies: as described.
        home: (7,) rad, usual angles.
        gravity: (3,) m/s², in the axes of the base.
        held: its torques lack what holds it up as described.
    """

    chain: Chain
    bodies: Bodies
    home: Array
    gravity: Array
    held: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class SpectrumRows:
    """Torques and their causes by frequency, in k coefficients of each of 7 joints.

    Attributes:
        tau: (k, 7) N m.
        tau_ext: (k, 7) the controller's own estimate; None where not logged.
        columns: (k, 7, c) by name.
        frequency: (k,) Hz.
        samples: rows of the stretches, in time.
    """

    tau: Array
    tau_ext: Array | None
    columns: Mapping[str, Array]
    frequency: Array
    samples: int

    @classmethod
    def of(cls, motions: Sequence[JointMotion], setup: Setup) -> SpectrumRows:
        """Rows of stretches of a recording."""
        return cls.concatenate([_stretch(motion, setup) for motion in motions])

    @classmethod
    def concatenate(cls, parts: Sequence[SpectrumRows]) -> SpectrumRows:
        """Rows of several stretches together."""
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
        """Rows in which the sensors' gains act on a further `torque` (7 k,), too."""
        gain = self.columns["gain"] + each(torque.reshape(self.tau.shape))
        return replace(self, columns={**self.columns, "gain": gain})

    def of_bodies(self, bodies: Bodies) -> Array:
        """(k, 7, 7, 10) columns of mass, first moment and inertia about each link's centre."""
        by_link = self.columns[LINKS].reshape(*self.tau.shape, -1, PARAMETERS)
        frames = np.array([bodies.link_frame(i) for i in range(len(bodies.links))])
        return np.einsum("kjlp,lpx->kjlx", by_link, frames)


def _stretch(motion: JointMotion, setup: Setup) -> SpectrumRows:
    """Compute the rows of one stretch."""
    chain, bodies, home = setup.chain, setup.bodies, setup.home
    step = motion.step
    q, dq = motion.q, motion.dq
    links = regressor(chain, q, dq, motion.ddq, setup.gravity)
    weight = bodies.links.copy()
    weight[-1] += bodies.hand

    def static_torque(angles: Array, gravity: Array) -> Array:
        still = np.zeros_like(angles)
        return np.einsum("njlp,lp->nj", regressor(chain, angles, still, still, gravity), weight)

    felt = np.einsum("njlp,lp->nj", links, weight)
    loads = np.abs(felt) - np.abs(static_torque(home[None], setup.gravity))
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
    """Columns of each joint's friction: its level, and by what it differs from it; `loads` (n, 7) N m are what the
    joints bear beyond their load at home."""
    q, speed, usual = motion.q, np.abs(motion.dq), motion.dahl[:, :, 0]
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
    """(k, 7, 7 s) columns of each joint's own of s signals (k, 7)."""
    joints = np.eye(signals[0].shape[1])
    return np.concatenate([signal[:, :, None] * joints for signal in signals], axis=2)


# Fit of an arm's torques: causes with priors, noise and presliding learnt from the recording
# itself.


PRESLIDING_SHARE = 0.3
"""... and parts (1 sigma) of it that do so over each of the others: no law of friction is Dahl's alone. Sensitive:
hand 0.2 σ, std ×1.0–1.1; others at most 2.0 σ, std ×0.8–1.1."""
COULOMB_PRIOR = 1.0
"""N m (1 sigma): 0.15 to 0.5 were seen on real arms. Sensitive: hand 0 σ, std ×1.0–1.0; others at most 0.2 σ, std
×1.0–1.0."""
USUAL_FRICTION = 0.3
"""N m of a joint's friction before it is seen: 0.15 to 0.5. Sensitive: hand 0.1 σ, std ×1.0–1.0; others at most
1.0 σ, std ×0.9–1.0."""
UNEVEN_FRICTION = 0.1
"""part (1 sigma) of a joint's friction by which it differs between angles, by sine and cosine of one and two
turns. Chosen, without a source. Sensitive: hand 0.2 σ, std ×1.0–1.0; others at most 1.2 σ, std ×0.6–1.9."""
LOADED_FRICTION = 3e-3
"""N m of friction per N m that a joint bears (1 sigma). Chosen, without a source. Sensitive: hand 0 σ, std
×1.0–1.0; others at most 0.5 σ, std ×0.8–1.2."""
SLOW_FRICTION = 0.2
"""part (1 sigma) of a joint's friction by which slow friction is more or less than quick friction ... Sensitive:
hand 0.1 σ, std ×1.0–1.1; others at most 0.8 σ, std ×0.9–1.1."""
VISCOUS_PRIOR = 0.5
"""N m s/rad (1 sigma): 0.07 on a Panda's first joint. Sensitive: hand 0 σ, std ×1.0–1.0; others at most 0.6 σ, std
×0.7–1.2."""
ARMATURE_PRIOR = 0.3
"""kg m² (1 sigma): 0.2 to 0.6 are a Franka's motors before the sensors, and 0 behind them. Sensitive: no."""
OFFSET_PRIOR = 0.3
"""N m (1 sigma): 0.01 to 0.48 were seen on real arms. Sensitive: hand 0.3 σ, std ×1.0–1.2; others at most 1.7 σ,
std ×0.8–1.2."""
CABLE_PRIOR = 0.1
"""N m/rad (1 sigma) by which cables and hoses pull a joint back. Chosen, without a source. Sensitive: hand 0.7 σ,
std ×0.8–1.1."""
DELAY_PRIOR = 3e-3
"""s (1 sigma) between the clocks of positions and torques: three cycles of a controller. Sensitive: hand 0 σ, std
×1.0–1.0; others at most 0.1 σ, std ×1.0–1.0."""
LEAN_PRIOR = 2e-3
"""rad (1 sigma): how far the base is out of level: 2 mm/m are what a spirit level leaves. Sensitive: hand 0.2 σ,
std ×0.9–1.2; others at most 1.0 σ, std ×0.9–1.2."""
LINK_FACTORS = (1.0, 3.0, 10.0, 30.0)
"""times the description's errors that the links' weight may be off: a description of another arm of its kind ...
Sensitive: hand 0.1 σ, std ×0.7–1.2."""
LIKELY_LINKS = (0.99, 0.006, 0.003, 0.001)
"""... and how likely each is. Chosen, without a source: a description is that of its arm. Sensitive: hand 0.1 σ,
std ×0.9–1.1."""
FIRST_RESIDUAL = 0.1
"""N m: what no cause explains, in the first round of fitting. Sensitive: hand 0.1 σ, std ×1.0–1.0; others at most
1.0 σ, std ×0.9–1.0."""
NOISE_ROUNDS = 4
"""rounds of fitting, in which the residual is learnt. Sensitive: hand 0.1 σ, std ×1.0–1.0; others at most 1.7 σ,
std ×0.8–1.1."""

HAND, GAIN, COMMON = "hand", "gain", "common gain"
WEIGHT, INERTIA = "weight", "inertia"
PARTS = {WEIGHT: slice(0, 4), INERTIA: slice(4, PARAMETERS)}
"""Of the links: masses and first moments, which gravity shows, and inertias."""
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
"""Standard deviation of each unknown of a cause, about 0 ..."""
LABELS = {
    GAIN: tuple(f"gain of joint {joint}" for joint in range(1, 8)),
    COMMON: ("gain of all joints",),
    WEIGHT: tuple(
        f"link {kind} at joint {joint}"
        for joint in range(1, 8)
        for kind in ("mass", *(f"centre along {axis}" for axis in "xyz"))
    ),
}
"""Names of unknowns whose errors other runs of the arm share."""
RELATIVE = ("presliding", "uneven", "stribeck")
"""... of these times the joint's friction."""


@dataclass(frozen=True, slots=True, eq=False)
class Assumed:
    """Prior of an arm's parameters.

    Attributes:
        bodies: as described.
        hand: (10,) known parameters of all that the last joint carries; None: to be found.
        gains: (7, 7) effects of one standard deviation of each cause on the relative errors of the torque sensors.
        common: standard deviation of one that all of them share.
    """

    bodies: Bodies
    hand: Array | None
    gains: Array
    common: float = 0.0

    def described(self, rows: SpectrumRows, hand: Array | None) -> Array:
        """(k, 7) torques of the described links and of a hand."""
        links = self.bodies.links.copy()
        if hand is not None:
            links[-1] += hand
        return rows.columns[LINKS] @ links.ravel()

    def causes(self, rows: SpectrumRows, names: Sequence[str], level: Array) -> list[Cause]:
        """Causes by name; `level` (7,) N m is the joints' friction."""
        return [self._cause(rows, name, level) for name in names]

    def _cause(self, rows: SpectrumRows, name: str, level: Array) -> Cause:
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
            prior *= np.tile(level, len(prior) // len(level))
        shared = LABELS.get(name)
        of = None if shared is None else "arm"
        return Cause(name, columns.reshape(rows.tau.size, -1), prior, of, shared or ())


@dataclass(frozen=True, slots=True, eq=False)
class ArmFit:
    """Fit of an arm's torques.

    Attributes:
        assumed: before it.
        posterior: of its causes.
        level: (7,) N m of the joints' friction, for the priors of what depends on it.
    """

    assumed: Assumed
    posterior: Posterior
    level: Array

    def predicted(self, rows: SpectrumRows) -> Array:
        """(k, 7) torques of other rows."""
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
    """Fit causes to rows, among them further `loads`, on which the sensors' gains act, and `others`, with further
    scales to be `learned`; in rounds, as the residual's size by frequency is learnt from what the last round left."""
    y = rows.tau - assumed.described(rows, assumed.hand)
    shape, std = ResidualSpectrum(rows.frequency), np.full(y.shape, FIRST_RESIDUAL)
    scales = [*learned]
    if WEIGHT in names:
        scales.append(PriorScale((WEIGHT,), LINK_FACTORS, LIKELY_LINKS))
    level, felt = np.full(y.shape[1], USUAL_FRICTION), rows

    def solve() -> Posterior:
        noise = SpectralNoise(std.ravel(), float(y.size))
        causes = [*loads, *others, *assumed.causes(felt, names, level)]
        return fit(causes, noise, y.ravel(), scales)

    for _ in range(NOISE_ROUNDS):
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
