"""Recordings in MCAP, rosbag2 and Parquet."""

from __future__ import annotations

import json
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from palpate.common.errors import InputError
from palpate.estimation.logs.reading import read_log
from palpate.trace.recording import ArmLog

N = 200
T = np.arange(N) * 2e-3
PHASE = np.arange(7)
Q = 0.4 * np.sin(2 * T[:, None] + PHASE)
DQ = 0.8 * np.cos(2 * T[:, None] + PHASE)
TAU = 10 * np.cos(T[:, None] + PHASE)
EPOCH = 1_760_000_000
JOINT_STATE = "sensor_msgs/msg/JointState"
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
def test_a_folder_of_rosbag2_is_read(tmp_path: Path, plugin: str) -> None:
    log = read_log(bag(tmp_path / "bag", plugin))
    np.testing.assert_allclose(log.t, T, atol=1e-6)
    for found, wanted in ((log.q, Q), (log.dq, DQ), (log.tau, TAU)):
        np.testing.assert_allclose(found, wanted)


def test_a_single_file_of_a_bag_is_read(tmp_path: Path) -> None:
    (file,) = bag(tmp_path / "bag", "mcap").glob("*.mcap")
    np.testing.assert_allclose(read_log(file).tau, TAU)
    (file,) = bag(tmp_path / "other", "sqlite3").glob("*.db3")
    np.testing.assert_allclose(read_log(file).tau, TAU)


def test_an_unknown_topic_of_a_bag_gets_a_suggestion(tmp_path: Path) -> None:
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


@pytest.mark.parametrize("ending", ["mcap", "db3"])
def test_a_damaged_file_of_a_folder_is_named(tmp_path: Path, ending: str) -> None:
    folder = bag(tmp_path / "bag", "mcap" if ending == "mcap" else "sqlite3")
    (folder / f"second.{ending}").write_bytes(b"no bag" * 1000)
    with pytest.raises(InputError, match=rf"bag/second\.{ending} is no bag that can be read"):
        read_log(folder)


def test_the_state_of_franka_ros2_is_read(tmp_path: Path) -> None:
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


def test_an_episode_of_a_lerobot_data_set_is_read(tmp_path: Path) -> None:
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


def test_two_arms_in_a_lerobot_data_set(tmp_path: Path) -> None:
    pyarrow = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    file, info = tmp_path / "data" / "chunk-000" / "file-000.parquet", tmp_path / "meta/info.json"
    for made in (file, info):
        made.parent.mkdir(parents=True)
    kinds = {"pos": Q, "vel": DQ, "effort": TAU}
    sides = {"left": 1.0, "right": -1.0}
    table = {
        f"observation.{side}.{kind}": sign * part
        for side, sign in sides.items()
        for kind, part in kinds.items()
    }
    labels = [f"{side}_joint_{i}.{kind}" for side in sides for kind in kinds for i in range(7)]
    states = np.hstack(list(table.values())).tolist()
    parquet.write_table(pyarrow.table({"observation.state": states, "timestamp": T}), file)
    info.write_text(json.dumps({"features": {"observation.state": {"names": labels}}}))
    with pytest.raises(InputError, match=r"'left' .*, 'right' .*'joints: right'"):
        read_log(file)
    assert is_left(with_map(tmp_path, file, "joints: right\n"), -1.0)
    text = "q: observation.state[0:7]\ndq: observation.state[7:14]\ntau: observation.state[14:21]\n"
    assert is_left(with_map(tmp_path, file, text))


def joint_states(store: Any, names: list[str], *signals: np.ndarray, stamp: float = EPOCH) -> Any:
    """One message; `stamp` s."""
    header, time = (
        store.types[name] for name in ("std_msgs/msg/Header", "builtin_interfaces/msg/Time")
    )
    nanosec = round(1e9 * (stamp % 1))
    parts = (time(sec=int(stamp), nanosec=nanosec), "")
    # A header of ROS 1 has a number, too.
    of = header(0, *parts) if "seq" in header.__dataclass_fields__ else header(*parts)
    return store.types[JOINT_STATE](of, names, *signals)


