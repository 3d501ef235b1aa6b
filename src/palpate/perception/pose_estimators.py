"""External pose estimators: one JSON document in, one out."""

from __future__ import annotations

import base64
import io
import json
import os
import shlex
import signal
import subprocess
import tempfile
import time
from collections.abc import Mapping
from contextlib import suppress
from http.client import HTTPConnection, HTTPException, HTTPSConnection
from typing import Annotated, Any
from urllib.parse import SplitResult, urlsplit

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, BaseModel, ValidationError

from palpate.common.errors import InputError, Unavailable, unknown_name
from palpate.common.files import describe_error
from palpate.common.pose import Pose
from palpate.common.processes import Call, CallTimeout
from palpate.mjcf.shapes import Shapes, hull_points, mesh_corners
from palpate.perception.lens import Lens
from palpate.perception.solve import Estimated
from palpate.scene.poses import Covariance, Quaternion, Vector
from palpate.scene.scene import Scene

PATIENCE = 120.0  # s. Maximum response time; loading a network takes half a minute.
# bytes. Maximum size of an answer; poses of a thousand objects take half of it.
MAX_ANSWER = 1_000_000
MAX_WORDS = 300  # Characters of a command's error output in a message


def exchange_document(source: str, document: bytes, patience: float | None = None) -> bytes:
    """Send a document to a command line or an `http(s)://` server and return the answer.

    Raises:
        InputError: no such command, or an invalid URL.
        Unavailable: it is unreachable or fails, or its answer is too late or too large.
    """
    seconds = PATIENCE if patience is None else patience
    # A source with an http scheme is a server, anything else a command line.
    url = urlsplit(source)
    answer = (
        _post(url, document, seconds)
        if url.scheme in ("http", "https")
        else _run(source, document, seconds)
    )
    if len(answer) > MAX_ANSWER:
        raise Unavailable(f"{_WHO} answers more than {MAX_ANSWER} bytes")
    return answer


_WHO = "the pose estimator"


def _run(source: str, document: bytes, seconds: float) -> bytes:
    """Run a command with the document as its input; return its output."""
    try:
        words = shlex.split(source)
    except ValueError as error:
        raise InputError(f"pose_estimator= is no command: {error}") from None
    if not words:
        raise InputError("pose_estimator= is empty: give a command, or a URL http://…")
    # Temporary files for input and errors cannot block, unlike pipes.
    with tempfile.TemporaryFile() as given, tempfile.TemporaryFile() as said:
        given.write(document)
        given.seek(0)
        try:
            process = subprocess.Popen(
                words, stdin=given, stdout=subprocess.PIPE, stderr=said, start_new_session=True
            )
        except OSError as error:
            raise InputError(f"{_WHO} '{words[0][:100]}': {error.strerror}") from None
        output, until = process.stdout, time.monotonic() + seconds
        assert output is not None
        try:
            # Read no more than the limit, and do not wait for a process with too much output.
            answer = Call(lambda: output.read(MAX_ANSWER + 1), "pose estimator").result(seconds)
            if len(answer) <= MAX_ANSWER:
                process.wait(max(0.0, until - time.monotonic()))
        except (CallTimeout, subprocess.TimeoutExpired):
            raise Unavailable(f"{_WHO} does not answer within {seconds:g} s") from None
        finally:
            # Kill the process group, including all child processes.
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
        # Quote the last line of the error output.
        if process.returncode != 0 and len(answer) <= MAX_ANSWER:
            said.seek(max(0, said.seek(0, os.SEEK_END) - MAX_WORDS))
            last = said.read().decode(errors="replace").strip().rpartition("\n")[2]
            raise Unavailable(
                f"{_WHO} fails with status {process.returncode}: {last or 'silently'}"
            )
    return answer


def _post(url: SplitResult, document: bytes, seconds: float) -> bytes:
    """Post the document to a server; return the answer."""
    try:
        port = url.port
    except ValueError:
        port = 0
    if not url.hostname or port == 0 or "@" in url.netloc:
        raise InputError(
            "pose_estimator= is no URL of the form http://HOST:PORT/PATH, without a user name"
        )
    kind = HTTPSConnection if url.scheme == "https" else HTTPConnection
    connection = kind(url.hostname, port, timeout=seconds)
    where = f"{_WHO} at {url.hostname}:{connection.port}"

    def exchange() -> tuple[int, bytes]:
        try:
            path = (url.path or "/") + (f"?{url.query}" if url.query else "")
            connection.request("POST", path, document, {"Content-Type": "application/json"})
            response = connection.getresponse()
            return response.status, response.read(MAX_ANSWER + 1)
        finally:
            connection.close()

    # The timeout of a socket applies to each read; that of the call bounds the whole exchange.
    try:
        status, answer = Call(exchange, "pose estimator").result(seconds)
    except (CallTimeout, TimeoutError):
        raise Unavailable(f"{where} does not answer within {seconds:g} s") from None
    except (OSError, HTTPException, ValueError) as error:
        reason = getattr(error, "strerror", None) or type(error).__name__
        raise Unavailable(f"{where}: {reason}") from None
    # Redirects are not followed: any status other than 200 is a failure.
    if status != 200:
        raise Unavailable(f"{where} answers with HTTP status {status}")
    return answer


