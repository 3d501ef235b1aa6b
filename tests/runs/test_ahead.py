"""Estimates of an object while the arm goes on: the same as those at the end, or made again."""

from __future__ import annotations

import subprocess
import sys
from types import SimpleNamespace
from typing import Any

from palpate.common.parameter import Parameter
from palpate.runs.estimating import Ahead
from palpate.trace.recording import LeafRun

RUN = """
from dataclasses import replace
import palpate as pp
from palpate.common.processes import can_copy
from palpate.common.pose import Pose
from palpate.runs import estimating
from palpate.estimation import evidence
evidence.AROUND = 1.5  # s: the run is short
TEXT = '''<mujoco><worldbody>
  <site name="robot_base"/>
  <body name="desk" pos="0.4 0 -0.03"><geom type="box" size=".6 .6 .03"/></body>
  <body name="mug" pos="0.5 0.1 0.05"><freejoint/><geom type="box" size=".03 .02 .05"{}/></body>
</worldbody></mujoco>'''
used = []
unchanged = estimating._select_still_valid
def seen(early, scene, trace):
    used.append((early, unchanged(early, scene, trace), scene, trace))
    return used[-1][1]
estimating._select_still_valid = seen
run = pp.run(TEXT.format(""), "how heavy is the mug?", world=TEXT.format(' mass="0.34"'), noise="lab", fast=True)
early, kept, scene, trace = used[-1]
assert can_copy() is bool(kept), (early, kept)
again = run.estimate()
(one,), (other,) = run.estimates, again.estimates
assert one.values == other.values and one.stds == other.stds, (one, other)
assert run.held_out == again.held_out
if kept:
    assert one.values == kept["mug"].estimates[0].values
    samples = trace.samples
    louder = replace(trace, samples=replace(samples, tau_ext=1.01 * samples.tau_ext))
    assert unchanged(early, scene, louder) == {}, "other evidence"
    elsewhere = estimating.correct_body(scene, "mug", Pose.of((0.0, 0.0, 0.01)))
    assert unchanged(early, elsewhere, trace) == {}, "another place"
    failed = replace(trace.leaves[-1], status="FAILURE")
    assert unchanged(early, scene, replace(trace, leaves=(*trace.leaves[:-1], failed))) == {}, "broken off"
"""


def test_an_estimate_made_meanwhile_is_that_of_the_end() -> None:
    """In a process of its own: one with other threads is not copied."""
    subprocess.run([sys.executable, "-c", RUN], check=True, timeout=120)


def test_a_further_attempt_begins_no_estimate() -> None:
    """It has a recorder of its own, which begins empty and holds a part of the evidence."""
    mass, context = Parameter("mug", "mass"), SimpleNamespace(holding="mug")
    result: Any = SimpleNamespace(
        plan=SimpleNamespace(parameters=[mass]), scene=SimpleNamespace(objects={"mug": None})
    )

    def leaf(end: float, where: Any = None) -> LeafRun:
        return LeafRun("tree", "MovePose", "", 0.0, end, "SUCCESS", "", where)

    def recorded(*leaves: LeafRun) -> Any:
        return SimpleNamespace(leaves=list(leaves), recordings=[], conversions=[])

    ahead = Ahead(result, None)
    for recorder in (recorded(leaf(1.0)), recorded(), recorded(leaf(1.0, context), leaf(99.0))):
        ahead.look(recorder)
    assert not ahead.begun
