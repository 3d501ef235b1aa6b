"""`make bench`: processor time in ratios and seconds, measured side by side, so that other load of the
machine does not change it."""

from __future__ import annotations

import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib import import_module
from itertools import pairwise
from pathlib import Path

import mujoco
import numpy as np

from bench.variety import crowd
from palpate.estimation.quantities.estimators import estimate_all
from palpate.execution.runner import TICK_PERIOD
from palpate.execution.simulated_cell import simulated_cell
from palpate.perception.film import Footage
from palpate.planning.check.check import check
from palpate.runs import pipeline
from palpate.runs.callbacks import SILENT
from palpate.runs.executing import perform
from palpate.runs.settings import Settings
from palpate.studies.scenarios.catalogue import scenario

ROOT = Path(__file__).parents[1]
ROUNDS = 3
ALTERNATIONS = 5  # of the measurements of two revisions
COUNTS = (1, 5, 15, 40, 80)
"""Objects on the table, for the growth with their number."""
KILOBYTES = 1024  # of one MB: `ru_maxrss` is in kB
SWAY = 2.0  # s of robot time in which the arm sways before them


Scenes = dict[int, Path]


@dataclass(frozen=True)
class Figure:
    """What is measured in a process of its own, with its budget.

    Attributes:
        measure: one number, or one for each of `COUNTS`.
        unit: s, ms (of numbers in s), MB, or empty for a ratio.
    """

    measure: Callable[[Scenes], float | list[float]]
    unit: str
    budget: str = ""


def _grows(measure: Callable[[Path], float], budget: str) -> Figure:
    return Figure(lambda scenes: [measure(scenes[n]) for n in COUNTS], "ms", budget)


FIGURES = {
    "closed loop / bare mj_step, lab": Figure(lambda _: closed_loop_ratio("lab"), "", "≤ 1.3"),
    "closed loop / bare mj_step, measured": Figure(
        lambda _: closed_loop_ratio("measured"), "", "≤ 1.3"
    ),
    "closed loop, a robot second": _grows(lambda scene: sway_seconds(scene), "flat"),
    "planning and checking": _grows(
        lambda scene: planning_seconds(scene)[0], "15: ≤ 0.1 s, 40: ≤ 0.3 s"
    ),
    "checking alone": _grows(lambda scene: planning_seconds(scene)[1], ""),
    "execution, one mass among": _grows(lambda scene: measuring_seconds(scene)[0], "flat"),
    "its estimate": _grows(lambda scene: measuring_seconds(scene)[1], "flat"),
    "palpate --help": Figure(lambda _: _median(lambda: _palpate("--help")), "s", "≤ 0.4 s"),
    "palpate plan, 15 objects, cold": Figure(
        lambda scenes: _median(lambda: _palpate("plan", "--scene", str(scenes[15]))), "s", "≤ 0.8 s"
    ),
    "palpate demo": Figure(lambda _: _whole("demo")[0], "s"),
    "palpate demo, memory peak": Figure(lambda _: _whole("demo")[1], "MB"),
    "palpate run, 15 objects": Figure(
        lambda scenes: _whole("run", "--scene", str(scenes[15]))[0], "s"
    ),
    "palpate run, 15 objects, memory peak": Figure(
        lambda scenes: _whole("run", "--scene", str(scenes[15]))[1], "MB"
    ),
}


def main(against: str | None = None, only: str = "") -> None:
    """Print the figures whose names contain `only`, with their budgets; beside them those of the
    revision `against`, measured alternately."""
    with tempfile.TemporaryDirectory() as folder:
        for count in COUNTS:
            crowd(Path(folder) / str(count), count)
        roots = [ROOT]
        if against is not None:
            _git("worktree", "add", "--detach", f"{folder}/against", against)
            roots.append(Path(folder) / "against")
        try:
            for name in (name for name in FIGURES if only in name):
                rounds = ALTERNATIONS if against is not None else 1
                _show(name, [[_child(name, folder, root) for root in roots] for _ in range(rounds)])
            if against is None and only in "stages":
                out = Path(folder)
                small = scenario("bottle_and_table").settings(seed=0, out=out / "stages")
                _stages("demo", small)
                many = Settings(scene=out / "15" / "scene.xml", seed=0, out=out / "many")
                _stages("15 objects", many)
        finally:
            if against is not None:
                _git("worktree", "remove", "--force", f"{folder}/against")


