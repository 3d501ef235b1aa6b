"""A run folder of the command line is read back."""

from __future__ import annotations

from pathlib import Path

import pytest

from palpate.runs import pipeline
from palpate.studies.scenarios.catalogue import scenario

pytestmark = pytest.mark.long


def test_a_scene_from_a_picture_is_read_back_as_corrected_by_contact(tmp_path: Path) -> None:
    settings = scenario("from_picture").settings(noise="none", out=tmp_path / "run", fast=True)
    run = pipeline.run(settings)
    again = pipeline.reopen(tmp_path / "run")
    assert run.seen is not None
    assert again.seen is not None
    assert again.seen.objects == run.seen.objects
    assert again.scene.text == run.scene.text
    assert again.status == run.status == "complete"
    assert again.twin.diff == run.twin.diff
