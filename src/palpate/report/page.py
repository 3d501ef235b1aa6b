"""The report: one self-contained HTML page, which loads nothing from the network."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from palpate.redaction import redact
from palpate.report.assets import picture_uri, plotly, policy, script, template, video_uri
from palpate.report.cards import FEW, cards, forest, in_words, parameter_groups
from palpate.report.changes import change, diff_lines
from palpate.report.data import ReportData
from palpate.report.held_out import predictions
from palpate.report.plots import FAILED, GROUPS, Figure, timeline
from palpate.report.proof import indifferent, lines
from palpate.report.tree import Branch, aftermath, branches, first_failure, primitive_groups
from palpate.report.windows import windows

VERDICTS = {
    "running": "Under way",
    "complete": "Complete",
    "rejected": "Not measured",
    "aborted": "Stopped safely",
    "failed": "Incomplete",
}

SAFE_PATH = re.compile(r"[\w.-]+(/[\w.-]+)*")
"""Link targets: files beside the page, nothing with a scheme."""

ADVICE = {
    "motion": "See what the hand met or what is in its way. Correct the position and size of that thing in the "
    "scene, or move it aside.",
    "gripper": "Compare the object's position, yaw and size in the scene with the real object: the fingers close "
    "where the scene has it. A `grasps` entry in poses.yaml chooses another place to grip it.",
    "sensing": "See that nothing but the plan's objects touches the arm or what it holds, and that the robot is "
    "still connected.",
    "conversion": "See that nothing but the plan's objects touched the arm or what it held: what was recorded "
    "does not suffice for a value.",
}
"""Advice after a failure, by the group of the primitive that failed."""


def write_report(path: Path, data: ReportData) -> None:
    """Write the page to `path`."""
    path.write_text(redact(render_report(data)), encoding="utf-8")


def render_report(data: ReportData) -> str:
    """The page's HTML."""
    made = cards(data.measured, data.trace)
    tree = branches(data.plan, data.trace)
    failure = first_failure(tree)
    nodes = data.plan.tree.walk() if data.plan.tree is not None else ()
    # Leaves of a controlled stop lie outside of the tree: their paths begin with another word.
    begun: int | None = None
    if data.status == "aborted" and data.trace is not None:
        begun = sum(leaf.node.startswith("tree") for leaf in data.trace.leaves)
    return template("palpate.report", "template.html").render(
        data=data,
        verdict=verdict_title(data),
        verdict_line=verdict_sentence(data),
        actions=sum(not node.children for _, node in nodes),
        begun=begun,
        cards=made,
        forest=forest(made),
        FEW=FEW,
        retraced=any(card.evidence or card.charts for card in made),
        captions=in_words(data.measured),
        parameters=parameter_groups(data.parameters, data.measured),
        tree=tree,
        failure=failure,
        steps=tuple(next_steps(data, failure)),
        aftermath=aftermath(data.plan, data.trace),
        predictions=predictions(data.held_out),
        tasks=lines(data.proof),
        indifferent=tuple(indifferent(data.proof)),
        diff=diff_lines(data.twin_diff),
        files=[name for name in data.files if SAFE_PATH.fullmatch(name) and ".." not in name],
        group_colours=GROUPS,
        failed=FAILED,
        policy=policy(),
        script=script(),
        **picture_uris(data),
        **timeline_figure(data),
    )


def verdict_title(data: ReportData) -> str:
    """The headline."""
    if data.status == "aborted" and data.held is not None and data.held.became != "put down":
        how = "still holds" if data.held.became == "held" else "lost"
        return f"Stopped: the hand {how} {data.held.name}"
    return VERDICTS[data.status]


def verdict_sentence(data: ReportData) -> str:
    """The run in one sentence."""
    if data.status == "rejected":
        return "The arm did not move."
    if data.plan.satisfied:
        return "Nothing is missing: the arm did not move."
    if data.status == "aborted":
        return data.stopped_by or "The robot stopped before the plan was finished."
    found = sum(m.estimate.identified for m in data.measured)
    wanted = max(len(data.plan.parameters), len(data.measured))
    unknowns = "unknown" if wanted == 1 else "unknowns"
    blind = [
        f"{m.estimate.parameter} along {' and '.join(m.estimate.doubtful_axes)}"
        for m in data.measured
        if m.estimate.identified and m.estimate.reason
    ]
    but = f", but for {', '.join(blind)}" if blind else ""
    elsewhere = [row.object for row in data.poses if row.contradiction]
    not_there = f"; {', '.join(elsewhere)} not where it was seen" if elsewhere else ""
    return f"{found} of {wanted} {unknowns} measured{but}{not_there}."


def picture_uris(data: ReportData) -> dict[str, Any]:
    changed = change(data.before, data.after)
    return {
        "workspace": picture_uri(data.workspace),
        "before": picture_uri(data.before),
        "after": picture_uri(data.after),
        "seen": picture_uri(data.seen),
        "changed": changed,
        "marked": picture_uri(changed.marked) if changed else None,
        "video": video_uri(data.video),
    }


def timeline_figure(data: ReportData) -> dict[str, Any]:
    """The timeline, and plotly.js to draw it, if anything was executed."""
    figure: Figure | None = None
    library = ""
    if data.trace is not None and len(data.trace.samples):
        named = windows(data.trace, [m.estimate for m in data.measured])
        figure = timeline(data.trace, named, primitive_groups())
        library, _ = plotly()  # 2 MB, only for pages that draw something
    return {"figure": figure, "plotly": library}


def next_steps(data: ReportData, failure: Branch | None) -> Iterator[str]:
    """Advice to the user, in order, after a run that stopped early."""
    if data.status != "aborted":
        return
    if data.held is not None:
        name = data.held.name
        advice = {
            "held": f"Support {name}, open the fingers, and put it back where the scene has it.",
            "lost": f"Find {name} and put it back where the scene has it.",
        }
        put_down = f"{name} was put down: see that it stands where the scene has it."
        yield advice.get(data.held.became, put_down)
    failed = failure is not None and failure.fate == "failure"
    if failure is not None and failed:
        yield ADVICE.get(failure.group, ADVICE["motion"])
    kept = [str(one.estimate.parameter) for one in data.measured if one.estimate.identified]
    if kept:
        yield f"Keep what was measured before the stop: {', '.join(kept)}."
    again = "Run the command again; it is at the end of this page, under “Reproduce”."
    if failed:
        again += (
            " With `--on-failure skip` it leaves out the object that fails and measures the rest; with "
            "`--on-failure replan` it tries again from where things stand."
        )
    yield again
