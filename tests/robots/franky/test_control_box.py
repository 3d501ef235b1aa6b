"""`franky://HOST`, and a control box that answers there, checked before planning."""

from __future__ import annotations

import socket
import struct
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

import palpate as pp
from palpate.robots.franky.control_box import ROBOT_PORT, Address, greet, read_address
from tests.fci.served import own_address

DESK = """<mujoco><worldbody>
  <geom name="desk" type="box" size=".3 .4 .1" pos=".5 0 .1"/>
  <body name="mug" pos=".5 0 .25"><freejoint/><geom type="box" size=".03 .03 .05"/></body>
</worldbody></mujoco>"""


@pytest.mark.parametrize(
    ("url", "address"),
    [
        ("franky://172.16.0.2", Address("172.16.0.2", realtime=True)),
        ("franky://fr3.lab/", Address("fr3.lab", realtime=True)),
        ("franky://172.16.0.2?realtime=ignore", Address("172.16.0.2", realtime=False)),
        ("franky://127.0.0.11", Address("127.0.0.11", realtime=False)),
        ("franky://localhost", Address("localhost", realtime=False)),
        ("franky://127.0.0.1?realtime=enforce", Address("127.0.0.1", realtime=True)),
    ],
)
def test_urls_are_parsed(url: str, address: Address) -> None:
    assert read_address(url) == address


@pytest.mark.parametrize(
    "url",
    ["franky://", "franky://a b", "franky://h/x", "franky://h?x=1", "franky://h?realtime=no", "h"],
)
def test_other_urls_are_bad_input(url: str) -> None:
    with pytest.raises(pp.InputError, match=r"franky://HOST|valid: enforce, ignore"):
        read_address(url)


@contextmanager
def listening(answer: bytes | None) -> Iterator[None]:
    """Somebody at the robot's port, who says one thing, or nothing."""
    with socket.create_server((own_address(), ROBOT_PORT)) as door:

        def serve() -> None:
            try:
                line, _ = door.accept()
            except OSError:
                return
            with line:
                if answer is not None:
                    line.sendall(answer)
                line.recv(100)
                time.sleep(60.0 if answer is None else 0.0)

        threading.Thread(target=serve, daemon=True).start()
        yield


def test_an_unreachable_robot_is_reported_at_once_and_nothing_is_planned() -> None:
    told: list[str] = []
    with pytest.raises(pp.Unavailable, match=r"cannot be used: Connection refused.*FCI in Desk"):
        pp.run(
            DESK, "how heavy is the mug?", robot=f"franky://{own_address()}", progress=told.append
        )
    assert told == []
    began = time.perf_counter()
    assert greet(Address(own_address())).problem is not None
    assert time.perf_counter() - began < 20.0


def test_a_mute_host_is_given_up() -> None:
    began = time.perf_counter()
    with listening(None):
        greeting = greet(Address(own_address()))
    assert greeting.problem is not None
    assert "says nothing within 2 s" in greeting.problem
    assert time.perf_counter() - began < 40.0


def test_another_version_is_named_with_its_remedy() -> None:
    with listening(struct.pack("<IIIBH", 0, 0, 15, 1, 5)):
        greeting = greet(Address(own_address()))
    assert greeting.version == 5
    assert greeting.problem is not None
    assert "version 5" in greeting.problem
    assert "franky-control" in greeting.problem


@pytest.mark.parametrize("answer", [b"SSH-2.0-OpenSSH_9.6\r\n", b"HTTP/1.1 400 Bad Request\r\n"])
def test_another_server_is_no_version(answer: bytes) -> None:
    with listening(answer):
        greeting = greet(Address(own_address()))
    assert greeting.version is None
    assert greeting.problem is not None
    assert answer[:8].decode() in greeting.problem
    assert "no control box" in greeting.problem


def test_a_control_box_of_the_same_version_is_fine() -> None:
    with listening(struct.pack("<IIIBH", 0, 0, 15, 0, 10)):
        greeting = greet(Address(own_address()))
    assert (greeting.version, greeting.problem) == (10, None)
