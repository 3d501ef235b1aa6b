"""The live page, as a person sees it in headless Chromium."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest
from browser import needs_chromium, opened

import palpate as pp
from palpate.live.page import LivePage

SCENE = """<mujoco><worldbody><site name="robot_base"/>
  <body name="bench" pos="0.35 0 -0.03"><geom type="box" size=".6 .6 .03" friction="0.6"/></body>
  <body name="bottle" pos="0.50 0 0.08"><freejoint/>
    <geom type="cylinder" size=".03 .08" friction="0.6"/></body></worldbody></mujoco>"""


@needs_chromium
def test_a_run_is_watched_and_played_again(tmp_path: Path) -> None:
    with LivePage(port=0) as page, opened(page.url, tmp_path) as seen:
        seen.until(lambda: "waiting" in seen.text)
        run = (
            pp.load(SCENE)
            .plan("how heavy is the bottle?")
            .run(observer=page, progress=page.progress)
        )
        seen.until(lambda: "CloseGripper" in seen.text)
        page.finished(run)
        seen.until(lambda: "time / s" in seen.text)
        assert "bottle.mass" in seen.text
        assert "grasped at" in seen.text
        seen.click("Close")
        seen.until(lambda: page.closed)


@needs_chromium
@pytest.mark.parametrize(("button", "allowed"), [("Let it move", True), ("Do not", False)])
def test_a_person_at_the_page_lets_the_robot_move_or_not(
    tmp_path: Path, button: str, allowed: bool
) -> None:
    made = pp.load(SCENE).plan("how heavy is the bottle?").made
    answers: list[bool] = []
    with LivePage(port=0) as page, opened(page.url, tmp_path) as seen:
        asked = threading.Thread(target=lambda: answers.append(page.confirm(made)))
        asked.start()
        seen.click(button)
        asked.join()
        assert "MovePose(bottle_pose + z_offset)" in seen.text
    assert answers == [allowed]
