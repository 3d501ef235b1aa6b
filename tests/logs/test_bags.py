"""Recordings in MCAP, rosbag2 and Parquet."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from palpate.errors import InputError
from palpate.logs.reading import read_log

N = 200
T = np.arange(N) * 2e-3
PHASE = np.arange(7)
Q = 0.4 * np.sin(2 * T[:, None] + PHASE)
DQ = 0.8 * np.cos(2 * T[:, None] + PHASE)
TAU = 10 * np.cos(T[:, None] + PHASE)
EPOCH = 1_760_000_000
SHUFFLED = [3, 0, 6, 1, 5, 2, 4]
STATE = """std_msgs/Header header
sensor_msgs/JointState measured_joint_state
sensor_msgs/JointState desired_joint_state
sensor_msgs/JointState tau_ext_hat_filtered
float64[6] o_f_ext_hat_k
"""


def bag(folder: Path, plugin: str) -> Path:
    """Write joint states, fingers last and joints in no order, and a robot's state without effort in it."""
    pytest.importorskip("rosbags")
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    store.register(get_types_from_msg(STATE, "franka_msgs/msg/FrankaRobotState"))
    types = store.types
    joint_state, header, stamp = (
        types[f"{name}"]
        for name in (
            "sensor_msgs/msg/JointState",
            "std_msgs/msg/Header",
            "builtin_interfaces/msg/Time",
        )
    )
    names = [f"fr3_joint{i + 1}" for i in SHUFFLED] + ["fr3_finger_joint1"]
    storage = StoragePlugin.MCAP if plugin == "mcap" else StoragePlugin.SQLITE3
    with Writer(folder, version=9, storage_plugin=storage) as writer:
        joints = writer.add_connection(
            "/joint_states", joint_state.__msgtype__, typestore=store, serialization_format="cdr"
        )
        text = writer.add_connection("/rosout", "std_msgs/msg/String", typestore=store)
        said = types["std_msgs/msg/String"]("hello")
        writer.write(text, 0, store.serialize_cdr(said, "std_msgs/msg/String"))
        for i, t in enumerate(T):
            of = header(stamp(sec=EPOCH, nanosec=round(t * 1e9)), "base")
            values = [np.append(part[i, SHUFFLED], 0.04) for part in (Q, DQ, TAU)]
            message = joint_state(of, names, *values)
            # The bag's own clock is of the computer, late and uneven.
            late = round(1e9 * (EPOCH + t + 0.003 * (i % 3)))
            data = store.serialize_cdr(message, joint_state.__msgtype__)
            writer.write(joints, late, data)
    return folder


@pytest.mark.parametrize("plugin", ["mcap", "sqlite3"])
def test_a_folder_of_rosbag2(tmp_path: Path, plugin: str) -> None:
    log = read_log(bag(tmp_path / "bag", plugin))
    np.testing.assert_allclose(log.t, T, atol=1e-6)
    for found, wanted in ((log.q, Q), (log.dq, DQ), (log.tau, TAU)):
        np.testing.assert_allclose(found, wanted)


def test_one_file_of_a_bag(tmp_path: Path) -> None:
    (file,) = bag(tmp_path / "bag", "mcap").glob("*.mcap")
    np.testing.assert_allclose(read_log(file).tau, TAU)
    (file,) = bag(tmp_path / "other", "sqlite3").glob("*.db3")
    np.testing.assert_allclose(read_log(file).tau, TAU)


def test_topics_of_a_bag(tmp_path: Path) -> None:
    folder, columns = bag(tmp_path / "bag", "mcap"), tmp_path / "map.yaml"
    columns.write_text("topic: /joint_state\n")
    with pytest.raises(InputError, match="did you mean '/joint_states'"):
        read_log(folder, columns)
    columns.write_text("topic: /joint_states\n")
    assert len(read_log(folder, columns)) == N
    damaged = tmp_path / "damaged.mcap"
    damaged.write_bytes(next(folder.glob("*.mcap")).read_bytes()[:3000])
    with pytest.raises(InputError, match="no bag that can be read"):
        read_log(damaged)


def test_state_of_franka_ros2(tmp_path: Path) -> None:
    """The robot's state holds what is measured beside what is desired, in one message."""
    pytest.importorskip("rosbags")
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    store.register(get_types_from_msg(STATE, "franka_msgs/msg/FrankaRobotState"))
    types = store.types
    joint_state, state = (
        types["sensor_msgs/msg/JointState"],
        types["franka_msgs/msg/FrankaRobotState"],
    )
    header, stamp = types["std_msgs/msg/Header"], types["builtin_interfaces/msg/Time"]
    names, nothing = [f"fr3_joint{i + 1}" for i in range(7)], np.empty(0)
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topic = "/franka_robot_state_broadcaster/robot_state"
        connection = writer.add_connection(topic, state.__msgtype__, typestore=store)
        for i, t in enumerate(T):
            of = header(stamp(sec=EPOCH, nanosec=round(t * 1e9)), "")
            message = state(
                of,
                joint_state(of, names, Q[i], DQ[i], TAU[i]),
                joint_state(of, names, Q[i] + 1, DQ[i] + 1, TAU[i] + 1),
                joint_state(of, names, nothing, nothing, 0.1 * TAU[i]),
                np.zeros(6),
            )
            data = store.serialize_cdr(message, state.__msgtype__)
            writer.write(connection, round(1e9 * (EPOCH + t)), data)
    log = read_log(tmp_path / "bag")
    np.testing.assert_allclose(log.q, Q)
    np.testing.assert_allclose(log.tau, TAU)
    np.testing.assert_allclose(log.tau_ext, 0.1 * TAU)


def test_an_episode_of_a_lerobot_data_set(tmp_path: Path) -> None:
    pyarrow = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    file, info = tmp_path / "data" / "chunk-000" / "file-000.parquet", tmp_path / "meta/info.json"
    for made in (file, info):
        made.parent.mkdir(parents=True)
    states = [*np.hstack([Q, DQ, TAU]).tolist(), *np.hstack([Q, DQ, TAU]).tolist()]
    table = {
        "observation.state": states,
        "timestamp": np.tile(T, 2),
        "episode_index": np.repeat([0, 1], N),
        "task": ["lift"] * 2 * N,
    }
    parquet.write_table(pyarrow.table(table), file)
    columns = tmp_path / "map.yaml"
    with pytest.raises(InputError, match=r"has episodes 0 to 1; state one .* 'episode: 0'"):
        read_log(file)
    columns.write_text(
        "episode: 1\nq: observation.state[0:7]\ndq: observation.state[7:14]\n"
        "tau: observation.state[14:21]\n"
    )
    np.testing.assert_array_equal(read_log(file, columns).tau, TAU)
    names = [f"joint_{i}.{kind}" for kind in ("pos", "vel", "effort") for i in range(7)]
    info.write_text(json.dumps({"features": {"observation.state": {"names": names}}}))
    columns.write_text("episode: 0\n")
    np.testing.assert_array_equal(read_log(file, columns).dq, DQ)
