"""Pose estimators by protocol: a command and a server that find a ball, and answers that are none."""

from __future__ import annotations

import base64
import io
import json
import shlex
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import palpate as pp
from palpate.common.errors import InputError, Unavailable
from palpate.common.pose import Pose
from palpate.perception import pose_estimators as exchange
from palpate.perception.lens import FACING, Lens, Mount, pinhole
from palpate.perception.look import things_of
from palpate.perception.pose_estimators import mesh_of, parse_answer, request
from palpate.perception.renderer import gl_available
from palpate.perception.solve import Estimated, Problem, move_pose, pose_difference, solve
from palpate.perception.tags import corners, tags_of
from palpate.scene.load import parse_scene

BALL = Path(__file__).parents[2] / "examples" / "ball_estimator.py"
XML = """<mujoco><worldbody><light pos="0 0 2"/>
<camera name="over" pos="0.5 -0.4 0.9" xyaxes="1 0 0 0 0.8 0.6" fovy="45"/>
<body name="table" pos="0.5 0 0.38"><geom type="box" size=".4 .4 .02" rgba=".5 .5 .5 1"/></body>
<body name="ball" pos="{x} {y} 0.43"><freejoint/>
  <geom type="sphere" size=".03" rgba=".8 .05 .05 1" mass=".1"/></body>
<body name="block" pos="0.6 0.1 0.42"><freejoint/><geom type="box" size=".02 .03 .02" mass=".1"/></body>
</worldbody></mujoco>"""
SCENE = parse_scene(XML.format(x=0.5, y=0))
LENS = Lens(pinhole(900.0, 639.5, 359.5), (1280, 720))
POSE = {"pos": [0, 0, 0.5], "quat": [1, 0, 0, 0], "covariance": (1e-6 * np.eye(6)).tolist()}


