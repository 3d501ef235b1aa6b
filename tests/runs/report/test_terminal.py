from __future__ import annotations

import io
import time

import pytest
from rich.console import Console

from palpate.execution.leaf import build
from palpate.execution.runner import Snapshot, run
from palpate.planning.plan import Plan
from palpate.runs.report.console import LIVE_LOGGER
from palpate.runs.report.live_terminal import LiveTree, bar, render


def console(terminal, height=40):
    return Console(
        file=io.StringIO(),
        force_terminal=terminal,
        width=100,
        height=height,
        color_system=None,
        highlight=False,
        legacy_windows=False,
    )


def drawn(snapshot, room=30):
    out = console(False)
    out.print(render(snapshot, room))
    return out.file.getvalue()


@pytest.fixture
def watched(plan, node, scene, robot, words):
    """Snapshots of a run, by robot time."""

    def watch(*children):
        pictures = []

        class Watcher:
            def on_tick(self, snapshot):
                pictures.append(drawn(snapshot))

        run(plan(*children), scene, robot, words=words, observer=Watcher())
        return pictures

    return watch


def test_the_tree_shows_statuses_time_and_force(watched, node, robot):
    robot.force[2] = 6.0
    pictures = watched(node("Go", z=0.28), node("Wait", seconds=0.5), node("Go", z=0.3))
    middle = pictures[25].splitlines()
    assert middle[0].startswith("    0.5 s robot time   step 2/3   Fz")
    assert middle[0].endswith("│██      +6.0 N   Wait(0.5)")
    assert middle[1] == "▶ Sequence"
    assert middle[2].startswith("  ✓ Go(0.28, 0.1)  0.2 s  at 0.28")
    assert middle[3].startswith("  ▶ Wait(0.5)  0.")
    assert middle[4] == "  · Go(0.3, 0.1)"


def test_a_failure_shows_its_reason_and_what_was_interrupted(watched, node):
    last = watched(node("Parallel", node("Go", z=0.1), node("Refuse")), node("Go", z=0.3))[
        -1
    ].splitlines()
    assert last[1].startswith("✗ Sequence")
    assert last[3].startswith("    – Go(0.1, 0.1)")
    assert last[4].startswith("    ✗ Refuse()  0.0 s  it refuses")
    assert last[5:] == ["  · Go(0.3, 0.1)", "stopping: Refuse(): it refuses"]


def test_the_measures_of_a_stop_are_shown_below_the_tree(watched, node, robot):
    robot.support_z, robot.weight = 0.1, 2.5
    last = watched(node("Go", z=0.1), node("Grasp"), node("Go", z=0.2), node("Refuse"))[
        -1
    ].splitlines()
    assert last[-2:] == ["stopping: Refuse(): it refuses", "✓ PutDown()  put cup down"]


def test_a_tree_taller_than_the_terminal_shows_the_active_part(node, words, blackboard, robot):
    root = build(
        node("Sequence", *[node("Wait", seconds=0.0) for _ in range(50)], node("Go", z=0.2)),
        words,
        blackboard,
    )
    for _ in range(2):
        robot.advance(0.02)
        root.tick_once()
    lines = drawn(
        Snapshot(root, robot.state, 0.1, blackboard.recorder.leaves), room=10
    ).splitlines()
    assert len(lines) == 11
    assert lines[-1].startswith("  ▶ Go(0.2, 0.1)")


def test_every_leaf_prints_one_line_without_a_terminal(plan, node, scene, robot, words):
    out = console(False)
    with LiveTree(out) as live:
        live.progress("touching")
        run(plan(node("Go", z=0.28), node("Refuse")), scene, robot, words=words, observer=live)
    lines = out.file.getvalue().splitlines()
    assert lines[0] == "touching …"
    assert [line.split()[2:4] for line in lines[1:]] == [
        ["ok", "Go(0.28,"],
        ["FAILED", "Refuse():"],
    ]
    assert "\x1b" not in out.file.getvalue()


@pytest.mark.parametrize(
    ("force", "shown"),
    [(0.0, "     │     "), (9.0, "     │██   "), (-9.0, "   ██│     "), (90.0, "     │█████")],
)
def test_a_force_is_a_bar_to_its_side(force, shown):
    assert bar(force) == shown


def test_the_log_has_what_the_terminal_shows(plan, node, scene, robot, words, caplog):
    caplog.set_level("INFO", logger=LIVE_LOGGER)
    with LiveTree(console(True)) as live:
        live.progress("touching")
        run(plan(node("Go", z=0.28)), scene, robot, words=words, observer=live)
    assert [record.message.split()[-1] for record in caplog.records] == ["touching", "(1/1)"]


def test_the_tree_is_redrawn_seldom_and_its_end_stays(plan, node, scene, robot, words):
    out = console(True)
    began = time.monotonic()
    with LiveTree(out) as live:
        run(
            plan(node("Go", z=0.1), node("Wait", seconds=2.0)),
            scene,
            robot,
            words=words,
            observer=live,
        )
    frames = out.file.getvalue().count("robot time")
    assert 2 <= frames <= 3 + (time.monotonic() - began) / 0.125
    assert "✓ Wait(2.0)" in out.file.getvalue()


def test_a_name_cannot_command_the_terminal(node, scene, robot, words):
    evil = node("Sequence", node("Wait", seconds=0.1))
    evil = type(evil)(evil.type, (), evil.children, name="\x1b]0;owned\x07 [red]markup[/]")
    out = console(True)
    with LiveTree(out) as live:
        run(Plan((), evil, ""), scene, robot, words=words, observer=live)
    assert "\x1b]" not in out.file.getvalue()
    assert "[red]markup[/]" in out.file.getvalue()
