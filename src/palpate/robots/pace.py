"""Speed limits of an arm, and the uncertainty of its wrench at rest."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache, lru_cache
from itertools import pairwise
from threading import Lock

import numpy as np

from palpate.common.pose import Array, Pose
from palpate.robots.description import RobotDescription
from palpate.robots.nominal import RIDGE, NominalArm
from palpate.robots.sheet import MotionLimits, WristSheet

STATIONS = 9  # number of configurations along a motion at which its speed limit is computed
SOFTEST = 1e-3  # 1/kg added to a mobility: a mass above 1000 kg counts as immovable
# N/m: stiffness of an obstacle of steel on a concrete floor. A softer obstacle stops the arm more
# gently.
STIFFEST = 1e6
# N/m: stiffness between the shells of elbow or wrist and obstacles that hang above. Stiffer
# obstacles are below, on a table.
SHELL = 1e5
# Restitution of the arm's shells on an obstacle of equal stiffness, with a damping ratio of one
# fifth.
REBOUND = 0.5
# Cosine to the tool axis of motions that only the fingertips or only the wrist lead. An upright
# obstacle meets the hand's side with at most the remaining part of the motion.
LENGTHWAYS = 0.7
WINDOW = 0.010  # s over which the force of a contact is averaged
GENTLE = 0.65  # N s: 65 N on average over 10 ms, the lowest quasi-static limit of ISO/TS 15066
STILL = 1e-6  # m on a whole motion: a point that moves less is at rest

_LOCK = Lock()


def contact_speed(arm: RobotDescription, pose_base_tcp: Pose, direction: Array) -> float:
    """Compute the speed, m/s, of an intended contact of the TCP with an impulse of `GENTLE`.

    The contact is at a pose, along the unit `direction` (3,), both in the base's axes. The mass is that of the
    hand with its orientation fixed: with both fingers on a surface it cannot turn. The speed is
    v = GENTLE / ((1 + e) d^T M_tcp d).
    """
    with _LOCK:
        nominal = _nominal(arm)
        q = nominal.reach(pose_base_tcp, arm.home)
        jacobian = nominal.jacobian(q)
        mobility = jacobian @ np.linalg.solve(nominal.mass_matrix(q), jacobian.T)
    # Inertia of the hand that cannot turn: the translational block of the inverted mobility.
    held = np.linalg.inv(mobility + SOFTEST * np.eye(6))[:3, :3]
    return GENTLE / ((1.0 + arm.pace.restitution) * float(direction @ held @ direction))


def configuration(arm: RobotDescription, pose_base_tcp: Pose) -> Array:
    """Compute the joint angles (7,), rad, for a pose of the TCP in the base's axes."""
    with _LOCK:
        return _nominal(arm).reach(pose_base_tcp, arm.home)


def jacobian(arm: RobotDescription, q: Array) -> Array:
    """Compute the Jacobian (6, 7) of the TCP at joint angles `q` (7,), rad, in the base's axes."""
    with _LOCK:
        return _nominal(arm).jacobian(q).copy()


def free_speeds(
    nominal: NominalArm, arm: RobotDescription, bent: tuple[Array, Array], way: Array
) -> list[float]:
    """Compute the speed limits, m/s, in free air in each equal part of the straight `way` (3,), m, in the nominal
    arm's axes. `bent` has the joint angles (7,), rad, at its beginning and end.
    """
    length = float(np.linalg.norm(way))
    direction, (first, last) = way / length, bent
    # Evaluate the limit at stations between the two configurations; a part takes the lower of its ends.
    speeds: list[float] = []
    for share in np.linspace(0.0, 1.0, STATIONS).tolist():
        q = first + share * (last - first)
        speed = free_speed(nominal, arm, q, direction)
        speeds.append(min(speed, elbow_speed(nominal, arm, q, direction, (last - first) / length)))
    return [min(pair) for pair in pairwise(speeds)]


