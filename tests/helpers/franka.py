"""Objects that stand for those of the library `franky`: an arm's state, and its gripper."""

from __future__ import annotations

import threading
from types import SimpleNamespace
from typing import Any

import numpy as np

from palpate.common.pose import Pose
from palpate.robots.nominal import NominalArm
from palpate.robots.owner import load_description

ARM = load_description()
BASE = Pose.of((0.1, -0.2, 0.3), (np.cos(0.4), 0.0, 0.0, np.sin(0.4)))
"""The arm stands turned and elsewhere."""
NOMINAL = NominalArm(ARM, BASE, np.array([0.0, 0.0, -9.81]))
DOWN = BASE.rotation.T @ [0.0, 0.0, -9.81]


class Gripper:
    """Stands for franky's; a command waits for `may_end`."""

    def __init__(self, width: float = 0.08, is_grasped: bool = False) -> None:
        self.now = SimpleNamespace(width=width, is_grasped=is_grasped)
        self.calls: list[tuple[Any, ...]] = []
        self.may_end, self.answers, self.lost = threading.Event(), True, False
        self.may_end.set()

    @property
    def state(self) -> SimpleNamespace:
        if self.lost:
            raise OSError("no packet")
        return self.now

    def open(self, *how: Any) -> bool:
        return self.done("open", *how)

    def grasp(self, *how: Any) -> bool:
        return self.done("grasp", *how)

    def done(self, *call: Any) -> bool:
        self.calls.append(call)
        self.may_end.wait(5.0)
        return self.answers


def affine(pose: Pose) -> SimpleNamespace:
    """franky's transform, whose quaternion is xyzw."""
    return SimpleNamespace(
        translation=pose.position, quaternion=[*pose.quaternion[1:], pose.quaternion[0]]
    )


def state(t: float, q: Any = ARM.home, mode: str = "Move", **more: Any) -> Any:
    """franky's state of the arm at `t` s."""
    row = NOMINAL.poses(np.asarray(q)[None])[0]
    tcp = BASE.inverse() @ Pose(row[:3], row[3:])
    usual: dict[str, Any] = {
        "dq": np.zeros(7),
        "tau_J": np.zeros(7),
        "tau_J_d": np.zeros(7),
        "tau_ext_hat_filtered": np.zeros(7),
        "O_F_ext_hat_K": np.zeros(6),
        "m_total": 0.73,
        "F_x_Ctotal": np.zeros(3),
        "control_command_success_rate": 1.0,
        "O_T_EE": affine(tcp),
    }
    clock = SimpleNamespace(to_sec=lambda: t, to_msec=lambda: round(1000 * t))
    usual |= {"time": clock, "q": np.asarray(q), "robot_mode": SimpleNamespace(name=mode)}
    return SimpleNamespace(**usual | more)
