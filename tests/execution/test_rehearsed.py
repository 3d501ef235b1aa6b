"""A rehearsal kept in a run folder: for the same plan, scene and arm only, and never if tampered with."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from palpate.common.pose import Pose
from palpate.execution.foresight import Foresight
from palpate.execution.rehearsal import FILE, Rehearsal, keep_rehearsal, kept_rehearsal
from palpate.planning.plan import Node, Plan, dump_plan
from palpate.runs.callbacks import RunCallbacks
from palpate.runs.planning import rehearse
from palpate.runs.run import Run
from palpate.runs.settings import Settings
from palpate.scene.load import parse_scene
from palpate.scene.poses import Poses

TEXT = """<mujoco><worldbody>
  <geom name="floor" type="plane" size="3 3 .1" pos="0 0 -.5"/>
  <site name="robot_base" pos="0 0 0"/>
  <body name="table" pos=".5 0 -.02"><geom type="box" size=".28 .28 .02"/></body>
  <body name="can" pos=".5 .1 .06"><freejoint/>
    <geom type="cylinder" size=".03 .06" mass=".3"/></body>
</worldbody></mujoco>"""
SCENE = parse_scene(TEXT)
PLAN = Plan((), Node("Sequence", (), (Node("OpenGripper"),)), "")
SEEN = Rehearsal(
    4,
    12.5,
    3.25,
    None,
    draws=3,
    foresight=Foresight(
        {"tree.children[2]": {"can": Pose.of((0.0, 0.008, 0.0))}},
        {"tree.children[2]": 0.06},
        {"can": (2.5, 3.5)},
    ),
)


def kept(folder: Path) -> Path:
    keep_rehearsal(folder, PLAN, SCENE, SEEN)
    return folder


def test_a_rehearsal_is_read_back(tmp_path: Path) -> None:
    again = kept_rehearsal(kept(tmp_path), PLAN, parse_scene(TEXT))
    assert again == SEEN
    assert again is not None
    assert again.foresight.widths == SEEN.foresight.widths
    assert again.foresight.weights == SEEN.foresight.weights
    (shift,) = again.foresight.shifts["tree.children[2]"].values()
    assert shift.position == pytest.approx([0.0, 0.008, 0.0])


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('mass=".3"', 'mass=".31"'),
        (".5 .1 .06", ".5 .1 .061"),
        ('mass=".3"', 'mass=".3" friction=".4"'),
    ],
)
def test_another_scene_was_not_rehearsed(tmp_path: Path, old: str, new: str) -> None:
    assert kept_rehearsal(kept(tmp_path), PLAN, parse_scene(TEXT.replace(old, new))) is None


def test_a_plan_whose_names_mean_other_places_was_not_rehearsed(tmp_path: Path) -> None:
    for poses in (
        Poses(offsets={"aside": (0.05, 0.0, 0.0)}),
        Poses(offsets={"aside": (0.2, 0.0, 0.0)}),
    ):
        assert kept_rehearsal(kept(tmp_path), PLAN, parse_scene(TEXT, poses=poses)) is None


def test_another_arm_and_other_priors_were_not_rehearsed(tmp_path: Path) -> None:
    unknown = TEXT.replace('mass=".3"', 'mass="?"')
    open_scene = parse_scene(unknown)
    assert kept_rehearsal(kept(tmp_path), PLAN, replace(SCENE, arm=SCENE.arm.cautious())) is None
    keep_rehearsal(tmp_path, PLAN, open_scene, SEEN)
    assert kept_rehearsal(tmp_path, PLAN, parse_scene(unknown)) == SEEN
    resolved = open_scene.resolved
    wider = {name: replace(prior, std=(1.0,)) for name, prior in resolved.priors.items()}
    other = replace(open_scene, resolved=replace(resolved, priors=wider))
    assert kept_rehearsal(tmp_path, PLAN, other) is None


def test_another_plan_was_not_rehearsed(tmp_path: Path) -> None:
    other = replace(PLAN, tree=Node("Sequence", (), (Node("OpenGripper"), Node("OpenGripper"))))
    assert kept_rehearsal(kept(tmp_path), other, SCENE) is None


@pytest.mark.parametrize(
    ("section", "changes"),
    [
        ("", {"key": "0" * 64}),
        ("", {"more": 1}),
        ("rehearsal", {"robot_seconds": "NaN"}),
        ("rehearsal", {"robot_seconds": float("nan")}),
        ("rehearsal", {"more": 1}),
        ("foresight", {"more": 1}),
        ("foresight", {"widths": {"tree": float("inf")}}),
        ("foresight", {"shifts": {"tree": {"can": [0.5, 0, 0, 1, 0, 0, 0]}}}),
        ("foresight", {"shifts": {"tree": {"can": [0, 0, 0, 0, 0, 0, 0]}}}),
        ("foresight", {"shifts": {"tree": {"can": [0, 0, 0]}}}),
    ],
)
def test_a_file_that_was_tampered_with_counts_for_nothing(
    tmp_path: Path, section: str, changes: dict[str, object]
) -> None:
    file = kept(tmp_path) / FILE
    content = json.loads(file.read_text())
    sections = {"": content, **content, **content["rehearsal"]}
    sections[section] |= changes
    file.write_text(json.dumps(content))
    assert kept_rehearsal(tmp_path, PLAN, SCENE) is None
    file.write_text("[" * 100_000)
    assert kept_rehearsal(tmp_path, PLAN, SCENE) is None


def test_the_embedded_arm_takes_it_and_a_real_one_is_rehearsed_for(tmp_path: Path) -> None:
    (kept(tmp_path) / "plan.json").write_text(dump_plan(PLAN))
    told: list[str] = []
    settings = Settings(planner=f"replay:{tmp_path}")
    made = Run(settings, SCENE, PLAN, ())
    callbacks = RunCallbacks(progress=told.append)
    assert rehearse(made, callbacks).rehearsal == SEEN
    assert told[0].startswith("rehearsal of the run that the plan comes from: ")
    told.clear()
    real = replace(made, settings=replace(settings, robot="franky://nobody"))
    assert rehearse(real, callbacks).rehearsal != SEEN
    assert told[0] == "rehearsing in simulation"
