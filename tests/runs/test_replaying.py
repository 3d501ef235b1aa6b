"""A replay in parts: they feel what the whole feels, and where none can begin, there are none."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

import palpate as pp
from palpate.runs import building as replaying
from palpate.runs.building import PlanPart, iter_rests, replay_of, replay_parts, touch_twin
from palpate.runs.run import Run
from palpate.trace.recording import Context, LeafRun
from palpate.twin.validate import Means, mean_recordings

TEXT = """<mujoco><worldbody>
  <site name="robot_base"/>
  <body name="desk" pos="0.4 0 {}"><geom type="box" size=".3 .3 .03"/></body>
  <body name="mug" pos="0.5 0.1 {}"><freejoint/><geom type="box" size=".03 .02 .05" mass="{}"/></body>
</worldbody></mujoco>"""
HEIGHT = 0.005  # m, of a desk believed at 0


@pytest.fixture(scope="module")
def run() -> Run:
    world, wanted = TEXT.format(-0.025, 0.055, 0.34), ["desk.height", "mug.mass"]
    return pp.run(TEXT.format("?", 0.05, "?"), measure=wanted, world=world, noise="none", fast=True)


def tried(
    run: Run, monkeypatch: pytest.MonkeyPatch, execute: Callable[..., Means]
) -> list[list[PlanPart]]:
    """The parts that `execute` is asked for."""
    asked: list[list[PlanPart]] = []

    def recorded(parts: list[PlanPart], world: pp.Scene) -> Means:
        asked.append(parts)
        return execute(parts, world)

    monkeypatch.setattr(replaying, "replay_parts", recorded)
    again = replay_of(run.plan, run.scene, run.trace, run.estimates)
    assert again is not None
    result = again(run.twin.scene)
    assert (
        not result or np.abs(np.subtract(result, mean_recordings(run.trace))).max() < 0.05
    )  # N, m
    return asked


def test_parts_feel_what_the_whole_feels(run, monkeypatch) -> None:
    (((first, second)),) = tried(run, monkeypatch, replay_parts)
    assert first.q is None
    assert second.q is not None
    # Each ends with what it records: nothing is set down, none goes home.
    trees = [part.plan.tree for part in (first, second)]
    assert [[node.type for _, node in tree.walk()][-1] for tree in trees if tree] == [
        "MeasureGripperPose",
        "MeasureForces",
    ]
    tops = [part.scene.surfaces["desk"].top_z() for part in (first, second)]
    assert tops == pytest.approx([0.0, HEIGHT], abs=5e-4)


def test_parts_that_depend_on_each_other_are_one(run, monkeypatch) -> None:
    several, (whole,) = tried(run, monkeypatch, lambda parts, world: [])
    assert len(several) == 2
    assert whole.plan == run.plan
    assert whole.q is None


def changed(run: Run, change: Callable[[Context], Context]) -> list[LeafRun]:
    """The run's leaves with their contexts changed."""
    leaves = run.trace.leaves
    return [replace(leaf, context=change(leaf.context)) for leaf in leaves if leaf.context]


def test_a_part_begins_in_free_air_with_everything_in_its_place(run) -> None:
    leaves = run.trace.leaves
    targets = [leaves[i].label for i in iter_rests(leaves)]
    assert targets[0].startswith("MoveUntilContact")
    assert "MovePose(mug_pose + z_offset)" in targets
    closed = [
        replace(leaf, primitive="CloseGripper") if leaf.primitive == "OpenGripper" else leaf
        for leaf in leaves
    ]
    assert not list(iter_rests(closed))
    assert not list(iter_rests(changed(run, lambda one: replace(one, activity="working"))))
    moved = changed(run, lambda one: replace(one, grasp="elsewhere"))
    put_down = [leaf.primitive for leaf in leaves].index("OpenGripper", 3)
    assert max(iter_rests(moved)) < put_down < max(iter_rests(leaves))


def test_a_twin_is_compared_up_to_the_first_repetition(run) -> None:
    trace, again = run.trace, "repeat[1].tree"
    end = float(trace.t[-1])
    leaf = replace(trace.leaves[-1], node=again, start=end, end=end + 1.0)
    recording = replace(trace.recordings[-1], node=again, start=end, end=end + 1.0)
    longer = replace(trace, leaves=(*trace.leaves, leaf), recordings=(*trace.recordings, recording))
    touched = touch_twin(replace(run, recorded=longer), run.scene)
    assert touched.finished is not None
    residual = touched.finished.validation.twin
    assert (residual.note, residual.force) == ("", pytest.approx(0.0, abs=0.05))
