"""What viewers are shown of a run, read by other people's readers of MCAP and of ROS 2 messages."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from PIL import Image
from workbench import BOTTLE, MUG, bench

from palpate.common.pose import Pose
from palpate.runs.folder import write_trace
from palpate.runs.run import Run
from palpate.runs.settings import Settings
from palpate.trace.mcap import read_mcap
from palpate.trace.recording import LeafRun, WrenchSensor
from palpate.trace.samples import Trace

LAYOUT = Path(__file__).parents[2] / "docs" / "palpate.foxglove.json"
POSES = (
    "camera: {pos: [1.5, 0, 1.0], quat: [0.653, 0.271, 0.271, 0.653], fovy: 45, size: [1280, 960]}"
)
GRASPED, LET_GO = 9.0, 15.0
"""s: between these the bottle is in the hand."""


@pytest.fixture
def weighed(trace: Trace) -> Trace:
    """A trace in which a bottle is held for a while."""
    leaves = tuple(_with_bottle(leaf) for leaf in trace.leaves)
    return replace(trace, leaves=leaves).until(16.0)


def _with_bottle(leaf: LeafRun) -> LeafRun:
    assert leaf.context is not None
    holding = "bottle" if GRASPED - 1 < leaf.end < LET_GO else None
    return replace(leaf, context=replace(leaf.context, holding=holding))


def written(folder: Path, trace: Trace, settings: Settings | None = None) -> Path:
    """The file that a run leaves."""
    scene = bench(BOTTLE, MUG)
    write_trace(Run(settings or Settings(), scene, None, recorded=trace), folder)  # type: ignore[arg-type]
    return folder / "trace.mcap"


def messages(file: Path, *topics: str) -> list[Any]:
    """Those of some topics, as a ROS 2 reader decodes them."""
    with file.open("rb") as content:
        reader = make_reader(content, decoder_factories=[DecoderFactory()])
        return [message for *_, message in reader.iter_decoded_messages(topics)]


def schemas(file: Path) -> dict[str, str]:
    """The name of each topic's schema."""
    with file.open("rb") as content:
        summary = make_reader(content).get_summary()
    assert summary is not None
    return {c.topic: summary.schemas[c.schema_id].name for c in summary.channels.values()}


def test_the_cell_is_described_as_links_that_the_transforms_move(
    weighed: Trace, tmp_path: Path
) -> None:
    file = written(tmp_path, weighed)
    (description,) = messages(file, "/robot_description")
    assert schemas(file)["/robot_description"] == "std_msgs/msg/String"
    urdf = ElementTree.fromstring(description.data)
    links = {link.get("name") for link in urdf.iter("link")}
    assert {"world", "bench", "bottle", "mug", "robot/fr3_link7", "robot/left_finger"} <= links
    assert not list(urdf.iter("mesh")), "nothing that lies in another file"
    parents = {
        j.find("child").get("link"): j.find("parent").get("link") for j in urdf.iter("joint")
    }
    first = messages(file, "/cell/tf")[0]
    assert schemas(file)["/cell/tf"] == "tf2_msgs/msg/TFMessage"
    moved = {t.child_frame_id: t.header.frame_id for t in first.transforms}
    assert moved.items() <= parents.items(), "each from the parent that the description says"
    assert "bottle" in moved
    assert "mug" not in moved, "nobody touched it"


def test_a_held_object_moves_with_the_hand(weighed: Trace, tmp_path: Path) -> None:
    places = []
    for message in messages(written(tmp_path, weighed), "/cell/tf"):
        (bottle,) = [t for t in message.transforms if t.child_frame_id == "bottle"]
        stamp = bottle.header.stamp
        at = bottle.transform.translation
        places.append((stamp.sec + 1e-9 * stamp.nanosec, at.x, at.y, at.z))
    times, at = np.array(places)[:, 0], np.array(places)[:, 1:]
    assert np.diff(times) == pytest.approx(0.1, abs=0.011), "ten a second"
    still = at[times < GRASPED - 1]
    np.testing.assert_allclose(still, np.broadcast_to(still[0], still.shape), atol=1e-6)
    hand = weighed.samples.pose_world_tcp
    held = (times > GRASPED + 0.5) & (times < LET_GO - 2.5)
    rows = np.searchsorted(weighed.t, times[held] - 1e-6)
    went = np.array([Pose.of(x[:3], x[3:]).position for x in hand[rows]])
    np.testing.assert_allclose(np.diff(at[held], axis=0), np.diff(went, axis=0), atol=1e-5)


