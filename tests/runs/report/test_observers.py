from __future__ import annotations

import time

from palpate.execution.runner import run
from palpate.planning.plan import Plan
from palpate.runs.report.live_terminal import RealTime, Remaining


def test_a_simulated_run_takes_as_long_as_a_real_one(node, scene, robot, words) -> None:
    plan = Plan((), node("Wait", seconds=0.3), "")
    pace = RealTime()
    for _ in range(2):  # the second run's clock starts at 0 again
        robot.put(t=0.0, stamp=0.0)
        done = run(plan, scene, robot, words=words, observer=pace)
        assert 0.28 <= done.wall_seconds < 5.0


def test_the_remaining_time_is_the_mean_time_of_the_primitives_to_come(
    plan, node, scene, robot, words
):
    rows = []

    class Watcher:
        def __init__(self):
            self.remaining = Remaining()

        def on_tick(self, snapshot):
            time.sleep(0.0005)
            rows.append((snapshot.elapsed, self.remaining.seconds(snapshot)))

    steps = [node("Wait", seconds=0.5) for _ in range(6)]
    run(plan(*steps), scene, robot, words=words, observer=Watcher())
    assert rows[10][1] is None, "too few steps"
    # Where half is done as much is left, whatever a second of robot time takes.
    half = next(left for elapsed, left in rows if elapsed > 1.6)
    later = next(left for elapsed, left in rows if elapsed > 2.6)
    assert half > later > 0.0
    assert rows[-1][1] == 0.0
