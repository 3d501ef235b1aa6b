"""Plans that break one rule of the check each, most of them as a model might, and a sentence that a
right plan for the same scene answers."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass

from workbench import BOTTLE, CRATE, KNOWN, MUG, bench, parallel, plan, sequence, weigh

from palpate.planning.plan import Node, plan_json
from palpate.scene.scene import Scene

Steps = Sequence[str | Node]

PLACES = """places:
  leaning: {pos: [0.50, 0.20, 0.30], euler: [2.6, 0, 0]}
  edge: {pos: [0.50, 0.597, 0.125], yaw: 0}
  above_edge: {pos: [0.50, 0.597, 0.265], yaw: 0}
  above_rim: {pos: [0.468, -0.25, 0.21], yaw: 1.5708}
"""
ALL = (BOTTLE, MUG, CRATE, KNOWN)
ASIDE = BOTTLE.replace("0.50 0.00", "0.45 0.25")
SMOOTH = BOTTLE.replace(' friction="0.6"', "")
WALL = '<body name="wall" pos="0.50 0.052 0.08"><freejoint/><geom type="box" size=".02 .02 .08" mass=".3"/></body>'
CRAMPED = "grasps: {bottle: {pos: [0, 0, 0.045], yaw: 0}}"
TOWER = (
    '<body name="tower" pos="0.50 0 0.08"><freejoint/><geom type="box" size=".06 .06 .08"/></body>'
)
ANVIL = '<body name="anvil" pos="0.50 0 0.03"><freejoint/><geom type="box" size=".05 .03 .03" mass="12"/></body>'
BAR = '<body name="bar" pos="0.50 0 0.02"><freejoint/><geom type="box" size=".18 .015 .02" mass="2.4"/></body>'
STACK = (
    '<body name="under" pos="0.50 0.20 0.04"><freejoint/><geom type="box" size=".10 .03 .04"/></body>'
    '<body name="over" pos="0.43 0.20 0.10"><freejoint/><geom type="box" size=".02 .02 .02"/></body>'
)
CRATE_ALONE = CRATE.replace('".06 .03 .03"', '".06 .03 .03" friction="0.5"')

BOTH = ("bottle.mass", "bench.height")
W = weigh("bottle")
"""0 home, 1 open, 2 above, 3 at, 4 close, 5 above, 6 log, 7 convert, 8 at, 9 open, 10 above, 11 home."""
ABOVE, AT = W[2], W[3]
PROBE = ["MovePose bench_approach", "MoveUntilContact -z", "MeasureGripperPose", "Pose2Height"]
AWAY = "MovePose bench_approach"
SLIDING = [*W[:7], AT, parallel("MovePose bottle_pose + x_offset", "MeasureForces"), *W[8:]]


@dataclass(frozen=True)
class Fault:
    """A plan, as the steps of its root, that breaks `rule`; what it promises, and of which scene."""

    name: str
    rule: str
    steps: Steps | None
    promises: tuple[str, ...] = ("bottle.mass",)
    bodies: tuple[str, ...] = ALL
    height: str = "-0.03"
    poses: str | None = PLACES
    request: str | None = "What does the bottle weigh?"
    explanation: str = "It is weighed."
    root: Node | None = None

    def scene(self) -> Scene:
        return bench(*self.bodies, height=self.height, poses=self.poses)

    def answer(self) -> str:
        """As a model would write it."""
        tree = self.root or (None if self.steps is None else sequence(*self.steps))
        document = plan_json(plan(tree, *self.promises))
        return json.dumps({**document, "explanation": self.explanation})


def without(*places: int, of: Steps = W) -> list[str | Node]:
    return [step for i, step in enumerate(of) if i not in places]


def instead(place: int, *steps: str | Node, of: Steps = W) -> list[str | Node]:
    return [*of[:place], *steps, *of[place + 1 :]]


def inserted(place: int, *steps: str | Node) -> list[str | Node]:
    return [*W[:place], *steps, *W[place:]]


def visited(name: str) -> list[str]:
    return weigh(name)[2:11]


def angles(*joints: float) -> Node:
    return Node("MoveJoints", (("joints", joints),))


def motion(type: str, **arguments: str) -> Node:
    return Node(type, tuple(arguments.items()))


PARAMETERS = [
    Fault("a word for a quantity", "unknown-parameter", W, ("bottle.weight",)),
    Fault("a thing misspelt", "unknown-parameter", W, ("botle.mass",)),
    Fault("the height of an object", "unmeasurable", W, ("bottle.mass", "bottle.height")),
    Fault("promised twice", "duplicate-parameter", W, ("bottle.mass", "bottle.mass")),
    Fault("a known mass", "known", inserted(2, *visited("can")), ("can.mass", "bottle.mass")),
    Fault("a known mass, unasked", "known", inserted(2, *visited("can"))),
    Fault("one too few", "requested", W, bodies=(BOTTLE, CRATE_ALONE), request=None),
    Fault(
        "one too many",
        "requested",
        W,
        ("bottle.mass", "bottle.position"),
        (BOTTLE,),
        request=None,
    ),
    Fault("a mass not measured", "undischarged", W, ("bottle.mass", "crate.mass")),
    Fault("a height not measured", "undischarged", W, BOTH, height="?"),
    Fault(
        "a friction not measured", "undischarged", weigh("crate"), ("crate.mass", "crate.friction")
    ),
    Fault("promised without a tree", "undischarged", None),
    Fault("logged in vain", "redundant", inserted(3, "MeasureForces")),
    Fault("weighed twice", "redundant", inserted(8, "MeasureForces", "Force2Mass")),
    Fault("another weighed, too", "redundant", inserted(2, *visited("crate"))),
    Fault(
        "a visit in vain",
        "untouched",
        inserted(2, *[s for s in visited("mug") if "2" not in s and "Forces" not in s]),
    ),
    Fault("without a word", "no-explanation", None, (), explanation=" "),
]
FORM = [
    Fault("a primitive misspelt", "unknown-primitive", instead(6, "MeasureForce")),
    Fault(
        "a word for a primitive",
        "unknown-primitive",
        instead(2, motion("MoveTo", pose="bottle_pose + z_offset")),
    ),
    Fault(
        "an argument by another name",
        "bad-argument",
        instead(2, motion("MovePose", goal="bottle_pose + z_offset")),
    ),
    Fault(
        "a composite with arguments",
        "bad-argument",
        None,
        root=Node("Sequence", (("memory", True),), sequence(*W).children),
    ),
    Fault(
        "below a leaf",
        "leaf-children",
        [*W[:4], Node("CloseGripper", (), sequence(ABOVE).children), *W[6:]],
    ),
    Fault("an empty sequence", "empty-composite", inserted(2, Node("Sequence"))),
    Fault("all at once", "one-owner", None, root=parallel(*W)),
    Fault("nothing logged", "buffer-unwritten", without(6)),
    Fault(
        "converted beside the log",
        "buffer-unwritten",
        [*W[:6], parallel("MeasureForces", "Force2Mass"), *W[8:]],
    ),
]
HAND = [
    Fault("never opened", "gripper-state", without(1)),
    Fault("closed on nothing", "gripper-state", without(3)),
    Fault("let go of in the air", "gripper-state", without(8)),
    Fault("closed beside a motion", "gripper-state", [*W[:3], parallel(AT, W[4]), *W[5:]]),
    Fault("let go of beside a motion", "gripper-state", [*W[:8], parallel(AT, W[9]), *W[10:]]),
    Fault(
        "beside its middle",
        "gripper-state",
        [*W[:2], f"{AT} + 0.9*y_offset + z_offset", f"{AT} + 0.9*y_offset", *W[4:]],
    ),
    Fault(
        "too wide",
        "too-wide",
        inserted(11, *visited("tower")),
        ("bottle.mass", "tower.mass"),
        (ASIDE, TOWER),
    ),
    Fault(
        "too heavy",
        "payload",
        inserted(11, *visited("anvil")),
        ("bottle.mass", "anvil.friction"),
        (ASIDE, ANVIL),
    ),
    Fault(
        "a heavy bar at its end",
        "twist",
        [
            *W[:2],
            "MovePose bar_pose + 1.5*x_offset + z_offset",
            "MovePose bar_pose + 1.5*x_offset",
            "CloseGripper",
            parallel("MovePose bar_pose + z_offset", "MeasureForces"),
            "Force2Momentum",
            *weigh("bar")[8:],
        ],
        ("bar.momentum",),
        (BAR,),
        request="What is the momentum of the bar?",
    ),
    Fault("still held", "gripper-at-end", [*W[:8], W[11]]),
    Fault("closed at the end", "gripper-at-end", inserted(11, "CloseGripper")),
    Fault(
        "folded at the end", "gripper-at-end", inserted(11, "MovePose bottle_top", "FoldFingers")
    ),
    Fault("weighed where it stands", "precondition", without(5)),
    Fault(
        "probed with a full hand",
        "precondition",
        inserted(8, *PROBE, AWAY),
        BOTH,
        height="?",
    ),
    Fault(
        "probed from too high",
        "precondition",
        inserted(11, f"{AWAY} + 3*z_offset", *PROBE[1:], AWAY),
        BOTH,
        height="?",
    ),
    Fault("probed from home", "precondition", inserted(2, *PROBE[1:], AWAY), BOTH, height="?"),
    Fault(
        "probed twice",
        "precondition",
        inserted(11, *PROBE[:2], *PROBE[1:], AWAY),
        BOTH,
        height="?",
    ),
]
MOTIONS = [
    Fault("a pose misspelt", "unknown-symbol", instead(2, "MovePose botle_pose + z_offset")),
    Fault("an offset misspelt", "unknown-symbol", instead(2, "MovePose bottle_pose + z_ofset")),
    Fault("a configuration misspelt", "unknown-symbol", instead(0, "MoveJoints home")),
    Fault("too high", "unreachable", instead(5, "MovePose bottle_pose + 12*z_offset")),
    Fault("angles beyond the limits", "unreachable", inserted(2, angles(9, 0, 0, 0, 0, 0, 0))),
    Fault("from nowhere", "unknown-start", W[1:]),
    Fault(
        "entered at a slant",
        "collision",
        instead(2, "MovePose bottle_pose + 10*y_offset + z_offset"),
    ),
    Fault("a neighbour", "blocked", W, bodies=(BOTTLE, WALL), poses=CRAMPED),
    Fault("through a neighbour", "blocked", inserted(8, "MovePose mug_pose + 0.1*z_offset")),
    Fault("into the table", "collision", inserted(11, AWAY, f"{AWAY} - 2*z_offset", AWAY)),
    Fault(
        "a finger on its top",
        "collision",
        inserted(
            2, f"{ABOVE} + 3.13*y_offset", f"{AT} + 3.13*y_offset", f"{ABOVE} + 3.13*y_offset"
        ),
    ),
    Fault("swung on the table", "collision", inserted(5, parallel("Swing", "MeasureForces"))),
    Fault(
        "angles through the table",
        "collision",
        inserted(2, angles(0.0, 1.0, 0.0, -1.6, 0.0, 2.6, 0.785)),
    ),
    Fault(
        "folded into itself",
        "self-collision",
        inserted(2, angles(0.0, -1.7, 0.0, -3.0, 0.0, 0.5, 0.785), W[0]),
    ),
    Fault(
        "over the edge",
        "unsupported",
        [*W[:8], "MovePose above_edge", "MovePose edge", W[9], "MovePose above_edge", W[11]],
    ),
    Fault("the lower one of a stack", "blocked", weigh("under"), ("under.mass",), (STACK,)),
    Fault("laid over", "tilted", inserted(8, "MovePose leaning")),
    Fault("a short slide", "short-slide", SLIDING, ("bottle.mass", "bottle.friction"), (SMOOTH,)),
    Fault(
        "left elsewhere",
        "not-restored",
        [*W[:8], "MovePose bottle_temporary", W[9], "MovePose bottle_temporary + z_offset", W[11]],
    ),
]

FAULTS = [*PARAMETERS, *FORM, *HAND, *MOTIONS]
