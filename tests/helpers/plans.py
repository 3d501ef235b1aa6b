"""A small scene, a right plan for it, and plans that go wrong in one way each, as models write
them."""

from __future__ import annotations

import json
from copy import deepcopy
from typing import Any

SCENE = """<mujoco><worldbody>
  <site name="robot_base"/>
  <body name="shelf" pos="0.5 0 0.10"><geom type="box" size=".4 .6 .02" friction="0.6 0.005 0.0001"/></body>
  <body name="cup" pos="0.5 0.2 0.17"><freejoint/>
    <geom type="cylinder" size=".03 .05" friction="0.6 0.005 0.0001"/></body>
  <body name="brick" pos="0.5 -0.2 0.15"><freejoint/>
    <geom type="box" size=".03 .05 .03" mass="0.4" friction="0.6 0.005 0.0001"/></body>
</worldbody></mujoco>"""

REQUEST = "What does the cup weigh?"


def move(pose: str) -> dict[str, Any]:
    return {"type": "MovePose", "pose": pose}


def sequence(*children: Any) -> dict[str, Any]:
    return {"type": "Sequence", "children": list(children)}


HOME = {"type": "MoveJoints", "joints": "home_config"}
OPEN, CLOSE = {"type": "OpenGripper"}, {"type": "CloseGripper"}
FORCES, MASS = {"type": "MeasureForces"}, {"type": "Force2Mass"}


def weighing(name: str = "cup") -> list[dict[str, Any]]:
    pose = f"{name}_pose"
    return [
        move(f"{pose} + z_offset"),
        move(pose),
        deepcopy(CLOSE),
        move(f"{pose} + z_offset"),
        sequence(FORCES, MASS),
        move(pose),
        deepcopy(OPEN),
        move(f"{pose} + z_offset"),
    ]


def answer(
    *steps: Any,
    parameters: tuple[str, ...] = ("cup.mass",),
    explanation: str = "The cup is weighed.",
) -> str:
    promised = [dict(zip(("object", "quantity"), p.split("."), strict=True)) for p in parameters]
    return json.dumps(
        {
            "parameters": promised,
            "explanation": explanation,
            "tree": sequence(HOME, OPEN, *steps, HOME),
        }
    )


GOOD = answer(*weighing())


def _without_release() -> str:
    return answer(*(step for step in weighing() if step["type"] != "OpenGripper"))


def _unknown_primitive() -> str:
    return GOOD.replace('"Force2Mass"', '"WeighObject"')


def _elsewhere() -> str:
    return answer(move("teapot_pose + z_offset"), *weighing("kettle"), parameters=("kettle.mass",))


BAD: dict[str, tuple[str, str]] = {
    "truncated": (GOOD[:-60], "breaks off"),
    "no json": ("I would lift the cup and weigh it.", "no JSON object"),
    "refusal": ("I'm sorry, but I can't help with controlling robots.", "no JSON object"),
    "empty": ("", "empty"),
    "unknown primitive": (_unknown_primitive(), "there is no 'WeighObject'"),
    "hallucinated object": (
        answer(*weighing("mug"), parameters=("cup.mass",)),
        "unknown pose 'mug_pose'",
    ),
    "unreachable pose": (
        answer(move("cup_pose + 40*z_offset"), *weighing()),
        "out of the arm's reach",
    ),
    "missing release": (_without_release(), "still in the gripper"),
    "known re-measured": (
        answer(*weighing(), *weighing("brick"), parameters=("cup.mass", "brick.mass")),
        "brick.mass is stated",
    ),
    "two motions in a Parallel": (
        answer(
            {"type": "Parallel", "children": [sequence(*weighing()), sequence(*weighing("brick"))]}
        ),
        "would move the arm at once",
    ),
    "empty tree": (
        json.dumps(
            {
                "parameters": [{"object": "cup", "quantity": "mass"}],
                "explanation": "e",
                "tree": {"type": "Sequence", "children": []},
            }
        ),
        "empty Sequence",
    ),
    "another scene": (_elsewhere(), "the scene has no 'kettle'"),
    "null without a word": (
        '{"parameters": [], "explanation": " ", "tree": null}',
        "explain in 'explanation'",
    ),
    "promises without a tree": (
        '{"parameters": [{"object": "cup", "quantity": "mass"}], "explanation": "no", "tree": null}',
        "the plan has the parameters",
    ),
    "nested too deep": (
        '{"tree": '
        + '{"type": "Sequence", "children": [' * 500
        + "]}" * 500
        + ', "parameters": []}',
        "nested deeper",
    ),
    "not a number": (GOOD.replace('"home_config"', "[0, NaN, 0, 0, 0, 0, 0]", 1), "NaN"),
}
"""An answer that is wrong in one way, and words of the finding it must lead to."""
