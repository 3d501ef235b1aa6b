"""Log-Cholesky parameters of a rigid body: every value is a physically consistent body.

A body's mass m, first moment h and second moment S make its pseudo-inertia [[S, h], [h', m]], which is
positive definite for every physically consistent body, and only for those. It is U U' with

    U = exp(a) [[exp(d1), s12, s13, t1], [0, exp(d2), s23, t2], [0, 0, exp(d3), t3], [0, 0, 0, 1]]

for any ten numbers (log-Cholesky: C. Rucker and P. Wensing, "Smooth Parameterization of
Rigid-Body Inertia", IEEE RA-L 7 (2022), doi:10.1109/LRA.2022.3144517): a is half the logarithm of the mass, t
the centre of mass, and d the logarithm of the root mean square distance of the mass from it along an axis.
"""

from __future__ import annotations

import numpy as np

from palpate.geometry.pose import Array, Pose, components

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