def free_speed(nominal: NominalArm, arm: RobotDescription, q: Array, direction: Array) -> float:
    """Compute the TCP's speed limit, m/s, in free air at joint angles `q` (7,), rad.

    The motion is along the unit `direction` (3,), in the nominal arm's axes. No leading point of the hand
    exceeds the pace's impulse.
    """
    mass_matrix, jacobian, tool = nominal.mass_matrix(q), nominal.jacobian(q), tool_axis(nominal, q)
    # Leading points, m behind the TCP: the fingertips, the back of the wrist or, sideways, both and the middle.
    forwards, points, stiffness = float(direction @ tool), (0.0, 0.5, 1.0), STIFFEST
    if forwards > LENGTHWAYS:
        points = (0.0,)
    elif forwards < -LENGTHWAYS:
        points, stiffness = (1.0,), SHELL
    # The point with the largest effective mass limits the speed.
    speed = arm.pace.speed
    for share in points:
        behind = share * arm.reach.wrist
        mass = guided_mass(mass_matrix, point_jacobian(jacobian, -behind * tool), direction)
        speed = min(speed, impulse_speed(arm.pace, mass, stiffness))
    return speed


def elbow_speed(
    nominal: NominalArm, arm: RobotDescription, q: Array, direction: Array, rate: Array
) -> float:
    """Compute the TCP's speed limit, m/s, at which the elbow keeps the pace's impulse.

    The TCP moves along the unit `direction` (3,). The joints move at the mean `rate` (7,), rad/m, corrected to
    this direction: dq = r + J^+ (d - J_v r, 0).
    """
    mass_matrix, jacobian = nominal.mass_matrix(q), nominal.jacobian(q)
    missing = np.concatenate([direction - jacobian[:3] @ rate, np.zeros(3)])
    way = rate + jacobian.T @ np.linalg.solve(jacobian @ jacobian.T + RIDGE, missing)
    return _impulse_rate(arm.pace, mass_matrix, nominal.elbow_jacobian(), way, SHELL)


def guided_mass(mass_matrix: Array, jacobian: Array, direction: Array) -> float:
    """Compute the effective mass, kg, along a unit `direction` (3,) of a point with its `jacobian` (3, 7).

    The point is kept on its line, as by friction at a contact: d^T (J M^-1 J^T)^-1 d. Its orientation is free.
    """
    return float(direction @ np.linalg.inv(point_mobility(mass_matrix, jacobian)) @ direction)


def joint_rates(
    nominal: NominalArm, arm: RobotDescription, start: Array, goal: Array
) -> list[float]:
    """Compute the rate limits, 1/s, in each equal part of the straight joint motion from `start` to `goal`
    (7,), rad.

    Joints, fingertips, wrist and elbow keep their limits at these rates.
    """
    # The fastest joint limits the rate of the whole motion; the moving points limit it further.
    way = goal - start
    most = arm.pace.joint_speed / max(float(np.abs(way).max()), 1e-6)
    rates: list[float] = []
    for share in np.linspace(0.0, 1.0, STATIONS).tolist():
        rates.append(min(most, point_rate(nominal, arm, start + share * way, way)))
    return [min(pair) for pair in pairwise(rates)]


def point_rate(nominal: NominalArm, arm: RobotDescription, q: Array, way: Array) -> float:
    """Compute the rate limit, 1/s, of fingertips, wrist and elbow along the joint motion `way` (7,),
    rad, at joint angles `q` (7,).
    """
    mass_matrix, tcp = nominal.mass_matrix(q), nominal.jacobian(q)
    wrist = point_jacobian(tcp, -arm.reach.wrist * tool_axis(nominal, q))
    # Each point meets an obstacle with its effective mass 1 / (d^T J M^-1 J^T d).
    points = ((tcp[:3], STIFFEST), (wrist, STIFFEST), (nominal.elbow_jacobian(), SHELL))
    return min(_impulse_rate(arm.pace, mass_matrix, point, way, k) for point, k in points)


def _impulse_rate(
    pace: MotionLimits, mass_matrix: Array, point: Array, way: Array, stiffness: float
) -> float:
    """Compute the rate limit, 1/s, of a point with its Jacobian (3, 7) along the joint motion `way` (7,)."""
    velocity = point @ way
    size = float(np.linalg.norm(velocity))
    if size <= STILL:
        return math.inf
    ahead = velocity / size
    mass = 1.0 / float(ahead @ point_mobility(mass_matrix, point) @ ahead)
    return min(pace.speed, impulse_speed(pace, mass, stiffness)) / size


