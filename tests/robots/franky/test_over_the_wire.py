"""Runs over libfranka's own protocol, on loopback, in hidden worlds."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

import palpate as pp
from palpate.execution.cell_drivers import drivers
from palpate.execution.runner import run
from palpate.execution.stop import HeldObject
from palpate.runs import pipeline
from palpate.scene.scene import with_real_arm
from palpate.studies.scenarios.catalogue import scenario
from tests.fci.served import Served, files, served

pytestmark = pytest.mark.long

pytest.importorskip("franky", reason="franky-control has no wheel for this machine")


@dataclass(frozen=True)
class Wired:
    """A finished run, and the server that it ran against."""

    run: pp.Run
    bench: Served
    robot: Any

    def error(self, name: str) -> float:
        """Of a parameter, in its unit."""
        return float(self.run[name].values[0] - self.bench.ask("truth", name=name)[0])


class Looked:
    """A cell, and the robots that it handed out."""

    def __init__(self, cell: Any) -> None:
        self.cell, self.robots = cell, list[Any]()

    def __getattr__(self, name: str) -> Any:
        return getattr(self.cell, name)

    def robot(self) -> Any:
        self.robots.append(self.cell.robot())
        return self.robots[-1]


def ran(name: str, bench: Served) -> Wired:
    """A bundled scenario on a served arm."""
    asked = scenario(name).settings()
    assert asked.scene is not None
    scene = pp.load(asked.scene, poses=asked.poses)
    cell: Any = Looked(drivers().connect(f"franky://{bench.address}", scene))
    run = scene.plan(asked.request).run(cell)
    return Wired(run, bench, cell.robots[-1])


@pytest.fixture(scope="module")
def wired() -> Iterator[Wired]:
    with served(**files("bottle_and_table"), seed=3, fastest=1.0) as bench:
        yield ran("bottle_and_table", bench)


def test_the_paper_s_first_scenario_is_complete(wired: Wired) -> None:
    assert wired.run.execution is not None
    assert wired.run.execution.stopped_by is None
    assert wired.run.status == "complete"
    assert not wired.run.simulated
    assert wired.run.truth == {}


def test_mass_and_height_are_right(wired: Wired) -> None:
    low, high = wired.run["bottle.mass"].intervals[0]
    assert low < wired.bench.ask("truth", name="bottle.mass")[0] < high
    assert abs(wired.error("bottle.mass")) < 0.004
    assert abs(wired.error("table.height")) < 0.5e-3


def test_no_cycle_is_lost_in_lockstep(wired: Wired) -> None:
    counts = wired.bench.ask("counts")
    assert counts["lost"] == 0
    assert counts["commanded"] > 20_000


def test_the_reference_never_jumps_while_probing(wired: Wired) -> None:
    """0.02 mm a cycle, the way at 20 mm/s, whatever held the computer up."""
    trace = wired.run.trace
    assert trace is not None
    probe = next(leaf for leaf in trace.leaves if leaf.label.startswith("MoveUntilContact"))
    samples = trace.samples.between(probe.start, probe.end)
    steps = np.linalg.norm(np.diff(samples.target_world_tcp[:, :3], axis=0), axis=1)
    cycles = np.round(np.diff(samples.t) / 0.001)
    assert (steps / cycles).max() < 0.021e-3


def test_the_arm_pressed_nothing_hard(wired: Wired) -> None:
    trace = wired.run.trace
    assert trace is not None
    assert np.linalg.norm(trace.wrench[:, :3], axis=1).max() < 40.0


def test_every_cycle_is_in_the_log(wired: Wired) -> None:
    stamps = np.array([row.state.time.to_msec() for row in wired.robot.cycles])
    assert len(stamps) == 5000
    assert (np.diff(stamps) == 1).all()


def test_an_obstacle_is_carried_aside_and_back() -> None:
    with served(**files("occlusion"), seed=1, fastest=1.0) as bench:
        boxes = ("red_box", "light_blue_box")
        before = [bench.ask("pose", body=name) for name in boxes]
        wired = ran("occlusion", bench)
        assert wired.run.status == "complete"
        low, high = wired.run["light_blue_box.mass"].intervals[0]
        assert low < bench.ask("truth", name="light_blue_box.mass")[0] < high
        after = [bench.ask("pose", body=name) for name in boxes]
        assert [pose[:3] for pose in after] == [
            pytest.approx(pose[:3], abs=5e-3) for pose in before
        ]
        assert bench.ask("counts")["lost"] == 0


def test_a_door_is_moved_on_its_arc_and_left_where_it_was() -> None:
    with served(**files("drawer/door"), seed=1, fastest=1.0) as bench:
        before = bench.ask("pose", body="door")
        wired = ran("drawer/door", bench)
        assert wired.run.status == "complete"
        for name in ("door.damping", "door.frictionloss"):
            low, high = wired.run[name].intervals[0]
            assert low < bench.ask("truth", name=name)[0] < high
        assert bench.ask("pose", body="door") == pytest.approx(before, abs=5e-3)
        assert bench.ask("counts")["lost"] == 0


def test_a_stop_while_the_bottle_hangs_in_the_air_puts_it_back() -> None:
    """The controlled stop runs through the same driver: lowered, proven, released, and retreated."""
    asked = scenario("bottle_and_table").settings()
    loaded = pipeline.load(asked)
    assert loaded is not None
    scene, plan = with_real_arm(loaded), pipeline.plan(asked, loaded).plan
    lifted = float(scene.symbols.resolve("bottle_pose").position[2]) + 0.04
    with served(**files("bottle_and_table"), seed=3, fastest=1.0) as bench:
        before = bench.ask("pose", body="bottle")
        robot = drivers().connect(f"franky://{bench.address}", scene).robot()

        def hangs() -> bool:
            return robot.state.gripping and robot.state.pose_world_tcp.position[2] > lifted

        try:
            done = run(plan, scene, robot, stop_requested=hangs)
            state = robot.state
        finally:
            robot.close()
        assert done.stopped_by == "stop requested"
        assert done.trace.leaves[-1].message == "put bottle down"
        assert (done.held, done.fault) == (HeldObject("bottle", "put down"), None)
        assert not state.gripping
        assert np.abs(state.dq).max() < 0.05
        assert bench.ask("pose", body="bottle") == pytest.approx(before, abs=5e-3)
        counts = bench.ask("counts")
        assert counts["lost"] == 0
        assert counts["fell"] < 0.3
        assert counts["peak"] < 65.0
