"""The arm's nominal model as a URDF, which a robot hands to its clients.

libfranka makes its dynamics of it (links `base` to `link8`, the flange, without the end effector),
and the limits of its motion generators (`position_based_velocity_limits`).
"""

from __future__ import annotations

from xml.sax.saxutils import quoteattr

import mujoco
import numpy as np

from palpate.common.pose import Array
from palpate.robots.description import RobotDescription

from .believed import BelievedArm

DECELERATION = (6.0, 2.585, 3.5, 4.0, 17.0, 5.5, 17.0)
OFFSET = (0.30, 0.20, 0.20, 0.30, 0.35, 0.35, 0.35)
"""rad/s^2 and rad/s of a joint's speed limit near its ends: min(v_max, -offset + sqrt(2 a (q_max -
q))), https://frankarobotics.github.io/docs/control_parameters.html#limits-for-franka-research-3."""


def urdf(arm: RobotDescription, believed: BelievedArm) -> str:
    """The text. Links and joints are numbered as Franka's own are."""
    model = believed.model
    lines = [f"<robot name={quoteattr(arm.name)}>", '<link name="base"/>']
    lines += ['<joint name="base_joint" type="fixed">', *_between("base", "link0"), "</joint>"]
    for i, name in enumerate(arm.links):
        lines += [f'<link name="link{i}">', *_inertial(model, name), "</link>"]
    for i, name in enumerate(arm.joints):
        lines += _joint(model, arm, i, name)
    lines += ['<link name="link8"/>', '<joint name="joint8" type="fixed">']
    lines += [*_between("link7", "link8"), _origin(believed.flange[:3, 3], np.eye(3)), "</joint>"]
    return "\n".join([*lines, "</robot>"])


def _between(parent: str, child: str) -> list[str]:
    return [f'<parent link="{parent}"/>', f'<child link="{child}"/>']


def _joint(model: mujoco.MjModel, arm: RobotDescription, i: int, name: str) -> list[str]:
    body = int(model.jnt_bodyid[model.joint(name).id])
    turn = np.empty(9)
    mujoco.mju_quat2Mat(turn, model.body_quat[body])
    x, y, z = model.joint(name).axis
    limits = arm.limits
    return [
        f'<joint name="joint{i + 1}" type="revolute">',
        *_between(f"link{i}", f"link{i + 1}"),
        _origin(model.body_pos[body], turn.reshape(3, 3)),
        f'<axis xyz="{x:.17g} {y:.17g} {z:.17g}"/>',
        f'<limit effort="{limits.tau_max[i]:g}" lower="{limits.q_min[i]:.9g}" '
        f'upper="{limits.q_max[i]:.9g}" velocity="{limits.dq_max[i]:g}"/>',
        f'<position_based_velocity_limits deceleration_limit="{DECELERATION[i]}" '
        f'velocity_offset="{OFFSET[i]}"/>',
        "</joint>",
    ]


def _inertial(model: mujoco.MjModel, name: str) -> list[str]:
    body = int(model.body(name).id)
    turn = np.empty(9)
    mujoco.mju_quat2Mat(turn, model.body_iquat[body])
    axes = turn.reshape(3, 3)
    full = (axes * model.body_inertia[body]) @ axes.T
    moments = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2)}
    moments["izz"] = (2, 2)
    said = " ".join(f'{key}="{full[at]:.17g}"' for key, at in moments.items())
    return [
        "<inertial>",
        _origin(model.body_ipos[body], np.eye(3)),
        f'<mass value="{model.body_mass[body]:.17g}"/>',
        f"<inertia {said}/>",
        "</inertial>",
    ]


def _origin(position: Array, turn: Array) -> str:
    """Roll, pitch and yaw about fixed axes, as URDF has them."""
    roll = np.arctan2(turn[2, 1], turn[2, 2])
    pitch = np.arctan2(-turn[2, 0], np.hypot(turn[0, 0], turn[1, 0]))
    yaw = np.arctan2(turn[1, 0], turn[0, 0])
    x, y, z = position
    return f'<origin xyz="{x:.17g} {y:.17g} {z:.17g}" rpy="{roll:.17g} {pitch:.17g} {yaw:.17g}"/>'