def tool_axis(nominal: NominalArm, q: Array) -> Array:
    """Compute the tool's axis (3,), out of the hand, in the nominal arm's axes."""
    return Pose(np.zeros(3), nominal.poses(q[None])[0, 3:]).rotation[:, 2]


def point_jacobian(jacobian: Array, offset: Array) -> Array:
    """Shift the TCP's `jacobian` (6, 7) to a point at `offset` (3,), m: (3, 7)."""
    return jacobian[:3] - np.cross(offset, jacobian[3:], axis=0)


def point_mobility(mass_matrix: Array, jacobian: Array) -> Array:
    """Compute the mobility (3, 3), 1/kg, of a point with this `jacobian` (3, 7): J M^-1 J^T, regularised."""
    return jacobian @ np.linalg.solve(mass_matrix, jacobian.T) + SOFTEST * np.eye(3)


def impulse_speed(pace: MotionLimits, mass: float, stiffness: float) -> float:
    """Compute the speed, m/s, at which a mass, kg, transfers the pace's impulse to an obstacle within `WINDOW`.

    The obstacle has the `stiffness`, N/m. The force is half a wave of sin(w t) with w = sqrt(k / m).
    Within the window, a heavy mass transfers only the middle of that wave.
    """
    angle = min(math.sqrt(stiffness / mass) * WINDOW / 2, math.pi / 2)
    return pace.impulse / ((1.0 + REBOUND) * mass * math.sin(angle))


@cache
def _nominal(arm: RobotDescription) -> NominalArm:
    return NominalArm(arm, Pose.of((0.0, 0.0, 0.0)), np.zeros(3))


# Uncertainty of the wrench measured at rest, from the arm's description.


# Ticks whose median is the measured wrench: 60 ms, in which a probing arm moves 1 mm at most.
SUSTAINED = 3
# Joint friction that an arm's torques may show, over the `friction` of its description: root of the
# sum of squares over the joints. A Franka's is 1.0 N m, half of phi_1 of Gaz, Cognetti, Oliva, Robuffo
# Giordano, De Luca, RA-L 2019, doi:10.1109/LRA.2019.2931248.
RUBBING = 6.637
# Factor on this friction, with the owner's figures of rests and noise, beyond which a torque is no
# error. Conforming runs leave up to 1.25 N m unexplained (ten scenarios at `hardware` and
# `measured`), and 0.35 N m at `lab`.
SURELY = 2.0


@dataclass(frozen=True, slots=True, eq=False)
class Doubt:
    """Standard deviations of a moment measured in one configuration, from the joints' errors."""

    # (7,) N m, of relative errors of each joint's sensor and links, the same in all configurations
    lasting: Array
    fleeting: float  # N m, of errors that differ at every rest: friction, drift and noise

    def of_change(self, since: Doubt) -> float:
        """Compute the standard deviation, N m, of the change from another configuration."""
        lasting = float(np.linalg.norm(self.lasting - since.lasting))
        return float(np.hypot(lasting, np.hypot(self.fleeting, since.fleeting)))


def shown_friction(arm: RobotDescription) -> float:
    """Compute the joint friction, N m, norm over the joints, that the arm's torques may show."""
    return RUBBING * float(np.linalg.norm(arm.sensors.friction))


def sensor_error(sensor: WristSheet) -> Array:
    """Compute standard deviations (6,), N and N m, of a six-axis sensor's reading at a rest."""
    return np.sqrt(sensor.white**2 / SUSTAINED + sensor.drift**2)


def doubt(arm: RobotDescription, q: Array, tau: Array, axis: Array) -> Doubt:
    """Compute the uncertainty of the moment about the unit `axis` (3,), in the base's axes, measured at rest.

    The joint angles are `q` (7,), rad, and the joint torques `tau` (7,), N m. The wrench at the TCP is
    (J J^T)^-1 J tau, and so is its deviation. A gain error of uniform distribution has the standard deviation
    half width / sqrt(3). A six-axis sensor measures the moment itself.
    """
    if arm.wrench_sensor is not None and arm.nominal.wrench_sensor is not None:
        own = sensor_error(arm.wrench_sensor)
        lever = math.hypot(*arm.nominal.wrench_sensor.pose_tcp_sensor[:3])
        return Doubt(np.zeros(1), math.hypot(own[3:].max(), lever * own[:3].max()))
    sensors, gain = arm.sensors, arm.nominal.torque_gain / np.sqrt(3.0)
    # Lever of each joint torque on the moment; relative errors scale with the torque.
    levers = moments(arm, q).T @ axis
    relative = np.hypot(gain, sensors.link_mass)
    # Errors of a rest: noise of a median over ticks, friction or ripple, and drift.
    noise = sensors.torque_noise / np.sqrt(SUSTAINED)
    rest = np.maximum(sensors.friction, arm.rest_torque)
    own = np.sqrt(rest**2 + noise**2 + sensors.drift**2)
    return Doubt(relative * levers * tau, float(np.linalg.norm(own * levers)))


