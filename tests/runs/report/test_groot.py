"""The run as Groot2 sees it: asked over ZeroMQ on loopback, as Groot2 asks."""

from __future__ import annotations

import socket
import struct
import threading
from collections.abc import Callable, Generator
from contextlib import contextmanager
from xml.etree import ElementTree

import behaviortreepy as bt
import pytest
from py_trees.common import Status

from palpate.common.errors import Unavailable
from palpate.execution.leaf import build
from palpate.execution.runner import Snapshot, run
from palpate.planning.plan import Plan
from palpate.runs.report.live_groot import GrootPublisher

zmq = pytest.importorskip("zmq")
msgpack = pytest.importorskip("msgspec").msgpack

IDLE, RUNNING, SUCCESS, FAILURE = range(4)
LEFT = 10
"""Added by BT.CPP to what a node was when it became IDLE."""
Ask = Callable[..., list[bytes]]


@contextmanager
def groot2(url: str, patience: int = 20000) -> Generator[Ask]:
    """Groot2's end of the line: it checks that every answer is one to its question."""
    with zmq.Context() as context, context.socket(zmq.REQ) as line:
        line.rcvtimeo, line.linger = patience, 0
        line.connect(url)
        number = 0

        def ask(kind: str, *more: bytes) -> list[bytes]:
            nonlocal number
            number += 1
            asked = struct.pack("<BcI", 2, kind.encode(), number)
            line.send_multipart([asked, *more])
            head, *rest = line.recv_multipart()
            if head != b"error":
                assert head[:6] == asked
                assert len(head) == 22
            return [head, *rest]

        yield ask


def statuses(ask: Ask) -> dict[int, int]:
    return dict(struct.iter_unpack("<HB", ask("S")[1]))


def shape(xml: bytes) -> list[tuple[str, str | None, str | None]]:
    """Every node of the tree: its type, its name, its number."""
    (tree,) = ElementTree.fromstring(xml).findall("BehaviorTree")
    nodes = (node for node in tree.iter() if node is not tree)
    return [(node.tag, node.get("name"), node.get("_uid")) for node in nodes]


@pytest.fixture
def tree(node):
    side_by_side = node("Parallel", node("Go", z=0.2), node("MeasureForces"))
    return node("Sequence", node("Wait", seconds=0.1), side_by_side, node("Refuse"))


class Curious:
    """An observer that asks what Groot2 would, after every tick."""

    def __init__(self, publisher: GrootPublisher, ask: Ask) -> None:
        self._publisher, self._ask = publisher, ask
        self.seen: list[dict[int, int]] = []
        self.values: list[dict[str, object]] = []

    def on_tick(self, snapshot: Snapshot) -> None:
        self._publisher.on_tick(snapshot)
        self.seen.append(statuses(self._ask))
        self.values.append(msgpack.decode(self._ask("B", b"Plan")[1])["Plan"])


def test_statuses_of_all_nodes_change_while_the_tree_runs(tree, scene, robot, words) -> None:
    with GrootPublisher(port=0) as publisher, groot2(publisher.url) as ask:
        curious = Curious(publisher, ask)
        run(Plan((), tree, ""), scene, robot, words=words, observer=curious)
        xml = ask("T")[1]
    kinds = ["Sequence", "Wait", "Parallel", "Go", "MeasureForces", "Refuse"]
    assert [kind for kind, _, _ in shape(xml)] == kinds
    assert curious.seen[0] == {1: RUNNING, 2: RUNNING, 3: IDLE, 4: IDLE, 5: IDLE, 6: IDLE}
    assert curious.seen[-1] == {
        1: FAILURE,
        2: SUCCESS,
        3: SUCCESS,
        4: SUCCESS,
        5: SUCCESS,
        6: FAILURE,
    }
    assert {1: RUNNING, 2: SUCCESS, 3: RUNNING, 4: RUNNING, 5: RUNNING, 6: IDLE} in curious.seen
    assert curious.values[0]["holding"] == "nothing"
    assert curious.values[-1]["robot_time_s"] > curious.values[0]["robot_time_s"]


def test_a_node_that_is_stopped_from_outside_was_running(node, scene, robot, words) -> None:
    tree = node("Parallel", node("Wait", seconds=9), node("Refuse"))
    with GrootPublisher(port=0) as publisher, groot2(publisher.url) as ask:
        run(Plan((), tree, ""), scene, robot, words=words, observer=publisher)
        assert statuses(ask) == {1: FAILURE, 2: LEFT + RUNNING, 3: FAILURE}


