"""What goes wrong on a real arm ends the run at once, with one clear message, and drops nothing."""

from __future__ import annotations

import os
import re
import signal
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

import palpate as pp
from palpate.common.errors import Stopped
from palpate.execution.cell_drivers import drivers
from palpate.execution.recovery import OnFailure, nobody
from palpate.execution.runner import Execution, Snapshot
from palpate.runs.callbacks import RunCallbacks
from palpate.runs.executing import perform
from palpate.runs.workplace import robot_of
from palpate.scene.scene import with_real_arm
from palpate.studies.scenarios.catalogue import scenario
from tests.fci.served import Served, files, served

pytestmark = pytest.mark.long

pytest.importorskip("franky", reason="franky-control has no wheel for this machine")

BOTTLE = "green_bottle"
BOXES: list[Any] = []
"""What the arms of the runs so far remembered of their last seconds."""


@pytest.fixture(scope="module")
def bench() -> Iterator[Served]:
    with served(**files("one_missing_mass"), fastest=1.0) as running:
        yield running


@dataclass
class Mishap:
    """Strikes half a second of robot time after a leaf has ended."""

    after: str
    strike: Callable[[], object]
    struck: float | None = None
    due: float | None = field(default=None, init=False)

    def on_tick(self, snapshot: Snapshot) -> None:
        if self.struck is not None or not any(self.after in leaf.label for leaf in snapshot.leaves):
            return
        self.due = self.due or snapshot.elapsed + 0.5
        if snapshot.elapsed >= self.due:
            self.struck = time.perf_counter()
            self.strike()


def ran(bench: Served, mishap: Mishap, policy: OnFailure = "stop") -> tuple[Execution, float]:
    """An execution with a mishap, and s from that to its end."""
    done = executed(bench, "one_missing_mass", mishap, policy)
    assert mishap.struck is not None, done.stopped_by
    return done, time.perf_counter() - mishap.struck


def executed(bench: Served, name: str, mishap: Mishap | None, policy: OnFailure) -> Execution:
    """A scenario's plan on the served arm."""
    asked = scenario(name).settings()
    assert asked.scene is not None
    scene = with_real_arm(pp.load(asked.scene))
    plan = pp.load(asked.scene).plan(asked.request)
    robot: Any = drivers().connect(f"franky://{bench.address}", scene).robot()
    done = perform(plan, scene, robot, RunCallbacks(mishap), policy, real=True)
    BOXES.append(robot.black_box())
    return done


def test_a_person_lets_a_stopped_arm_go_on(bench: Served) -> None:
    robot: Any = drivers().connect(f"franky://{bench.address}", real_scene()).robot()
    home = robot.state.q
    try:
        robot.move_joints(home + 0.05)
        robot.advance(0.2)
        bench.ask("user_stop", pressed=True)
        passing(robot, lambda state: state.fault is not None)
        with pytest.raises(pp.Unavailable, match="stopped by the user stop"):
            robot.recover()
        assert "user stop" in robot.state.fault
        bench.ask("user_stop", pressed=False)
        robot.recover()
        assert (robot.state.fault, robot.black_box()) == (None, None)
        robot.move_joints(home)
        passing(robot, lambda state: not state.moving)
        robot.advance(0.3)
        assert robot.state.q == pytest.approx(home, abs=5e-3)
    finally:
        robot.close()


def test_a_killed_control_box_is_gone_and_the_next_one_is_found() -> None:
    with served(**files("one_missing_mass"), fastest=1.0) as first:
        address = first.address
        robot: Any = drivers().connect(f"franky://{address}", real_scene()).robot()
        robot.move_joints(robot.state.q + 0.05)
        robot.advance(0.2)
        first.ask("kill")
        began = time.perf_counter()
        passing(robot, lambda state: state.fault is not None)
        robot.close()
        assert time.perf_counter() - began < 60.0  # 1 s where nothing else keeps the machine busy
        assert re.search(
            "said nothing|connection .* is lost|not answer any more", robot.state.fault
        )
    with served(**files("one_missing_mass"), fastest=1.0, address=address):
        again: Any = drivers().connect(f"franky://{address}", real_scene()).robot()
        again.move_joints(again.state.q + 0.02)
        passing(again, lambda state: not state.moving)
        assert again.state.fault is None
        again.close()


