"""Messages as bytes, held against an independent reader of ROS 2 messages."""

from __future__ import annotations

import numpy as np
import pytest
from mcap_ros2._dynamic import generate_dynamic

from palpate.trace.topics import Layout, definition

STAMPED = Layout().time("stamp").text("world").doubles("force", 3).doubles("torque", 3)
NAMED = Layout().time("stamp").text("a").texts(["one", "four"]).array("q", 2)


def test_bytes_are_those_of_the_encoding() -> None:
    message = Layout().uint8(7).text("é").doubles("x", 1).encode({"x": np.array([[1.0]])}, 1)[0]
    number = bytes([0, 0, 0, 0, 0, 0, 0xF0, 0x3F])
    behind_header = bytes([7, 0, 0, 0, 3, 0, 0, 0, 0xC3, 0xA9, 0]) + bytes(5) + number
    assert message == bytes([0, 1, 0, 0]) + behind_header


def test_an_independent_reader_finds_every_field() -> None:
    stamps = np.array([[1, 2], [3, 4]])
    numbers = np.arange(12.0).reshape(2, 6)
    signals = {"stamp": stamps, "force": numbers[:, :3], "torque": numbers[:, 3:]}
    name = "geometry_msgs/WrenchStamped"
    decode = generate_dynamic(name, definition(name))[name]
    second = decode(STAMPED.encode(signals, 2)[1])
    assert (second.header.stamp.sec, second.header.stamp.nanosec) == (3, 4)
    assert second.header.frame_id == "world"
    assert second.wrench.force.y == numbers[1, 1]
    assert second.wrench.torque.z == numbers[1, 5]


def test_encoded_messages_are_decoded() -> None:
    signals = {"stamp": np.array([[1, 2], [3, 4]]), "q": np.array([[0.1, 0.2], [np.pi, -0.0]])}
    found = NAMED.decode(NAMED.encode(signals, 2))
    for name, values in signals.items():
        np.testing.assert_array_equal(found[name], values)


def test_no_messages_are_no_rows() -> None:
    assert NAMED.decode([])["q"].shape == (0, 2)


def test_a_message_of_another_size_is_refused() -> None:
    with pytest.raises(ValueError, match="does not have"):
        NAMED.decode([bytes(len(NAMED.constant) - 1)])
