"""The finished trace file, and the one that grows while the robot moves."""

from __future__ import annotations

import contextlib
import io
import tracemalloc
from dataclasses import fields, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import zstandard
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.data_stream import RecordBuilder
from mcap.reader import make_reader
from mcap.records import Chunk
from mcap.stream_reader import CRCValidationError, StreamReader
from mcap.writer import CompressionType, Writer
from mcap_ros2.decoder import DecoderFactory

from palpate.common.errors import InputError
from palpate.robots.owner import load_description
from palpate.trace.mcap import PROFILE, TraceStream, read_mcap, stored_messages, write_mcap
from palpate.trace.recording import NominalHand, WrenchSensor
from palpate.trace.samples import Samples, Trace


def assert_same(a: Trace, b: Trace) -> None:
    for field in fields(Samples):
        np.testing.assert_array_equal(
            getattr(a.samples, field.name), getattr(b.samples, field.name), field.name
        )
    for name in ("leaves", "recordings", "conversions", "hand", "gravity"):
        assert getattr(a, name) == getattr(b, name), name


def test_round_trip_is_exact(trace: Trace, tmp_path: Path) -> None:
    path = tmp_path / "trace.mcap"
    write_mcap(path, trace)
    assert_same(read_mcap(path), trace)


def test_a_wrench_sensor_round_trips(trace: Trace, tmp_path: Path) -> None:
    """In a finished file, as a standard message, and in the stream of an unfinished run."""
    sensor = WrenchSensor("Bota SensONE", (0.0, 0.0, -0.1, 0.0, 1.0, 0.0, 0.0), 0.01)
    hand = replace(trace.hand, wrench_sensor=sensor)
    sensed = replace(trace.samples, wrench_sensor=2.0 * trace.samples.wrench)
    made = replace(trace, samples=sensed, hand=hand)
    path = tmp_path / "trace.mcap"
    write_mcap(path, made)
    assert_same(read_mcap(path), made)
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        seen = {c.topic: m for _, c, _, m in reader.iter_decoded_messages()}
    assert seen["/wrench_sensor"].header.frame_id == "wrench_sensor"
    assert seen["/wrench_sensor"].wrench.torque.z == sensed.wrench_sensor[-1, 5]
    frame = seen["/tf"].transforms[2]
    assert (frame.header.frame_id, frame.child_frame_id) == ("tcp", "wrench_sensor")
    assert (frame.transform.translation.z, frame.transform.rotation.x) == (-0.1, 1.0)
    stream = TraceStream(tmp_path / "stream.mcap", hand, made.gravity)
    stream.write(sensed, SimpleNamespace(leaves=[], recordings=[], conversions=[]))
    stream.close()
    np.testing.assert_array_equal(
        read_mcap(tmp_path / "stream.mcap").samples.wrench_sensor, sensed.wrench_sensor
    )


def test_an_empty_trace_round_trips(trace: Trace, tmp_path: Path) -> None:
    empty = replace(trace, samples=Samples.empty(), leaves=(), recordings=(), conversions=())
    path = tmp_path / "trace.mcap"
    write_mcap(path, empty)
    assert_same(read_mcap(path), empty)


def test_hostile_names_of_leaves_round_trip(trace: Trace, tmp_path: Path) -> None:
    hostile = replace(
        trace, leaves=(replace(trace.leaves[0], label='x"}</script>\n\0é', message="{}"),)
    )
    path = tmp_path / "trace.mcap"
    write_mcap(path, hostile)
    assert read_mcap(path).leaves == hostile.leaves


def test_a_ros2_reader_sees_standard_messages(trace: Trace, tmp_path: Path) -> None:
    path = tmp_path / "trace.mcap"
    write_mcap(path, trace)
    row = 1200
    seen: dict[str, list[object]] = {}
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        assert reader.get_header().profile == "ros2"
        for schema, channel, _, message in reader.iter_decoded_messages():
            seen.setdefault(f"{channel.topic} {schema.name}", []).append(message)
    wrench = seen["/wrench geometry_msgs/msg/WrenchStamped"][row]
    assert wrench.wrench.force.z == trace.samples.wrench[row, 2]
    assert wrench.header.frame_id == "tcp_world_axes"
    assert wrench.header.stamp.sec == int(trace.samples.t[row])
    transforms = seen["/tf tf2_msgs/msg/TFMessage"][row].transforms
    assert [f.child_frame_id for f in transforms] == ["tcp", "tcp_world_axes"]
    assert transforms[1].transform.rotation.w == 1.0
    joints = seen["/joint_states sensor_msgs/msg/JointState"][row]
    assert list(joints.position) == trace.samples.q[row].tolist()
    assert joints.name[0] == "fr3_joint1"
    log = seen["/rosout rcl_interfaces/msg/Log"]
    assert [m.msg for m in log][6] == "MeasureForces(): SUCCESS, done in 1.5 s"
    assert len(seen["/leaves std_msgs/msg/String"]) == 2 * len(trace.leaves)
    assert len(seen["/conversions std_msgs/msg/String"]) == 2


