"""Motion that excites a load: a Fourier series per joint within the limits of the arm.

    q_i(t) = c_i + Σ_k a_ik sin(k ω t) / (k ω) - b_ik cos(k ω t) / (k ω)

Source: J. Swevers, C. Ganseman, D. Tükel, J. De Schutter and H. Van Brussel, Optimal robot excitation and
identification, IEEE Trans. Robotics and Automation 13, 1997. The motion begins and ends at rest, at home. Among many
random series, the search takes that with the best conditioned load equations. The joints' friction and offsets are
projected out of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from palpate.common.errors import InputError
from palpate.common.pose import Array
from palpate.estimation.rigid_bodies import load_torques, tool_kinematics
from palpate.robots.description import RobotDescription
from palpate.trace.samples import STANDARD_GRAVITY

PERIOD = 12.0
"""s. Period of the base frequency."""
HARMONICS = 5
CYCLES = 3
RATE = 100.0
"""Rows per second of the file."""
LOOKED_AT = 150
"""Number of configurations of a period that are checked."""
TRIES, REFINED = 300, 300
SPEED_SHARE, ACCELERATION = 0.35, 4.0
"""Fraction of the joints' speed limits; rad/s²."""
SHARES = (1.0, 0.8, 0.6, 0.45, 0.3)
"""Fractions of the largest amplitude that are tried until the hand stays in its workspace."""
MARGIN = 0.12
"""rad. Distance from the ends of the joint ranges."""
ABOVE = 0.15
"""m. Smallest height of the hand above the arm's base."""
TYPICAL = np.array([1.0, *[0.05] * 3, *[5e-3] * 6])
"""kg, kg m and kg m². Parameters of a typical load; they scale the condition number."""


HOW = """\
{file} holds {seconds:.0f} s of motion for {arm}: t (s), q1…q7 (rad), dq1…dq7 (rad/s) at {rate:.0f} Hz, {cycles} \
periods of a Fourier series, from the home posture and back to it at rest. It keeps {share:.0%} of the joints' speeds, \
{acceleration:g} rad/s², and {above:g} m above the base; no links of the arm touch each other. The condition number of \
the load's equations is {condition:.0f}.
1. Clear the space around the arm: nothing but the arm itself was looked at, neither table nor load. Watch the first \
period at a tenth of the speed.
2. Play it with the empty hand, with a joint impedance or position controller, and log every cycle.
3. Grasp the load, lift it, and play it again in the same log, or in another one (--empty).
4. Log time, joint positions, joint velocities, and the joint torques as sensed, gravity in them (libfranka: q, dq, \
tau_J; ROS: joint_states with effort). External torques are not needed.
5. palpate estimate LOG --loaded A-B, with the seconds between lifting and putting down. For the mass alone any slow \
motion serves, in which all joints turn both ways; the inertia needs the fast one."""
"""Instructions for a recording."""


@dataclass(frozen=True, slots=True, eq=False)
class Excitation:
    """Periodic motion that starts and ends at home."""

    home: Array  # (7,) rad
    # sines, cosines: (7, HARMONICS) rad/s
    sines: Array
    cosines: Array
    condition: float  # condition number of the load's equations in units of `TYPICAL`

    def sample(self, t: Array) -> tuple[Array, Array, Array]:
        """Angles, rates and accelerations (n, 7), rad, rad/s, rad/s², at times `t` (n,), s, of whole periods."""
        rate = 2.0 * np.pi / PERIOD * np.arange(1, HARMONICS + 1)
        sine, cosine = np.sin(np.outer(t, rate)), np.cos(np.outer(t, rate))
        q = sine @ (self.sines / rate).T + (1.0 - cosine) @ (self.cosines / rate).T
        dq = cosine @ self.sines.T + sine @ self.cosines.T
        ddq = -sine @ (self.sines * rate).T + cosine @ (self.cosines * rate).T
        return self.home + q, dq, ddq

    def csv(self) -> str:
        """CSV table of t, q and dq over `CYCLES` periods."""
        t = np.arange(round(CYCLES * PERIOD * RATE) + 1) / RATE
        q, dq, _ = self.sample(t)
        names = [f"{kind}{joint}" for kind in ("q", "dq") for joint in range(1, 8)]
        rows = [",".join(f"{x:.6f}" for x in row) for row in np.column_stack([t, q, dq]).tolist()]
        return "\n".join([",".join(["t", *names]), *rows, ""])

    def told(self, arm: str, file: str) -> str:
        """Instructions for the recording."""
        return HOW.format(
            file=file,
            arm=arm,
            seconds=CYCLES * PERIOD,
            rate=RATE,
            cycles=CYCLES,
            share=SPEED_SHARE,
            acceleration=ACCELERATION,
            above=ABOVE,
            condition=self.condition,
        )


