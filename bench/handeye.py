"""Calibrations of a camera by a tag on the hand: are errors as large as their covariance says?

    python -m bench.handeye [RUNS] [NOISE]

Every run is another embedded arm of the noise model (zeros of encoders, lengths of links, place of the base),
another camera, 5 mm and 5 mrad from where it is believed to be, another lens, 1 % off, and another sticker;
corners have noise. The arm does not move, its true kinematics are used; all of it does
`palpate calibrate --camera world:workspace`.
"""

from __future__ import annotations

import sys
import time

import mujoco
import numpy as np

from palpate.calibration.camera import (
    KEPT,
    PICTURES,
    configurations,
    in_view,
    stances,
)
from palpate.calibration.session import Session
from palpate.cells.simulated import SimulatedCell
from palpate.geometry.pose import Array, Pose
from palpate.robots.model import PREFIX
from palpate.robots.nominal import NominalArm
from palpate.robots.owner.config import RobotConfig
from palpate.seeing.handeye.embedded import STICKER
from palpate.seeing.handeye.fit import Views, frame_of, hand_eye, surest
from palpate.seeing.lens import FACING, Lens, Mount, pinhole
from palpate.seeing.solve import apart, moved
from palpate.seeing.vision import CORNERS
from palpate.settings import Settings
from palpate.trace.samples import STANDARD_GRAVITY

HALF, PLACE, LENS = 0.03, 0.005, 0.01
"""m, m and rad, relative."""


def true_poses(cell: SimulatedCell, arm, q: Array) -> list[Pose]:
    """True poses of the TCP in the world at configurations (n, 7) that the encoders show, which sit before what
    gives way in the joints."""
    footage, robot = cell.footage(), cell._robot
    assert footage is not None
    assert robot is not None
    nominal = NominalArm(arm, Pose.of([0, 0, 0]), np.array([0.0, 0.0, -STANDARD_GRAVITY]))
    torque = nominal.kinematics(q).gravity_torque
    q = q - (robot._encoders.reported(q, torque) - q)
    model = footage.model
    data, found = mujoco.MjData(model), []
    joints = [model.joint(PREFIX + name).qposadr[0] for name in arm.joints]
    for row in q:
        data.qpos[joints] = row
        mujoco.mj_kinematics(model, data)
        hand = data.body(PREFIX + arm.hand.body)
        found.append(Pose.of(data.site(PREFIX + arm.tcp).xpos, hand.xquat))
    return found


def rigid(places: Array, onto: Array) -> Pose:
    """The pose nearest to taking places (n, 3) onto others, least squares (Kabsch)."""
    a, b = places.mean(axis=0), onto.mean(axis=0)
    u, _, v = np.linalg.svd((onto - b).T @ (places - a))
    rotation = u @ np.diag([1, 1, np.linalg.det(u @ v)]) @ v
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, rotation.ravel())
    return Pose.of(b - rotation @ a, quaternion)


def camera_of(scene) -> Pose:
    """Where the bench's camera is."""
    model = scene.spec().compile()
    data, quaternion = mujoco.MjData(model), np.empty(4)
    mujoco.mj_forward(model, data)
    mujoco.mju_mat2Quat(quaternion, data.cam_xmat[0])
    return Pose.of(data.cam_xpos[0], quaternion)


def main(runs: int, noise: float, level: str) -> None:
    """Print the figures."""
    offs, stds, whole, used, spent = [], [], [], [], 0.0
    for seed in range(runs):
        random = np.random.default_rng([seed, 7])
        session = Session(Settings(seed=seed, noise=level).checked(at_hand=True), RobotConfig())
        scene, arm = session.bench_with_camera(), session.arm
        cell = SimulatedCell(scene, noise=level, seed=seed)
        cell.robot()
        q = configurations(arm)
        hands, jacobians = stances(arm, q)
        believed = Mount(camera_of(scene), PLACE**2 * np.eye(6))
        lens = Lens(
            pinhole(869.1, 639.5, 359.5), (1280, 720), np.array([-0.08, 0.03, 5e-4, -3e-4, 0]), LENS
        )
        frame = frame_of(hands[:KEPT], jacobians[:KEPT])
        views = Views(hands, jacobians, frame, HALF, 0.0, lens, believed, False, 1e-4)
        began = time.process_time()
        left = in_view(views, STICKER)
        chosen = [left[i] for i in surest(views.some(left), STICKER, PICTURES)]
        true = moved(believed.pose_world_camera, PLACE * random.standard_normal(6))
        zoom = float(np.exp(LENS * random.standard_normal()))
        sticker = moved(STICKER, np.array([0.005] * 3 + [0.05] * 3) * random.standard_normal(6))
        corners, eye = list[Array](), true @ FACING
        for hand in true_poses(cell, arm, q[chosen]):
            tag = hand @ sticker
            points = tag.position + (HALF * CORNERS) @ tag.rotation.T
            there = lens.project((points - eye.position) @ eye.rotation, zoom)
            corners.append(there + noise * random.standard_normal((4, 2)))
        found = hand_eye(views.some(chosen), corners)
        spent += time.process_time() - began
        # The frame in which the arm reports its poses, and what a point in view is off in it.
        places = np.array([hand.position for hand in hands[:KEPT]])
        truly = np.array([hand.position for hand in true_poses(cell, arm, q[:KEPT])])
        wanted = rigid(truly, places) @ true
        off = apart(found.mount.pose_world_camera, wanted)
        covariance = found.mount.covariance[:6, :6]
        offs.append(off)
        stds.append(np.sqrt(np.diag(covariance)))
        whole.append(off @ np.linalg.solve(covariance, off) / 6)
        # Along the view, what is seen is as far as the focal length makes it.
        far = np.array([1.0, 1.0, found.lens.matrix[0, 0] / (zoom * lens.matrix[0, 0])])
        told = np.array([hands[i].position for i in left[::5]])
        there = true_poses(cell, arm, q[left[::5]])
        seen = [found.mount.pose_world_camera.apply(far * true.local(p.position)) for p in there]
        used.append(np.mean(np.sum((np.array(seen) - told) ** 2, axis=1)))
    off, z = np.array(offs), np.array(offs) / np.array(stds)
    places, turns = np.linalg.norm(off[:, :3], axis=1), np.linalg.norm(off[:, 3:], axis=1)
    print(
        f"{level}, corners {noise:g} px: {runs} runs, {1e3 * rms(places):.2f} mm (worst "
        f"{1e3 * places.max():.2f}), {np.degrees(rms(turns)):.3f}°; "
        f"a point in view {1e3 * np.sqrt(np.mean(used)):.2f} mm; z by axis "
        f"{' '.join(f'{rms(one):.2f}' for one in z.T)} together {np.sqrt(np.mean(whole)):.2f}; "
        f"{spent / runs:.1f} s of a processor each"
    )


def rms(values: Array) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(values**2)))


if __name__ == "__main__":
    main(
        int((sys.argv[1:] or ["20"])[0]),
        float((sys.argv[2:] or ["0.07"])[0]),
        (sys.argv[3:] or ["measured"])[0],
    )
