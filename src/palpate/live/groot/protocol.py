"""Protocol of Groot2's requests about a running tree: bytes of BehaviorTree.CPP's monitor.

A request's first part is six bytes: protocol, kind, a number. The first part of an answer repeats
them and adds 16 bytes that tell one tree from another; what was asked for is its second part
(source: BehaviorTree.CPP 4.8, groot2_protocol.h and groot2_publisher.cpp).
"""

from __future__ import annotations

import struct
from collections.abc import Iterable
from dataclasses import dataclass

from py_trees.common import Status

PROTOCOL = 2

FULL_TREE, STATUS, BLACKBOARD = b"T", b"S", b"B"
HOOKS_DUMP, REMOVE_ALL_HOOKS, DISABLE_ALL_HOOKS = b"D", b"A", b"X"
TOGGLE_RECORDING, GET_TRANSITIONS = b"r", b"t"

_REQUEST = struct.Struct("<BcI")
_ANSWER = struct.Struct("<BcI16s")
_NODE = struct.Struct("<HB")
_TIME_BYTES = 6

CODES = {Status.INVALID: 0, Status.RUNNING: 1, Status.SUCCESS: 2, Status.FAILURE: 3}
"""BT.CPP's `NodeStatus`; a node that no longer runs is IDLE."""
LEFT = 10
"""Added to what a node was when it became IDLE."""


class NotUnderstood(ValueError):
    """No request that can be answered; its text goes back to Groot2."""


@dataclass(frozen=True, slots=True)
class Request:
    """Attributes:
    kind: one of the letters above. number: told back, so that answers find their question."""

    kind: bytes
    number: int

    @classmethod
    def read(cls, part: bytes) -> Request:
        """Parse the first part of a request.

        Raises:
            NotUnderstood: it is no such part.
        """
        if len(part) != _REQUEST.size:
            raise NotUnderstood("wrong request header")
        _, kind, number = _REQUEST.unpack(part)
        return cls(kind, number)

    def head(self, tree: bytes) -> bytes:
        """The first part of its answer; `tree`: 16 bytes."""
        return _ANSWER.pack(PROTOCOL, self.kind, self.number, tree)


@dataclass(frozen=True, slots=True)
class Transition:
    """A node changed its status.

    Attributes:
        microseconds: since the recording began.
        node: its number.
        code: what it is now.
    """

    microseconds: int
    node: int
    code: int


def statuses(codes: Iterable[int]) -> bytes:
    """The statuses of nodes 1, 2, 3 …"""
    return b"".join(_NODE.pack(node, code) for node, code in enumerate(codes, 1))


def transitions(changes: Iterable[Transition]) -> bytes:
    """Transitions during a recording."""
    return b"".join(
        change.microseconds.to_bytes(_TIME_BYTES, "little") + _NODE.pack(change.node, change.code)
        for change in changes
    )
