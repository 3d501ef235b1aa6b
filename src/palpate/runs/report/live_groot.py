"""Publisher for Groot2: the live tree with its statuses, over ZeroMQ, on this machine only.

It is read-only. Breakpoints and substituted results are refused, so that no viewer stops or steers
a moving arm. The protocol has no password; a web page cannot speak it (ZMTP's greeting is not an
HTTP request).

The protocol is that of BehaviorTree.CPP 4.8 (groot2_protocol.h, groot2_publisher.cpp). A request's
first part is six bytes: protocol, kind, a number. The first part of an answer repeats them and adds
16 bytes that identify the tree. Its second part is the content.
"""

from __future__ import annotations

import struct
import threading
import time
import uuid
from collections import deque
from typing import TYPE_CHECKING

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from palpate.common.errors import Unavailable
from palpate.execution.btcpp import TREE_ID, running_xml
from palpate.execution.runner import Snapshot
from palpate.runs.report.live_terminal import steps_of, walk

if TYPE_CHECKING:
    import zmq


# zmq is typed in part.
# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false, reportUnknownArgumentType=false


HOST, PORT = "127.0.0.1", 1667
"""Groot2's own default port."""
PATIENCE_MS = 100
"""ms: timeout of a wait for requests. The end is checked after it."""
MOST_BYTES = 1 << 20
"""Bytes: the sender of a larger message is disconnected."""
MOST_TRANSITIONS = 1000
"""Largest count of transitions in a recording, which keeps the newest."""

PROTOCOL = 2
_REQUEST = struct.Struct("<BcI")
_ANSWER = struct.Struct("<BcI16s")
_NODE = struct.Struct("<HB")
CODES = {Status.INVALID: 0, Status.RUNNING: 1, Status.SUCCESS: 2, Status.FAILURE: 3}
"""BT.CPP's `NodeStatus`. A node that has stopped running is IDLE."""
LEFT = 10
"""Offset that is added to the last status of a node when it becomes IDLE."""


class NotUnderstood(ValueError):
    """A request that cannot be answered; the message is sent to Groot2."""


class GrootPublisher:
    """Server of Groot2. A context manager and an `Observer`.

    Args:
        port: to listen at; 0 takes any free port.

    Attributes:
        url: address to enter in Groot2.

    Raises:
        Unavailable: the port is taken, or pyzmq is not installed.
    """

    def __init__(self, port: int = PORT) -> None:
        self._lock = threading.Lock()
        self._tree: _Tree | None = None
        self._values: dict[str, float | str] = {}
        self._recorded: deque[bytes] | None = None
        self._began = 0.0
        self._over = threading.Event()
        self._socket, self.url = _listening(port)
        self._server = threading.Thread(target=self._serve, name="groot", daemon=True)
        self._server.start()

    def __enter__(self) -> GrootPublisher:
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._server.join()
        self._socket.close()

    def progress(self, stage: str) -> None:
        """Do nothing: Groot2 shows no stages."""

    def on_tick(self, snapshot: Snapshot) -> None:
        """Record the statuses of a tick, and the values for Groot2's table of the blackboard."""
        with self._lock:
            # A new attempt runs a new tree.
            if self._tree is None or self._tree.root is not snapshot.root:
                self._tree = _Tree(snapshot.root)
            changed = self._tree.update()
            if self._recorded is not None:
                microseconds = round(1e6 * (time.perf_counter() - self._began))
                time_bytes = microseconds.to_bytes(6, "little")
                self._recorded += [time_bytes + _NODE.pack(*change) for change in changed]
            self._values = {
                "robot_time_s": snapshot.elapsed,
                "vertical_force_N": float(snapshot.robot.wrench[2]),
                "opening_m": float(snapshot.robot.width),
                "holding": steps_of(snapshot)[0].blackboard.state.holding or "nothing",
            }

    def _serve(self) -> None:
        while not self._over.is_set():
            if self._socket.poll(PATIENCE_MS):
                parts = self._socket.recv_multipart()
                self._socket.send_multipart(self._answer(parts))

    def _answer(self, parts: list[bytes]) -> list[bytes]:
        try:
            # Parse the header; an error message is an answer too.
            if len(parts[0]) != _REQUEST.size:
                raise NotUnderstood("wrong request header")
            _, kind, number = _REQUEST.unpack(parts[0])
            with self._lock:
                if self._tree is None:
                    raise NotUnderstood("no tree is being run yet")
                content = self._content(kind, self._tree, parts[1:])
                return [_ANSWER.pack(PROTOCOL, kind, number, self._tree.id), *content]
        except NotUnderstood as error:
            return [b"error", str(error).encode()]

    def _content(self, kind: bytes, tree: _Tree, more: list[bytes]) -> list[bytes]:
        """Content of the answer to a request of this kind, with `more` parts."""
        match kind:
            case b"T":  # full tree
                return [tree.xml]
            case b"S":  # statuses
                return [b"".join(_NODE.pack(i, code) for i, code in enumerate(tree.codes, 1))]
            case b"B":  # blackboards of the named trees
                from msgspec import msgpack

                wanted = b";".join(more).decode(errors="replace").split(";")
                return [msgpack.encode({TREE_ID: self._values} if TREE_ID in wanted else {})]
            case b"r":  # begin or end a recording; the answer is its beginning, µs since 1970
                if more != [b"start"]:
                    self._recorded = None
                    return []
                self._recorded = deque(maxlen=MOST_TRANSITIONS)
                self._began = time.perf_counter()
                return [str(time.time_ns() // 1000).encode()]
            case b"t":  # transitions of the recording since the last request
                transitions = b"".join(self._recorded or ())
                if self._recorded is not None:
                    self._recorded.clear()
                return [transitions]
            case b"D":  # list the breakpoints: there are none
                return [b"[]"]
            case b"A" | b"X":  # remove or disable all breakpoints
                return []
            case _:
                raise NotUnderstood("palpate runs its trees without breakpoints")


def _listening(port: int) -> tuple[zmq.Socket[bytes], str]:
    """Open the socket for answers; return it with its address."""
    try:
        import zmq
    except ImportError as error:
        why = f"Groot2 is served with pyzmq: pip install 'palpate[groot]' ({error})"
        raise Unavailable(why) from None
    # Close without waiting, and refuse large messages.
    socket = zmq.Context.instance().socket(zmq.REP)
    socket.linger = 0
    socket.maxmsgsize = MOST_BYTES
    try:
        socket.bind(f"tcp://{HOST}:{port or '*'}")
    except zmq.ZMQError as error:
        socket.close()
        raise Unavailable(f"Groot2 cannot be served at port {port}: {error}") from None
    return socket, socket.get_string(zmq.LAST_ENDPOINT)


class _Tree:
    """A tree in Groot2's form, with nodes numbered from 1."""

    def __init__(self, root: Behaviour) -> None:
        self.root = root
        self.id = uuid.uuid4().bytes
        self._nodes = [node for node, _ in walk(root)]
        self.xml = running_xml(root, {node: i for i, node in enumerate(self._nodes, 1)}).encode()
        self.codes = [0] * len(self._nodes)
        self._known = [Status.INVALID] * len(self._nodes)

    def update(self) -> list[tuple[int, int]]:
        """Read the statuses of the nodes; return number and new status of the changed ones."""
        changed: list[tuple[int, int]] = []
        for i, node in enumerate(self._nodes):
            before, now = self._known[i], node.status
            if now is not before:
                self._known[i] = now
                self.codes[i] = LEFT + CODES[before] if now is Status.INVALID else CODES[now]
                changed.append((i + 1, CODES[now]))
        return changed
