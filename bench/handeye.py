"""Calibrations of a camera by a tag on the hand: are errors as large as their covariance says?

    python -m bench.handeye [RUNS] [PIXELS|world:workspace|world:hand] [NOISE]

Every run is another embedded arm of the noise model (zeros of encoders, lengths of links, place of the base).
With PIXELS of noise at drawn corners there is another camera, 5 mm and 5 mrad from where it is believed to be,
another lens, 1 % off, and another sticker; the arm does not move, its true kinematics are used. With a camera of
the simulated world it is all that `palpate calibrate --camera` does, in rendered pictures.
"""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass

import mujoco
import numpy as np

from palpate.common.pose import Array, Pose
from palpate.execution.simulated_cell import SimulatedCell
from palpate.perception.detection import CORNERS
from palpate.perception.hand_eye import HAND, HELD, STICKER
from palpate.perception.hand_eye_fit import (
    CalibrationViews,
    HandEye,
    frame_of,
    hand_eye,
    stances,
    surest,
)
from palpate.perception.lens import FACING, Lens, Mount, pinhole
from palpate.perception.solve import move_pose, pose_difference
from palpate.robots.description import PREFIX, RobotDescription
from palpate.robots.nominal import NominalArm
from palpate.robots.robot_config import RobotConfig
from palpate.runs.calibration.camera import KEPT, PICTURES, configurations, locate, select_views
from palpate.runs.calibration.gains import LENGTH, NamedSize
from palpate.runs.calibration.session import CalibrationSession
from palpate.runs.settings import WORLD_CAMERA, Settings
from palpate.scene.scene import Scene
from palpate.trace.samples import STANDARD_GRAVITY

SIDE, PLACE, LENS = 0.1, 0.005, 0.01
"""m, m and rad, relative."""


def true_poses(cell: SimulatedCell, arm: RobotDescription, q: Array) -> list[Pose]:
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


def camera_of(scene: Scene) -> Pose:
    """Where the bench's camera is."""
    model = scene.spec().compile()
    data, quaternion = mujoco.MjData(model), np.empty(4)
    mujoco.mj_forward(model, data)
    mujoco.mju_mat2Quat(quaternion, data.cam_xmat[0])
    return Pose.of(data.cam_xpos[0], quaternion)


@dataclass(frozen=True, slots=True)
class Off:
    """By how much a calibration is off.

    Attributes:
        pose: (6,) m and rad, of the camera in the frame in which the arm reports its poses.
        covariance: (6, 6), as stated.
        along: (3, 3) axes of the camera, columns, in the same frame.
        point: m, rms, of points in its view; None where they are not compared.
    """

    pose: Array
    covariance: Array
    along: Array
    point: float | None = None


def drawn(session: CalibrationSession, noise: float, seed: int) -> Off:
    """A calibration by drawn corners with `noise`, pixels."""
    random = np.random.default_rng([seed, 7])
    scene, arm = session.bench_with_camera(), session.arm
    cell = SimulatedCell(scene, noise=session.settings.noise, seed=seed)
    cell.robot()
    q = configurations(arm)
    hands, jacobians = stances(arm, q)
    believed = Mount(camera_of(scene), PLACE**2 * np.eye(6))
    lens = Lens(
        pinhole(869.1, 639.5, 359.5), (1280, 720), np.array([-0.08, 0.03, 5e-4, -3e-4, 0]), LENS
    )
    frame = frame_of(hands[:KEPT], jacobians[:KEPT])
    views = CalibrationViews(hands, jacobians, frame, SIDE / 2, 0.0, lens, believed, False, 1e-4)
    left = select_views(views, STICKER)
    chosen = [left[i] for i in surest(views.some(left), STICKER, PICTURES)]
    true = move_pose(believed.pose_world_camera, PLACE * random.standard_normal(6))
    zoom = float(np.exp(LENS * random.standard_normal()))
    sticker = move_pose(STICKER, np.array([0.005] * 3 + [0.05] * 3) * random.standard_normal(6))
    corners, eye = list[Array](), true @ FACING
    for hand in true_poses(cell, arm, q[chosen]):
        tag = hand @ sticker
        points = tag.position + (SIDE / 2 * CORNERS) @ tag.rotation.T
        there = lens.project((points - eye.position) @ eye.rotation, zoom)
        corners.append(there + noise * random.standard_normal((4, 2)))
    found = hand_eye(views.some(chosen), corners)
    # Along the view, what is seen is as far as the focal length makes it.
    far = np.array([1.0, 1.0, found.lens.matrix[0, 0] / (zoom * lens.matrix[0, 0])])
    told = np.array([hands[i].position for i in left[::5]])
    there = true_poses(cell, arm, q[left[::5]])
    seen = [found.mount.pose_world_camera.apply(far * true.local(p.position)) for p in there]
    point = np.sqrt(np.mean(np.sum((np.array(seen) - told) ** 2, axis=1)))
    return _off(found, reported(cell, arm) @ true, float(point))