def serialised(names: list[str], *signals: np.ndarray, stamped: bool = True) -> list[bytes]:
    """Messages of joint states at the times T."""
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    every = (
        joint_states(
            store, names, *(part[i].copy() for part in signals), stamp=(EPOCH + T[i]) * stamped
        )
        for i in range(N)
    )
    return [bytes(store.serialize_cdr(message, JOINT_STATE)) for message in every]


def written(
    folder: Path, topics: dict[str, list[list[bytes]]], plugin: str = "mcap", mode: str = ""
) -> Path:
    """Write joint states on several topics, a message of each series at each time."""
    pytest.importorskip("rosbags")
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    storage = StoragePlugin.MCAP if plugin == "mcap" else StoragePlugin.SQLITE3
    writer = Writer(folder, version=9, storage_plugin=storage)
    if mode:
        writer.set_compression(CompressionMode[mode], CompressionFormat.ZSTD)
    with writer:
        for topic, series in topics.items():
            connection = writer.add_connection(topic, JOINT_STATE, typestore=store)
            for i, t in enumerate(T):
                for messages in series:
                    writer.write(connection, round(1e9 * (EPOCH + t)), messages[i])
    return folder


def names(prefix: str = "") -> list[str]:
    return [f"{prefix}fr3_joint{i + 1}" for i in range(7)]


def is_left(log: ArmLog, sign: float = 1.0) -> bool:
    """The log holds Q, DQ and TAU, or those of the right arm, of opposite sign."""
    pairs = ((log.q, Q), (log.dq, DQ), (log.tau, TAU))
    return all(np.allclose(found, sign * wanted) for found, wanted in pairs)


def with_map(tmp_path: Path, log: Path, text: str) -> ArmLog:
    (tmp_path / "map.yaml").write_text(text)
    return read_log(log, tmp_path / "map.yaml")


@pytest.mark.parametrize("form", ["together", "alternating", "interleaved"])
def test_two_arms_on_one_topic(tmp_path: Path, form: str) -> None:
    both = [np.hstack([part, -part]) for part in (Q, DQ, TAU)]
    every, order = names("left_") + names("right_"), np.arange(14)
    if form == "interleaved":
        order = order.reshape(2, 7).T.ravel()
    series = [serialised([every[i] for i in order], *(part[:, order] for part in both))]
    if form == "alternating":
        series = [
            serialised(names("left_"), Q, DQ, TAU),
            serialised(names("right_"), -Q, -DQ, -TAU),
        ]
    folder = written(tmp_path / "bag", {"/joint_states": series})
    with pytest.raises(InputError, match=r"several arms: 'left_fr3' .*, 'right_fr3' .*'joints: "):
        read_log(folder)
    assert is_left(with_map(tmp_path, folder, "joints: left\n"))
    log = with_map(tmp_path, folder, "joints: right_fr3_joint\n")
    assert is_left(log, -1.0)
    assert "right_fr3_joint7" in log.notes[0]
    assert "not" in log.notes[0]
    if form == "together":  # in the order of the message
        text = "q: position[7:14]\ndq: velocity[7:14]\ntau: effort[7:14]\n"
        assert is_left(with_map(tmp_path, folder, text), -1.0)


def test_arms_of_one_name_on_two_topics(tmp_path: Path) -> None:
    left, right = serialised(names(), Q, DQ, TAU), serialised(names(), -Q, -DQ, -TAU)
    folder = written(tmp_path / "a", {"/left/joint_states": [left], "/right/joint_states": [right]})
    with pytest.raises(InputError, match=r"'left_fr3' \(/left/joint_states\), 'right_fr3'"):
        read_log(folder)
    assert is_left(with_map(tmp_path, folder, "joints: left\n"))
    assert is_left(with_map(tmp_path, folder, "topic: /right/joint_states\n"), -1.0)


def test_one_arm_on_several_topics(tmp_path: Path) -> None:
    """As franka_ros publishes it: the same joints twice, those desired, and the gripper's."""
    states, fingers = serialised(names(), Q, DQ, TAU), [np.full((N, 1), 0.04)] * 3
    desired = serialised(names(), Q + 1, DQ, TAU + 1)
    folder = written(
        tmp_path / "bag",
        {
            "/controller/joint_states_desired": [desired],
            "/controller/joint_states": [states],
            "/joint_states": [states],
            "/gripper/joint_states": [serialised(["fr3_finger_joint1"], *fingers)],
        },
    )
    log = read_log(folder)
    assert is_left(log)
    assert log.notes[0].startswith("200 messages on /controller/joint_states ")
    assert "200 messages on /gripper/joint_states" in log.notes[0]


