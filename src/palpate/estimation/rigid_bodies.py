"""Inertial parameters of rigid bodies, and kinematics and inverse dynamics of a chain."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from palpate.common.pose import Array, Pose, components, tensor_of
from palpate.trace.recording import Chain, ChainLink

PARAMETERS = 10


def repeat_prior(mass: float, moment: float, inertia: float) -> Array:
    """Repeat deviations of mass (kg), first moment (kg m) and inertia (kg m²) for the parameters (10,)."""
    return np.repeat([mass, moment, inertia], (1, 3, 6))


BODY_PRIOR = repeat_prior(30.0, 10.0, 1.0)
"""1 sigma: wide prior of a load about which nothing is known. Not sensitive."""
MASS, RADIUS, SKEW, CENTRE = 0, slice(1, 4), slice(4, 7), slice(7, 10)
"""Indices of the log-Cholesky parameters a, d, s (12, 13, 23) and t."""


def pseudo_inertia(theta: Array) -> Array:
    """Compute the (4, 4) pseudo-inertia J = U Uᵀ of log-Cholesky parameters `theta` (10,), (a, d, s, t).

        U = exp(a) [[exp(d1), s12, s13, t1], [0, exp(d2), s23, t2], [0, 0, exp(d3), t3], [0, 0, 0,
        1]]

    a is half the logarithm of the mass, and t the centre of mass, m. d is the logarithm of the root mean square
    distance of the mass from it along an axis. Every ten numbers give a physically consistent body.

    Source: C. Rucker and P. Wensing, Smooth Parameterization of Rigid-Body Inertia, IEEE RA-L 7, 2022,
    doi:10.1109/LRA.2022.3144517.
    """
    root = np.eye(4)
    root[:3, :3] = np.diag(np.exp(theta[RADIUS]))
    root[[0, 0, 1], [1, 2, 2]] = theta[SKEW]
    root[:3, 3] = theta[CENTRE]
    root *= np.exp(theta[MASS])
    return root @ root.T


def of_box(mass: float, centre: Array, size: Array) -> Array:
    """Compute the log-Cholesky parameters (10,) of a uniform box of `mass` kg and `size` (3,), m,
    about `centre` (3,), m."""
    # Standard deviation of a uniform distribution over each edge.
    radii = np.log(np.maximum(size, 1e-3) / np.sqrt(12.0))
    return np.concatenate([[np.log(mass) / 2.0], radii, np.zeros(3), centre])


def move_inertia(pseudo: Array, pose: Pose) -> Array:
    """Transform a pseudo-inertia to the frame in which its own frame is at `pose`."""
    transform = np.eye(4)
    transform[:3, :3], transform[:3, 3] = pose.rotation, pose.position
    return transform @ pseudo @ transform.T


def linear(pseudo: Array) -> Array:
    """Convert a pseudo-inertia to (10,) mass, first moment, and inertia xx yy zz xy xz yz about the frame's origin."""
    second = pseudo[:3, :3]
    tensor = np.trace(second) * np.eye(3) - second
    return np.concatenate([[pseudo[3, 3]], pseudo[:3, 3], components(tensor)])


def about_centre(theta: Array) -> Array:
    """Compute the inertia (6,), xx yy zz xy xz yz, about the centre of mass from log-Cholesky parameters `theta`."""
    central = theta.copy()
    central[CENTRE] = 0.0
    return linear(pseudo_inertia(central))[4:]


def wrench_columns(pulled: Array, turn: Array, spun: Array) -> Array:
    """Compute the wrench regressor (n, 6, 10) of a rigid body: force and moment about its frame's
    origin per unit of each parameter.

    All vectors are in the axes of the body.

    Args:
        pulled: (n, 3) m/s², acceleration of the origin less gravity.
        turn: (n, 3) rad/s, angular velocity.
        spun: (n, 3) rad/s², angular acceleration.
    """
    found = np.zeros((len(turn), 6, PARAMETERS))
    across = _cross(turn)
    # Force: m a + α × h + ω × (ω × h), with the first moment h.
    found[:, :3, 0] = pulled
    found[:, :3, 1:4] = _cross(spun) + across @ across
    # Moment: h × a + I α + ω × I ω.
    found[:, 3:, 1:4] = -_cross(pulled)
    found[:, 3:, 4:] = _momentum(spun) + across @ _momentum(turn)
    return found


