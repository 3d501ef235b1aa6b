"""Scenes of runs by sight alone: their tags, and how far things stand off."""

from __future__ import annotations

import numpy as np
import pytest

from bench.sighted import SCENARIOS, SHIFT, SightedRun, Value, displaced, marked, summary
from palpate.perception.tags import tags_of
from palpate.scene.load import parse_scene
from palpate.studies.scenarios.catalogue import scenario


@pytest.mark.parametrize("name", SCENARIOS)
def test_every_object_and_its_table_has_tags_and_stands_elsewhere(name: str) -> None:
    settings = scenario(name).settings()
    assert settings.scene is not None
    text, folder = settings.scene.read_text(encoding="utf-8"), settings.scene.parent
    given = parse_scene(text, folder)
    shown = parse_scene(marked(text, given), folder)
    on = [tag.body for tag in tags_of(shown).values()]
    assert set(given.objects) <= set(on)
    assert len(on) == len(given.objects) + 3
    there = parse_scene(displaced(text, given, np.random.default_rng(0)), folder)
    for body, before in given.objects.items():
        way = there.body(body).pose_world.position - before.pose_world.position
        assert 0.0 < np.abs(way[:2]).max() <= SHIFT + 1e-6


def test_figures_count_what_holds() -> None:
    value = Value("mass", "identified", 0.3, 0.302, 0.001, 0.30, 0.304)
    missed = Value("mass", "identified", 0.3, 0.304, 0.001, 0.302, 0.306)
    rows = [
        SightedRun("hammer", "lab", 0, status="complete", force=20.0, seen=(1.0,), values=(value,)),
        SightedRun("hammer", "lab", 1, status="aborted", beyond=("65 N",), values=(missed,)),
        SightedRun("hammer", "lab", 2, error="not seen: hammer"),
    ]
    first, z, mass = summary(rows)
    assert first.startswith(
        "hammer: 3 runs, 1 complete, 1 aborted, 1 not begun; 1 beyond a limit; "
    )
    assert z == "z of poses seen: 1.00 over 1"
    assert mass == "mass: 2 values, 2 identified, 1 hold, z 3.16"