def test_messages_are_in_order_of_time(trace: Trace, tmp_path: Path) -> None:
    path = tmp_path / "trace.mcap"
    write_mcap(path, trace)
    with path.open("rb") as file:
        times = [m.log_time for _, _, m in make_reader(file).iter_messages(log_time_order=False)]
    assert times == sorted(times)


@pytest.mark.parametrize("content", [b"", b"not an mcap", b"\x89MCAP0\r\n" + b"\0" * 64])
def test_other_files_are_refused(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "trace.mcap"
    path.write_bytes(content)
    with pytest.raises(InputError, match="not a trace"):
        read_mcap(path)


@settings(
    max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None
)
@given(data=st.data())
def test_messages_read_from_damaged_bytes_are_original(
    data: st.DataObject, trace: Trace, tmp_path: Path
) -> None:
    path, written = tmp_path / "trace.mcap", trace.until(0.1)
    write_mcap(path, written)
    content = bytearray(path.read_bytes())
    position = data.draw(st.integers(0, len(content) - 1))
    content[position] ^= data.draw(st.integers(1, 255))
    path.write_bytes(content)
    with contextlib.suppress(InputError):
        assert_same(read_mcap(path), written)


def test_a_figure_outside_of_all_chunks_is_under_a_checksum(trace: Trace, tmp_path: Path) -> None:
    path = tmp_path / "trace.mcap"
    write_mcap(path, trace.until(0.1))
    path.write_bytes(path.read_bytes().replace(b'"tip_offset":0.009', b'"tip_offset":0.008'))
    with pytest.raises(InputError, match="crc"):
        read_mcap(path)


def test_a_chunk_of_another_program_is_under_its_own_checksum(tmp_path: Path) -> None:
    """Most writers give the data as a whole none."""
    path = tmp_path / "log.mcap"
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.NONE)
        writer.start()
        channel = writer.register_channel("/mass", "json", schema_id=0)
        writer.add_message(channel, 0, b'{"mass": 0.254}', publish_time=0)
        writer.finish()
    path.write_bytes(path.read_bytes().replace(b"0.254", b"0.255"))
    with path.open("rb") as file, pytest.raises(CRCValidationError):
        list(stored_messages(file))


def test_a_trace_from_before_joints_were_named_is_an_fr3s() -> None:
    hand = NominalHand(
        tip_offset=0.009, force_repeatability=0.15, torque_gain=0.01, pose_repeatability=1e-4
    )
    arm = load_description("fr3").nominal
    assert (hand.joints, hand.fingers) == (arm.joints, arm.fingers)


@pytest.mark.parametrize("profile", ["ros2", PROFILE])
@pytest.mark.parametrize("chunks", [1, pytest.param(40, marks=pytest.mark.long)])
def test_a_file_that_unpacks_to_much_is_refused_in_little_memory(
    profile: str, chunks: int, tmp_path: Path
) -> None:
    """1 GB of zeros in one chunk of 32 kB, which claims to have 1 kB; or 7 MiB in each of 40 chunks."""
    size = (1 << 30) // (1 if chunks == 1 else 146)
    path = tmp_path / "trace.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile=profile)
        packer = zstandard.ZstdCompressor(level=19).compressobj()
        mib = bytes(1 << 20)
        packed = b"".join(packer.compress(mib) for _ in range(size >> 20)) + packer.flush()
        for _ in range(chunks):
            record = RecordBuilder()
            Chunk("zstd", packed, 0, 0, 0, 1000).write(record)
            file.write(record.end())
        writer.finish()
    assert path.stat().st_size < 100_000
    tracemalloc.start()
    try:
        with pytest.raises(InputError, match="not a trace"):
            read_mcap(path)
        assert tracemalloc.get_traced_memory()[1] < 64 << 20
    finally:
        tracemalloc.stop()


def test_a_cut_file_is_refused(trace: Trace, tmp_path: Path) -> None:
    path = tmp_path / "trace.mcap"
    write_mcap(path, trace)
    path.write_bytes(path.read_bytes()[:-2000])
    with pytest.raises(InputError, match="not a trace"):
        read_mcap(path)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no trace at"):
        read_mcap(tmp_path / "trace.mcap")


def write_stream(path: Path, trace: Trace, *, ends: bool = True) -> None:
    """Tick by tick, as a runner hands it over."""
    stream = TraceStream(path, trace.hand, trace.gravity)
    recorded: Any = SimpleNamespace(leaves=[], recordings=[], conversions=[])
    for start in range(0, len(trace.samples), 4):
        samples = trace.samples.where(slice(start, start + 4))
        now = float(samples.t[-1])
        recorded.leaves[:] = [leaf for leaf in trace.leaves if leaf.end <= now]
        recorded.recordings[:] = [r for r in trace.recordings if r.end <= now]
        recorded.conversions[:] = [c for c in trace.conversions if c.time <= now]
        stream.write(samples, recorded)
    if ends:
        stream.close()