# Protocol of external pose estimators (FoundationPose, MegaPose, …): one JSON document in each
# direction.


LEAST_STD = 1e-6  # m or rad. Minimum accepted standard deviation.
SHOWN = 2  # Last visible geom group, as in MuJoCo's viewer


def request(
    scene: Scene, picture: NDArray[np.uint8], lens: Lens, depth: NDArray[np.uint16] | None = None
) -> bytes:
    """Return the JSON document for an estimator."""
    # Picture, intrinsics with distortion, and a mesh of each object.
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
    """Encode pixels as PNG in base64: RGB or 16-bit grey."""
    from PIL import Image

    png = io.BytesIO()
    Image.fromarray(pixels).save(png, "PNG")
    return base64.b64encode(png.getvalue()).decode()


def parse_answer(answer: bytes, names: Mapping[str, Any]) -> dict[str, Estimated]:
    """Parse and validate the poses in an estimator's answer.

    Raises InputError: the answer has another form, or an unknown object.
    """
    try:
        read = _Answer.model_validate_json(answer)
    except ValidationError as error:
        raise InputError(f"the pose estimator's answer: {describe_error(error, _Answer)}") from None
    found: dict[str, Estimated] = {}
    for name, entry in read.objects.items():
        if name not in names:
            raise unknown_name("object in the pose estimator's answer", name, names)
        pose = Pose.of(entry.pos, entry.quat)
        found[name] = Estimated(pose, np.array(entry.covariance))
    return found


def mesh_of(scene: Scene, name: str) -> str:
    """Wavefront OBJ of an object's visible geoms in its own frame, m; round shapes are polyhedra."""
    # Visible geoms, or all if none is visible.
    known = scene.resolved.description.bodies[name]
    shapes, pose = scene.resolved.shapes, known.pose_world
    ids = [shapes.geom_ids[geom] for geom in known.elements.geoms]
    shown = [i for i in ids if shapes.model.geom_group[i] <= SHOWN] or ids
    lines: list[str] = []
    count = 0
    for i in shown:
        # Transform to the object's frame and merge equal vertices; OBJ indices start at 1.
        triangles = (_triangles(shapes, i) - pose.position) @ pose.rotation
        points, where = np.unique(triangles.reshape(-1, 3).round(7), axis=0, return_inverse=True)
        lines += [f"v {x:.7g} {y:.7g} {z:.7g}" for x, y, z in points.tolist()]
        corners = (where.reshape(-1, 3) + 1 + count).tolist()
        lines += [f"f {a} {b} {c}" for a, b, c in corners]
        count += len(points)
    return "\n".join([*lines, ""])


def _triangles(shapes: Shapes, geom: int) -> NDArray[np.float64]:
    """Triangles (n, 3, 3) of a geom in the world, m; counter-clockwise from outside."""
    from scipy.spatial import ConvexHull

    model, data = shapes.model, shapes.data
    # A mesh has triangles. Other shapes use their convex hull.
    if model.geom_dataid[geom] >= 0:
        corners = mesh_corners(model, int(model.geom_dataid[geom]))
    else:
        points = hull_points(model, geom)
        hull: Any = ConvexHull(points)
        corners = points[np.asarray(hull.simplices)]
        # Flip triangles whose normal points inwards.
        a, b, c = np.moveaxis(corners, 1, 0)
        inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), hull.equations[:, :3]) < 0
        corners[inward] = corners[inward][:, ::-1]
    return corners @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]


def _in_front(position: Vector) -> Vector:
    if position[2] <= 0:
        raise ValueError("is behind the camera: its z points along the view")
    return position


def _normalise_quaternion(quaternion: Quaternion) -> Quaternion:
    if sum(part * part for part in quaternion) < 1e-9:
        raise ValueError("is no rotation")
    return quaternion


def _spread(rows: Covariance) -> Covariance:
    if np.linalg.eigvalsh(np.array(rows))[0] < LEAST_STD**2:
        raise ValueError(f"has a standard deviation below {LEAST_STD:g} m or rad")
    return rows


class _Pose(BaseModel):
    pos: Annotated[Vector, AfterValidator(_in_front)]
    quat: Annotated[Quaternion, AfterValidator(_normalise_quaternion)]
    covariance: Annotated[Covariance, AfterValidator(_spread)]


class _Answer(BaseModel):
    objects: dict[str, _Pose]
