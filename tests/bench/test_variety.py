"""The generated scenes are valid MJCF with the gaps they are meant to have, and can be measured."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from bench.variety import SCENES, Variety, crowd, drawn, frustum
from palpate.common.parameter import Parameter
from palpate.runs import pipeline
from palpate.scene.load import load_scene
from palpate.studies.accuracy import run_seed


@pytest.mark.parametrize("variety", SCENES, ids=lambda v: v.name)
def test_scene_and_world_differ_by_the_gaps(variety: Variety, tmp_path: Path) -> None:
    settings = variety.write(tmp_path)
    assert settings.scene is not None
    assert settings.world is not None
    scene, world = load_scene(settings.scene), load_scene(settings.world)
    assert set(scene.missing) == set(variety.missing)
    assert world.missing == ()
    assert (
        set(scene.bodies)
        == set(world.bodies)
        == {"table", *(thing.name for thing in variety.things)}
    )
    for thing in variety.things:
        assert world.body(thing.name).known["mass"] == (thing.mass,)
        assert world.body(thing.name).bottom_z() == pytest.approx(variety.height, abs=1e-4)
    assert world.body("table").top_z() == pytest.approx(variety.height)


@pytest.mark.parametrize("variety", [*SCENES, *map(drawn, range(6))], ids=lambda v: v.name)
def test_every_scene_has_a_plan_that_passes_the_check(variety: Variety, tmp_path: Path) -> None:
    settings = variety.write(tmp_path)
    run = pipeline.plan(settings, pipeline.load(settings))
    assert run.findings == ()
    stated = {one for one in variety.asked if one.quantity == "friction"}
    assert set(run.plan.parameters) == {*variety.missing, *variety.asked} - stated
    assert run.plan.actions >= 6


def test_a_mesh_on_a_high_shelf_is_weighed(tmp_path: Path) -> None:
    variety = next(v for v in SCENES if v.name == "cup")
    run = run_seed(replace(variety.write(tmp_path), noise="none"), 0)
    assert run.status == "complete"
    (estimate,) = run.estimates
    assert estimate.value == pytest.approx(0.21, abs=0.002)


def test_a_frustum_is_closed() -> None:
    lines = frustum(0.02, 0.03, 0.05).splitlines()
    faces = [list(map(int, line.split()[1:])) for line in lines if line.startswith("f")]
    edges = [(a, b) for face in faces for a, b in zip(face, [*face[1:], face[0]], strict=True)]
    assert len(edges) == len(set(edges))
    assert {(b, a) for a, b in edges} == set(edges), (
        "every edge has its neighbour, the other way round"
    )


@pytest.mark.parametrize("count", [1, 15])
def test_a_crowd_is_all_unweighed(tmp_path: Path, count: int) -> None:
    scene = load_scene(crowd(tmp_path, count))
    assert scene.missing == tuple(Parameter(f"box_{i + 1}", "mass") for i in range(count))


@pytest.mark.long
@pytest.mark.parametrize(("number", "seed"), [(9106, 306), (9117, 317)])
def test_the_grasps_of_a_round_object_agree_on_its_centre(
    number: int, seed: int, tmp_path: Path
) -> None:
    """Its grasps are 5 mm apart, which is also the tolerance of its place."""
    settings = replace(drawn(number).write(tmp_path), noise="lab", seed=seed)
    run = pipeline.measure(pipeline.plan(settings, pipeline.load(settings)))
    assert run.execution is not None
    assert run.execution.stopped_by is None
    centres = [one for one in run.estimates if one.parameter.quantity == "com"]
    assert centres
    for one in centres:
        assert [test.passed for test in one.tests if test.name == "grasps agree"] == [True]
        (x, y, _), intervals = run.truth[one.parameter], one.intervals
        assert intervals[0][0] <= x <= intervals[0][1]
        assert intervals[1][0] <= y <= intervals[1][1]
