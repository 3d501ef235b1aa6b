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
    PROBE,
    READERS,
    Reader,
    add_probes,
    check_export,
    collect_quantities,
    experiments_for,
    is_installed,
    judge,
)
from palpate.twin.export_readers import bodies_of

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
def test_exported_files_act_in_their_readers(
    reader: Reader, chosen: export.Format, tmp_path: Path
) -> None:
    result = next((each for each in PYTHONS if each and is_installed(reader, each)), None)
    expected = ACTING.get((reader.name, chosen))
    if result is None or expected is None:
        pytest.skip("not installed, or known to lose bodies")
    if chosen == "usd":
        pytest.importorskip("mujoco_usd_converter", reason="the extra has no wheel here")
    scratch, outcome = tmp_path / "scratch", tmp_path / "made"
    scratch.mkdir()
    outcome.mkdir()
    source = scratch / "scene.xml"
    source.write_text(SCENE)
    file, _ = export.WRITERS[chosen](source, outcome, {})
    findings = check_export(mujoco.MjModel.from_xml_path(str(source)), source, file, chosen, result)
    items = [f for f in findings if f.reader.rpartition(" ")[0] == reader.name]
    assert {f.quantity for f in items if f.verdict == "acts"} >= expected, items


def test_experiments_move_free_bodies_and_joints_away_from_their_limits() -> None:
    text = SCENE.replace('frictionloss=".83"', 'frictionloss=".83" range="-90 5"')
    experiments = experiments_for(mujoco.MjModel.from_xml_string(text))
    assert experiments["slide"]["velocity"].keys() == {"mug"}
    assert experiments["swing"]["rate"] == {"hinge": -2.0}
    assert experiments["press"]["force"]["mug"] == pytest.approx([0.0, 0.0, -5 * 0.25 * 9.81])


def test_a_difference_names_the_worst_body_and_a_missing_one_is_lost() -> None:
    values = {"mug": np.array([0.25]), "tin": np.array([1.0])}
    acts = judge("reader 1", "mass", values, values)
    assert (acts.verdict, acts.detail) == ("acts", "")
    off = judge("reader 1", "mass", values, {"mug": np.array([0.25]), "tin": np.array([2.0])})
    assert (off.verdict, off.detail) == ("differs", "tin: 2 for 1 kg")
    # A simulation that explodes gives NaN, which is no agreement.
    wild = judge("reader 1", "mass", values, {"mug": np.array([np.nan]), "tin": np.array([1.0])})
    assert wild.verdict == "differs"
    lost = judge("reader 1", "mass", values, {"mug": np.array([0.25])})
    assert (lost.verdict, lost.detail) == ("lost", "of tin")


MERGED = """<mujoco><worldbody>
  <body name="base" pos="0 0 .5"><freejoint/>
    <body name="bowl" pos="0 .1 0"><geom type="box" size=".1 .05 .02" mass="2"/>
      <body name="rim" pos="0 0 .1"><geom type="sphere" size=".02" mass=".5"/></body></body></body>
</worldbody></mujoco>"""


def test_rigidly_connected_bodies_count_as_one_since_readers_merge_them() -> None:
    model = mujoco.MjModel.from_xml_string(MERGED)
    values = {"bodies": bodies_of(mujoco, model), "runs": {"rest": {"com": {}}}}
    whole = collect_quantities(model, values)
    assert whole["mass"] == {"base": pytest.approx(2.5)}
    assert whole["com"]["base"] == pytest.approx([0.0, 0.1, 0.52])
    # MuJoCo itself merges the bodies.
    spec = mujoco.MjSpec.from_string(MERGED)
    spec.compiler.fusestatic = True
    fused = spec.compile()
    assert fused.nbody == 2
    its = collect_quantities(model, {"bodies": bodies_of(mujoco, fused), "runs": values["runs"]})
    for quantity in SURE:
        assert its[quantity]["base"] == pytest.approx(whole[quantity]["base"])
    # The heaviest of them is pressed.
    assert experiments_for(model)["press"]["force"].keys() == {"bowl"}


MATS = """<mujoco><worldbody>
  <body name="open" pos="0 0 .1"><geom type="box" size=".2 .2 .1"/></body>
  <body name="covered" pos="1 0 .1"><geom type="box" size=".1 .1 .1"/></body>
  <body name="lid" pos="1 0 .3"><geom type="box" size=".2 .2 .01"/></body>
  <body name="can" pos="0 0 .25"><freejoint/><geom type="box" size=".05 .05 .05"/></body>
</worldbody></mujoco>"""


def test_a_ball_lies_on_each_surface_that_is_not_covered(tmp_path: Path) -> None:
    source = tmp_path / "scene.xml"
    source.write_text(MATS)
    model = mujoco.MjModel.from_xml_path(str(add_probes(source, ["open", "covered"])))
    names = [model.body(body).name for body in range(model.nbody)]
    assert [name for name in names if name.startswith(PROBE)] == [f"{PROBE}open"]
    ball = model.body(f"{PROBE}open").pos
    assert ball[2] == pytest.approx(0.21)
    # It is next to the can, and no experiment lets it roll.
    assert max(abs(ball[:2])) > 0.06
    experiments = experiments_for(model)
    assert experiments["slide"]["velocity"].keys() == {"can"}
    assert experiments["press"]["force"].keys() == {"can", f"{PROBE}open"}
