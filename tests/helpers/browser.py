"""Headless Chromium, driven over its debugging protocol: what a person sees on a page, and clicks."""

from __future__ import annotations

import json
import shutil
import subprocess
import time
import urllib.request
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from websockets.sync.client import ClientConnection, connect

CHROMIUM = (
    shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
)
PATIENCE = 60.0
"""s: a page in software WebGL is slow to appear."""
FLAGS = ("--headless=new", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")

needs_chromium = pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium here")


class Page:
    """A page in the browser."""

    def __init__(self, socket: ClientConnection) -> None:
        self._socket = socket
        self._number = 0

    def evaluate(self, script: str) -> Any:
        """What JavaScript on the page says."""
        self._number += 1
        asked = {"expression": script, "returnByValue": True}
        call = {"id": self._number, "method": "Runtime.evaluate", "params": asked}
        self._socket.send(json.dumps(call))
        while True:
            answer = json.loads(self._socket.recv(timeout=PATIENCE))
            if answer.get("id") == self._number:
                # a page that is being left answers with an error
                return answer.get("result", {}).get("result", {}).get("value")

    @property
    def text(self) -> str:
        """All that is written on it."""
        return str(self.evaluate("document.body.innerText"))

    def click(self, button: str) -> None:
        """Press the button with this text, once it is there."""
        found = (
            f"[...document.querySelectorAll('button')].find(b => b.innerText.trim() === {button!r})"
        )
        self.until(lambda: bool(self.evaluate(f"!!{found}")))
        self.evaluate(f"{found}.click()")

    def until(self, so: Callable[[], bool]) -> None:
        """Wait for something to be so."""
        end = time.monotonic() + PATIENCE
        while not so():
            assert time.monotonic() < end, f"it never came; the page says: {self.text}"
            time.sleep(0.2)


@contextmanager
def opened(url: str, profile: Path) -> Generator[Page]:
    """The page at a URL; `profile` is a folder that the browser may write into."""
    assert CHROMIUM is not None
    browser = [CHROMIUM, *FLAGS, "--remote-debugging-port=0", f"--user-data-dir={profile}", url]
    process = subprocess.Popen(browser, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
    try:
        with connect(_debugger(profile), max_size=None) as socket:
            yield Page(socket)
    finally:
        process.kill()
        process.wait()


def _debugger(profile: Path) -> str:
    """Where the page's debugger listens."""
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        try:
            port = (profile / "DevToolsActivePort").read_text().splitlines()[0]
            with urllib.request.urlopen(f"http://127.0.0.1:{port}/json", timeout=5) as answer:
                pages = [page for page in json.load(answer) if page["type"] == "page"]
                return str(pages[0]["webSocketDebuggerUrl"])
        except (OSError, IndexError):
            time.sleep(0.2)
    raise AssertionError("the browser does not answer")
