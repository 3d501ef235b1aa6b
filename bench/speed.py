"""`make bench`: processor time in ratios and seconds, measured side by side, so that other load of the
machine does not change it."""

from __future__ import annotations

import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import mujoco
import numpy as np

from bench.variety import crowd
from palpate import pipeline
from palpate.callbacks import SILENT
from palpate.cells.simulated import simulated_cell
from palpate.execution.runner import TICK_PERIOD
from palpate.pictures.film import Footage
from palpate.planning.check.check import check
from palpate.quantities.estimators import estimate_all
from palpate.scenarios.catalogue import scenario
from palpate.settings import Settings
from palpate.stages.executing import perform

ROUNDS = 3
COUNTS = (1, 5, 15, 40)
"""Objects on the table, for the growth with their number."""
KILOBYTES = 1024  # of one MB: `ru_maxrss` is in kB
SWAY = 2.0  # s of robot time in which the arm sways before them


def main() -> None:
    """Print all figures with their budgets."""
    for noise in ("lab", "measured"):
        ratio = f"{closed_loop_ratio(noise):.2f}"
        _line(f"closed loop / bare mj_step, {noise}", ratio, "≤ 1.3")
    with tempfile.TemporaryDirectory() as folder:
        scenes = {count: crowd(Path(folder) / str(count), count) for count in COUNTS}
        _growth("closed loop, a robot second", [sway_seconds(scenes[n]) for n in COUNTS], "flat")
        planned = [planning_seconds(scenes[n]) for n in COUNTS]
        _growth("planning and checking", [both for both, _ in planned], "15: ≤ 0.1 s, 40: ≤ 0.3 s")
        _growth("checking alone", [check for _, check in planned], "")
        one = [measuring_seconds(scenes[n]) for n in COUNTS]
        _growth("execution, one mass among", [execution for execution, _ in one], "flat")
        _growth("its estimate", [estimates for _, estimates in one], "flat")
        _line("palpate --help", f"{_median(lambda: _palpate('--help')):.2f} s", "≤ 0.4 s")
        cold = _median(lambda: _palpate("plan", "--scene", str(scenes[15])))
        _line("palpate plan, 15 objects, cold", f"{cold:.2f} s", "≤ 0.8 s")
        _stages("demo", scenario("bottle_and_table").settings(seed=0, out=Path(folder) / "stages"))
        many = Settings(scene=scenes[15], seed=0, out=Path(folder) / "many")
        _stages("15 objects", many)
        for what, args in (("demo", ["demo"]), ("15 objects", ["run", "--scene", str(scenes[15])])):
            seconds, peak = _whole(*args, "--seed", "0", "--out", str(Path(folder) / what))
            _line(f"palpate {args[0]}, {what}", f"{seconds:.1f} s", "")
            _line("  memory peak", f"{peak:.0f} MB", "")


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
    _palpate(*args, check=False)  # a parameter may stay unidentified
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


def _growth(what: str, seconds: list[float], budget: str) -> None:
    """Print processor times by the number of objects, and the exponent of their growth."""
    exponent = np.polyfit(np.log(COUNTS), np.log(seconds), 1)[0]
    for count, time_of in zip(COUNTS, seconds, strict=True):
        _line(f"{what}, {count}", f"{1e3 * time_of:.0f} ms", budget)
    _line("  exponent", f"{exponent:.2f}", "")


def _line(what: str, figure: str, budget: str) -> None:
    print(f"{what:40s} {figure:>10s}   {budget and 'budget ' + budget}")


if __name__ == "__main__":
    main()