def test_a_stream_is_read_again_in_full(trace: Trace, tmp_path: Path) -> None:
    path = tmp_path / "trace.mcap"
    write_stream(path, trace)
    found = read_mcap(path)
    np.testing.assert_array_equal(found.samples.wrench, trace.samples.wrench)
    np.testing.assert_array_equal(found.samples.width, trace.samples.width)
    assert found.recordings == trace.recordings
    assert found.conversions == trace.conversions
    assert found.hand == trace.hand
    assert len(found.leaves) == sum(leaf.end <= trace.t[-1] for leaf in trace.leaves)


def test_events_before_a_further_attempt_are_in_the_stream(trace: Trace, tmp_path: Path) -> None:
    stream = TraceStream(tmp_path / "trace.mcap", trace.hand, trace.gravity)
    first: Any = SimpleNamespace(leaves=[], recordings=[], conversions=[])
    stream.write(trace.samples, first)  # a block is written, and the next is due later
    first.leaves += trace.leaves
    stream.write(Samples.empty(), first)
    # A further attempt has a recorder of its own. Then the process is killed.
    stream.write(Samples.empty(), SimpleNamespace(leaves=[], recordings=[], conversions=[]))
    assert read_mcap(tmp_path / "trace.mcap").leaves == trace.leaves


def test_a_killed_process_loses_a_quarter_of_a_second_of_the_stream(
    trace: Trace, tmp_path: Path
) -> None:
    path = tmp_path / "trace.mcap"
    write_stream(path, trace, ends=False)
    assert read_mcap(path).t[-1] > trace.t[-1] - 0.3


@pytest.mark.parametrize("share", [0.02, 0.3, 0.7, 0.99])
def test_a_stream_that_is_cut_off_is_read_up_to_there(
    share: float, trace: Trace, tmp_path: Path
) -> None:
    path = tmp_path / "trace.mcap"
    write_stream(path, trace)
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    found = read_mcap(path)
    assert len(found.samples) > (share - 0.1) * len(trace.samples)
    np.testing.assert_array_equal(found.t, trace.t[: len(found.t)])


def test_no_key_is_in_the_file_of_a_run_under_way(
    trace: Trace, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ACME_API_KEY", "ak-31415926535897932384")
    path = tmp_path / "trace.mcap"
    telling = replace(
        trace.leaves[0], label="with ak-31415926535897932384", message="ak-3141592653"
    )
    write_stream(path, replace(trace, leaves=(telling,)), ends=False)
    assert b"ak-31415926" not in path.read_bytes()
    assert read_mcap(path).leaves == (replace(telling, label="with [key]", message="[key]"),)


def test_the_finished_file_replaces_the_stream(trace: Trace, tmp_path: Path) -> None:
    path = tmp_path / "trace.mcap"
    write_stream(path, trace)
    write_mcap(path, trace)
    assert read_mcap(path).leaves == trace.leaves


def test_nan_is_written_and_read_as_nan(trace: Trace, tmp_path: Path) -> None:
    path = tmp_path / "trace.mcap"
    faulty = replace(trace.leaves[0], end=float("nan"))
    readings = (replace(trace.recordings[0], reading=(float("nan"),)),)
    samples = replace(trace.samples, t=np.where(trace.t > 30.0, np.nan, trace.t))
    write_mcap(path, replace(trace, samples=samples, leaves=(faulty,), recordings=readings))
    found = read_mcap(path)
    assert np.isnan(found.leaves[0].end)
    assert np.isnan(found.recordings[0].reading[0])
    assert np.isnan(found.t).sum() == np.isnan(samples.t).sum()


def test_samples_at_a_nan_time_are_written_without_delay(trace: Trace, tmp_path: Path) -> None:
    path = tmp_path / "trace.mcap"
    lost = replace(trace.samples, t=np.full(len(trace.t), np.nan))
    write_stream(path, replace(trace, samples=lost), ends=False)
    assert len(read_mcap(path).samples) == len(lost)


def test_a_stream_without_its_first_record_is_refused(tmp_path: Path, trace: Trace) -> None:
    path = tmp_path / "trace.mcap"
    write_stream(path, trace)
    path.write_bytes(path.read_bytes()[:40])
    with pytest.raises(InputError, match="not a trace"):
        read_mcap(path)


def test_the_index_finds_every_message(trace: Trace, tmp_path: Path) -> None:
    path = tmp_path / "trace.mcap"
    write_mcap(path, trace)
    content, found = path.read_bytes(), 0
    with path.open("rb") as file:
        summary = make_reader(file, validate_crcs=True).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    for chunk in summary.chunk_indexes:
        packed = first_record(content[chunk.chunk_start_offset :])
        data = zstandard.decompress(packed.data, chunk.uncompressed_size)
        # Each entry of a channel's index has the time and the offset of a message in the chunk.
        for channel, start in chunk.message_index_offsets.items():
            for time, offset in first_record(content[start:]).records:
                message = first_record(data[offset:])
                assert (message.channel_id, message.log_time) == (channel, time)
                found += 1
    assert found == summary.statistics.message_count > 9 * len(trace.samples)


def first_record(content: bytes) -> Any:
    stream = io.BytesIO(content)
    return next(iter(StreamReader(stream, skip_magic=True, emit_chunks=True).records))
