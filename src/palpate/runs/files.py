"""What a run leaves in its folder, but for the request, the pictures and the page."""

from __future__ import annotations

from pathlib import Path

from palpate.execution.btcpp import tree_xml
from palpate.runs.folder import write_json
from palpate.runs.result import has_scene_of_its_own, plan_text, result_json
from palpate.runs.run import TRACE, Run
from palpate.trace.mcap import write_mcap
from palpate.vocabulary.registry import vocabulary


def write_files(run: Run, scratch: Path, folder: Path) -> None:
    """Write plan, conversation, scene, tree, trace, twin and result into `scratch`, which will
    become `folder`."""
    (scratch / "plan.json").write_text(plan_text(run), encoding="utf-8")
    if run.conversation is not None:
        (scratch / "conversation.json").write_text(run.conversation.dump(), encoding="utf-8")
    if has_scene_of_its_own(run):
        (scratch / "scene.xml").write_text(run.scene.text, encoding="utf-8")
    if run.ready and run.plan.tree is not None:
        (scratch / "tree.xml").write_text(tree_xml(run.plan, vocabulary()), encoding="utf-8")
    if run.trace is not None:
        write_mcap(scratch / TRACE, run.trace)
    if run.twin is not None:
        run.twin.save(scratch / "twin.xml")
    write_json(scratch / "result.json", result_json(run, folder))