@contextmanager
def server(reply: Callable[[BaseHTTPRequestHandler, bytes], None]) -> Iterator[str]:
    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            reply(self, self.rfile.read(int(self.headers["Content-Length"])))

        def log_message(self, *_: Any) -> None:
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as listening:
        listening.daemon_threads = True
        threading.Thread(target=listening.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{listening.server_port}/pose"
        listening.shutdown()


def sends(body: bytes, status: int = 200) -> Callable[[BaseHTTPRequestHandler, bytes], None]:
    def reply(handler: BaseHTTPRequestHandler, _: bytes) -> None:
        handler.send_response(status)
        handler.end_headers()
        handler.wfile.write(body)

    return reply


def by_command(handler: BaseHTTPRequestHandler, asked: bytes) -> None:
    sends(subprocess.run([sys.executable, BALL], input=asked, capture_output=True).stdout)(
        handler, asked
    )


@pytest.mark.skipif(not gl_available()[0], reason="no OpenGL")
def test_a_command_and_a_server_find_a_ball_without_tags(tmp_path: Path) -> None:
    pytest.importorskip("cv2")
    world, command = tmp_path / "world.xml", f"{shlex.quote(sys.executable)} {BALL}"
    world.write_text(XML.format(x=0.56, y=0.05))
    asked: list[dict[str, Any]] = []

    def kept(handler: BaseHTTPRequestHandler, document: bytes) -> None:
        asked.append(json.loads(document))
        by_command(handler, document)

    with server(kept) as url:
        looks = [
            pp.see(SCENE, "world:over", world=world, pose_estimator=how) for how in (command, url)
        ]
    for seen in looks:
        off = seen.poses["ball"].position - [0.56, 0.05, 0.43]
        spread = seen.covariances["ball"][:3, :3]
        assert off @ np.linalg.solve(spread, off) < 14  # chi-squared of 3, 99.7 %
        assert np.linalg.norm(off) < 0.01
        assert seen.unseen == ("block",)
    # The ball is red, and its nearest point is a radius nearer than its middle.
    image, depth = (
        np.asarray(Image.open(io.BytesIO(base64.b64decode(asked[0][key])))).astype(int)
        for key in ("image", "depth")
    )
    red = image[..., 0] > 2 * image[..., 1] + 20
    back = np.array([0.0, -0.6, 0.8])  # the camera's z, away from the view
    away = (np.array([0.5, -0.4, 0.9]) - [0.56, 0.05, 0.43]) @ back
    assert np.percentile(depth[red], 5) == pytest.approx(1e3 * (away - 0.03), abs=4)


def drawn(random: np.random.Generator, tag: bool, wrong: float = 0.0) -> np.ndarray:
    """Deviations of a fit to an estimate, and to a tag, drawn as the fit takes them to be; in a unit ball
    if it is as sure as it says."""
    body = '<site name="tag_3" pos="0 0 .02" size=".02"/></body></worldbody>'
    scene = parse_scene(XML.format(x=0.5, y=0).replace("</body>\n</worldbody>", body))
    things, tags = things_of(scene), tags_of(scene)
    stands = Pose.of((0.5, -0.3, 1.0), (np.cos(0.2), np.sin(0.2), 0, 0))
    spread = np.diag([0.002**2] * 3 + [0.003**2] * 3)
    camera = move_pose(stands @ FACING, np.sqrt(np.diag(spread)) * random.standard_normal(6))
    scatter = np.array([0, 0, 0.001, np.radians(0.5), np.radians(0.5), 0])
    truth = move_pose(things["block"].pose_world, scatter * random.standard_normal(6))
    covariance = np.diag([0.004, 0.004, 0.02, 0.05, 0.05, 0.05]) ** 2
    step = np.linalg.cholesky(covariance) @ random.standard_normal(6)
    told = move_pose(camera.inverse() @ truth, step + wrong * np.eye(6)[0])
    seen = {}
    if tag:
        place = truth @ things["block"].pose_world.inverse() @ tags[3].pose_world
        off = place.rotation[:, :2] @ (3e-4 * random.standard_normal(2))
        points = (corners(tags[3].half, place) + off - camera.position) @ camera.rotation
        zoom = float(np.exp(LENS.focal_std * random.standard_normal()))
        seen[3] = LENS.project(points, zoom) + 0.3 * random.standard_normal((4, 2))
    estimates = {"block": Estimated(told, covariance)}
    found = solve(Problem(LENS, seen, tags, things, Mount(stands, spread), estimates))
    assert found.outliers.estimates == (("block",) if wrong else ())
    off = pose_difference(found.poses["block"], truth)
    return np.asarray(np.linalg.solve(np.linalg.cholesky(found.covariances["block"]), off))


@pytest.mark.parametrize("tag", [False, True])
def test_errors_are_as_large_as_the_covariance_says(tag: bool) -> None:
    pytest.importorskip("cv2")
    random = np.random.default_rng(5)
    z = np.array([drawn(random, tag) for _ in range(12)])
    assert 0.7 < np.sqrt(np.mean(z**2)) < 1.4


def test_an_estimate_that_its_tag_contradicts_is_not_used() -> None:
    pytest.importorskip("cv2")
    assert np.abs(drawn(np.random.default_rng(1), True, wrong=0.1)).max() < 4


def test_a_mesh_is_the_object_in_its_own_frame() -> None:
    rows = [line.split() for line in mesh_of(SCENE, "block").splitlines()]
    points = np.array([row[1:] for row in rows if row[0] == "v"], dtype=float)
    faces = np.array([row[1:] for row in rows if row[0] == "f"], dtype=int) - 1
    assert np.abs(points).max(axis=0) == pytest.approx([0.02, 0.03, 0.02])
    a, b, c = np.moveaxis(points[faces], 1, 0)
    volume = np.einsum("ij,ij->", a, np.cross(b, c)) / 6  # positive: from outside
    assert volume == pytest.approx(8 * 0.02 * 0.03 * 0.02)
    content = json.loads(request(SCENE, np.zeros((720, 1280, 3), np.uint8), LENS))
    assert [one["name"] for one in content["objects"]] == ["ball", "block"]


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"pos": [0, 0, -1]}, "behind the camera"),
        ({"pos": [0, 0, float("nan")]}, "finite"),
        ({"pos": [0, 0]}, "pos"),
        ({"quat": [0, 0, 0, 0]}, "no rotation"),
        ({"covariance": np.diag([1, 1, 1, 1, 1, -1]).tolist()}, "not a covariance"),
        ({"covariance": np.triu(np.ones((6, 6))).tolist()}, "not a covariance"),
        ({"covariance": np.zeros((6, 6)).tolist()}, "standard deviation below"),
    ],
)
def test_a_pose_that_cannot_be_is_one_clear_error(changed: dict[str, Any], words: str) -> None:
    answer = json.dumps({"objects": {"ball": POSE | changed}}).encode()
    with pytest.raises(InputError, match=f"pose estimator's answer.*{words}"):
        parse_answer(answer, SCENE.objects)


