"""What palpate says of how it read a scene."""

from __future__ import annotations

from palpate.scene.load import parse_scene
from palpate.scene.remarks import remarks

TABLE = '<body name="table" pos="0.5 0 0.2"><geom type="box" size="0.3 0.4 0.02"/></body>'
BALL = '<body name="ball" pos="0.5 0 0.25"><freejoint/><geom size=".03" mass="0.1" friction="1"/></body>'
ARM = """<body name="arm" pos="0 0.2 0"><geom size=".05"/><body name="link">
<joint name="turn"/><geom size=".05"/><camera name="wrist"/></body></body>"""


def read(inside: str, after: str = "") -> tuple[str, ...]:
    return remarks(parse_scene(f"<mujoco><worldbody>{inside}</worldbody>{after}</mujoco>"))


def test_a_scene_that_needs_no_words() -> None:
    unknown = BALL.replace('mass="0.1"', "")
    assert read(f'<site name="robot_base"/>{TABLE}{unknown}') == ()


def test_where_the_arm_is_taken_to_stand() -> None:
    (line,) = read(TABLE + BALL.replace('mass="0.1"', ""))
    assert '<site name="robot_base" pos="x y z"/>' in line


def test_what_went_with_the_robot() -> None:
    after = """<actuator><motor joint="turn"/></actuator><sensor><jointpos joint="turn"/></sensor>
    <keyframe><key qpos="1 0 0 0 0 0 0 0"/></keyframe>"""
    watcher = '<camera name="on" mode="targetbody" target="link"/>'
    lines = read(TABLE + BALL + ARM + watcher, after)
    assert lines[0].startswith("Robot left out: 'arm'; the Franka Research 3")
    assert "1 camera, 1 jointpos, 1 key, 1 keyframe, 1 motor" in lines[0]
    assert lines[1].startswith("Nothing is missing")


def test_what_is_neither() -> None:
    door = '<body name="door"><joint/><geom size=".1"/></body>'
    lines = read('<site name="robot_base"/>' + door)
    assert "'door'" in lines[0]
    assert lines[1:] == (
        "There is no object: no body has a free joint.",
        "There is no surface: nothing static has a name and a level top.",
    )
