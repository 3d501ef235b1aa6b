"""Access and shapes of the live page."""

from __future__ import annotations

import hmac
import http
import logging
import secrets
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any
from urllib.parse import urlsplit

import mujoco
import numpy as np
import websockets.asyncio.server as websocket_server
from numpy.typing import NDArray
from trimesh import creation
from viser import FrameHandle, SceneApi
from websockets.asyncio.server import ServerConnection
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from palpate.perception.renderer import geom_rgba

LOOPBACK = ("127.0.0.1", "localhost", "[::1]")

HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": "frame-ancestors 'none'",  # no page shows it in a frame (clickjacking)
    "X-Frame-Options": "DENY",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",  # the address is a secret
    "Cross-Origin-Opener-Policy": "same-origin",
}

# viser's client is dark with `?darkMode` in its address.
FOLLOW_COLOUR_SCHEME = """<script>
if (matchMedia("(prefers-color-scheme: dark)").matches && !location.search.includes("darkMode"))
  location.replace(location.pathname + "?darkMode");
</script>"""

LOGGER = logging.getLogger(__name__)
LOGGER.addHandler(logging.NullHandler())
LOGGER.propagate = False  # refused requests do not belong into the run's log

Answer = Callable[[ServerConnection, Request], Response | None]


class Access:
    """Decides which requests a websocket server answers.

    Attributes:
        path: of the page, with the token; 256 bits of it are random.
        applied: a server consults it.
    """

    def __init__(self) -> None:
        self.path = f"/{secrets.token_urlsafe(32)}/"
        self.applied = False

    @contextmanager
    def controls(self) -> Generator[None]:
        """Control the servers that are started within this context.

        viser offers no hook for requests; it starts its server with `websockets`, which does.
        """
        # Replace the server's constructor meanwhile, so that it checks every request.
        serve = websocket_server.serve

        def serve_with_controls(
            *args: Any, process_request: Answer, **options: Any
        ) -> websocket_server.serve:
            self.applied = True
            options["logger"] = LOGGER
            return serve(*args, process_request=self._check_requests(process_request), **options)

        websocket_server.serve = serve_with_controls  # type: ignore[assignment, misc]
        try:
            yield
        finally:
            websocket_server.serve = serve  # type: ignore[misc]

    def _check_requests(self, answer: Answer) -> Answer:
        """Wrap `answer`: refuse requests, and add the page's own headers and script to the others."""

        def check(connection: ServerConnection, request: Request) -> Response | None:
            # Refuse before viser sees the request.
            reason = self.refusal(request)
            if reason is not None:
                text = f"{reason}\n".encode()
                status = http.HTTPStatus.FORBIDDEN
                return Response(status.value, status.phrase, Headers(HEADERS), text)
            request.headers.pop("Accept-Encoding", None)  # the answer is changed below
            response = answer(connection, replace(request, path="/"))
            if response is None:
                return None
            # Add script and headers to the answer, and correct its length.
            script = FOLLOW_COLOUR_SCHEME.encode()
            body = response.body.replace(b"</head>", script + b"</head>", 1)
            headers = Headers({**dict(response.headers), **HEADERS})
            del headers["Content-Length"]
            headers["Content-Length"] = str(len(body))
            return replace(response, headers=headers, body=body)

        return check

    def refusal(self, request: Request) -> str | None:
        """Reason to refuse a request; None for one that may be answered."""
        # Refuse other hosts: a DNS name that resolves to this machine must not reach the page.
        host = request.headers.get("Host", "")
        if host.rpartition(":")[0] not in LOOPBACK and host not in LOOPBACK:
            return f"this page is served to {', '.join(LOOPBACK)} alone"
        # Refuse websockets that another page opens.
        if "Upgrade" in request.headers:
            origin = urlsplit(request.headers.get("Origin", ""))
            if origin.scheme not in ("http", "https") or origin.netloc != host:
                return "another page's connection"
        path = urlsplit(request.path).path.rstrip("/") + "/"
        # In constant time: response times reveal no prefix of the token.
        if not hmac.compare_digest(path.encode(), self.path.encode()):
            return "not the address that palpate has printed"
        return None


# Visual geometry of a MuJoCo model in the page's 3-D view. Only poses change later.

# trimesh is typed in part.
# pyright: reportUnknownMemberType=false


# Count of visible groups. MuJoCo's own viewer shows groups 0 to 2 at first; collision shapes are in
# the others.
SEEN_GROUPS = 3
PLANE = 2.0  # m: half the side of the plate that represents an infinite plane

Type = mujoco.mjtGeom
Surface = tuple[NDArray[np.float32], NDArray[np.int32]]  # Vertices (n, 3), m, and triangles (m, 3)


class DrawnBodies:
    """The bodies of a model in the page's view."""

    def __init__(self, view: SceneApi, model: mujoco.MjModel) -> None:
        self._frames: dict[int, FrameHandle] = {}
        for geom in range(model.ngeom):
            # Skip hidden and transparent geoms.
            *colour, opacity = (float(value) for value in geom_rgba(model, geom))
            if model.geom_group[geom] >= SEEN_GROUPS or opacity <= 0:
                continue
            # Give each body one frame, to which its geoms are fixed.
            body = int(model.geom_bodyid[geom])
            if body not in self._frames:
                self._frames[body] = view.add_frame(f"/bodies/{body}", show_axes=False)
            # Add the geom's surface in its colour.
            surface = _surface(model, geom)
            if surface is None:
                continue
            red, green, blue = (round(255 * value) for value in colour)
            view.add_mesh_simple(
                f"/bodies/{body}/{geom}",
                *surface,
                color=(red, green, blue),
                opacity=None if opacity >= 1 else opacity,
                flat_shading=int(model.geom_type[geom]) == Type.mjGEOM_BOX,
                side="double",
                position=model.geom_pos[geom],
                wxyz=model.geom_quat[geom],
            )

    def move(self, data: mujoco.MjData) -> None:
        """Move every body to its pose."""
        for body, frame in self._frames.items():
            frame.position = data.xpos[body]
            frame.wxyz = data.xquat[body]


def _surface(model: mujoco.MjModel, geom: int) -> Surface | None:
    """Make a geom's surface in its own frame; None for height fields and signed distance fields."""
    # MuJoCo states half sizes, trimesh full ones.
    x, y, z = (float(value) for value in model.geom_size[geom])
    match Type(int(model.geom_type[geom])):
        case Type.mjGEOM_MESH:
            mesh = int(model.geom_dataid[geom])
            first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
            face, faces = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
            return model.mesh_vert[first : first + count], model.mesh_face[face : face + faces]
        case Type.mjGEOM_BOX:
            solid = creation.box((2 * x, 2 * y, 2 * z))
        case Type.mjGEOM_CYLINDER:
            solid = creation.cylinder(x, 2 * y, sections=48)
        case Type.mjGEOM_SPHERE:
            solid = creation.icosphere(subdivisions=3, radius=x)
        case Type.mjGEOM_ELLIPSOID:
            solid = creation.icosphere(subdivisions=3).apply_scale((x, y, z))
        case Type.mjGEOM_CAPSULE:
            solid = creation.capsule(height=2 * y, radius=x, count=[16, 16])
            solid.apply_translation(-solid.bounds.mean(axis=0))
        case Type.mjGEOM_PLANE:
            solid = creation.box((2 * (x or PLANE), 2 * (y or PLANE), 1e-4))
        case _:
            return None
    return solid.vertices.astype(np.float32), solid.faces.astype(np.int32)
