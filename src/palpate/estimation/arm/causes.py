"""Causes of an arm's joint torques: links, hand, friction, sensors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from palpate.estimation import tuning
from palpate.estimation.arm.motion import Motion
from palpate.estimation.arm.spectrum import frequencies, transformed
from palpate.estimation.load.chain import regressor
from palpate.estimation.rigid import PARAMETERS, inertia_about_centre, parameters, placed_at
from palpate.geometry.pose import Array
from palpate.trace.recording import Chain
from palpate.trace.samples import STANDARD_GRAVITY

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
            error[4:] = tuning.LINK_INERTIA * np.trace(inertia_about_centre(link)) / 3.0
        reach = hand[1:4] / hand[0] if hand[0] > 0.0 else links[-1, 1:4] / links[-1, 0]
        return cls(links, hand, errors, anchors, reach, load)

    def link_frame(self, joint: int) -> Array:
        """(10, 10) parameters by the errors' mass, first moment and inertia."""
        return placed_at(self.links[joint, 1:4] / self.links[joint, 0])

    def hand_prior(self) -> Array:
        """(10,) standard deviations of mass, first moment and inertia about `reach` of an unknown hand."""
        size = tuning.HAND_REACH
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
class Rows:
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
    def of(cls, motions: Sequence[Motion], setup: Setup) -> Rows:
        """Rows of stretches of a recording."""
        return cls.joined([_stretch(motion, setup) for motion in motions])

    @classmethod
    def joined(cls, parts: Sequence[Rows]) -> Rows:
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

    def bearing(self, torque: Array) -> Rows:
        """Rows in which the sensors' gains act on a further `torque` (7 k,), too."""
        gain = self.columns["gain"] + each(torque.reshape(self.tau.shape))
        return replace(self, columns={**self.columns, "gain": gain})

    def of_bodies(self, bodies: Bodies) -> Array:
        """(k, 7, 7, 10) columns of mass, first moment and inertia about each link's centre."""
        by_link = self.columns[LINKS].reshape(*self.tau.shape, -1, PARAMETERS)
        frames = np.array([bodies.link_frame(i) for i in range(len(bodies.links))])
        return np.einsum("kjlp,lpx->kjlx", by_link, frames)


def _stretch(motion: Motion, setup: Setup) -> Rows:
    """Compute the rows of one stretch."""
    chain, bodies, home = setup.chain, setup.bodies, setup.home
    step = motion.step
    q, dq = motion.q, motion.dq
    links = regressor(chain, q, dq, motion.ddq, setup.gravity)
    weight = bodies.links.copy()
    weight[-1] += bodies.hand

    def held(angles: Array, gravity: Array) -> Array:
        still = np.zeros_like(angles)
        return np.einsum("njlp,lp->nj", regressor(chain, angles, still, still, gravity), weight)

    felt = np.einsum("njlp,lp->nj", links, weight)
    loads = np.abs(felt) - np.abs(held(home[None], setup.gravity))
    columns = {
        LINKS: links.reshape(len(q), 7, -1),
        **_frictions(motion, loads),
        "offset": each(np.ones_like(q)),
        "viscous": each(dq),
        "armature": each(motion.ddq),
        "cable": each(q - home),
        "gain": each(felt),
        "lean": np.stack([held(q, aside) for aside in STANDARD_GRAVITY * np.eye(3)[:2]], axis=2),
        "delay": np.gradient(felt, step, axis=0)[:, :, None],
    }
    external = motion.tau_ext
    tau = transformed(motion.tau + held(q, setup.gravity) if setup.held else motion.tau, step)
    return Rows(
        tau=tau,
        tau_ext=None if external is None else transformed(external, step),
        columns={name: transformed(signal, step) for name, signal in columns.items()},
        frequency=frequencies(len(tau), len(q), step),
        samples=len(q),
    )


def _frictions(motion: Motion, loads: Array) -> dict[str, Array]:
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
        "stribeck": each(*(usual * np.exp(-speed / slow) for slow in tuning.STRIBECK_SPEEDS)),
        "strained": each(*np.moveaxis(motion.strained, 2, 0)),
    }


def each(*signals: Array) -> Array:
    """(k, 7, 7 s) columns of each joint's own of s signals (k, 7)."""
    joints = np.eye(signals[0].shape[1])
    return np.concatenate([signal[:, :, None] * joints for signal in signals], axis=2)
