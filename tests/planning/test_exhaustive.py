"""The baseline measures everything, whatever is asked or known."""

from __future__ import annotations

from workbench import BOTTLE, KNOWN, MUG, actions, bench, parameters

from palpate.planning.check.check import check
from palpate.planning.exhaustive import ExhaustivePlanner
from palpate.planning.symbolic.planner import SymbolicPlanner


def test_every_surface_is_probed_and_every_object_weighed_and_slid():
    scene = bench(BOTTLE, MUG, KNOWN)
    plan = ExhaustivePlanner().plan("the mass of the bottle", scene)
    assert set(plan.parameters) == set(
        parameters(
            "bench.height",
            *(
                f"{name}.{quantity}"
                for name in ("bottle", "mug", "can")
                for quantity in ("mass", "friction")
            ),
        )
    )
    assert check(plan, scene, remeasure=True) == ()
    assert actions(plan.tree).count("MoveJoints home_config") == 2
    asked = SymbolicPlanner().plan("the mass of the bottle", scene)
    assert asked.actions == 12
    assert plan.actions >= 29