def _git(*arguments: str) -> None:
    subprocess.run(["git", "-C", str(ROOT), *arguments], check=True, capture_output=True)


def _child(name: str, folder: str, root: Path) -> list[float]:
    """Numbers of a figure, measured by a revision's own instrument in a process of its own; empty if it has no
    such figure."""
    environment = os.environ | {"PYTHONPATH": f"{root / 'src'}{os.pathsep}{root}"}
    command = [sys.executable, "-m", "bench.speed", name, folder]
    done = subprocess.run(command, env=environment, cwd=root, stdout=subprocess.PIPE, text=True)
    return json.loads(done.stdout.splitlines()[-1]) if done.returncode == 0 else []


def _measured(name: str, folder: str) -> None:
    """Print the numbers of a figure as JSON."""
    found = FIGURES[name].measure({n: Path(folder) / str(n) / "scene.xml" for n in COUNTS})
    print(json.dumps(found if isinstance(found, list) else [found]))


def _show(name: str, rounds: list[list[list[float]]]) -> None:
    """Print the medians of a figure, by round, revision and number, exponents of their growth, and the least, median
    and largest ratio to the other revision."""
    figure = FIGURES[name]
    digits, scale = {"ms": (0, 1e3), "MB": (0, 1.0)}.get(figure.unit, (2, 1.0))
    several = len(rounds[0][0]) > 1
    medians = [np.median(each, axis=0) for each in zip(*rounds, strict=True)]
    for i in range(len(rounds[0][0])):
        known = [values[i] for values in medians if i < len(values)]
        shown = " · ".join(f"{scale * value:.{digits}f} {figure.unit}".strip() for value in known)
        if len(known) > 1:
            ratios = sorted(own[i] / other[i] for own, other in rounds)
            middle = statistics.median(ratios)
            shown += f" · {ratios[0]:.2f} {middle:.2f} {ratios[-1]:.2f}"
        _line(f"{name}, {COUNTS[i]}" if several else name, shown, figure.budget)
    if several:
        exponents = [
            np.polyfit(np.log(COUNTS[: len(row)]), np.log(row), 1)[0] for row in medians if len(row)
        ]
        _line("  exponent", " · ".join(f"{exponent:.2f}" for exponent in exponents), "")


def _stages(what: str, settings: Settings) -> None:
    """Print wall and processor seconds of each stage of a run, of this process and of its copies that end
    meanwhile."""
    marks: list[tuple[str, float, float, float]] = []

    def mark(stage: str) -> None:
        marks.append((stage, time.perf_counter(), time.process_time(), _of_children()))

    mark("load")
    pipeline.run(settings, replace(SILENT, progress=mark))
    mark("")
    for (stage, *before), (_, *after) in pairwise([*marks, (what, *marks[0][1:]), marks[-1]]):
        if stage:
            wall, own, copies = np.subtract(after, before)
            figures = f"{wall:.1f} s, processor {own:.1f} + {copies:.1f} s"
            _line(f"{what}, {stage}" if stage != what else f"{what}, in all", figures, "")


def closed_loop_ratio(noise: str) -> float:
    """Processor time of the whole loop (control, sensing, ticks, logging, estimates on the way) over
    that of as many bare `mj_step`s in the same world, alternated."""
    ratios: list[float] = []
    for seed in range(ROUNDS):
        settings = scenario("bottle_and_table").settings(noise=noise, seed=seed)
        run = pipeline.plan(settings, pipeline.load(settings))
        cell = simulated_cell(run.scene, settings.world, noise=noise, seed=seed)
        robot = cell.robot()
        start = time.process_time()
        execution = perform(run.plan, run.scene, robot)
        loop = time.process_time() - start
        seen = cell.footage()
        assert seen is not None
        steps = round(execution.robot_seconds / seen.model.opt.timestep)
        ratios.append(loop / _bare(seen, steps))
    return statistics.median(ratios)


