"""Answers as models give them on a bad day, by kind: what is read as the plan that was meant, and what is
answered with a finding."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

from plans import FORCES, GOOD, HOME, MASS, OPEN, answer, move, sequence, weighing

KEY = "sk-proj-0123456789abcdefghij"
PLAN: dict[str, Any] = json.loads(GOOD)
PRETTY = json.dumps(PLAN, indent=2)
TREE = json.dumps(PLAN["tree"])


def plan(**fields: object) -> str:
    return json.dumps(PLAN | fields)


def steps(change: Callable[[list[Any]], object]) -> str:
    """The plan with its root's children changed in place."""
    document = json.loads(GOOD)
    change(document["tree"]["children"])
    return json.dumps(document)


def put(place: int, node: object) -> str:
    return steps(lambda children: children.__setitem__(place, node))


def added(place: int, *nodes: object) -> str:
    return steps(lambda children: children.__setitem__(slice(place, place), nodes))


def pose(text: object) -> str:
    return put(2, {"type": "MovePose", "pose": text})


def called(name: str, arguments: str) -> str:
    """A call of a tool, as chat models write it."""
    return json.dumps({"tool_calls": [{"function": {"name": name, "arguments": arguments}}]})


def deep(levels: int) -> dict[str, Any]:
    node: dict[str, Any] = dict(OPEN)
    for _ in range(levels):
        node = sequence(node)
    return node


MEANT: dict[str, str] = {
    "as it should be": GOOD,
    "pretty": PRETTY,
    "prose before and behind": f"Here is my plan:\n\n{PRETTY}\n\nIt takes about 30 s.",
    "a fence": f"```json\n{PRETTY}\n```",
    "a fence with three words": f"```json title=plan.json linenums\n{PRETTY}\n```",
    "tildes": f"~~~\n{PRETTY}\n~~~",
    "thoughts in tags": f"<think>Maybe {{brick}} first? No.</think>\n{GOOD}",
    "thoughts with a draft": f"<think>{plan(tree=None)}</think>\n{GOOD}",
    "two fences, the second is it": f"```json\n{plan(tree=None)}\n```\nor rather\n```json\n{PRETTY}\n```",
    "xml around": f"<answer>{GOOD}</answer>",
    "a trailing comma": PRETTY[:-2] + ",\n}",
    "python's null": GOOD.replace('"explanation"', '"scene": None, "explanation"'),
    "comments": PRETTY.replace('"tree":', '// what to do\n"tree":'),
    "a hash of fields": plan(id="x", confidence=0.3, steps=12),
    "german": plan(explanation="Die Tasse wird gehoben und gewogen."),
    "chinese": plan(explanation="把杯子拿起来称重。"),
    "right to left": plan(explanation="يتم رفع الكوب ووزنه."),
    "emoji": plan(explanation="🤖 lifts ☕ and weighs it 👍"),
    "a very long explanation": plan(explanation="It is weighed. " * 400),
    "code in words": plan(explanation="__import__('os').system('rm -rf /')"),
    "html in words": plan(explanation="<script>alert(1)</script>"),
    "a template in words": plan(explanation="{{7*7}} ${HOME} %s {0}"),
    "parameters as text": plan(parameters=["cup.mass"]),
    "fields in capitals": GOOD.replace('"parameters"', '"Parameters"').replace('"tree"', '"TREE"'),
    "a list for the tree": plan(tree=PLAN["tree"]["children"]),
    "names of nodes": put(1, {**OPEN, "name": "open the hand, please"}),
    "a comment field": plan(comment="I am sure", version=2),
    "a redundant home": added(2, HOME),
    "nested ten deep": added(2, deep(10)),
    "spaces in a pose": pose("  cup_pose   +  1.0 * z_offset "),
    "a factor of one": pose("cup_pose + 1*z_offset"),
    "a factor of 1e0": pose("cup_pose + 1e0*z_offset"),
    "an alias": pose("cup + z"),
    "non-breaking blanks": PRETTY.replace("  ", "\u00a0"),
    "a byte order mark": "\ufeff" + GOOD,
    "windows lines": PRETTY.replace("\n", "\r\n"),
    "a control character": GOOD.replace("weighed", "wei\x07ghed"),
    "words of several lines": GOOD.replace("is weighed", "is\nweighed\tby lifting"),
    "an answer twice": f"{GOOD}\n{GOOD}",
    "single quotes": str(PLAN),
    "single quotes and a quotation": str(PLAN | {"explanation": 'The "cup" is weighed.'}),
    "a tree as text": plan(tree=TREE),
    "an object for the parameters": plan(parameters={"cup": "mass"}),
    "one parameter": plan(parameters=PLAN["parameters"][0]),
    "a parameter with its unit": plan(parameters=["cup.mass kg"]),
    "a primitive with blanks": put(1, {"type": "Open Gripper"}),
    "a node called an action": put(1, {"action": "OpenGripper"}),
    "arguments in a box": put(
        2, {"type": "MovePose", "args": {"pose": "cup_pose + z_offset"}, "children": None}
    ),
    "nodes for children": GOOD.replace('"children"', '"nodes"'),
    "nodes without ids": json.dumps(
        {"parameters": PLAN["parameters"], "explanation": "e", "nodes": [PLAN["tree"]]}
    ),
    "a root in the tree": plan(tree={"root": PLAN["tree"]}),
    "a root for the tree": GOOD.replace('"tree"', '"root"'),
    "a plan in a box": json.dumps({"plan": PLAN}),
    "a root node": plan(tree={"type": "BehaviorTree", "children": [PLAN["tree"]]}),
    "an id for every step": put(1, {"id": 7, "type": "OpenGripper"}),
    "a tool call": called("plan", GOOD),
}
"""Kind to an answer that is read as a valid plan."""

