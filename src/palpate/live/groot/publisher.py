"""Publisher for Groot2: the tree with its statuses, live, over ZeroMQ on this machine alone.

Read-only: breakpoints and substituted results are refused, so that no viewer stops or steers a moving arm.
The protocol knows no password; a web page cannot speak it (ZMTP's greeting is no HTTP request).
"""

# zmq is typed in part.
# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false, reportUnknownArgumentType=false

from __future__ import annotations

import threading
import time
import uuid
from collections import deque
from typing import TYPE_CHECKING

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from palpate.errors import Unavailable
from palpate.execution.btcpp import TREE_ID, running_xml
from palpate.execution.runner import Snapshot
from palpate.live.groot import protocol
from palpate.live.groot.protocol import NotUnderstood, Request, Transition
from palpate.live.nodes import steps_of, walk

if TYPE_CHECKING:
    import zmq

HOST = "127.0.0.1"
PORT = 1667
"""Groot2's own default (source: BehaviorTree.CPP 4.8, groot2_publisher.h)."""
PATIENCE_MS = 100
"""Timeout of a wait for requests, ms, after which the end is checked."""
MOST_BYTES = 1 << 20
"""Size of a message above which its sender is disconnected."""
MOST_TRANSITIONS = 1000
"""A recording keeps the newest."""


class GrootPublisher:
    """Answers Groot2. A context manager and an `Observer`.

    Args:
        port: where it listens; 0 takes any that is free.
        paced: hold a simulated run to real time, so that a person can follow.

    Attributes:
        url: where Groot2 connects.

    Raises:
        Unavailable: the port is taken, or pyzmq is not installed.
    """

    def __init__(self, port: int = PORT) -> None:
        self._lock = threading.Lock()
        self._tree: _Tree | None = None
        self._values: dict[str, float | str] = {}
        self._recording: _Recording | None = None
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
        """Groot2 shows no stages."""

    def on_tick(self, snapshot: Snapshot) -> None:
        """Take note of a tick."""
        with self._lock:
            if self._tree is None or self._tree.root is not snapshot.root:
                self._tree = _Tree(snapshot.root)
            changed = self._tree.update()
            if self._recording is not None:
                self._recording.add(changed)
            self._values = _values(snapshot)

    def _serve(self) -> None:
        while not self._over.is_set():
            if self._socket.poll(PATIENCE_MS):
                parts = self._socket.recv_multipart()
                self._socket.send_multipart(self._answer(parts))

    def _answer(self, parts: list[bytes]) -> list[bytes]:
        try:
            request = Request.read(parts[0])
            with self._lock:
                if self._tree is None:
                    raise NotUnderstood("no tree is being run yet")
                told = self._told(request.kind, self._tree, parts[1:])
                return [request.head(self._tree.id), *told]
        except NotUnderstood as error:
            return [b"error", str(error).encode()]

    def _told(self, kind: bytes, tree: _Tree, said: list[bytes]) -> list[bytes]:
        """Body of the answer."""
        match kind:
            case protocol.FULL_TREE:
                return [tree.xml]
            case protocol.STATUS:
                return [protocol.statuses(tree.codes)]
            case protocol.BLACKBOARD:
                return [self._blackboards(said)]
            case protocol.TOGGLE_RECORDING:
                return self._toggled(said)
            case protocol.GET_TRANSITIONS:
                return [protocol.transitions(self._recording.take() if self._recording else ())]
            case protocol.HOOKS_DUMP:
                return [b"[]"]
            case protocol.REMOVE_ALL_HOOKS | protocol.DISABLE_ALL_HOOKS:
                return []
            case _:
                raise NotUnderstood("palpate runs its trees without breakpoints")

    def _blackboards(self, names: list[bytes]) -> bytes:
        """Present forces, where the blackboard of the tree is requested."""
        from msgspec import msgpack

        wanted = b";".join(names).decode(errors="replace").split(";")
        return msgpack.encode({TREE_ID: self._values} if TREE_ID in wanted else {})

    def _toggled(self, said: list[bytes]) -> list[bytes]:
        """Begin a recording, or end it; when it began: µs since 1970."""
        if said != [b"start"]:
            self._recording = None
            return []
        self._recording = _Recording()
        return [str(time.time_ns() // 1000).encode()]


def _listening(port: int) -> tuple[zmq.Socket[bytes], str]:
    """The socket that answers, and its address."""
    try:
        import zmq
    except ImportError as error:
        why = f"Groot2 is served with pyzmq: pip install 'palpate[groot]' ({error})"
        raise Unavailable(why) from None
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
    """A tree as Groot2 knows it: its nodes are numbered from 1."""

    def __init__(self, root: Behaviour) -> None:
        self.root = root
        self.id = uuid.uuid4().bytes
        self._nodes = [node for node, _ in walk(root)]
        self.xml = running_xml(root, {node: i for i, node in enumerate(self._nodes, 1)}).encode()
        self.codes = [0] * len(self._nodes)
        self._known = [Status.INVALID] * len(self._nodes)

    def update(self) -> list[tuple[int, int]]:
        """Look at the nodes: those that changed, with what they are now."""
        changed: list[tuple[int, int]] = []
        for i, node in enumerate(self._nodes):
            before, now = self._known[i], node.status
            if now is before:
                continue
            self._known[i], self.codes[i] = now, _code(before, now)
            changed.append((i + 1, protocol.CODES[now]))
        return changed


def _code(before: Status, now: Status) -> int:
    if now is Status.INVALID:
        return protocol.LEFT + protocol.CODES[before]
    return protocol.CODES[now]


class _Recording:
    """Transitions since a recording began."""

    def __init__(self) -> None:
        self._began = time.perf_counter()
        self._changes: deque[Transition] = deque(maxlen=MOST_TRANSITIONS)

    def add(self, changed: list[tuple[int, int]]) -> None:
        now = round(1e6 * (time.perf_counter() - self._began))
        self._changes += [Transition(now, node, code) for node, code in changed]

    def take(self) -> list[Transition]:
        taken = list(self._changes)
        self._changes.clear()
        return taken


def _values(snapshot: Snapshot) -> dict[str, float | str]:
    """Values in Groot2's table of the blackboard."""
    leaf = steps_of(snapshot)[0]
    robot = snapshot.robot
    return {
        "robot_time_s": snapshot.elapsed,
        "vertical_force_N": float(robot.wrench[2]),
        "opening_m": float(robot.width),
        "holding": leaf.blackboard.state.holding or "nothing",
    }
