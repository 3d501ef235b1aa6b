from __future__ import annotations

from palpate.execution.runner import run
from palpate.live.pace import RealTime
from palpate.planning.plan import Plan


def test_a_simulated_run_takes_as_long_as_a_real_one(node, scene, robot, words) -> None:
    plan = Plan((), node("Wait", seconds=0.3), "")
    pace = RealTime()
    for _ in range(2):  # the second run's clock begins anew
        robot.put(t=0.0, stamp=0.0)
        done = run(plan, scene, robot, words=words, observer=pace)
        assert 0.28 <= done.wall_seconds < 5.0