def test_the_trace_stays_what_it_was(weighed: Trace, tmp_path: Path) -> None:
    written(tmp_path, weighed)
    again = read_mcap(tmp_path / "trace.mcap")
    assert again.leaves == weighed.leaves
    np.testing.assert_array_equal(again.samples.wrench, weighed.samples.wrench)


def test_the_picture_and_its_camera_are_recorded(weighed: Trace, tmp_path: Path) -> None:
    poses, image = tmp_path / "poses.yaml", tmp_path / "desk.png"
    poses.write_text(POSES)
    Image.new("RGB", (1280, 960), (10, 120, 200)).save(image)
    file = written(tmp_path, weighed, Settings(images=(image,), poses=poses))
    (message,) = messages(file, "/camera/image")
    assert schemas(file)["/camera/image"] == "sensor_msgs/msg/CompressedImage"
    picture = Image.open(BytesIO(bytes(message.data)))
    assert (message.format, picture.format, picture.size) == ("jpeg", "JPEG", (640, 480))
    (info,) = messages(file, "/camera/camera_info")
    assert schemas(file)["/camera/camera_info"] == "sensor_msgs/msg/CameraInfo"
    assert (info.width, info.height, len(info.d)) == (640, 480, 5)
    focal = 240 / np.tan(np.radians(22.5))
    assert list(info.k) == pytest.approx([focal, 0, 320, 0, focal, 240, 0, 0, 1])
    (placed,) = messages(file, "/tf_static")
    (camera,) = placed.transforms
    assert camera.child_frame_id == message.header.frame_id == info.header.frame_id
    turned = camera.transform.rotation
    pose = Pose.of((0, 0, 0), (turned.w, turned.x, turned.y, turned.z))
    assert pose.rotation[2, 2] < 0, "it looks down at the desk, along its z"


def test_a_picture_whose_camera_is_nowhere_is_shown_alone(weighed: Trace, tmp_path: Path) -> None:
    image = tmp_path / "desk.png"
    Image.new("RGB", (320, 240)).save(image)
    result = schemas(written(tmp_path, weighed, Settings(images=(image,))))
    assert "/camera/image" in result
    assert not {"/camera/camera_info", "/tf_static"} & set(result)


def test_a_failing_view_costs_no_trace(weighed: Trace, tmp_path: Path) -> None:
    file = written(tmp_path, weighed, Settings(images=(tmp_path / "gone.png",)))
    result = schemas(file)
    assert len(read_mcap(file).t) == len(weighed.t)
    assert "/robot_description" in result
    assert "/camera/image" not in result


def test_every_topic_and_field_of_the_layout_is_in_a_trace(weighed: Trace, tmp_path: Path) -> None:
    poses, image = tmp_path / "poses.yaml", tmp_path / "desk.png"
    poses.write_text(POSES)
    Image.new("RGB", (320, 240)).save(image)
    # The layout also shows a wrist sensor, which the arm of this trace does not have.
    part = weighed.until(4.0)
    samples = replace(part.samples, wrench_sensor=np.zeros((len(part.samples.t), 6)))
    hand = replace(part.hand, wrench_sensor=WrenchSensor("a test sensor"))
    part = replace(part, samples=samples, hand=hand)
    file = written(tmp_path, part, Settings(images=(image,), poses=poses))
    result = schemas(file)
    layout = json.loads(LAYOUT.read_text())
    panels = layout["configById"]
    assert set(_panels_of(layout["layout"])) == set(panels)
    for panel in panels.values():
        for path in panel.get("paths", []):
            topic, *fields = re.findall(r"/[\w/]+|\.\w+|\[\d+\]", path["value"])
            value: Any = messages(file, topic)[0]
            for field in fields:
                value = value[int(field[1:-1])] if field[0] == "[" else getattr(value, field[1:])
            assert isinstance(value, float | str), path
    cell = panels["3D!cell"]
    assert set(cell["topics"]) <= set(result)
    assert {
        panels["RosOut!log"]["topicToRender"],
        *panels["Image!camera"]["imageMode"].values(),
    } <= {*result}


def _panels_of(layout: Any) -> list[str]:
    if isinstance(layout, str):
        return [layout]
    return [*_panels_of(layout["first"]), *_panels_of(layout["second"])]
