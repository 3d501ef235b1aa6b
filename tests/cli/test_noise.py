"""`palpate noise LOG`."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml
from moving_arm import COULOMB, OFFSET, recorded

from palpate.robots.owner import load_description
from palpate.robots.simulated.noise.models import noise_models

from .conftest import Answer

Call = Callable[..., Answer]
ARM = load_description("fr3")


def log() -> None:
    run = recorded(ARM, 0.73, seconds=20.0)
    np.savez("log.npz", t=run.t, q=run.q, dq=run.dq, tau=run.tau)


def test_the_measured_noise_is_shown_with_the_models_and_written(
    palpate: Call, monkeypatch: pytest.MonkeyPatch
) -> None:
    log()
    monkeypatch.setenv("COLUMNS", "80")
    done = palpate("noise", "log.npz", "-o", "mine.yaml")
    assert done.status == 0, done.err
    lines = done.out.splitlines()
    assert lines[0] == "log.npz: 20 s of free motion"
    assert max(map(len, lines)) <= 80
    friction = lines.index("Coulomb friction, N m")
    labels = ["this arm", "± (95 %)", "measured", "hardware", "datasheet", "lab"]
    assert [line[:12].strip() for line in lines[friction + 1 : friction + 7]] == labels
    assert lines[-1] == "written to mine.yaml"
    written = noise_models().load("mine.yaml")
    assert written.name == "mine"
    assert written.friction.coulomb == pytest.approx(COULOMB, rel=0.3)
    assert not written.friction.spread.any
    offset = written.torque.offset.fixed
    assert offset is not None
    assert offset[[0, 2, 4, 6]] == pytest.approx(OFFSET[[0, 2, 4, 6]], abs=0.05)
    # A recording at 250 Hz without rests shows no white noise: the base model's stands.
    assert "white" not in yaml.safe_load(Path("mine.yaml").read_text())["torque"]
    assert written.torque.white == pytest.approx(noise_models().load("measured").torque.white)


def test_the_noise_of_an_arm_is_printed_as_json(palpate: Call) -> None:
    log()
    done = palpate("noise", "log.npz", "--json")
    assert done.status == 0, done.err
    document = json.loads(done.out)
    assert document["log"] == "log.npz"
    assert document["file"] is None
    assert document["figures"]["white"]["value"] == [None] * 7
    low, high = (document["figures"]["coulomb"][part][0] for part in ("low", "high"))
    assert low < document["figures"]["coulomb"]["value"][0] < high
    assert list(document["models"]) == ["measured", "hardware", "datasheet", "lab"]


def test_an_existing_file_is_not_overwritten(palpate: Call) -> None:
    log()
    Path("mine.yaml").write_text("name: kept")
    done = palpate("noise", "log.npz", "-o", "mine.yaml")
    assert done.status == 2
    assert "'mine.yaml' exists already" in done.err
    assert Path("mine.yaml").read_text() == "name: kept"
