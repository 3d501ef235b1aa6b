"""Bound of a height measured by touch: from the errors of the arm, its links and its fingertips."""

from __future__ import annotations

from collections.abc import Iterator

import mujoco
import numpy as np

from bench.bounds.errors import deviation
from palpate.common.parameter import Parameter
from palpate.common.pose import Array, Pose
from palpate.estimation.descent import probes
from palpate.robots.description import RobotDescription
from palpate.robots.simulated.noise.model import NoiseModel
from palpate.trace.samples import Trace

VERTICAL = 2


def of_height(
    trace: Trace, parameter: Parameter, base: Pose, arm: RobotDescription, noise: NoiseModel
) -> float | None:
    """Least standard deviation (m) of a surface's height; None if it was not touched.

    Touching cannot distinguish a higher surface from a higher base, longer links or longer
    fingertips, which are drawn once a robot. The bound is the root of the sum of squares of their
    effects on the height of the fingertips, and of the pose's repeatability over √n for n touches.
    """
    # Force noise over the stiffness of a rigid surface is negligible.
    touches = probes(trace, parameter)
    if not touches:
        return None
    q = trace.of(touches[-1]).q.mean(axis=0)
    repeated = deviation(noise.pose.repeatability)[VERTICAL] / np.sqrt(len(touches))
    parts = [repeated, noise.pose.thermal, *_of_robot(q, base, arm, noise)]
    return float(np.linalg.norm(parts))


def _of_robot(q: Array, base: Pose, arm: RobotDescription, noise: NoiseModel) -> Iterator[float]:
    """Effects (m) of the errors that are drawn once a robot on the fingertips' height, at angles `q`."""
    drawn = noise.model
    model = arm.spec().compile()
    data = mujoco.MjData(model)
    joints = [int(model.joint(name).id) for name in arm.joints]
    data.qpos[[int(model.jnt_qposadr[joint]) for joint in joints]] = q
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    hand = int(model.body(arm.hand.body).id)
    tool = data.xmat[hand].reshape(3, 3)
    tip = data.site(arm.tcp).xpos + tool[:, VERTICAL] * arm.tip
    jacobian = np.zeros((3, model.nv))
    mujoco.mj_jac(model, data, jacobian, None, tip, hand)
    dofs = [int(model.jnt_dofadr[joint]) for joint in joints]
    yield from (deviation(drawn.joint_offset) * jacobian[VERTICAL, dofs]).tolist()
    for joint, size in zip(joints, deviation(drawn.link_length).tolist(), strict=True):
        body = int(model.jnt_bodyid[joint])
        way, length = model.body_pos[body], float(np.linalg.norm(model.body_pos[body]))
        along = way / length if length else model.jnt_axis[joint]
        parent = data.xmat[model.body_parentid[body]].reshape(3, 3)
        yield size * float((parent @ along)[VERTICAL])
    away = base.rotation @ tip
    tilt = deviation(drawn.base_tilt)
    yield float(tilt[0] * away[1])
    yield float(tilt[1] * away[0])
    yield float(deviation(drawn.base_position)[VERTICAL])
    yield float(deviation(drawn.tip_offset)) * float(tool[VERTICAL, VERTICAL])
    yield from (deviation(drawn.tip_lateral) * tool[VERTICAL, :2]).tolist()
