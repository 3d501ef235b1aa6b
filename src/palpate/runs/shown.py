"""Content for trace viewers in addition to the signals: the cell, poses of its parts, the picture.

| topic | message | content |
|---|---|---|
| `/robot_description` | String | URDF of the cell: arm and all bodies of D, as links by their names
|
| `/cell/tf` | TFMessage | links that move, each from its parent, ten times a second |
| `/camera/image` | CompressedImage | the picture given to the planner, as JPEG |
| `/camera/camera_info` | CameraInfo | its intrinsics, if poses.yaml states the camera's pose |
| `/tf_static` | TFMessage | `world` → `camera` (z into the picture, x right, y down) |
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from io import BytesIO
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from palpate.common.pose import Array, Pose
from palpate.runs.run import Run
from palpate.scene.camera import Camera, load_image
from palpate.scene.poses import read_poses
from palpate.trace.samples import Trace
from palpate.trace.topics import WORLD, Layout, Message, header, nanoseconds, stamps, text, xyzw

if TYPE_CHECKING:
    import mujoco
    from PIL.Image import Image


PERIOD = 0.1  # s: interval of the poses of the cell. Viewers interpolate.
CAMERA = "camera"
LONGEST_SIDE = 640  # Pixels: longest side of the picture in the trace
QUALITY = 85  # Quality of the JPEG, per cent
# Rotation from a MuJoCo camera (looks along −z) to an optical frame (looks along +z).
OPTICAL = Pose.of((0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0))

log = logging.getLogger(__name__)


def trace_messages(run: Run) -> list[Message]:
    """Make all messages; a part that fails is left out and logged."""
    trace = run.trace_if_any
    if trace is None or not len(trace.t):
        return []
    # Each part is independent: one that fails costs only itself.
    messages: list[Message] = []
    for part in (_cell, _camera):
        try:
            messages += part(run, trace)
        except Exception as error:
            log.warning("viewers are shown less: %s: %s", type(error).__name__, error)
    return messages


def _cell(run: Run, trace: Trace) -> Iterator[Message]:
    from palpate.perception.posed import PosedCell, Replay
    from palpate.twin.export_urdf import urdf_to_look_at

    cell = PosedCell(run.scene)
    yield text(float(trace.t[0]), "/robot_description", urdf_to_look_at(cell.model))
    # Sample the trace at the interval, and pose the whole cell at each sample.
    times = trace.t[np.searchsorted(trace.t, np.arange(trace.t[0], trace.t[-1], PERIOD))]
    replay = Replay(cell, trace)
    poses = np.empty((len(times), cell.model.nbody, 7))
    for row, t in enumerate(times.tolist()):
        replay.show(t)
        poses[row, :, :3], poses[row, :, 3:] = cell.data.xpos, cell.data.xquat
    yield from _transforms(cell.model, times, poses)


def _transforms(model: mujoco.MjModel, times: Array, poses: Array) -> Iterator[Message]:
    """Yield the transforms of the moving links from their parents, for world poses (n, bodies, 7)."""
    from palpate.twin.export_facts import body_name

    layout = Layout()
    signals: dict[str, NDArray[Any]] = {"stamp": stamps(times)}
    moving: list[tuple[str, str, Array]] = []
    # Keep only links that move relative to their parents.
    for body in range(1, model.nbody):
        parent = int(model.body_parentid[body])
        relative = _from(poses[:, parent], poses[:, body])
        if np.ptp(relative, axis=0).max() > 0.0:
            moving.append((body_name(model, parent), body_name(model, body), relative))
    # Layout of one message: the count of transforms, then each with stamp, names and pose.
    layout.uint32(len(moving))
    for parent, child, relative in moving:
        layout.time("stamp").text(parent, child)
        layout.doubles(f"{child} at", 3).doubles(f"{child} turned", 4)
        signals[f"{child} at"], signals[f"{child} turned"] = relative[:, :3], xyzw(relative)
    encoded = layout.encode(signals, len(times))
    for time, data in zip(nanoseconds(times).tolist(), encoded, strict=True):
        yield Message(time, "/cell/tf", "tf2_msgs/TFMessage", data)


def _from(parent: Array, child: Array) -> Array:
    """Relative pose parent⁻¹ · child (n, 7) of two world poses, rounded to single precision for a small file."""
    from scipy.spatial.transform import Rotation

    # scipy types the product of two rotations as an array.
    turns: list[Any] = [Rotation.from_quat(p[:, 3:], scalar_first=True) for p in (parent, child)]
    back = turns[0].inv()
    at = back.apply(child[:, :3] - parent[:, :3])
    # The canonical quaternion has a scalar part that is not negative.
    quaternions = (back * turns[1]).as_quat(canonical=True, scalar_first=True)
    return np.column_stack([at, quaternions]).astype(np.float32).astype(np.float64)


def _camera(run: Run, trace: Trace) -> Iterator[Message]:
    picture = _picture(run)
    if picture is None:
        return
    start = trace.t[:1]
    # Encode the picture once.
    jpeg = BytesIO()
    picture.save(jpeg, "JPEG", quality=QUALITY)
    image = header(CAMERA).text("jpeg").octets(jpeg.getvalue())
    # The picture needs no camera pose; intrinsics and transform do.
    yield _once(start, "/camera/image", "sensor_msgs/CompressedImage", image)
    poses = run.settings.poses
    entry = read_poses(poses).camera if poses is not None else None
    if entry is not None:
        camera = Camera.of(entry)
        yield _once(start, "/camera/camera_info", "sensor_msgs/CameraInfo", *_info(camera, picture))
        yield _once(start, "/tf_static", "tf2_msgs/TFMessage", *_place_camera(camera))


def _picture(run: Run) -> Image | None:
    """Picture for the planner, reduced in size."""
    from PIL import Image

    if run.settings.images:
        return Image.fromarray(load_image(run.settings.images[0], LONGEST_SIDE))
    if run.picture is None:
        return None
    picture = Image.open(BytesIO(run.picture)).convert("RGB")
    picture.thumbnail((LONGEST_SIDE, LONGEST_SIDE))
    return picture


def _info(camera: Camera, picture: Image) -> tuple[Layout, dict[str, Array]]:
    """CameraInfo of a pinhole camera without distortion, scaled to the picture."""
    width, height = picture.size
    # Scale the focal length with the picture, principal point in the middle.
    focal = camera.focal * height / camera.height
    k = np.array([[focal, 0.0, width / 2], [0.0, focal, height / 2], [0.0, 0.0, 1.0]])
    layout = header(CAMERA).uint32(height, width).text("plumb_bob").array("d", 5)
    layout.doubles("k", 9).doubles("r", 9).doubles("p", 12)
    layout.uint32(0, 0).uint32(0, 0, 0, 0).uint8(0)
    p = np.column_stack([k, np.zeros(3)])
    return layout, {"d": np.zeros(5), "k": k.ravel(), "r": np.eye(3).ravel(), "p": p.ravel()}


def _place_camera(camera: Camera) -> tuple[Layout, dict[str, Array]]:
    pose = (camera.pose_world_camera @ OPTICAL).vector[None, :]
    layout = Layout().uint32(1).time("stamp").text(WORLD, CAMERA)
    return layout.doubles("at", 3).doubles("turned", 4), {"at": pose[:, :3], "turned": xyzw(pose)}


def _once(
    start: Array, topic: str, datatype: str, layout: Layout, signals: dict[str, Array] | None = None
) -> Message:
    (data,) = layout.encode({"stamp": stamps(start), **(signals or {})}, 1)
    return Message(int(nanoseconds(start)[0]), topic, datatype, data)