def test_messages_of_arm_and_gripper_alternate_on_one_topic(tmp_path: Path) -> None:
    fingers = serialised(["fr3_finger_joint1", "fr3_finger_joint2"], *[np.full((N, 2), 0.04)] * 3)
    series = [fingers, serialised(names(), Q, DQ, TAU)]
    log = read_log(written(tmp_path / "bag", {"/joint_states": series}))
    assert is_left(log)
    assert (
        "effort.fr3_joint7) are read, not 200 messages on /joint_states (… effort.fr3_finger"
        in log.notes[0]
    )


def test_an_order_of_joints_that_changes(tmp_path: Path) -> None:
    mixed = serialised(
        [names()[i] for i in SHUFFLED], *(part[:, SHUFFLED] for part in (Q, DQ, TAU))
    )
    straight = serialised(names(), Q, DQ, TAU)
    series = [mixed[i] if i % 2 else straight[i] for i in range(N)]
    assert is_left(read_log(written(tmp_path / "bag", {"/joint_states": [series]})))


def test_messages_without_names_or_stamps_are_read_with_a_note(tmp_path: Path) -> None:
    wide = [np.hstack([part, np.zeros((N, 2))]) for part in (Q, DQ, TAU)]
    series = serialised([], *wide, stamped=False)
    log = read_log(written(tmp_path / "bag", {"/joint_states": [series]}))
    assert is_left(log)
    assert log.notes == (
        "its messages have no stamps: their times are those of the bag",
        "joints position[0] to position[6] are read, not position[7], position[8]",
    )


@pytest.mark.parametrize(
    ("plugin", "mode"),
    [
        ("mcap", "FILE"),
        ("mcap", "MESSAGE"),
        ("mcap", "STORAGE"),
        ("sqlite3", "FILE"),
        ("sqlite3", "MESSAGE"),
    ],
)
def test_packed_bags_without_metadata_are_read(tmp_path: Path, plugin: str, mode: str) -> None:
    series = {"/joint_states": [serialised(names(), Q, DQ, TAU)]}
    folder = written(tmp_path / "bag", series, plugin, mode)
    assert is_left(read_log(folder))
    (folder / "metadata.yaml").unlink()
    assert is_left(read_log(folder))
    (file,) = folder.iterdir()
    assert is_left(read_log(file))


@pytest.mark.parametrize("packed", ["", "BZ2", "LZ4"])
def test_packed_bags_of_ros1_are_read(tmp_path: Path, packed: str) -> None:
    pytest.importorskip("rosbags")
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    store, writer = get_typestore(Stores.ROS1_NOETIC), Writer(tmp_path / "log.bag")
    if packed:
        writer.set_compression(Writer.CompressionFormat[packed])
    with writer:
        connection = writer.add_connection("/joint_states", JOINT_STATE, typestore=store)
        for i, t in enumerate(T):
            message = joint_states(store, names(), Q[i], DQ[i], TAU[i], stamp=EPOCH + t)
            data = store.serialize_ros1(message, JOINT_STATE)
            writer.write(connection, round(1e9 * (EPOCH + t)), data)
    assert is_left(read_log(tmp_path / "log.bag"))


def mcap(
    file: Path, *channels: tuple[str, str, str, str, bytes, list[bytes]], packed: str = "ZSTD"
) -> Path:
    """Write messages on channels: topic, type, encodings of type and messages, definition."""
    from mcap.writer import CompressionType, Writer

    with file.open("wb") as out:
        writer = Writer(out, compression=CompressionType[packed])
        writer.start(profile="")
        for topic, datatype, form, encoding, definition, messages in channels:
            schema = writer.register_schema(datatype, form, definition)
            channel = writer.register_channel(topic, encoding, schema)
            for t, data in zip(T, messages, strict=True):
                time = round(1e9 * (EPOCH + t))
                writer.add_message(channel, time, data, time)
        writer.finish()
    return file


RULE = "=" * 80 + "\n"
DEFINITION = f"""std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
{RULE}MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
{RULE}MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
""".encode()


