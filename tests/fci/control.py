"""The robot's own controllers, and what it makes of a client's motion commands."""

from __future__ import annotations

import numpy as np

from palpate.common.pose import Array
from palpate.robots.simulated.timing import TIMESTEP

from .believed import BelievedArm
from .sensing import Sensing
from .wire import MotionMode

JOINT_STIFFNESS = np.array([3000.0, 3000, 3000, 2500, 2500, 2000, 2000])
CARTESIAN_STIFFNESS = np.array([3000.0, 3000, 3000, 300, 300, 300])
"""N m/rad, N/m: what franka_ros sets by default, franka_control_node.yaml."""
HOLDING = 1e4 * np.ones(7)
"""N m/rad of the position controller that holds an arm that nobody commands."""
DECELERATION = 10.0
"""rad/s^2 at which an arm is stopped: FR3's largest (franka/rate_limiting.h)."""
GUIDED = 0.5
"""rad/s: how fast somebody leads the arm by hand."""
PULL = 3.0
"""1/s: how fast the elbow comes back where a Cartesian motion leaves it free."""


class Desired:
    """What the arm is to do: (7,) q, dq, ddq."""

    def __init__(self, q: Array) -> None:
        self.q, self.dq, self.ddq = q.copy(), np.zeros(7), np.zeros(7)

    def become(self, q: Array) -> None:
        """Be at `q` one cycle later."""
        dq = (q - self.q) / TIMESTEP
        self.ddq, self.dq, self.q = (dq - self.dq) / TIMESTEP, dq, q.copy()

    def brake(self) -> None:
        """One cycle of coming to rest."""
        slower = np.sign(self.dq) * np.maximum(np.abs(self.dq) - DECELERATION * TIMESTEP, 0.0)
        self.become(self.q + slower * TIMESTEP)

    def approach(self, goal: Array) -> bool:
        """One cycle of being led to `goal` (7,), rad, by a hand; whether it is there."""
        way = goal - self.q
        self.dq = np.clip(way / TIMESTEP, -GUIDED, GUIDED)
        self.q, self.ddq = self.q + self.dq * TIMESTEP, np.zeros(7)
        return not way.any()


class Controller:
    """Torques (7,), N m, besides gravity, for what is desired."""

    def __init__(self, believed: BelievedArm, sensing: Sensing) -> None:
        self._believed, self._sensing = believed, sensing
        self.desired = Desired(sensing.q)
        self.K_theta, self.K_x = JOINT_STIFFNESS.copy(), CARTESIAN_STIFFNESS.copy()
        self.hold()

    def hold(self, at_once: bool = False) -> None:
        """Come to rest, and stay; `at_once`: where the arm is now, however hard that is for it."""
        self._stiffness = HOLDING
        self.desired = Desired(self._sensing.q)
        if not at_once:
            self.desired.dq = self._sensing.dq.copy()
        self._inertia = self._believed.mass_matrix()
        self._damp()

    def _damp(self) -> None:
        self._damping = 2 * np.sqrt(self._stiffness * np.diag(self._inertia))

    def joints(self) -> Array:
        """Joint impedance, with what the motion needs fed forward."""
        sensing, desired = self._sensing, self.desired
        torque = self._stiffness * (desired.q - sensing.q)
        torque += self._damping * (desired.dq - sensing.dq)
        return torque + self._inertia @ desired.ddq + self._believed.bias

    def cartesian(self) -> Array:
        """Cartesian impedance at the end effector, the elbow held softly."""
        believed, sensing, desired = self._believed, self._sensing, self.desired
        jacobian, target = believed.ee_jacobian(), self.target
        error = np.concatenate(
            [target[:3, 3] - believed.O_T_EE[:3, 3], turn(believed.O_T_EE, target)]
        )
        mobility = jacobian @ np.linalg.solve(self._inertia, jacobian.T)
        apparent = np.diag(np.linalg.inv(mobility + 1e-6 * np.eye(6)))
        damping = 2 * np.sqrt(self.K_x * apparent)
        force = self.K_x * error + damping * (jacobian @ (desired.dq - sensing.dq))
        rest = 50.0 * (desired.q - sensing.q) + 10.0 * (desired.dq - sensing.dq)
        inverse = np.linalg.pinv(jacobian.T)
        rest -= jacobian.T @ (inverse @ rest)
        return jacobian.T @ force + rest + believed.bias

    def start(self) -> None:
        """A motion begins where the arm is held, with the impedance that the client set."""
        self._stiffness = self.K_theta
        self._inertia = self._believed.mass_matrix()
        self._damp()
        self.target = self._believed.O_T_EE.copy()
        self.twist, self.acceleration = np.zeros(6), np.zeros(6)
        self._posture = self.desired.q.copy()

    def pursue(self, mode: int, q: Array, dq: Array, target: Array, twist: Array) -> None:
        """Take over one command of a motion generator."""
        desired = self.desired
        if mode == MotionMode.JOINT_POSITION:
            desired.become(q)
        elif mode == MotionMode.JOINT_VELOCITY:
            desired.become(desired.q + TIMESTEP * dq)
        elif mode == MotionMode.CARTESIAN_POSITION:
            way = np.concatenate([target[:3, 3] - self.target[:3, 3], turn(self.target, target)])
            self._go(way / TIMESTEP, target)
        else:
            goal = self.target.copy()
            goal[:3, 3] += TIMESTEP * twist[:3]
            goal[:3, :3] = turned(TIMESTEP * twist[3:]) @ goal[:3, :3]
            self._go(twist, goal)

    def _go(self, twist: Array, target: Array) -> None:
        """Joint rates that move the end effector so, and leave the elbow where it was."""
        self.acceleration = (twist - self.twist) / TIMESTEP
        self.twist, self.target = twist, target.copy()
        jacobian = self._believed.ee_jacobian()
        inverse = np.linalg.pinv(jacobian)
        behind = self._behind()
        back = PULL * (self._posture - self.desired.q)
        rate = inverse @ (twist + behind) + back - inverse @ (jacobian @ back)
        self.desired.become(self.desired.q + TIMESTEP * rate)

    def _behind(self) -> Array:
        """(6,) rates that bring the measured pose, less what springs give way, to the target: joint
        angles drift off a pose that is only integrated."""
        believed, sensing = self._believed, self._sensing
        jacobian = believed.ee_jacobian()
        lag = jacobian @ (self.desired.q - sensing.q)
        error = np.concatenate(
            [self.target[:3, 3] - believed.O_T_EE[:3, 3], turn(believed.O_T_EE, self.target)]
        )
        return 5.0 * (error - lag)


def turn(start: Array, goal: Array) -> Array:
    """(3,) rad, base axes, from one (4, 4) to another, small."""
    difference = goal[:3, :3] @ start[:3, :3].T
    axis = np.array(
        [
            difference[2, 1] - difference[1, 2],
            difference[0, 2] - difference[2, 0],
            difference[1, 0] - difference[0, 1],
        ]
    )
    return axis / 2


def turned(way: Array) -> Array:
    """(3, 3) of a rotation vector (3,), rad (Rodrigues)."""
    angle = float(np.linalg.norm(way))
    if angle == 0.0:
        return np.eye(3)
    x, y, z = way / angle
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
