"""Plans written by hand to do harm, at least one against every rule of the check, and more against
none in particular.

Each is to be refused, or to be harmless when it is executed: the probe decides.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from bench.campaign.ledger import Ledger, Row, judged_run, within_time
from bench.faults.scenes import small_scene
from bench.harm.probe import probed_run
from palpate.parameter import Parameter
from palpate.planning.check.check import check
from palpate.planning.plan import Node, Plan

FILE = Path(__file__).with_suffix(".toml")
Step = str | tuple["Step", ...]
"""A leaf in a word or two, or a composite's name and its children."""

PLAIN = {
    "open": Node("OpenGripper"),
    "close": Node("CloseGripper"),
    "home": Node("MoveJoints", (("joints", "home_config"),)),
    "forces": Node("MeasureForces"),
    "pose": Node("MeasureGripperPose"),
    "mass": Node("Force2Mass"),
    "height": Node("Pose2Height"),
    "plan": Node("Pose2Plan"),
    "velocity": Node("Force2Velocity"),
}


@dataclass(frozen=True, slots=True)
class Nasty:
    """A plan written by hand.

    Attributes:
        intention: what it is to break, in a line.
        scene: one of `small_scene`'s.
        measures: the parameters that it promises.
        requested: what was asked for, if anything.
        explanation: of a plan without steps.
    """

    name: str
    intention: str
    scene: str
    steps: tuple[Step, ...] | None
    measures: tuple[str, ...] = ()
    requested: tuple[str, ...] | None = None
    explanation: str = "written by hand"

    @property
    def plan(self) -> Plan:
        tree = None if self.steps is None else Node("Sequence", (), _nodes(self.steps))
        return Plan(tuple(map(Parameter, self.measures)), tree, self.explanation)

    @property
    def asked(self) -> tuple[Parameter, ...] | None:
        """What was asked for, None for whatever the plan measures."""
        return None if self.requested is None else tuple(map(Parameter, self.requested))


def _nodes(steps: Sequence[Step]) -> tuple[Node, ...]:
    return tuple(_node(step) for step in steps)


def _node(step: Step) -> Node:
    if isinstance(step, tuple):
        kind, *children = step
        assert isinstance(kind, str)
        return Node(kind, (), _nodes(children))
    if step in PLAIN:
        return PLAIN[step]
    word, _, rest = step.partition(" ")
    if word == "probe":
        return Node("MoveUntilContact", (("axis", rest),))
    if word == "joints":
        return Node("MoveJoints", (("joints", tuple(map(float, rest.split()))),))
    if word == "raw":
        return Node(rest)
    return Node("MovePose", (("pose", step),))


START: tuple[Step, ...] = ("home", "open")


def _grasp(name: str) -> tuple[Step, ...]:
    return (*START, f"{name}_pose + z_offset", f"{name}_pose", "close")


def _leave(name: str) -> tuple[Step, ...]:
    return (f"{name}_pose", "open", f"{name}_pose + z_offset", "home")


def _weigh(name: str) -> tuple[Step, ...]:
    return (*_grasp(name), f"{name}_pose + z_offset", "forces", "mass", *_leave(name))


def _read() -> tuple[Nasty, ...]:
    document = tomllib.loads(FILE.read_text(encoding="utf-8"))
    return tuple(_nasty(**entry) for entry in document["plan"])


def _nasty(
    name: str,
    intention: str,
    scene: str,
    steps: Sequence[Any] | None = None,
    measures: Sequence[str] = (),
    requested: Sequence[str] | None = None,
    explanation: str = "written by hand",
) -> Nasty:
    tree = None if steps is None else _steps(steps)
    asked = None if requested is None else tuple(requested)
    return Nasty(name, intention, scene, tree, tuple(measures), asked, explanation)


def _steps(written: Sequence[Any]) -> tuple[Step, ...]:
    """The steps as they stand in the file, composites as lists and usual sequences in a word."""
    found: list[Step] = []
    for step in written:
        if isinstance(step, str):
            word, _, thing = step.partition(" ")
            usual = USUAL.get(word)
            found += usual(thing) if usual else (step,)
        else:
            found.append((step[0], *_steps(step[1:])))
    return tuple(found)


USUAL: dict[str, Callable[[str], tuple[Step, ...]]] = {
    "start": lambda _: START,
    "grasp": _grasp,
    "leave": _leave,
    "weigh": _weigh,
}
"""What a word stands for, where it is no leaf's."""
NASTY = _read()


def judged(case: Nasty, seed: int = 0) -> Row:
    """What becomes of a nasty plan: refused, or executed and judged."""
    blank = Row.named("nasty", case.name, case.intention)

    def work() -> Row:
        scene, plan = small_scene(case.scene), case.plan
        findings = check(plan, scene, requested=case.asked)
        if findings:
            said = tuple(f"{f.rule}: {f.message}"[:300] for f in findings)
            rules = sorted({f.rule for f in findings})
            return replace(blank, outcome="refused", said=said, figures={"rules": rules})
        if plan.tree is None:
            return replace(blank, outcome="nothing to do")
        return judged_run(blank, probed_run(plan, scene, None, "lab", seed))

    return within_time(work, blank)


def judge_nasty(folder: Path, workers: int, say: Callable[[str], None]) -> list[Row]:
    """Every nasty plan."""
    return Ledger(folder / "nasty.jsonl").complete(NASTY, judged, workers, say)
