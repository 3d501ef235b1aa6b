"""Files of a run in its folder, without request, pictures and page."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from palpate.files.plain_yaml import yaml_text
from palpate.runs.folder import replacing, write_json, write_text
from palpate.runs.reproduce import POSES
from palpate.runs.result import CYCLES, has_scene_of_its_own, plan_text, result_json
from palpate.runs.run import TRACE, Run
from palpate.runs.shown import shown
from palpate.trace.mcap import write_mcap
from palpate.vocabulary.registry import vocabulary


def write_files(run: Run, scratch: Path, folder: Path) -> None:
    """Write plan, conversation, scene, tree, trace, twin and result into `scratch`, which will
    become `folder`."""
    write_plan(run, scratch)
    write_trace(run, scratch)
    write_twin(run, scratch)
    write_json(scratch / "result.json", result_json(run, folder))


def write_plan(run: Run, folder: Path) -> None:
    """Write the files that exist before the execution: plan, conversation, tree, rehearsal, scene,
    poses that a camera saw."""
    write_text(folder / "plan.json", plan_text(run))
    if run.conversation is not None:
        write_text(folder / "conversation.json", run.conversation.dump())
    if run.ready and run.plan.tree is not None:
        from palpate.execution.btcpp import tree_xml  # loads py_trees

        write_text(folder / "tree.xml", tree_xml(run.plan, vocabulary()))
    if run.rehearsal is not None:
        from palpate.execution.rehearsed import keep_rehearsal  # loads the simulated arm

        keep_rehearsal(folder, run.plan, run.scene, run.rehearsal)
    _write_scene(run, folder)


def write_trace(run: Run, folder: Path) -> None:
    """Write the finished trace over the growing one, and the log of cycles before a stop."""
    if run.trace_if_any is not None:
        with replacing(folder / TRACE) as part:
            write_mcap(part, run.trace_if_any, shown(run))
    if run.black_box is not None:
        with replacing(folder / CYCLES) as part, part.open("wb") as file:
            np.savez(file, **dict[str, Any](run.black_box))


def write_twin(run: Run, folder: Path) -> None:
    """Write the twin with the files that it needs, and the scene as completed by contact."""
    if run.finished is not None:
        for name, text in run.finished.packed(folder).items():
            write_text(folder / name, text)
    _write_scene(run, folder)


def _write_scene(run: Run, folder: Path) -> None:
    if run.settings.camera is not None:
        kept = run.scene.resolved.poses.model_dump(mode="json", exclude_defaults=True)
        write_text(folder / POSES, yaml_text(kept))
    if has_scene_of_its_own(run):
        write_text(folder / "scene.xml", run.scene.text)