def whole(session: CalibrationSession, source: str) -> Off:
    """A calibration of a camera of the simulated world, as `palpate calibrate --camera` does it."""
    tag = NamedSize.of(f"0={SIDE * 1e3:g}mm±0.1mm", LENGTH, "tag")
    found, _ = locate(session, source, None, tag)
    if source == WORLD_CAMERA + HAND:
        return _off(found, HELD)
    cell = session.cell
    assert isinstance(cell, SimulatedCell)
    return _off(found, reported(cell, session.arm) @ camera_of(session.bench_with_camera()))


def reported(cell: SimulatedCell, arm: RobotDescription) -> Pose:
    """The frame in which the arm reports its poses, of the world's."""
    q = configurations(arm)[:KEPT]
    places = np.array([hand.position for hand in stances(arm, q)[0]])
    return rigid(np.array([hand.position for hand in true_poses(cell, arm, q)]), places)


def _off(found: HandEye, wanted: Pose, point: float | None = None) -> Off:
    off = pose_difference(found.mount.pose_world_camera, wanted)
    return Off(off, found.mount.covariance[:6, :6], wanted.rotation, point)


def main(runs: int, corners: str, level: str) -> None:
    """Print the figures."""
    all_off, began = list[Off](), time.process_time()
    for seed in range(runs):
        session = CalibrationSession(
            Settings(seed=seed, noise=level).check_values(at_hand=True), RobotConfig()
        )
        if corners.startswith(WORLD_CAMERA):
            off = whole(session, corners)
            view = " ".join(f"{1e3 * part:+.2f}" for part in off.along.T @ off.pose[:3])
            print(f"seed {seed}: {view} mm right, up and back", flush=True)
        else:
            off = drawn(session, float(corners), seed)
        all_off.append(off)
    spent = (time.process_time() - began) / runs
    pose = np.array([off.pose for off in all_off])
    z = pose / np.sqrt([np.diag(off.covariance) for off in all_off])
    every = [off.pose @ np.linalg.solve(off.covariance, off.pose) / 6 for off in all_off]
    places, turns = np.linalg.norm(pose[:, :3], axis=1), np.linalg.norm(pose[:, 3:], axis=1)
    points = [off.point for off in all_off if off.point is not None]
    point = f"a point in view {1e3 * rms(np.array(points)):.2f} mm; " if points else ""
    print(
        f"{level}, corners {corners}: {runs} runs, {1e3 * rms(places):.2f} mm (worst "
        f"{1e3 * places.max():.2f}), {np.degrees(rms(turns)):.3f}°; {point}z by axis "
        f"{' '.join(f'{rms(one):.2f}' for one in z.T)} together {np.sqrt(np.mean(every)):.2f}; "
        f"{spent:.1f} s of a processor each"
    )


def rms(values: Array) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(values**2)))


if __name__ == "__main__":
    main(
        int((sys.argv[1:] or ["20"])[0]),
        (sys.argv[2:] or ["0.07"])[0],
        (sys.argv[3:] or ["measured"])[0],
    )
