"""Worlds that deceive: that they are what they say, and that answers are judged by what is true."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from bench.campaign.ledger import Row
from bench.deceptions.page import coverage, page
from bench.deceptions.study import (
    Case,
    cases,
    deceive,
    jumped,
    measured,
    own_noises,
)
from bench.deceptions.world import Deception, Jump, deception, deceptions, task
from palpate.common.errors import InputError
from palpate.robots.simulated.noise.models import noise_models
from palpate.trace.samples import Trace

TETHERED = "tether of 30 N/m"


def test_every_quantity_has_deceptive_worlds_of_every_kind() -> None:
    kinds = Counter(world.kind for world in deceptions().values())
    assert kinds["deceptive"] >= 30
    assert kinds["innocent"] >= 8
    assert all(world.why for world in deceptions().values() if world.kind == "not observable")
    bases = {world.base for world in deceptions().values() if world.kind == "deceptive"}
    assert bases >= {"one_missing_mass", "bottle_and_table", "friction", "hammer", "mat"}


@pytest.mark.parametrize("name", deceptions())
def test_every_edit_of_a_world_finds_its_place_and_the_world_compiles(name: str) -> None:
    _, _, text = task(deception(name))
    mujoco.MjModel.from_xml_string(text)


def test_a_cord_pulls_only_when_it_is_taut_and_a_magnet_only_within_its_reach() -> None:
    for name, near, far in ((TETHERED, 0.3, 3.9), ("magnet in the table", -1.8, 0.0)):
        _, _, text = task(deception(name))
        model = mujoco.MjModel.from_xml_string(text)
        data = mujoco.MjData(model)
        dof = int(model.body("green_bottle").dofadr[0])
        for lift, force in ((0.0, near), (0.12, far)):
            data.qpos[model.jnt_qposadr[model.body("green_bottle").jntadr[0]] + 2] = 0.08 + lift
            mujoco.mj_forward(model, data)
            pull = float((data.qfrc_passive + data.qfrc_actuator)[dof + 2])
            assert abs(pull) == pytest.approx(abs(force), abs=0.05)


def test_an_edit_that_finds_nothing_is_an_error() -> None:
    world = Deception(name="w", base="mat", story="", replace=(("nowhere", "else"),))
    with pytest.raises(ValueError, match="0 times"):
        task(world)


@pytest.mark.parametrize("name", own_noises())
def test_the_noise_files_are_noise_models(name: str) -> None:
    model = noise_models().load(str(own_noises()[name]))
    assert model.name == name.replace("_", " ")


def test_an_innocent_world_is_identified_and_its_trace_estimated_again(tmp_path: Path) -> None:
    (case,) = cases(["soft mat"], ["lab"], [1])
    (row,) = deceive([case], tmp_path / "out", traces=tmp_path / "traces")
    assert (row.outcome, row.crash, row.beyond) == ("identified", "", ())
    (score,) = row.figures["scores"]
    assert score["truth"] == (800.0,)
    assert score["covered"]
    assert "soft mat" in (tmp_path / "out" / "deceptions.html").read_text()
    again = deceive([case], tmp_path / "out")
    assert again[0].figures["scores"][0]["value"] == score["value"]

    (kept,) = (tmp_path / "traces").iterdir()
    before = kept.stat().st_mtime_ns
    run = measured(case, tmp_path / "traces")
    assert kept.stat().st_mtime_ns == before
    assert run.estimates[0].values[0] == score["value"]
    assert run.status == "complete"
    _jumps(run.trace)


def _jumps(trace: Trace) -> None:
    """The sensors' zero jumps in joints and wrench alike."""
    spoilt = jumped(trace, Jump(force=(0.0, 0.0, -1.5), at=0.5))
    t = trace.samples.t
    late = t > (t[0] + t[-1]) / 2
    change = spoilt.samples.wrench - trace.samples.wrench
    assert np.allclose(change[late, 2], -1.5)
    assert not change[~late].any()
    torque = (spoilt.samples.tau_ext - trace.samples.tau_ext)[late]
    assert np.abs(torque).max() > 0.3


def test_a_deceptive_world_is_refused() -> None:
    run = measured(Case("coin in the mat", "lab", 1))
    assert not run.estimates[0].identified


def test_intervals_are_counted_over_what_is_identified() -> None:
    scores = [_score(0.1), _score(0.5), _score(3.0, covered=False), _score(9.0, "contradicted")]
    judged = Row("deceptions", "a", "", "", "", figures={"kind": "innocent", "scores": scores})
    hidden = replace(judged, figures={"kind": "not observable", "scores": [_score(50.0)]})
    pooled, mass = coverage([judged, hidden])
    assert (pooled.quantity, pooled.values) == ("all", 3)
    assert mass == replace(pooled, quantity="mass")
    assert pooled.covered95 == pytest.approx(2 / 3)
    assert pooled.covered50 == pytest.approx(2 / 3)
    assert (pooled.far, pooled.worst) == (0, 3.0)
    assert "<table>" in page([judged, hidden])
    assert coverage([]) == []


def _score(z: float, verdict: str = "identified", covered: bool = True) -> dict[str, object]:
    return {"parameter": "cup.mass", "verdict": verdict, "z": z, "covered": covered}


def test_unknown_worlds_and_noises_are_bad_input() -> None:
    with pytest.raises(InputError, match="tether of 30"):
        cases(["a flood"], ["lab"], [0])
    with pytest.raises(InputError, match="hardware"):
        cases([TETHERED], ["storm"], [0])