def wrenches_of_load(axes: Array, pulled: Array, turn: Array, spun: Array) -> Array:
    """Compute the wrench regressor (n, 6, 10) as `wrench_columns`, with vectors and wrench in world axes.

    Args:
        axes: (n, 3, 3) axes of the body in the world.
    """
    local = (np.einsum("nji,nj->ni", axes, each) for each in (pulled, turn, spun))
    columns = wrench_columns(*local)
    return np.concatenate([axes @ columns[:, :3], axes @ columns[:, 3:]], axis=1)


def body_wrench(own: Array, pulled: Array, turn: Array, spun: Array) -> tuple[Array, Array]:
    """Compute force and moment (n, 3) about the origin of a body's frame with parameters `own` (10,).

    The other arguments are those of `wrench_columns`.
    """
    first, inertia = own[1:4], tensor_of(own[4:].tolist())
    # Newton and Euler equations about the origin, with the first moment h.
    force = own[0] * pulled + cross(spun, first) + cross(turn, cross(turn, first))
    return force, cross(first, pulled) + spun @ inertia + cross(turn, turn @ inertia)


def cross(left: Array, right: Array) -> Array:
    """Compute the cross products of vectors (..., 3): `np.cross` takes five times as long for some hundred of them."""
    a, b = left, right
    found = np.empty(np.broadcast_shapes(a.shape, b.shape))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        found[..., i] = a[..., j] * b[..., k] - a[..., k] * b[..., j]
    return found


def _cross(vectors: Array) -> Array:
    """Build the cross-product matrices (n, 3, 3) of vectors (n, 3)."""
    found = np.zeros((len(vectors), 3, 3))
    found[:, (2, 0, 1), (1, 2, 0)] = vectors
    found[:, (1, 2, 0), (2, 0, 1)] = -vectors
    return found


def _momentum(vectors: Array) -> Array:
    """Compute (n, 3, 6) I v per unit of each component of I."""
    found = np.zeros((len(vectors), 3, 6))
    found[:, (0, 1, 2), (0, 1, 2)] = vectors
    found[:, (0, 1), (3, 3)] = vectors[:, (1, 0)]
    found[:, (0, 2), (4, 4)] = vectors[:, (2, 0)]
    found[:, (1, 2), (5, 5)] = vectors[:, (2, 1)]
    return found


def parameters(links: Iterable[ChainLink], anchor: Array) -> Array:
    """Compute the parameters (10,) of links that move as one, about `anchor` (3,), m, at joint angles 0."""
    found = np.zeros(PARAMETERS)
    for link in links:
        own = [link.mass, 0.0, 0.0, 0.0, *link.inertia]
        found += placed_at(np.array(link.com) - anchor) @ own
    return found


def placed_at(centre: Array) -> Array:
    """Build the (10, 10) map to parameters about the origin from those about `centre` (3,), m.

    The input holds mass, first moment about `centre`, and inertia about it. The map is exact to
    first order in that first moment.
    """
    found = np.eye(PARAMETERS)
    # Mass at `centre`: its first moment, and its inertia (parallel axis theorem).
    found[1:4, 0] = centre
    found[4:, 0] = components(centre @ centre * np.eye(3) - np.outer(centre, centre))
    # First moment h about `centre` c: inertia 2 (c · h) 1 - c hᵀ - h cᵀ.
    for axis, unit in enumerate(np.eye(3)):
        both = np.outer(centre, unit)
        found[4:, 1 + axis] = components(2.0 * centre[axis] * np.eye(3) - both - both.T)
    return found


def inertia_about_centre(found: Array) -> Array:
    """Compute the inertia (3, 3), kg m², about the centre of mass from parameters (10,)."""
    centre = found[1:4] / found[0]
    away = centre @ centre * np.eye(3) - np.outer(centre, centre)
    return tensor_of(found[4:].tolist()) - found[0] * away


def jacobian(of: Callable[[Array], Array], value: Array) -> Array:
    """Compute the (k, 10) derivatives of a function of the parameters by central differences."""
    steps = 1e-6 * np.eye(len(value))
    return np.column_stack([(of(value + step) - of(value - step)) / 2e-6 for step in steps])


