"""Exports in other simulators, as far as they are installed.

`PALPATE_READERS` names interpreters of further environments, separated like a path; without it only
the readers beside the tests are run.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest

from palpate.twin import export
from palpate.twin.export_check import (
    READERS,
    Reader,
    check_export,
    experiments_for,
    is_installed,
    judge,
)

SCENE = """<mujoco model="scene"><option timestep="0.002"/><worldbody>
  <geom name="floor" type="plane" size="2 2 .1"/>
  <body name="table" pos=".5 0 .2"><geom name="top" type="box" size=".4 .4 .2" friction=".8"/></body>
  <body name="mug" pos=".5 0 .45"><freejoint name="mug_free"/>
    <geom name="mug" type="cylinder" size=".04 .05" mass=".25" friction=".3" priority="1"/></body>
  <body name="door" pos="1.5 0 1">
    <joint name="hinge" axis="0 0 1" pos="0 .3 0" damping=".2" frictionloss=".83"/>
    <geom type="box" size=".01 .3 .4" mass="4"/></body>
</worldbody></mujoco>"""
PYTHONS = [sys.executable, *os.environ.get("PALPATE_READERS", "").split(os.pathsep)]
SURE = {"mass", "com", "inertia"}
"""Quantities that act in every reader, except those of MJCF by readers that drop bodies."""
ACTING = {
    ("mujoco", "mjcf"): SURE | {"pose", "slide", "press", "swing"},
    ("mujoco", "urdf"): SURE | {"pose", "swing"},
    ("mujoco-usd", "usd"): SURE | {"pose", "slide", "press", "swing"},
    ("mujoco-warp", "mjcf"): SURE | {"pose", "slide", "press", "swing"},
    ("newton", "usd"): SURE | {"pose", "swing"},
    ("newton", "urdf"): SURE | {"pose", "swing"},
    ("newton with remedy", "usd"): SURE | {"pose", "slide", "press", "swing"},
    ("newton with remedy", "mjcf"): SURE | {"pose", "slide", "press", "swing"},
    ("drake", "urdf"): SURE,
    ("drake with remedy", "urdf"): SURE | {"pose"},
    ("pinocchio", "urdf"): SURE | {"swing"},
    ("pybullet", "urdf"): SURE | {"pose", "slide"},
}
CASES = [(reader, chosen) for reader in READERS for chosen in reader.formats]


@pytest.mark.long
@pytest.mark.parametrize(("reader", "chosen"), CASES, ids=lambda case: getattr(case, "name", case))
def test_what_is_written_acts_where_it_is_read(
    reader: Reader, chosen: export.Format, tmp_path: Path
) -> None:
    found = next((each for each in PYTHONS if each and is_installed(reader, each)), None)
    expected = ACTING.get((reader.name, chosen))
    if found is None or expected is None:
        pytest.skip("not installed, or known to lose bodies")
    if chosen == "usd":
        pytest.importorskip("mujoco_usd_converter", reason="the extra has no wheel here")
    scratch, made = tmp_path / "scratch", tmp_path / "made"
    scratch.mkdir()
    made.mkdir()
    source = scratch / "scene.xml"
    source.write_text(SCENE)
    file, _ = export.WRITERS[chosen](source, made, {})
    findings = check_export(mujoco.MjModel.from_xml_path(str(source)), source, file, chosen, found)
    mine = [f for f in findings if f.reader.rpartition(" ")[0] == reader.name]
    assert {f.quantity for f in mine if f.verdict == "acts"} >= expected, mine


def test_experiments_move_free_bodies_and_joints_away_from_their_limits() -> None:
    text = SCENE.replace('frictionloss=".83"', 'frictionloss=".83" range="-90 5"')
    found = experiments_for(mujoco.MjModel.from_xml_string(text))
    assert found["slide"]["velocity"].keys() == {"mug"}
    assert found["swing"]["rate"] == {"hinge": -2.0}
    assert found["press"]["force"]["mug"] == pytest.approx([0.0, 0.0, -5 * 0.25 * 9.81])


def test_a_difference_names_the_worst_body_and_a_missing_one_is_lost() -> None:
    mine = {"mug": np.array([0.25]), "tin": np.array([1.0])}
    acts = judge("reader 1", "mass", mine, mine)
    assert (acts.verdict, acts.detail) == ("acts", "")
    off = judge("reader 1", "mass", mine, {"mug": np.array([0.25]), "tin": np.array([2.0])})
    assert (off.verdict, off.detail) == ("differs", "tin: 2 for 1 kg")
    # A simulation that explodes gives NaN, which is no agreement.
    wild = judge("reader 1", "mass", mine, {"mug": np.array([np.nan]), "tin": np.array([1.0])})
    assert wild.verdict == "differs"
    lost = judge("reader 1", "mass", mine, {"mug": np.array([0.25])})
    assert (lost.verdict, lost.detail) == ("lost", "of tin")
