"""Access to the live page: a secret token in its address, same-origin requests, loopback hosts.

The page lets a robot move, and every page in a person's browser may open connections to this machine. So a
request is served only if it has the token, names a loopback host (a foreign name that resolves to this
machine is DNS rebinding), and, for a websocket, comes from the page itself (RFC 6455, section 10.2).
"""

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

import websockets.asyncio.server as websocket_server
from websockets.asyncio.server import ServerConnection
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

LOOPBACK = ("127.0.0.1", "localhost", "[::1]")

HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": "frame-ancestors 'none'",  # no page shows it in a frame (clickjacking)
    "X-Frame-Options": "DENY",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",  # the address is a secret
    "Cross-Origin-Opener-Policy": "same-origin",
}

FOLLOW_COLOUR_SCHEME = """<script>
if (matchMedia("(prefers-color-scheme: dark)").matches && !location.search.includes("darkMode"))
  location.replace(location.pathname + "?darkMode");
</script>"""
"""viser's client is dark with `?darkMode` in its address."""

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
        serve = websocket_server.serve

        def controlled(
            *args: Any, process_request: Answer, **options: Any
        ) -> websocket_server.serve:
            self.applied = True
            options["logger"] = LOGGER
            return serve(*args, process_request=self._checked(process_request), **options)

        websocket_server.serve = controlled  # type: ignore[assignment, misc]
        try:
            yield
        finally:
            websocket_server.serve = serve  # type: ignore[misc]

    def _checked(self, answer: Answer) -> Answer:
        """`answer` for requests that are not refused, with the page's own headers and script."""

        def checked(connection: ServerConnection, request: Request) -> Response | None:
            reason = self.refusal(request)
            if reason is not None:
                text = f"{reason}\n".encode()
                status = http.HTTPStatus.FORBIDDEN
                return Response(status.value, status.phrase, Headers(HEADERS), text)
            request.headers.pop("Accept-Encoding", None)  # the answer is changed below
            response = answer(connection, replace(request, path="/"))
            if response is None:
                return None
            script = FOLLOW_COLOUR_SCHEME.encode()
            body = response.body.replace(b"</head>", script + b"</head>", 1)
            headers = Headers({**dict(response.headers), **HEADERS})
            del headers["Content-Length"]
            headers["Content-Length"] = str(len(body))
            return replace(response, headers=headers, body=body)

        return checked

    def refusal(self, request: Request) -> str | None:
        """Reason to refuse a request; None for one that may be answered."""
        host = request.headers.get("Host", "")
        if host.rpartition(":")[0] not in LOOPBACK and host not in LOOPBACK:
            return f"this page is served to {', '.join(LOOPBACK)} alone"
        if "Upgrade" in request.headers:
            origin = urlsplit(request.headers.get("Origin", ""))
            if origin.scheme not in ("http", "https") or origin.netloc != host:
                return "another page's connection"
        path = urlsplit(request.path).path.rstrip("/") + "/"
        # In constant time: response times reveal no prefix of the token.
        if not hmac.compare_digest(path.encode(), self.path.encode()):
            return "not the address that palpate has printed"
        return None
