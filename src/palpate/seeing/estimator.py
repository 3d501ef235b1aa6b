"""Pose estimators of others (FoundationPose, MegaPose, …), which take one JSON document and give one back.

    {"palpate_estimator": 1,
     "image": "iVBORw0…",                                     # PNG in base64, RGB
     "depth": "iVBORw0…",                                     # of the same pixels, 16 bit PNG; where a camera has it
     "intrinsics": {"fx": …, "fy": …, "cx": …, "cy": …, "size": [1280, 720], "distortion": [k1, k2, p1, p2, k3]},
     "objects": [{"name": "mug", "mesh": "v 0.04 0 0.1\\n…"}]}  # Wavefront OBJ in the object's frame, m

    {"objects": {"mug": {"pos": [x, y, z], "quat": [w, x, y, z], "covariance": [[…], …]}}}

A pose is the object's in OpenCV's camera frame (z along the view, y down); its covariance is of position,
m, and rotation, rad, along the camera's axes. An object that is not in the answer was not found.
"""

from __future__ import annotations

import base64
import io
import json
from collections.abc import Mapping
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, BaseModel, ValidationError

from palpate.errors import InputError, unknown_name
from palpate.files.plain_yaml import worded
from palpate.geometry.pose import Pose
from palpate.mjcf.shapes import Shapes, hull_points, mesh_corners
from palpate.scene.poses import Covariance, Quaternion, Vector
from palpate.scene.scene import Scene
from palpate.seeing.exchange import exchanged
from palpate.seeing.lens import Lens
from palpate.seeing.problem import Estimated

LEAST_STD = 1e-6
"""m or rad: smallest standard deviation that is believed."""
SHOWN = 2
"""The last group of geoms that is shown, as in MuJoCo's viewer."""


def estimated(
    source: str,
    scene: Scene,
    picture: NDArray[np.uint8],
    lens: Lens,
    depth: NDArray[np.uint16] | None = None,
) -> dict[str, Estimated]:
    """Ask an estimator, a command or a URL, for the poses of a scene's objects in a picture, with `depth` in mm.

    Raises:
        InputError: it answers something else.
        Unavailable: it does not answer, or fails.
    """
    answer = exchanged(source, request(scene, picture, lens, depth))
    return parsed(answer, scene.objects)


def request(
    scene: Scene,
    picture: NDArray[np.uint8],
    lens: Lens,
    depth: NDArray[np.uint16] | None = None,
) -> bytes:
    """The document that an estimator is given, JSON."""
    (fx, _, cx), (_, fy, cy), _ = lens.matrix.tolist()
    content = {
        "palpate_estimator": 1,
        "image": _png(picture),
        "intrinsics": {"fx": fx, "fy": fy, "cx": cx, "cy": cy}
        | {"size": list(lens.size), "distortion": lens.distortion.tolist()},
        "objects": [{"name": name, "mesh": mesh_of(scene, name)} for name in scene.objects],
    }
    if depth is not None:
        content["depth"] = _png(depth)
    return json.dumps(content).encode()


def _png(pixels: NDArray[np.uint8] | NDArray[np.uint16]) -> str:
    """PNG in base64: RGB, or grey of 16 bits."""
    from PIL import Image

    png = io.BytesIO()
    Image.fromarray(pixels).save(png, "PNG")
    return base64.b64encode(png.getvalue()).decode()


def parsed(answer: bytes, names: Mapping[str, Any]) -> dict[str, Estimated]:
    """Poses of an estimator's answer, which are believed no further than they make sense.

    Raises:
        InputError: not of this form, or an object that was not asked for.
    """
    try:
        read = _Answer.model_validate_json(answer)
    except ValidationError as error:
        raise InputError(f"the pose estimator's answer: {worded(error, _Answer)}") from None
    found: dict[str, Estimated] = {}
    for name, entry in read.objects.items():
        if name not in names:
            raise unknown_name("object in the pose estimator's answer", name, names)
        pose = Pose.of(entry.pos, entry.quat)
        found[name] = Estimated(pose, np.array(entry.covariance))
    return found


def mesh_of(scene: Scene, name: str) -> str:
    """Wavefront OBJ of an object as its geoms are shown, in its own frame, m; a round shape has corners."""
    known = scene.resolved.description.bodies[name]
    shapes, pose = scene.resolved.shapes, known.pose_world
    ids = [shapes.geom_ids[geom] for geom in known.elements.geoms]
    shown = [i for i in ids if shapes.model.geom_group[i] <= SHOWN] or ids
    lines: list[str] = []
    count = 0
    for i in shown:
        triangles = (_triangles(shapes, i) - pose.position) @ pose.rotation
        points, where = np.unique(triangles.reshape(-1, 3).round(7), axis=0, return_inverse=True)
        lines += [f"v {x:.7g} {y:.7g} {z:.7g}" for x, y, z in points.tolist()]
        corners = (where.reshape(-1, 3) + 1 + count).tolist()
        lines += [f"f {a} {b} {c}" for a, b, c in corners]
        count += len(points)
    return "\n".join([*lines, ""])


def _triangles(shapes: Shapes, geom: int) -> NDArray[np.float64]:
    """(n, 3, 3) corners of the triangles of a geom in the world, m; counter-clockwise from outside."""
    from scipy.spatial import ConvexHull

    model, data = shapes.model, shapes.data
    if model.geom_dataid[geom] >= 0:
        corners = mesh_corners(model, int(model.geom_dataid[geom]))
    else:
        points = hull_points(model, geom)
        hull: Any = ConvexHull(points)
        corners = points[np.asarray(hull.simplices)]
        a, b, c = np.moveaxis(corners, 1, 0)
        inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), hull.equations[:, :3]) < 0
        corners[inward] = corners[inward][:, ::-1]
    return corners @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]


def _in_front(position: Vector) -> Vector:
    if position[2] <= 0:
        raise ValueError("is behind the camera: its z points along the view")
    return position


def _turned(quaternion: Quaternion) -> Quaternion:
    if sum(part * part for part in quaternion) < 1e-9:
        raise ValueError("is no rotation")
    return quaternion


def _spread(rows: Covariance) -> Covariance:
    if np.linalg.eigvalsh(np.array(rows))[0] < LEAST_STD**2:
        raise ValueError(f"has a standard deviation below {LEAST_STD:g} m or rad")
    return rows


class _Pose(BaseModel):
    pos: Annotated[Vector, AfterValidator(_in_front)]
    quat: Annotated[Quaternion, AfterValidator(_turned)]
    covariance: Annotated[Covariance, AfterValidator(_spread)]


class _Answer(BaseModel):
    objects: dict[str, _Pose]
