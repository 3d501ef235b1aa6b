"""Next steps after a run that stopped early."""

from __future__ import annotations

from collections.abc import Iterator

from palpate.execution.stop import Held
from palpate.report.data import ReportData
from palpate.report.tree import Branch

BY_GROUP = {
    "motion": "See what the hand met or what is in its way. Correct the position and size of that thing in the "
    "scene, or move it aside.",
    "gripper": "Compare the object's position, yaw and size in the scene with the real object: the fingers close "
    "where the scene has it. A `grasps` entry in poses.yaml chooses another place to grip it.",
    "sensing": "See that nothing but the plan's objects touches the arm or what it holds, and that the robot is "
    "still connected.",
    "conversion": "See that nothing but the plan's objects touched the arm or what it held: what was recorded "
    "does not suffice for a value.",
}
"""By the group of the primitive that failed."""


def next_steps(data: ReportData, failure: Branch | None) -> tuple[str, ...]:
    """Actions for the user, in order; none after a run that did not stop early."""
    return tuple(_steps(data, failure)) if data.status == "aborted" else ()


def _steps(data: ReportData, failure: Branch | None) -> Iterator[str]:
    if data.held is not None:
        yield _to_secure(data.held)
    failed = failure is not None and failure.fate == "failure"
    if failure is not None and failed:
        yield BY_GROUP.get(failure.group, BY_GROUP["motion"])
    kept = [str(one.estimate.parameter) for one in data.measured if one.estimate.identified]
    if kept:
        yield f"Keep what was measured before the stop: {', '.join(kept)}."
    again = "Run the command again; it stands at the end of this page, under “Do it again”."
    if failed:
        again += (
            " With `--on-failure skip` it leaves out the object that fails and measures the rest; with "
            "`--on-failure replan` it tries again from where things stand."
        )
    yield again


def _to_secure(held: Held) -> str:
    """Step to secure the object that was in the fingers."""
    if held.became == "held":
        return f"Support {held.name}, open the fingers, and put it back where the scene has it."
    if held.became == "lost":
        return f"Find {held.name} and put it back where the scene has it."
    return f"{held.name} was put down: see that it stands where the scene has it."