def in_axes(axes: Array) -> Array:
    """Build the (10, 10) map of parameters from a frame whose `axes` are the columns (3, 3) to the frame of these."""
    found = np.eye(PARAMETERS)
    found[1:4, 1:4] = axes
    # Rotate each unit inertia: R I Rᵀ.
    for place, unit in enumerate(np.eye(6).tolist()):
        found[4:, 4 + place] = components(axes @ tensor_of(unit) @ axes.T)
    return found


# Kinematics and inverse dynamics of a chain.


@dataclass(frozen=True, slots=True, eq=False)
class Hinge:
    """A joint at k configurations, in the axes of the base."""

    axis: Array  # (k, 3) unit vector
    anchor: Array  # (k, 3) m
    frame: Array  # (k, 3, 3) axes of the link that moves with it; at angles 0 those of the base
    origin: Array  # (k, 3) m, of that link's frame


def hinges(chain: Chain, q: Array) -> list[Hinge]:
    """Compute the joints at angles `q` (k, m), rad, from the base on, by a product of exponentials.

    Source: Lynch and Park, Modern Robotics, 2017, chapter 4.
    """
    found: list[Hinge] = []
    frame, origin = np.broadcast_to(np.eye(3), (len(q), 3, 3)), np.zeros((len(q), 3))
    for own, place, angle in zip(chain.axes, chain.anchors, q.T, strict=True):
        # All joints before it turn the axis; then the joint turns its own link about its anchor.
        axis, anchor = np.dot(frame, own), np.dot(frame, place) + origin
        frame = frame @ rotations_about(np.array(own), angle)
        origin = anchor - np.dot(frame, place)
        found.append(Hinge(axis, anchor, frame, origin))
    return found


def rotations_about(axis: Array, angle: Array) -> Array:
    """Compute the rotations (k, 3, 3) by `angle` (k,), rad, about a unit `axis` (3,), by Rodrigues' formula."""
    (skew,) = _cross(axis[None])
    sine, cosine = np.sin(angle)[:, None, None], np.cos(angle)[:, None, None]
    return np.eye(3) + sine * skew + (1.0 - cosine) * (skew @ skew)


def tool_kinematics(chain: Chain, q: Array) -> tuple[Array, Array, Array]:
    """Compute TCP (k, 3), tool axes (k, 3, 3) and Jacobian (k, 6, m) about the TCP at angles `q` (k, m).

    All are in the axes of the base. The columns of the Jacobian are the twists of the joints (Lynch and Park, chapter
    5).
    """
    turned = hinges(chain, q)
    last = turned[-1]
    tcp = last.frame @ np.array(chain.tcp) + last.origin
    # Twist of each joint at the TCP: ω × r, and ω.
    columns: list[Array] = []
    for hinge in turned:
        about_tcp = cross(hinge.axis, tcp - hinge.anchor)
        columns.append(np.concatenate([about_tcp, hinge.axis], axis=1))
    return tcp, last.frame @ np.array(chain.tool), np.stack(columns, axis=2)


def regressor(chain: Chain, q: Array, dq: Array, ddq: Array, gravity: Array) -> Array:
    """Compute the joint torques (n, m, m, 10) by a unit of each parameter of each joint's link.

    The parameters (`PARAMETERS`) are about the joint's anchor, in axes that are those of the base at angles 0.

    Args:
        q, dq, ddq: (n, m) rad, rad/s, rad/s².
        gravity: (3,) m/s², or (n, 3), in the axes of the base.
    """
    found = np.zeros((*q.shape, q.shape[1], PARAMETERS))
    for link, (motions, wrench) in enumerate(link_wrenches(chain, q, dq, ddq, gravity)):
        # A link loads the joints up to its own.
        found[:, : link + 1, link] = motions @ wrench
    return found