@pytest.mark.parametrize("packed", ["ZSTD", "LZ4", "NONE"])
def test_an_undecodable_topic_refuses_no_bag(tmp_path: Path, packed: str) -> None:
    pytest.importorskip("rosbags")
    good = serialised(names(), Q, DQ, TAU)
    damaged = [b"\0\1\0\0ab" if i in (5, 6) else data for i, data in enumerate(good)]
    other = ("/other/joint_states", JOINT_STATE, "ros2msg", "cdr", b"no definition!", good)
    proto = ("/arm/state", "pb.RobotState", "protobuf", "protobuf", b"", [b"\x08\1"] * N)
    log = read_log(
        mcap(
            tmp_path / "log.mcap",
            ("/joint_states", JOINT_STATE, "ros2msg", "cdr", DEFINITION, damaged),
            other,
            proto,
            packed=packed,
        )
    )
    assert len(log) == N - 2
    few, whole, foreign = log.notes
    assert few.startswith(f"2 messages on /joint_states ({JOINT_STATE}) cannot be decoded")
    assert whole.startswith(
        f"200 messages on /other/joint_states ({JOINT_STATE}) cannot be decoded"
    )
    assert "/arm/state (pb.RobotState)" in foreign
    assert "unknown encoding 'protobuf' ('protobuf'), not cdr, ros1 or json" in foreign
    alone = mcap(tmp_path / "alone.mcap", proto)
    with pytest.raises(InputError, match=r"/arm/state .* unknown encoding 'protobuf'"):
        read_log(alone)


def test_an_undefined_message_type_is_refused(tmp_path: Path) -> None:
    """Databases before Iron have no definitions: standard types alone are known."""
    pytest.importorskip("rosbags")
    file = tmp_path / "old.db3"
    with closing(sqlite3.connect(file)) as database:
        database.executescript(
            "CREATE TABLE topics(id INTEGER PRIMARY KEY, name, type, serialization_format,"
            "offered_qos_profiles); CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id, timestamp, data)"
        )
        rows = [(1, "/joint_states", JOINT_STATE), (2, "/franka", "franka_msgs/msg/FrankaState")]
        database.executemany("INSERT INTO topics VALUES(?, ?, ?, 'cdr', '')", rows)
        for t, data in zip(T, serialised(names(), Q, DQ, TAU), strict=True):
            for topic in (1, 2):
                values = (topic, round(1e9 * (EPOCH + t)), data)
                database.execute("INSERT INTO messages VALUES(NULL, ?, ?, ?)", values)
        database.commit()
    log = read_log(file)
    assert is_left(log)
    assert log.notes == (
        "200 messages on /franka (franka_msgs/msg/FrankaState) cannot be decoded and are left out: "
        "its type is not defined in the bag",
    )


@pytest.mark.parametrize("form", ["lists", "a list of joints", "plain"])
def test_messages_in_json_are_read(tmp_path: Path, form: str) -> None:
    def message(i: int) -> dict[str, Any]:
        stamp = {"sec": EPOCH, "nsec": round(1e9 * T[i])}
        signals = [part[i].tolist() for part in (Q, DQ, TAU)]
        keys = ("name", "position", "velocity", "effort")
        columns = [names(), *signals]
        if form == "lists":
            return {"header": {"stamp": stamp}, **dict(zip(keys, columns, strict=True))}
        if form == "plain":
            return dict(zip(("t", "q", "dq", "tau"), (T[i], *signals), strict=True))
        joints = [dict(zip(keys, joint, strict=True)) for joint in zip(*columns, strict=True)]
        return {"timestamp": stamp, "joints": joints}

    data = [json.dumps(message(i)).encode() for i in range(N)]
    log = read_log(mcap(tmp_path / "log.mcap", ("/arm", "Arm", "jsonschema", "json", b"{}", data)))
    assert is_left(log)
    np.testing.assert_allclose(log.t, T, atol=1e-6)


def test_a_packed_file_of_excessive_size_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    zstandard = pytest.importorskip("zstandard")
    file = tmp_path / "log.db3.zstd"
    file.write_bytes(zstandard.ZstdCompressor().compress(bytes(3_000_000)))
    monkeypatch.setattr("palpate.estimation.logs.formats.MAX_BAG_BYTES", 2_000_000)
    with pytest.raises(InputError, match=r"log.db3.zstd unpacks to more than 2 MB"):
        read_log(file)
