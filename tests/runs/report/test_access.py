"""The live page lets a robot move: only the person who knows its address may use it."""

from __future__ import annotations

import http.client
from collections.abc import Generator
from urllib.parse import urlsplit

import pytest
import viser
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from palpate.runs.report.live_page import LivePage


@pytest.fixture
def page() -> Generator[LivePage]:
    with LivePage(port=0) as page:
        yield page


def upgraded(page: LivePage, path: str | None = None, **headers: str) -> str:
    """Open a websocket as a browser does, and say how it ended: `open`, or the refusal."""
    at = urlsplit(page.url)
    sent = {"Origin": f"http://{at.netloc}", **headers}
    try:
        with connect(
            f"ws://{at.netloc}{at.path if path is None else path}",
            additional_headers=sent,
            subprotocols=[f"viser-v{viser.__version__}"],  # type: ignore[list-item]
        ) as socket:
            assert socket.recv(timeout=10)
            return "open"
    except InvalidStatus as refused:
        return refused.response.body.decode().strip()


def fetched(page: LivePage, path: str, **headers: str) -> http.client.HTTPResponse:
    at = urlsplit(page.url)
    connection = http.client.HTTPConnection(at.netloc, timeout=10)
    connection.request("GET", path, headers=headers)
    return connection.getresponse()


def test_the_page_s_own_websocket_opens(page: LivePage) -> None:
    assert upgraded(page) == "open"


def test_a_websocket_of_another_page_is_refused(page: LivePage) -> None:
    assert upgraded(page, Origin="http://evil.example") == "another page's connection"
    assert upgraded(page, Origin="http://localhost:3000") == "another page's connection"
    assert upgraded(page, Origin="null") == "another page's connection"


@pytest.mark.parametrize("path", ["/", "", "/guessed/", "/guessed"])
def test_a_websocket_without_the_token_is_refused(page: LivePage, path: str) -> None:
    assert upgraded(page, path) == "not the address that palpate has printed"


@pytest.mark.parametrize("path", ["/", "/index.html", "/../", "/guessed/", "/%2e%2e/x"])
def test_the_page_without_the_token_is_refused(page: LivePage, path: str) -> None:
    answer = fetched(page, path)
    assert answer.status == 403
    assert b"viser" not in answer.read()


def test_a_foreign_name_of_this_machine_is_refused(page: LivePage) -> None:
    answer = fetched(page, urlsplit(page.url).path, Host="evil.example:8080")
    assert answer.status == 403


def test_the_page_is_served_through_a_tunnel_and_in_no_frame(page: LivePage) -> None:
    answer = fetched(page, urlsplit(page.url).path, Host="localhost:9000")
    assert answer.status == 200
    assert b"<html" in answer.read()
    assert answer.headers["X-Frame-Options"] == "DENY"
    assert answer.headers["Referrer-Policy"] == "no-referrer"


def test_the_server_listens_on_loopback_alone(page: LivePage) -> None:
    assert urlsplit(page.url).hostname == "127.0.0.1"
    assert page._server.get_host() == "127.0.0.1"  # pyright: ignore[reportPrivateUsage]


def test_tokens_differ_between_pages(page: LivePage) -> None:
    with LivePage(port=0) as other:
        assert urlsplit(other.url).path != urlsplit(page.url).path
        assert len(urlsplit(page.url).path) > 40