def sway_seconds(scene_file: Path) -> float:
    """Processor seconds for a second in which the arm moves before the objects, which stand still."""
    scene = pipeline.load(Settings(scene=scene_file))
    assert scene is not None
    robot = simulated_cell(scene).robot()
    times: list[float] = []
    for i in range(ROUNDS + 1):
        robot.move_joints(scene.arm.home + 0.1 * (-1) ** i)
        start = time.process_time()
        for _ in range(round(SWAY / TICK_PERIOD)):
            robot.advance(TICK_PERIOD)
            assert robot.state.reflex is None
            robot.drain()
        times.append((time.process_time() - start) / SWAY)
    return min(times[1:])  # in the first the objects come to rest


def _bare(seen: Footage, steps: int) -> float:
    """Seconds for `steps` bare steps through the same states: restarted at each stored frame of the
    run."""
    model, frames = seen.model, seen.frames
    data = mujoco.MjData(model)
    chunk = steps // len(frames)
    start = time.process_time()
    for _, qpos in frames:
        data.qpos[:] = qpos
        data.qvel[:] = 0.0
        mujoco.mj_step(model, data, nstep=chunk)
    return (time.process_time() - start) * steps / (chunk * len(frames))


def planning_seconds(scene_file: Path) -> tuple[float, float]:
    """Planning and checking together, and the check alone: warm imports, cold caches."""
    settings = Settings(scene=scene_file)
    scene, again = pipeline.load(settings), pipeline.load(settings)
    small = scenario("one_missing_mass").settings()
    pipeline.plan(small, pipeline.load(small))
    import_module("mink")  # which the first pose that the controller does not reach would load
    start = time.process_time()
    run = pipeline.plan(settings, scene)
    planned = time.process_time()
    check(run.plan, again)
    return planned - start, time.process_time() - planned


def measuring_seconds(scene_file: Path) -> tuple[float, float]:
    """Execution of the plan for the first object's mass, and its estimate, the others standing by."""
    settings = Settings(scene=scene_file, measure=("box_1.mass",))
    run = pipeline.plan(settings, pipeline.load(settings))
    robot = simulated_cell(run.scene).robot()
    start = time.process_time()
    execution = perform(run.plan, run.scene, robot)
    executed = time.process_time()
    estimate_all(run.plan.parameters, execution.trace, run.scene.bodies)
    return executed - start, time.process_time() - executed


def _palpate(*args: str, check: bool = True) -> None:
    # As on a user's machine, modules are compiled once.
    environment = os.environ | {"PYTHONDONTWRITEBYTECODE": ""}
    subprocess.run(
        [sys.executable, "-m", "palpate.cli.main", *args],
        check=check,
        env=environment,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )


def _whole(*args: str) -> tuple[float, float]:
    """Processor seconds of a whole run, its own processes included, and the memory peak, MB, of the
    largest process that has run so far."""
    start = _of_children()
    with tempfile.TemporaryDirectory() as folder:
        # A parameter may stay unidentified.
        _palpate(*args, "--seed", "0", "--out", f"{folder}/run", check=False)
    peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / KILOBYTES
    return _of_children() - start, peak


def _median(run: Callable[[], None]) -> float:
    times: list[float] = []
    for _ in range(ROUNDS):
        start = _of_children()
        run()
        times.append(_of_children() - start)
    return statistics.median(times)


def _of_children() -> float:
    """Processor time of all ended child processes, s."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _line(what: str, figure: str, budget: str) -> None:
    print(f"{what:40s} {figure:>20s}   {budget and 'budget ' + budget}", flush=True)


if __name__ == "__main__":
    _measured(*sys.argv[1:])
