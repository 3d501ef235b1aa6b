"""`make bench`: processor time in ratios and seconds, measured side by side, so that other load of the
machine does not change it."""

from __future__ import annotations

import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import mujoco

from bench.variety import crowd
from palpate import pipeline
from palpate.cells.simulated import simulated_cell
from palpate.pictures.film import Footage
from palpate.scenarios.catalogue import scenario
from palpate.stages.executing import perform

ROUNDS = 3


def main() -> None:
    """Print all figures with their budgets."""
    _line("closed loop / bare mj_step", f"{closed_loop_ratio():.2f}", "≤ 1.25")
    _line("palpate --help", f"{_median(lambda: _palpate('--help')):.2f} s", "≤ 0.4 s")
    with tempfile.TemporaryDirectory() as folder:
        scene = crowd(Path(folder), 15)
        _line(
            "palpate plan, 15 objects, cold",
            f"{_median(lambda: _palpate('plan', '--scene', str(scene))):.2f} s",
            "≤ 0.8 s",
        )
        _line(
            "  of which planning and checking",
            f"{1e3 * planning_seconds(scene):.0f} ms",
            "≤ 50 ms",
        )


def closed_loop_ratio() -> float:
    """Processor time of the whole loop (control, sensing, ticks, logging) over that of as many bare
    `mj_step`s, alternated."""
    ratios: list[float] = []
    for seed in range(ROUNDS):
        settings = scenario("bottle_and_table").settings(noise="lab", seed=seed)
        run = pipeline.plan(settings, pipeline.load(settings))
        cell = simulated_cell(run.scene, settings.world, noise="lab", seed=seed)
        robot = cell.robot()
        start = time.process_time()
        execution = perform(run.plan, run.scene, robot)
        loop = time.process_time() - start
        seen = cell.footage()
        assert seen is not None
        steps = round(execution.robot_seconds / seen.model.opt.timestep)
        ratios.append(loop / _bare(seen, steps))
    return statistics.median(ratios)


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


def planning_seconds(scene_file: Path) -> float:
    """Planning and checking alone, warm imports, cold caches."""
    from palpate.settings import Settings

    settings = Settings(scene=scene_file)
    scene = pipeline.load(settings)
    small = scenario("one_missing_mass").settings()
    pipeline.plan(small, pipeline.load(small))
    start = time.process_time()
    pipeline.plan(settings, scene)
    return time.process_time() - start


def _palpate(*args: str) -> None:
    subprocess.run(
        [sys.executable, "-m", "palpate.cli.main", *args],
        check=True,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )


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
    print(f"{what:36s} {figure:>10s}   budget {budget}")


if __name__ == "__main__":
    main()