def excitation(arm: RobotDescription, seed: int = 0) -> Excitation:
    """Search for a well conditioned motion of `arm`; the result depends on the seed alone.

    Raises InputError: no tried motion keeps the limits.
    """
    random, search = np.random.default_rng(seed), _Search(arm)
    best: Excitation | None = None
    for count in range(TRIES + REFINED):
        shape = random.normal(size=(2, 7, HARMONICS))
        if count >= TRIES:
            if best is None:
                break
            # Refine: smaller and smaller random changes of the best series.
            last = np.array([best.sines, best.cosines])
            shape = last + last.std() * 0.5 * (1.0 - (count - TRIES) / REFINED) * shape
        # Keep a better conditioned motion if the arm does not touch itself.
        found = search.tried(shape)
        better = best is None or (found is not None and found.condition < best.condition)
        if found is not None and better and search.is_free(found):
            best = found
    if best is None:
        raise InputError(
            f"no exciting motion of '{arm.name}' keeps its limits; give its limits wider"
        )
    return best


class _Search:
    """Random search: limits of an arm and the evaluation of motions."""

    def __init__(self, arm: RobotDescription) -> None:
        self._arm, self._t = arm, np.arange(LOOKED_AT) * PERIOD / LOOKED_AT
        self._model = arm.spec(np.array([0.0, 0.0, -STANDARD_GRAVITY])).compile()
        self._data = mujoco.MjData(self._model)
        self._data.qpos[7:] = arm.hand.opening / 4
        self._joints = [int(self._model.jnt_qposadr[self._model.joint(n).id]) for n in arm.joints]

    def tried(self, shape: Array) -> Excitation | None:
        """Largest motion with `shape` (2, 7, HARMONICS); None if even a small one leaves the workspace."""
        k = np.arange(1, HARMONICS + 1)
        # Rest without acceleration at t = 0: the sines' speeds and the cosines' accelerations sum to 0.
        sines = shape[0] - shape[0].mean(axis=1, keepdims=True)
        cosines = shape[1] - np.outer(shape[1] @ k, k) / (k @ k)
        # Largest amplitude of each joint within its range, speed and acceleration limits.
        limits, home = self._arm.limits, self._arm.home
        q, dq, ddq = Excitation(np.zeros(7), sines, cosines, 0.0).sample(self._t)
        room = [
            (limits.q_max - MARGIN - home) / np.maximum(q.max(axis=0), 1e-9),
            (limits.q_min + MARGIN - home) / np.minimum(q.min(axis=0), -1e-9),
            SPEED_SHARE * limits.dq_max / np.abs(dq).max(axis=0),
            ACCELERATION / np.abs(ddq).max(axis=0),
        ]
        scale = np.min(room, axis=0)[:, None]
        # Reduce the amplitude until the hand stays in its workspace.
        for share in SHARES:
            size = share * scale
            found = self._judge_motion(Excitation(home, sines * size, cosines * size, 0.0))
            if found is not None:
                return found
        return None

    def _judge_motion(self, found: Excitation) -> Excitation | None:
        """Evaluate the condition of a motion; None if the hand leaves its workspace."""
        q, dq, ddq = found.sample(self._t)
        chain = self._arm.nominal.chain
        assert chain is not None
        # Workspace check along the whole period.
        tcp, _, _ = tool_kinematics(chain, q)
        limits = self._arm.limits
        low = np.maximum(limits.workspace_min, [-np.inf, -np.inf, ABOVE])
        if bool((tcp < low).any() or (tcp > limits.workspace_max).any()):
            return None
        # Condition number of the load's equations, joint by joint.
        load = load_torques(chain, q, dq, ddq, np.array([0.0, 0.0, -STANDARD_GRAVITY]))
        left: list[Array] = []
        for joint in range(7):
            # Project out offset, Coulomb and viscous friction of the joint.
            own = np.column_stack([np.ones(len(q)), np.sign(dq[:, joint]), dq[:, joint]])
            basis = np.linalg.qr(own)[0]
            seen = load[:, joint]
            left.append(seen - basis @ (basis.T @ seen))
        condition = float(np.linalg.cond(np.concatenate(left) * TYPICAL))
        return Excitation(found.home, found.sines, found.cosines, condition)

    def is_free(self, found: Excitation) -> bool:
        """True if no parts of the arm touch each other in the motion."""
        for q in found.sample(self._t)[0]:
            self._data.qpos[self._joints] = q
            mujoco.mj_kinematics(self._model, self._data)
            mujoco.mj_collision(self._model, self._data)
            if self._data.ncon:
                return False
        return True
