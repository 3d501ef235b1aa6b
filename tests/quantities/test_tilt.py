"""Tilt: three touches of a table show how it rises, and a plan for it makes them."""

import numpy as np
import pytest

from palpate.parameter import Parameter
from palpate.planning.symbolic.planner import SymbolicPlanner
from palpate.quantities.shape.tilt import estimate_tilt
from palpate.scene.load import parse_scene

TILT = Parameter("table", "tilt")
TABLE = 0.2653
CORNERS = ((0.45, -0.05), (0.55, -0.05), (0.45, 0.05))
D = """<mujoco><worldbody>
  <site name="robot_base"/>
  <body name="table" pos="0.5 0 ?"><geom type="box" size=".4 .5 .02"/></body>
  <body name="can" pos="0.5 -0.15 0.05"><freejoint/><geom type="cylinder" size=".03 .05"/></body>
</worldbody></mujoco>"""


def touched(bench, noise, spots, slope, seed=0):
    """One touch a spot of a table that rises by `slope` along x and y."""
    b = bench(noise, seed)
    for x, y in spots:
        top = TABLE + slope[0] * (x - 0.5) + slope[1] * y
        b.go("table_approach", (x, y, 0.32))
        b.descend(lambda z, top=top: max(0.0, top - z) * 4e4, "table")
    return estimate_tilt(b.trace(), TILT, None)


@pytest.mark.parametrize("slope", [(0.0, 0.0), (0.01, 0.0), (-0.02, 0.015)])
@pytest.mark.parametrize("noise", ["none", "lab", "datasheet"])
def test_three_touches_tell_how_a_table_rises(bench, noises, noise, slope):
    found = touched(bench, noises[noise], CORNERS, slope)
    assert found.verdict == "identified"
    assert found.values == pytest.approx(slope, abs=1e-3)
    assert np.abs(found.z_score(slope)).max() < 3.0
    assert found.parts["angle"].value == pytest.approx(np.hypot(*slope), abs=1.5e-3)


@pytest.mark.parametrize("spots", [CORNERS[:2], ((0.45, 0.0), (0.5, 0.0), (0.55, 0.0))])
def test_touches_in_line_tell_none(bench, noises, spots):
    found = touched(bench, noises["lab"], spots, (0.01, 0.0))
    assert found.verdict == "not identified"
    assert "not in line" in found.method


def test_a_plan_touches_three_spots():
    scene = parse_scene(D)
    plan = SymbolicPlanner().plan("how much is the table tilted?", scene)
    assert plan.parameters == (TILT,)
    kinds = [node.type for _, node in plan.tree.walk()]
    assert kinds.count("MoveUntilContact") == kinds.count("MeasureGripperPose") == 3


def test_a_height_alone_takes_one_touch():
    plan = SymbolicPlanner().plan("how high is the table?", parse_scene(D))
    kinds = [node.type for _, node in plan.tree.walk()]
    assert kinds.count("MoveUntilContact") == 1