@pytest.mark.parametrize("answer", [b"", b"{", b"[" * 100_000, b'{"objects": []}', b"\xff", b"{}"])
def test_an_invalid_answer_gets_one_clear_error(answer: bytes) -> None:
    with pytest.raises(InputError, match="pose estimator's answer"):
        parse_answer(answer, SCENE.objects)


def test_an_object_that_was_not_asked_for_is_named() -> None:
    with pytest.raises(InputError, match="'bal'; did you mean 'ball'"):
        parse_answer(json.dumps({"objects": {"bal": POSE}}).encode(), SCENE.objects)


@pytest.mark.parametrize(
    ("program", "words"),
    [
        ("raise SystemExit('no GPU')", "fails with status 1: no GPU"),
        ("import time; time.sleep(99)", "within 0.3 s"),
        ("import os, time; os.close(1); time.sleep(99)", "within 0.3 s"),
        ("while True: print('x' * 10000)", "more than"),
    ],
)
def test_a_command_that_fails_hangs_or_floods_is_ended(program: str, words: str) -> None:
    command = f"{shlex.quote(sys.executable)} -S -c {shlex.quote(program)}"
    began = time.monotonic()
    with pytest.raises(Unavailable, match=words):
        exchange.exchange_document(command, b"{}", 0.3 if "within" in words else 20)
    assert time.monotonic() - began < 50


def drips(handler: BaseHTTPRequestHandler, _: bytes) -> None:
    handler.send_response(200)
    handler.end_headers()
    for _ in range(2000):
        time.sleep(0.05)
        handler.wfile.write(b" ")


def stalls(handler: BaseHTTPRequestHandler, _: bytes) -> None:
    time.sleep(99)


@pytest.mark.parametrize(
    ("reply", "words"),
    [
        (sends(b"", 500), "HTTP status 500"),
        (sends(b"", 307), "HTTP status 307"),
        (sends(b"x" * (exchange.MAX_ANSWER + 1)), "more than"),
        (drips, "within 0.3 s"),
        (stalls, "within 0.3 s"),
    ],
)
def test_a_server_that_fails_stalls_or_floods_is_left(reply: Any, words: str) -> None:
    began = time.monotonic()
    with server(reply) as url, pytest.raises(Unavailable, match=words):
        exchange.exchange_document(url, b"{}", 0.3 if "within" in words else 20)
    assert time.monotonic() - began < 50


@pytest.mark.parametrize(
    ("source", "words"),
    [
        ("no-such-command", "No such file"),
        ("", "empty"),
        ("'", "no command"),
        ("http://user@host/", "without a user name"),
        ("http://:1/", "no URL"),
    ],
)
def test_a_source_that_is_none_is_one_clear_error(source: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        exchange.exchange_document(source, b"{}")
    with pytest.raises(Unavailable, match="refused"):
        exchange.exchange_document("http://127.0.0.1:9/", b"{}")
