"""The live page, as a person sees it in headless Chromium."""

from __future__ import annotations

import threading
from dataclasses import replace
from pathlib import Path

import pytest
from browser import needs_chromium, opened

import palpate as pp
import palpate.runs.report.live_page as page_module
from palpate.runs.report.live_page import LivePage

pytestmark = pytest.mark.long

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
        page.offer_playback(run)
        seen.until(lambda: "time / s" in seen.text)
        assert "bottle.mass" in seen.text
        assert "grasped at" in seen.text
        seen.click("Play")
        seen.until(lambda: "▶" in seen.text)
        seen.click("Pause")
        seen.click("Close")
        seen.until(lambda: page.closed)


@needs_chromium
@pytest.mark.parametrize(("button", "allowed"), [("Let it move", True), ("Do not", False)])
def test_a_person_at_the_page_lets_the_robot_move_or_not(
    tmp_path: Path, button: str, allowed: bool
) -> None:
    result = pp.load(SCENE).plan("how heavy is the bottle?").run_so_far
    answers: list[bool] = []
    with LivePage(port=0) as page, opened(page.url, tmp_path) as seen:
        page.show_plan(result)
        asked = threading.Thread(target=lambda: answers.append(page.confirm(result)))
        asked.start()
        seen.click(button)
        asked.join()
        assert "MovePose(bottle_pose + z_offset)" in seen.text
    assert answers == [allowed]


PRESSES = (
    "for (const b of parent.document.querySelectorAll('button'))"
    " if (b.innerText.trim() === 'Let it move') b.click()"
)
ATTACKS = [
    f'<iframe srcdoc="<script>{PRESSES}</script>"></iframe>',
    f'<img src=x onerror="{PRESSES}">',
    f"[press](javascript:{PRESSES}) <svg onload='{PRESSES}'></svg>",
    f'{{{PRESSES}}} ``` <details open ontoggle="{PRESSES}">',
]


@needs_chromium
def test_an_explanation_presses_no_button(tmp_path: Path) -> None:
    result = pp.load(SCENE).plan("how heavy is the bottle?").run_so_far
    attack = replace(
        result, plan=replace(result.plan, explanation="\n".join([*ATTACKS, "the end"]))
    )
    answers: list[bool] = []
    with LivePage(port=0) as page, opened(page.url, tmp_path) as seen:
        asked = threading.Thread(target=lambda: answers.append(page.confirm(attack)))
        asked.start()
        seen.until(lambda: "the end" in seen.text)
        assert "<iframe srcdoc=" in seen.text
        page.progress(ATTACKS[0])
        seen.until(lambda: "May the robot" not in seen.text and "<iframe srcdoc=" in seen.text)
        assert (
            seen.evaluate("document.querySelectorAll('iframe, img[src=x], svg[onload]').length")
            == 0
        )
        assert answers == []
        seen.click("Do not")
        asked.join()
    assert answers == [False]


def test_the_page_has_no_markdown() -> None:
    """viser's markdown renders HTML, whatever is escaped before."""
    assert "add_markdown" not in Path(page_module.__file__).read_text(encoding="utf-8")
