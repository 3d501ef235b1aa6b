"""The report: one HTML page that holds everything and asks nothing of the network."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from palpate.redaction import redact
from palpate.report.assets import picture_uri, plotly, policy, script, template, video_uri
from palpate.report.cards import cards, in_words
from palpate.report.data import ReportData
from palpate.report.evidence.windows import windows
from palpate.report.forest import FEW, forest
from palpate.report.plots import FAILED, GROUPS, Figure, timeline
from palpate.report.remedy import next_steps
from palpate.report.tables import parameter_groups
from palpate.report.tree import aftermath, branches, first_failure, primitive_groups
from palpate.report.twin.changes import change
from palpate.report.twin.diff import diff_lines
from palpate.report.twin.held_out import predictions

VERDICTS = {
    "running": "Under way",
    "complete": "Complete",
    "rejected": "Not measured",
    "aborted": "Stopped safely",
    "failed": "Incomplete",
}

SAFE_PATH = re.compile(r"[\w.-]+(/[\w.-]+)*")
"""Link targets: files beside the page, nothing with a scheme."""


def write_report(path: Path, data: ReportData) -> None:
    """Write the page to `path`."""
    path.write_text(redact(render_report(data)), encoding="utf-8")


def render_report(data: ReportData) -> str:
    """The page's HTML."""
    made = cards(data.measured, data.trace)
    tree = branches(data.plan, data.trace)
    failure = first_failure(tree)
    return template("palpate.report", "template.html").render(
        data=data,
        verdict=_verdict(data),
        verdict_line=_verdict_line(data),
        actions=_actions(data),
        begun=_begun(data),
        cards=made,
        forest=forest(made),
        FEW=FEW,
        retraced=any(card.evidence or card.charts for card in made),
        captions=in_words(data.measured),
        parameters=parameter_groups(data.parameters, data.measured),
        tree=tree,
        failure=failure,
        steps=next_steps(data, failure),
        aftermath=aftermath(data.plan, data.trace),
        predictions=predictions(data.held_out),
        diff=diff_lines(data.twin_diff),
        files=_linked(data.files),
        group_colours=GROUPS,
        failed=FAILED,
        policy=policy(),
        script=script(),
        **_pictures(data),
        **_figure(data),
    )


def _verdict(data: ReportData) -> str:
    """The headline."""
    if data.status == "aborted" and data.held is not None and data.held.became != "put down":
        how = "still holds" if data.held.became == "held" else "lost"
        return f"Stopped: the hand {how} {data.held.name}"
    return VERDICTS[data.status]


def _verdict_line(data: ReportData) -> str:
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
    return f"{found} of {wanted} {unknowns} measured."


def _actions(data: ReportData) -> int:
    """Leaves of the plan."""
    if data.plan.tree is None:
        return 0
    return sum(not node.children for _, node in data.plan.tree.walk())


def _begun(data: ReportData) -> int | None:
    """Number of actions that a stopped run began; None for other runs."""
    if data.status != "aborted" or data.trace is None:
        return None
    return sum(leaf.node.startswith("tree") for leaf in data.trace.leaves)


def _pictures(data: ReportData) -> dict[str, Any]:
    changed = change(data.before, data.after)
    return {
        "workspace": picture_uri(data.workspace),
        "before": picture_uri(data.before),
        "after": picture_uri(data.after),
        "changed": changed,
        "marked": picture_uri(changed.marked) if changed else None,
        "video": video_uri(data.video),
    }


def _figure(data: ReportData) -> dict[str, Any]:
    """The timeline and what draws it, where anything was executed."""
    figure: Figure | None = None
    library = ""
    if data.trace is not None and len(data.trace.samples):
        named = windows(data.trace, [m.estimate for m in data.measured])
        figure = timeline(data.trace, named, primitive_groups())
        library, _ = plotly()
    return {"figure": figure, "plotly": library}


def _linked(names: Sequence[str]) -> list[str]:
    return [name for name in names if SAFE_PATH.fullmatch(name) and ".." not in name]