def own_motion(
    chain: Chain, q: Array, dq: Array, ddq: Array, gravity: Array | None = None
) -> Array:
    """Compute the joint torques (n, m), N m, that move the links of `chain`, without gravity by default.

    The recursive Newton-Euler algorithm; arguments as in `regressor`.
    """
    pull = np.zeros(3) if gravity is None else gravity
    turned, found = hinges(chain, q), np.zeros(q.shape)
    # From the base out: motion of each link.
    moved = list(link_motions(turned, dq, ddq, pull))
    force, moment, tip = np.zeros((3, len(q), 3))
    # From the tip in: wrench of a link and all links after it, about its anchor.
    for link, (hinge, motion) in reversed(list(enumerate(zip(turned, moved, strict=True)))):
        local = (np.einsum("nji,nj->ni", hinge.frame, each) for each in motion)
        wrench = body_wrench(link_parameters(chain, link), *local)
        own, about_anchor = (np.einsum("nij,nj->ni", hinge.frame, each) for each in wrench)
        moment = moment + about_anchor + cross(tip - hinge.anchor, force)
        force, tip = force + own, hinge.anchor
        found[:, link] = np.vecdot(hinge.axis, moment)
    return found


def load_torques(chain: Chain, q: Array, dq: Array, ddq: Array, gravity: Array) -> Array:
    """Compute the joint torques (n, m, 10) of a load on the hand, per unit of each of its parameters.

    The parameters are about the TCP, in the axes of the tool; arguments as in `regressor`.
    """
    *_, (motions, wrench) = link_wrenches(chain, q, dq, ddq, gravity)
    return motions @ wrench @ tool_parameters(chain)


def tool_parameters(chain: Chain) -> Array:
    """Build the (10, 10) map to parameters of the last joint's link from those about the TCP, in
    the axes of the tool."""
    place = placed_at(np.array(chain.tcp) - chain.anchors[-1])
    return place @ in_axes(np.array(chain.tool))


def link_parameters(chain: Chain, joint: int) -> Array:
    """Compute the parameters (10,) of all links that move with a joint, about its anchor."""
    links = (link for link in chain.links if link.joint == joint)
    return parameters(links, np.array(chain.anchors[joint]))


def link_wrenches(
    chain: Chain, q: Array, dq: Array, ddq: Array, gravity: Array
) -> Iterator[tuple[Array, Array]]:
    """Yield the motion and the wrench regressor of each joint's link, in its own axes about its
    anchor, from the base out.

    Source: Khalil and Dombre, Modeling, Identification and Control of Robots, 2002, chapters 9 and
    12.

    Yields:
        (n, j, 6) twists of the joints up to it.
        (n, 6, 10) wrench that moves it, per unit of each of its parameters.
    """
    turned = hinges(chain, q)
    axes, anchors = (
        np.array([getattr(one, name) for one in turned]) for name in ("axis", "anchor")
    )
    moved = link_motions(turned, dq, ddq, gravity)
    for link, (hinge, motion) in enumerate(zip(turned, moved, strict=True)):
        before = slice(link + 1)
        # Twists of the joints up to this one at its anchor, turned into the axes of the link.
        asides = cross(axes[before], hinge.anchor - anchors[before])
        motions = np.stack([asides, axes[before]])
        local = np.einsum("nji,cbnj->nbci", hinge.frame, motions).reshape(len(q), link + 1, 6)
        # Motion of the link in its own axes.
        own = (np.einsum("nji,nj->ni", hinge.frame, each) for each in motion)
        yield local, wrench_columns(*own)


def link_motions(
    turned: Sequence[Hinge], dq: Array, ddq: Array, gravity: Array
) -> Iterator[tuple[Array, Array, Array]]:
    """Yield the motion of each joint's link, in the axes of the base.

    It is the acceleration of its anchor less gravity, its angular velocity, and its angular acceleration, (n, 3) each.
    """
    turn, spun, place = np.zeros((3, len(dq), 3))
    pulled = np.broadcast_to(-gravity, (len(dq), 3))
    for link, hinge in enumerate(turned):
        # Acceleration of the next anchor: α × r + ω × (ω × r).
        arm = hinge.anchor - place
        pulled = pulled + cross(spun, arm) + cross(turn, cross(turn, arm))
        # Add the joint's own rotation; its axis turns with the link before it.
        rate, change = dq[:, link, None], ddq[:, link, None]
        spun = spun + hinge.axis * change + cross(turn, hinge.axis) * rate
        turn, place = turn + hinge.axis * rate, hinge.anchor
        yield pulled, turn, spun