def test_tree_and_statuses_are_answered_as_by_btcpp(tree, words, blackboard) -> None:
    """The same tree in BT.CPP, asked by the same Groot2."""
    factory = bt.BehaviorTreeFactory()
    for kind in words.primitives:
        factory.register_simple_action(kind, lambda *_: bt.NodeStatus.SUCCESS)
    root = build(tree, words, blackboard)
    theirs = factory.create_tree_from_text("""
        <root BTCPP_format="4" main_tree_to_execute="Plan"><BehaviorTree ID="Plan"><Sequence>
          <Wait name="Wait(0.1)"/>
          <Parallel success_count="-1" failure_count="1">
            <Go name="Go(0.2, 0.1)"/><MeasureForces name="MeasureForces()"/>
          </Parallel>
          <Refuse name="Refuse()"/>
        </Sequence></BehaviorTree></root>""")

    def told(ask: Ask) -> list[list[bytes]]:
        return [ask("S")[1:], ask("D")[1:], ask("A")[1:], ask("X")[1:], ask("r", b"stop")[1:]]

    with GrootPublisher(port=0) as publisher, groot2(publisher.url) as ask:
        publisher.on_tick(Snapshot(root, blackboard.robot.state, 0.0, ()))
        our_xml, ours = ask("T")[1], told(ask)
    published = bt.Groot2Publisher(theirs, port := free_port())
    with groot2(f"tcp://127.0.0.1:{port}") as ask:
        assert shape(our_xml) == shape(ask("T")[1])
        assert ours == told(ask)
    del published


def test_transitions_are_recorded(tree, scene, robot, words) -> None:
    with GrootPublisher(port=0) as publisher, groot2(publisher.url) as ask:
        run(Plan((), tree, ""), scene, robot, words=words, observer=publisher)
        head, began = ask("r", b"start")
        assert int(began) > 1.7e15, "µs since 1970"
        run(Plan((), tree, ""), scene, robot, words=words, observer=publisher)
        changes = ask("t")[1]
        assert ask("t")[1] == b"", "told once"
        assert ask("S")[0][6:] != head[6:], "another run is another tree"
    rows = [changes[i : i + 9] for i in range(0, len(changes), 9)]
    told = [struct.unpack("<HB", row[6:]) for row in rows]
    assert told[:2] == [(1, RUNNING), (2, RUNNING)]
    assert told[-1] == (6, FAILURE)
    times = [int.from_bytes(row[:6], "little") for row in rows]
    assert times == sorted(times)


def test_breakpoints_are_refused(tree, words, blackboard) -> None:
    root = build(tree, words, blackboard)
    with GrootPublisher(port=0) as publisher, groot2(publisher.url) as ask:
        assert ask("T") == [b"error", b"no tree is being run yet"]
        publisher.on_tick(Snapshot(root, blackboard.robot.state, 0.0, ()))
        refused = [b"error", b"palpate runs its trees without breakpoints"]
        assert ask("I", b'{"uid": 2}') == refused
        assert ask("U", b'{"uid": 2}') == refused
        assert root.status is Status.INVALID


def test_bytes_that_are_no_request_are_answered(words) -> None:
    with (
        GrootPublisher(port=0) as publisher,
        zmq.Context() as context,
        context.socket(zmq.REQ) as line,
    ):
        line.connect(publisher.url)
        line.send(b"hello, Groot")
        assert line.recv_multipart() == [b"error", b"wrong request header"]


def test_the_publisher_listens_on_this_machine_alone_and_reports_a_taken_port() -> None:
    with GrootPublisher(port=0) as publisher:
        assert publisher.url.startswith("tcp://127.0.0.1:")
        with pytest.raises(Unavailable, match="Groot2 cannot be served at port"):
            GrootPublisher(port=int(publisher.url.rpartition(":")[2]))
    assert "groot" not in {thread.name for thread in threading.enumerate()}


def free_port() -> int:
    """A port that nobody listens on; BT.CPP takes the next one, too."""
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]


def test_a_web_page_and_an_oversized_message_are_not_heard() -> None:
    with GrootPublisher(port=0) as publisher:
        port = int(publisher.url.rsplit(":", 1)[1])
        with socket.create_connection(("127.0.0.1", port), timeout=5) as browser:
            browser.sendall(b"POST / HTTP/1.1\r\nOrigin: http://evil.example\r\n\r\nT")
            assert b"palpate" not in browser.recv(1000)
        with groot2(publisher.url, 1000) as ask, pytest.raises(zmq.Again):
            ask("T", bytes(2 << 20))
        with groot2(publisher.url) as ask:
            assert ask("T") == [b"error", b"no tree is being run yet"]
