"""Inertial parameters of rigid bodies, ten each.

The wrench that moves a body is linear in its mass m, kg, its first moment h = m c, kg m, and its inertia I, xx yy zz
xy xz yz, kg m², about the origin of its frame (C. Atkeson, C. An and J. Hollerbach, Estimation of inertial parameters
of manipulator loads and links, IJRR 5, 1986): with acceleration a of the origin less gravity, and turning at ω

    f = m a + (ω̇× + ω×ω×) h            n = h × a + I ω̇ + ω × I ω

Log-Cholesky parameters are ten numbers of which every value is a physically consistent body. A body's mass m, first
moment h and second moment S make its pseudo-inertia [[S, h], [h', m]], which is positive definite for every physically
consistent body, and only for those. It is U U' with

    U = exp(a) [[exp(d1), s12, s13, t1], [0, exp(d2), s23, t2], [0, 0, exp(d3), t3], [0, 0, 0, 1]]

for any ten numbers (log-Cholesky: C. Rucker and P. Wensing, "Smooth Parameterization of
Rigid-Body Inertia", IEEE RA-L 7 (2022), doi:10.1109/LRA.2022.3144517): a is half the logarithm of the mass, t
the centre of mass, and d the logarithm of the root mean square distance of the mass from it along an axis.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from palpate.geometry.pose import Array, Pose, components, tensor_of
from palpate.trace.recording import Link

PARAMETERS = 10
MASS, RADIUS, SKEW, CENTRE = 0, slice(1, 4), slice(4, 7), slice(7, 10)
"""Places of a, d, s (12, 13, 23) and t in the ten."""


def pseudo_inertia(theta: Array) -> Array:
    """(4, 4) pseudo-inertia of the ten numbers."""
    root = np.eye(4)
    root[:3, :3] = np.diag(np.exp(theta[RADIUS]))
    root[[0, 0, 1], [1, 2, 2]] = theta[SKEW]
    root[:3, 3] = theta[CENTRE]
    root *= np.exp(theta[MASS])
    return root @ root.T


def of_box(mass: float, centre: Array, size: Array) -> Array:
    """Ten numbers of a uniform box of `mass` kg about `centre` (3,), m."""
    radii = np.log(np.maximum(size, 1e-3) / np.sqrt(12.0))
    return np.concatenate([[np.log(mass) / 2.0], radii, np.zeros(3), centre])


def moved(pseudo: Array, pose: Pose) -> Array:
    """Pseudo-inertia in the frame in which its own frame is at `pose`."""
    transform = np.eye(4)
    transform[:3, :3], transform[:3, 3] = pose.rotation, pose.position
    return transform @ pseudo @ transform.T


def linear(pseudo: Array) -> Array:
    """(10,) mass, first moment, and inertia xx yy zz xy xz yz, about the frame's origin."""
    second = pseudo[:3, :3]
    tensor = np.trace(second) * np.eye(3) - second
    return np.concatenate([[pseudo[3, 3]], pseudo[:3, 3], components(tensor)])


def about_centre(theta: Array) -> Array:
    """(6,) inertia xx yy zz xy xz yz about the centre of mass."""
    central = theta.copy()
    central[CENTRE] = 0.0
    return linear(pseudo_inertia(central))[4:]


def wrench_columns(pulled: Array, turn: Array, spun: Array) -> Array:
    """(n, 6, 10) force and moment about the origin of a body's frame, in its axes, per unit of each parameter;
    acceleration of the origin less gravity, rate and its change (n, 3), in the same axes."""
    found = np.zeros((len(turn), 6, PARAMETERS))
    across = _cross(turn)
    found[:, :3, 0] = pulled
    found[:, :3, 1:4] = _cross(spun) + across @ across
    found[:, 3:, 1:4] = -_cross(pulled)
    found[:, 3:, 4:] = _momentum(spun) + across @ _momentum(turn)
    return found


def body_wrench(own: Array, pulled: Array, turn: Array, spun: Array) -> tuple[Array, Array]:
    """(n, 3) force and moment about the origin of a body's frame with parameters `own` (10,); arguments else as in
    `wrench_columns`."""
    first, inertia = own[1:4], tensor_of(own[4:].tolist())
    force = own[0] * pulled + np.cross(spun, first) + np.cross(turn, np.cross(turn, first))
    return force, np.cross(first, pulled) + spun @ inertia + np.cross(turn, turn @ inertia)


def _cross(vectors: Array) -> Array:
    """(n, 3, 3) v × ·."""
    found = np.zeros((len(vectors), 3, 3))
    found[:, (2, 0, 1), (1, 2, 0)] = vectors
    found[:, (1, 2, 0), (2, 0, 1)] = -vectors
    return found


def _momentum(vectors: Array) -> Array:
    """(n, 3, 6) I v by each component of I."""
    found = np.zeros((len(vectors), 3, 6))
    found[:, (0, 1, 2), (0, 1, 2)] = vectors
    found[:, (0, 1), (3, 3)] = vectors[:, (1, 0)]
    found[:, (0, 2), (4, 4)] = vectors[:, (2, 0)]
    found[:, (1, 2), (5, 5)] = vectors[:, (2, 1)]
    return found


def parameters(links: Iterable[Link], anchor: Array) -> Array:
    """(10,) parameters of links that move as one, about an anchor (3,), m, at joint angles 0."""
    found = np.zeros(PARAMETERS)
    for link in links:
        own = [link.mass, 0.0, 0.0, 0.0, *link.inertia]
        found += placed_at(np.array(link.com) - anchor) @ own
    return found


def placed_at(centre: Array) -> Array:
    """(10, 10) parameters by mass, first moment about `centre` (3,), m, and inertia about it (to first order in
    that first moment)."""
    found = np.eye(PARAMETERS)
    found[1:4, 0] = centre
    found[4:, 0] = components(centre @ centre * np.eye(3) - np.outer(centre, centre))
    for axis, unit in enumerate(np.eye(3)):
        both = np.outer(centre, unit)
        found[4:, 1 + axis] = components(2.0 * centre[axis] * np.eye(3) - both - both.T)
    return found


def inertia_about_centre(found: Array) -> Array:
    """(3, 3) kg m², inertia about the centre of mass of parameters (10,)."""
    centre = found[1:4] / found[0]
    away = centre @ centre * np.eye(3) - np.outer(centre, centre)
    return tensor_of(found[4:].tolist()) - found[0] * away


def in_axes(axes: Array) -> Array:
    """(10, 10) parameters in a frame by those in one whose `axes` are the columns (3, 3)."""
    found = np.eye(PARAMETERS)
    found[1:4, 1:4] = axes
    for place, unit in enumerate(np.eye(6).tolist()):
        found[4:, 4 + place] = components(axes @ tensor_of(unit) @ axes.T)
    return found