FOUND: dict[str, tuple[str, str]] = {
    # Nothing to read.
    "empty": ("", "empty"),
    "blank": ("  \n\t ", "empty"),
    "a refusal": ("I'm sorry, but I can't help with that.", "no JSON object"),
    "a refusal in german": ("Dabei kann ich leider nicht helfen.", "no JSON object"),
    "a lecture": ("Robots can be dangerous. " * 200, "no JSON object"),
    "a question": ("Which cup do you mean?", "no JSON object"),
    "a number": ("42", "no JSON object"),
    "null": ("null", "no JSON object"),
    "a list alone": ("[1, 2, 3]", "no JSON object"),
    "yaml": ("tree:\n  type: Sequence\n  children: []", "no JSON object"),
    "xml": ("<BehaviorTree><Sequence/></BehaviorTree>", "no JSON object"),
    "python": ("def plan():\n    robot.move('cup_pose')\n", "no JSON object"),
    "pseudo code": ("MovePose(cup_pose) → CloseGripper() → MeasureForces()", "no JSON object"),
    "only a fence": ("```json\n```", "no JSON object"),
    "an empty object": ("{}", "tree"),
    "another object": ('{"mass": 0.25, "unit": "kg"}', "tree"),
    "a made up result": ('{"cup.mass": {"value": 0.254, "std": 0.001}}', "tree"),
    # Broken off, or nearly JSON.
    "cut in the middle": (GOOD[: len(GOOD) // 2], "breaks off"),
    "cut before the end": (GOOD[:-3], "breaks off"),
    "cut in a word": (GOOD[: GOOD.index("Force2") + 3], "breaks off"),
    "single quotes around one of their own": (
        str(PLAN).replace("The cup", "The cup's weight"),
        "double quotes",
    ),
    "typographic quotes": (GOOD.replace('"', "”"), "no JSON object"),
    "no quotes": (GOOD.replace('"', ""), "no JSON object"),
    "ellipses": (GOOD.replace('{"type": "OpenGripper"}', "...", 1), "is not valid"),
    "a missing comma": (GOOD.replace("}, {", "} {", 1), "delimiter"),
    "a missing bracket": (GOOD[::-1].replace("]", "", 1)[::-1], "delimiter"),
    "escaped twice": (json.dumps(GOOD), "no JSON object"),
    "two trees": (GOOD.replace('"tree"', '"tree": null, "tree"'), "twice"),
    "a broken tree as text": (plan(tree=TREE[:-3]), "JSON object"),
    "a call in text": ('plan(tree="Sequence", parameters=["cup.mass"])', "no JSON object"),
    "a function of one primitive": (
        '{"name": "MovePose", "arguments": {"pose": "cup_pose"}}',
        "tree",
    ),
    "surrogates": (plan(explanation="\ud83d"), "surrogate"),
    # Of the wrong type.
    "a number for the tree": (plan(tree=7), "must be a JSON object"),
    "a word for the tree": (plan(tree="Sequence"), "must be a JSON object"),
    "true for the tree": (plan(tree=True), "must be a JSON object"),
    "a word for the parameters": (plan(parameters="cup.mass"), "must be a list"),
    "numbers for parameters": (plan(parameters=[1, 2]), "parameters[0]"),
    "nested parameters": (plan(parameters=[["cup", "mass"]]), "parameters[0]"),
    "a parameter without quantity": (plan(parameters=[{"object": "cup"}]), "quantity"),
    "an object that is a list": (
        plan(parameters=[{"object": ["cup"], "quantity": "mass"}]),
        "object",
    ),
    "a number for the explanation": (plan(explanation=5), "explanation"),
    "a list for the explanation": (plan(explanation=["a", "b"]), "explanation"),
    "an unknown outcome": (plan(outcome="success"), "must be one of"),
    "an outcome against the tree": (plan(outcome="cannot"), "cannot"),
    "children that are words": (
        plan(tree={"type": "Sequence", "children": ["OpenGripper"]}),
        "children[0]",
    ),
    "children that are an object": (
        plan(tree={"type": "Sequence", "children": {"a": OPEN}}),
        "children",
    ),
    "a type that is a number": (put(1, {"type": 3}), "type"),
    "no type": (put(1, {"do": "OpenGripper"}), "type"),
    "two types": (put(1, {"action": "OpenGripper", "primitive": "CloseGripper"}), "type"),
    "a null step": (put(1, None), "children[1]"),
    "arguments in a box and beside it": (
        put(2, {"type": "MovePose", "pose": "cup_pose", "args": {"pose": "brick_pose"}}),
        "next to 'type'",
    ),
    "children by a name of their own": (
        plan(tree={"type": "Sequence", "body": [PLAN["tree"]]}),
        "did you mean 'children'",
    ),
    "a pose that is a number": (pose(3), "'pose'"),
    "a pose that is a list": (pose([0.5, 0.2, 0.3]), "'pose'"),
    "a pose that is an object": (pose({"x": 0.5, "y": 0.2, "z": 0.3}), ".pose is an object"),
    "a pose that is null": (pose(None), "'pose'"),
    "speed in words": (put(2, {**move("cup_pose + z_offset"), "speed": "slow"}), "'speed'"),
    "speed in mm/s": (put(2, {**move("cup_pose + z_offset"), "speed": 250}), "'speed'"),
    "a negative speed": (put(2, {**move("cup_pose + z_offset"), "speed": -0.1}), "'speed'"),
    "speed is not a number": (
        GOOD.replace('"cup_pose + z_offset"', '"cup_pose + z_offset", "speed": NaN', 1),
        "NaN",
    ),
    "speed is infinite": (
        GOOD.replace('"cup_pose + z_offset"', '"cup_pose + z_offset", "speed": 1e999', 1),
        "must be finite",
    ),
    "three joints": (put(0, {"type": "MoveJoints", "joints": [0, 0, 0]}), "7 angles"),
    "joints in degrees": (
        put(0, {"type": "MoveJoints", "joints": [0, -45, 0, -135, 0, 90, 45]}),
        "beyond the arm's limits",
    ),
    "huge joints": (
        put(0, {"type": "MoveJoints", "joints": [1e300] * 7}),
        "beyond the arm's limits",
    ),
    "nowhere, and the hand closes": (
        put(
            2,
            {
                "type": "Parallel",
                "children": [move("cup_pose + 900*x_offset"), {"type": "CloseGripper"}],
            },
        ),
        "out of the arm's reach",
    ),
    "nowhere, and a turn": (
        put(
            2,
            {
                "type": "Parallel",
                "children": [{"type": "MoveJoints", "joints": [1e300] * 7}, {"type": "Swing"}],
            },
        ),
        "into a Sequence",
    ),
    "joints that are null": (put(0, {"type": "MoveJoints", "joints": [None] * 7}), "joints"),
    # Things that are not there.
    "an object that is not there": (answer(*weighing("mug")), "did you mean"),
    "a surface that is not there": (
        answer(*weighing(), parameters=("cup.mass", "table.height")),
        "no 'table'",
    ),
    "a quantity that is not there": (
        answer(*weighing(), parameters=("cup.temperature",)),
        "not a quantity",
    ),
    "a quantity in german": (
        answer(*weighing(), parameters=("cup.Gewicht",)),
        "did you mean 'mass'",
    ),
    "a quantity of another kind": (answer(*weighing(), parameters=("shelf.mass",)), "remove it"),
    "the robot as an object": (answer(*weighing(), parameters=("robot.mass",)), "no 'robot'"),
    "a pose that is not there": (pose("handle_pose + z_offset"), "unknown pose"),
    "a pose of coordinates": (pose("[0.5, 0.2, 0.3]"), "unknown pose"),
    "a pose with arithmetic": (pose("cup_pose + z_offset / 2"), "cannot read"),
    "a pose with a call": (pose("offset(cup_pose, z=0.1)"), "unknown pose"),
    "a pose in mm": (pose("cup_pose + 120mm"), "unknown offset 'mm'"),
    "a pose with code": (pose("cup_pose; import os"), "unknown pose"),
    "a pose with a path": (pose("../../etc/passwd"), "unknown pose"),
    "a pose of emoji": (pose("☕ + ⬆"), "unknown pose"),
    "a very long pose": (pose("cup_pose" + " + z_offset" * 5000), "characters"),
    "an offset that is not there": (pose("cup_pose + height_offset"), "unknown offset"),
    "a factor that is huge": (pose("cup_pose + 1e308*z_offset"), "exceeds 1000"),
    "a factor that overflows": (pose("cup_pose + 1e999*z_offset"), "exceeds 1000"),
    "outside of the reach": (
        pose("cup_pose + 50*x_offset - 40*y_offset"),
        "out of the arm's reach",
    ),
    "below the floor": (pose("cup_pose - 10*z_offset"), "out of the arm's reach"),
    "a configuration that is not there": (
        put(0, {"type": "MoveJoints", "joints": "ready"}),
        "did you mean 'home_config'",
    ),
    "an axis that is not there": (added(2, {"type": "MoveUntilContact", "axis": "down"}), "'axis'"),
    "a primitive that is not there": (put(6, {"type": "WeighObject"}), "there is no 'WeighObject'"),
    "a decorator": (
        plan(tree={"type": "Retry", "num_attempts": 3, "children": [PLAN["tree"]]}),
        "there is no 'Retry'",
    ),
    "a fallback": (
        plan(tree={"type": "Fallback", "children": [PLAN["tree"]]}),
        "there is no 'Fallback'",
    ),
    "a primitive as a path": (put(1, {"type": "os.system"}), "there is no 'os.system'"),
    "a dunder for a primitive": (put(1, {"type": "__class__"}), "there is no '__class__'"),
    "a dunder for an argument": (put(1, {"type": "OpenGripper", "__class__": "x"}), "__class__"),
    # Trees that do not do.
    "an empty sequence": (plan(tree=sequence()), "empty Sequence"),
    "an empty parallel": (plan(tree={"type": "Parallel", "children": []}), "empty Parallel"),
    "a leaf for a tree": (plan(tree=dict(OPEN)), "MoveJoints to 'home_config' first"),
    "a tree 40 deep": (plan(tree=deep(40)), "nested deeper"),
    "a tree 5000 deep": ('{"parameters": [], "tree": ' + '{"children": [' * 5000, "nested deeper"),
    "6000 steps": (plan(tree=sequence(*[dict(OPEN)] * 6000)), "nodes"),
    "everything at once": (
        plan(tree={"type": "Parallel", "children": PLAN["tree"]["children"]}),
        "Sequence",
    ),
    "weighed on the shelf": (steps(lambda children: children.__delitem__(5)), "lifted"),
    "dropped": (steps(lambda children: children.__delitem__(7)), "would fall"),
    "never taken": (steps(lambda children: children.__delitem__(4)), "first lift"),
    "kept": (steps(lambda children: children.__delitem__(slice(7, 10))), "still in the gripper"),
    "measured by another": (answer(*weighing("brick")), "brick"),
    "nothing but home": (plan(tree=sequence(HOME)), "does not yield"),
    "a conversion alone": (plan(tree=sequence(HOME, MASS)), "MeasureForces"),
    "logged a hundred times": (added(6, *[dict(FORCES)] * 100), "remove it"),
    "no tree, a promise": (plan(tree=None), "has the parameters"),
    "no tree, no word": (
        plan(tree=None, parameters=[], explanation=""),
        "explain in 'explanation'",
    ),
    # Secrets.
    "a key repeated": (f"My key is {KEY}.", "no JSON object"),
    "a key for a type": (put(1, {"type": KEY}), "there is no"),
    "a key for a pose": (pose(KEY), "unknown pose"),
    "a key for an object": (answer(*weighing(), parameters=(f"{KEY}.mass",)), "the scene has no"),
}
"""Kind to an answer and words of the finding that it must lead to."""