def real_scene() -> Any:
    """What the user knows, with an arm in it that is not simulated."""
    asked = scenario("one_missing_mass").settings()
    assert asked.scene is not None
    return with_real_arm(pp.load(asked.scene))


def passing(robot: Any, until: Callable[[Any], bool]) -> None:
    """Let time pass until something is so, for 5 s at most."""
    for _ in range(250):
        robot.advance(0.02)
        robot.drain()
        if until(robot.state):
            return
    pytest.fail("it is not so within 5 s")


def stopped_by(done: Execution) -> str:
    assert done.status == "stopped"
    assert done.setbacks == ()
    return str(done.stopped_by)


def test_a_frozen_control_box_is_noticed_and_taken_up_again(bench: Served) -> None:
    mishap = Mishap("OpenGripper", lambda: bench.ask("freeze", frozen=True))
    try:
        done, seconds = ran(bench, mishap)
    finally:
        bench.ask("freeze", frozen=False)
    assert re.search("has said nothing|connection .* is lost|not answer any more", stopped_by(done))
    assert seconds < 10.0  # 0.6 s where nothing else keeps the machine busy
    cell = drivers().connect(f"franky://{bench.address}", real_scene())
    with pytest.raises(Stopped, match=r"stopped by a reflex: see what it met"):
        robot_of(cell, nobody)
    told: list[str] = []
    robot, before = robot_of(cell, lambda why: told.append(why) is None)
    robot.close()
    assert "stopped by a reflex" in told[0]
    assert "a person let the robot go on at" in before[0]


def test_a_cut_connection_is_reported_and_another_one_can_be_made(bench: Served) -> None:
    done, _ = ran(bench, Mishap("OpenGripper", lambda: bench.ask("hang_up")))
    assert re.search("network cable|not answer any more", stopped_by(done))
    bench.ask("recover")


def test_lost_cycles_end_nothing(bench: Served) -> None:
    """And Ctrl-C puts down what is held."""
    bench.ask("lose", share=0.2)
    mishap = Mishap("Force2Mass", lambda: os.kill(os.getpid(), signal.SIGINT))
    before = bench.ask("pose", body=BOTTLE)
    done, _ = ran(bench, mishap)
    bench.ask("lose", share=0.0)
    assert stopped_by(done) == "interrupted"
    assert done.fault is None
    assert done.final_state.holding is None
    assert bench.ask("pose", body=BOTTLE)[:3] == pytest.approx(before[:3], abs=2e-3)
    assert bench.ask("counts")["lost"] > 100


def test_a_user_stop_ends_the_run_without_putting_down(bench: Served) -> None:
    mishap = Mishap("Force2Mass", lambda: bench.ask("user_stop", pressed=True))
    lifted = bench.ask("pose", body=BOTTLE)[2] + 0.05
    done, seconds = ran(bench, mishap, "replan")
    assert "user stop" in stopped_by(done)
    assert "still hold 'green_bottle'" in stopped_by(done)
    assert seconds < 5.0  # 0.13 s where nothing else keeps the machine busy
    assert bench.ask("pose", body=BOTTLE)[2] > lifted
    kept = BOXES[-1]
    assert "user stop" in str(kept["why"])
    assert kept["tau_J"].shape == (5000, 7)
    assert (np.diff(kept["t"]) > 0).all()
    with pytest.raises(pp.Unavailable, match=r"stopped by the user stop: release"):
        ran(bench, Mishap("nothing", lambda: None))
    bench.ask("user_stop", pressed=False)
    with pytest.raises(pp.Unavailable, match=r"the hand holds something at 6\d mm: take it out"):
        ran(bench, Mishap("nothing", lambda: None))


def test_an_unseen_post_is_met_softly_and_a_person_has_to_look() -> None:
    """franky's reaction, 1 kHz; the embedded robot would plan again."""
    with served(**files("mishaps/obstacle"), fastest=1.0) as bench:
        done = executed(bench, "mishaps/obstacle", None, "replan")
        assert "unexpected contact: the arm stopped itself at" in stopped_by(done)
        assert done.reflex is not None
        assert done.fault is None
        assert bench.ask("counts")["lost"] == 0