def rubbing(arm: RobotDescription, pose_base_tcp: Pose) -> float:
    """Compute the largest moment about the TCP, N m, that joint friction can imitate at a pose.

    Where the wrist's first and last axis are nearly parallel, their torques carry no information on a moment
    across them. Friction can then imitate any such moment.
    """
    return shown_friction(arm) * _moment_gain(arm, tuple(pose_base_tcp.vector.round(6).tolist()))


@lru_cache
def unexplained_torque(arm: RobotDescription) -> float:
    """Compute the largest torque, N m, norm over the joints, that errors of the arm can explain.

    These errors are friction of the joints, remainders of rests, and the sensors' noise.
    """
    rest = np.maximum(arm.sensors.friction, arm.rest_torque)
    noise = arm.sensors.torque_noise / np.sqrt(SUSTAINED)
    return SURELY * float(np.sqrt(shown_friction(arm) ** 2 + rest @ rest + noise @ noise))


def mistaken_force(arm: RobotDescription, q: Array) -> float:
    """Compute the largest force on the TCP, N, that errors of the measured wrench imitate at joint angles `q`
    (7,), rad: those of a six-axis sensor, or of the joint torques.
    """
    if arm.wrench_sensor is not None:
        return SURELY * float(np.linalg.norm(sensor_error(arm.wrench_sensor)[:3]))
    return force_of_torque_errors(arm, q)


def force_of_torque_errors(arm: RobotDescription, q: Array) -> float:
    """Compute the largest force on the TCP, N, that `unexplained_torque` can imitate at joint angles `q` (7,),
    rad.

    The force is (J J^T)^-1 J tau. A stretched arm has no lever on a force along it: a little friction imitates
    a large force.
    """
    return unexplained_torque(arm) * float(np.linalg.norm(_unit_wrenches(arm, q)[:3], 2))


def mistaken_weight(arm: RobotDescription, q: Array, up: Array) -> float:
    """Compute the largest force along the unit `up` (3,), N, that `unexplained_torque` can imitate at joint
    angles `q` (7,), rad; or the error of a six-axis sensor.
    """
    if arm.wrench_sensor is not None:
        return SURELY * float(sensor_error(arm.wrench_sensor)[:3].max())
    return unexplained_torque(arm) * float(np.linalg.norm(up @ _unit_wrenches(arm, q)[:3]))


def mistaken_moment(arm: RobotDescription, q: Array) -> float:
    """Compute the largest moment about the TCP, N m, that `unexplained_torque` can imitate at joint angles `q`
    (7,), rad.
    """
    return unexplained_torque(arm) * float(np.linalg.norm(moments(arm, q), 2))


@lru_cache(maxsize=4096)
def _moment_gain(arm: RobotDescription, pose: tuple[float, ...]) -> float:
    """Compute the largest moment about the TCP, N m, of joint torques of 1 N m, at a pose."""
    there = Pose(np.array(pose[:3]), np.array(pose[3:]))
    return float(np.linalg.norm(moments(arm, configuration(arm, there)), 2))


def moments(arm: RobotDescription, q: Array) -> Array:
    """Compute the moments about the TCP (3, 7), in the base's axes, of unit torques of the joints."""
    return _unit_wrenches(arm, q)[3:]


def _unit_wrenches(arm: RobotDescription, q: Array) -> Array:
    """Compute the wrenches at the TCP (6, 7), in the base's axes, of unit torques of the joints."""
    there = jacobian(arm, q)
    return np.linalg.solve(there @ there.T + RIDGE, there).astype(np.float64)
