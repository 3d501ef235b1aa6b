"""Exchange of one document for another: by a command's standard input and output, or by a POST over HTTP. What comes
back is bounded in size and in time."""

from __future__ import annotations

import os
import selectors
import shlex
import signal
import socket
import subprocess
import tempfile
import threading
import time
from collections.abc import Generator
from contextlib import contextmanager, suppress
from http.client import HTTPConnection, HTTPException, HTTPSConnection
from urllib.parse import SplitResult, urlsplit

from palpate.errors import InputError, Unavailable

PATIENCE = 120.0
"""s: time to answer; a network that is loaded first takes half a minute."""
MAX_ANSWER = 1_000_000
"""Bytes: largest answer; poses of a thousand objects have half of them."""
MAX_WORDS = 300
"""Characters of a command's last words that are shown."""


def exchanged(source: str, document: bytes, patience: float | None = None) -> bytes:
    """The answer of a command line, or of a server by its `http://` or `https://` URL.

    Raises:
        InputError: no such command, or a URL that is none.
        Unavailable: it cannot be reached, fails, or its answer is too late or too large.
    """
    seconds = PATIENCE if patience is None else patience
    url = urlsplit(source)
    answer = (
        _posted(url, document, seconds)
        if url.scheme in ("http", "https")
        else _run(source, document, seconds)
    )
    if len(answer) > MAX_ANSWER:
        raise Unavailable(f"{_WHO} answers more than {MAX_ANSWER} bytes")
    return answer


_WHO = "the pose estimator"


def _run(source: str, document: bytes, seconds: float) -> bytes:
    try:
        words = shlex.split(source)
    except ValueError as error:
        raise InputError(f"pose_estimator= is no command: {error}") from None
    if not words:
        raise InputError("pose_estimator= is empty: give a command, or a URL http://…")
    with tempfile.TemporaryFile() as given, tempfile.TemporaryFile() as said:
        given.write(document)
        given.seek(0)
        try:
            process = subprocess.Popen(
                words, stdin=given, stdout=subprocess.PIPE, stderr=said, start_new_session=True
            )
        except OSError as error:
            raise InputError(f"{_WHO} '{words[0][:100]}': {error.strerror}") from None
        try:
            answer, ended = _output(process, time.monotonic() + seconds)
        finally:
            # With whatever it started.
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
        if not ended:
            raise Unavailable(f"{_WHO} does not answer within {seconds:g} s")
        if process.returncode != 0 and len(answer) <= MAX_ANSWER:
            said.seek(max(0, said.seek(0, os.SEEK_END) - MAX_WORDS))
            last = said.read().decode(errors="replace").strip().rpartition("\n")[2]
            raise Unavailable(
                f"{_WHO} fails with status {process.returncode}: {last or 'silently'}"
            )
    return answer


def _output(process: subprocess.Popen[bytes], until: float) -> tuple[bytes, bool]:
    """Output of a process, up to a little more than an answer may have, and False if time runs out."""
    assert process.stdout is not None
    answer = bytearray()
    with process.stdout, selectors.DefaultSelector() as waiting:
        waiting.register(process.stdout, selectors.EVENT_READ)
        while len(answer) <= MAX_ANSWER:
            if not waiting.select(max(0.0, until - time.monotonic())):
                return bytes(answer), False
            part = os.read(process.stdout.fileno(), 65536)
            if not part:
                break
            answer += part
    try:
        # One that writes too much is not waited for.
        if len(answer) <= MAX_ANSWER:
            process.wait(max(0.0, until - time.monotonic()))
    except subprocess.TimeoutExpired:
        return bytes(answer), False
    return bytes(answer), True


def _posted(url: SplitResult, document: bytes, seconds: float) -> bytes:
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
    where = f"{url.hostname}:{connection.port}"
    try:
        connection.connect()
        with _closed_after(connection.sock, seconds) as late:
            try:
                path = url.path or "/"
                headers = {"Content-Type": "application/json"}
                connection.request(
                    "POST", f"{path}?{url.query}" if url.query else path, document, headers
                )
                response = connection.getresponse()
                answer = response.read(MAX_ANSWER + 1)
            except (OSError, HTTPException, ValueError) as error:
                if late.is_set() or isinstance(error, TimeoutError):
                    raise TimeoutError from None
                raise Unavailable(f"{_WHO} at {where}: {type(error).__name__}") from None
            if late.is_set():
                raise TimeoutError
    except TimeoutError:
        raise Unavailable(f"{_WHO} at {where} does not answer within {seconds:g} s") from None
    except OSError as error:
        raise Unavailable(f"{_WHO} at {where}: {error.strerror or error}") from None
    finally:
        connection.close()
    if response.status != 200:
        raise Unavailable(f"{_WHO} at {where} answers with HTTP status {response.status}")
    return answer


@contextmanager
def _closed_after(sock: socket.socket, seconds: float) -> Generator[threading.Event]:
    """Close a connection after a time, however slowly its other end goes on; the event is set then."""
    late = threading.Event()

    def close() -> None:
        late.set()
        with suppress(OSError):
            sock.shutdown(socket.SHUT_RDWR)

    timer = threading.Timer(seconds, close)
    timer.daemon = True
    timer.start()
    try:
        yield late
    finally:
        timer.cancel()
