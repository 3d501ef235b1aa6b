"""Mats that give way: hidden ones against their estimates, and indentation of the twin against the truth."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from bench.fixtures import Case, FixtureRun, Score
from palpate.estimation.spring import damping_ratio, restitution
from palpate.execution.simulated_cell import simulated_cell
from palpate.mjcf.contacts import FINGERTIPS
from palpate.runs import pipeline
from palpate.scene.load import parse_scene
from palpate.studies.scenarios.catalogue import scenario
from palpate.twin.validate import press, rest_depth

STIFFNESSES = (500.0, 2_000.0, 10_000.0, 50_000.0)
"""N/m under both fingertips."""
SOLVERS = {
    "Newton": '<option timestep="0.001" cone="elliptic" solver="Newton"/>',
    "CG": '<option timestep="0.001" cone="pyramidal" solver="CG"/>',
}
IMPEDANCE = 0.1
"""Constant, so that the contact is a spring and a damper."""
DAMPING = 0.5
"""Part of the critical damping of FINGERTIPS."""
MAT = '<geom type="box" size=".12 .16 .015" '


STREAM = 40
"""Random stream of the hidden mats, independent of all others of a seed."""
DRAWN = (500.0, 50_000.0)
"""N/m: range of hidden stiffnesses, log-uniform."""
RATIOS = (0.05, 1.0)
"""Range of hidden damping ratios of 1 kg, uniform."""
OPTIONS = (
    '<option timestep="0.002"/>',
    '<option timestep="0.004" cone="elliptic" solver="PGS"/>',
    '<option timestep="0.001" cone="pyramidal" solver="CG"/>',
)
"""Worlds of hidden mats."""
QUANTITIES = ("stiffness", "contact_damping", "restitution")


def hidden(seed: int) -> tuple[str, float, float]:
    """Option, stiffness, N/m, and damping, N s/m, of a hidden mat."""
    random = np.random.default_rng([seed, STREAM])
    stiffness = float(np.exp(random.uniform(*np.log(DRAWN))))
    damping = 2.0 * float(random.uniform(*RATIOS)) * stiffness**0.5
    return str(random.choice(OPTIONS)), stiffness, damping


def judge(case: Case) -> FixtureRun:
    """Measure a hidden mat, and compare with its truth."""
    given = scenario(case.scenario).settings(noise=case.noise, seed=case.seed)
    assert given.scene is not None
    known = given.scene.read_text(encoding="utf-8")
    option, stiffness, damping = hidden(case.seed)
    asked = tuple(f"mat.{quantity}" for quantity in QUANTITIES)
    settings = replace(given, world=None, request=None, measure=asked).check_values(at_hand=True)
    arm = settings.described_arm()
    scene = parse_scene(known, arm=arm)
    hidden_world = parse_scene(world(known, option, stiffness, damping), arm=arm)
    cell = simulated_cell(scene, hidden_world, noise=case.noise, seed=case.seed)
    run = pipeline.estimate(pipeline.execute(pipeline.plan(settings, scene), cell), cell)
    truth = (stiffness, damping, restitution(damping_ratio(stiffness, damping)))
    scores: list[Score] = []
    without: list[str] = []
    for true, quantity in zip(truth, QUANTITIES, strict=True):
        found = next(one for one in run.estimates if one.parameter.quantity == quantity)
        if not found.has_value:
            without.append(f"{quantity} of {true:.3g}: {found.method}")
            continue
        value, std = float(found.values[0]), float(found.stds[0])
        low, high = found.intervals[0].tolist()
        scores.append(Score(quantity, found.verdict, true, value, std, low, high))
    done = run.execution
    reason = (done.stopped_by or "") if done is not None else ""
    return FixtureRun(case, run.status, reason, scores=tuple(scores), unmeasured=tuple(without))


def world(text: str, option: str, stiffness: float, damping: float) -> str:
    """The scene with a mat that gives way by `stiffness`, N/m, and `damping`, N s/m, under the fingertips."""
    k, d = (one * (1.0 - IMPEDANCE) / FINGERTIPS for one in (stiffness, damping))
    contact = f'solref="{-k:.6g} {-d:.6g}" solimp="{IMPEDANCE} {IMPEDANCE} .001" solmix="1e6" '
    assert MAT in text
    return text.replace(MAT, MAT + contact).replace('<option timestep="0.002"/>', option)


def main() -> None:
    """Print a line for each mat: stiffness, and depths in twin and truth at three forces."""
    given = scenario("soft_mat").settings(noise="measured", seed=1)
    assert given.scene is not None
    text = given.scene.read_text(encoding="utf-8")
    for name, option in SOLVERS.items():
        for stiffness in STIFFNESSES:
            made = world(text, option, stiffness, 2.0 * DAMPING * (stiffness * FINGERTIPS) ** 0.5)
            with TemporaryDirectory() as folder:
                file = Path(folder) / "world.xml"
                file.write_text(made, encoding="utf-8")
                out = Path(folder) / "run"
                settings = replace(given, world=file, out=out, fast=True)
                run = pipeline.run(settings)
            found = next(one for one in run.estimates if one.parameter.quantity == "stiffness")
            twin = run.finished.scene if run.finished is not None else None
            if twin is None or not found.identified:
                print(f"{name:7} {stiffness:6.0f} N/m: {found.verdict}: {found.method}")
                continue
            truth = parse_scene(made, arm=given.described_arm())
            for one in press(twin, found):
                true = rest_depth(truth, "mat", one.force, stiffness)
                print(
                    f"{name:7} {stiffness:6.0f} N/m: {found.values[0]:.0f} ± {found.stds[0]:.0f}, {one.force:.2f} N: "
                    f"twin {1e3 * one.depth:.3f} mm, truth {1e3 * true:.3f}, "
                    f"interval {1e3 * one.low:.3f} … {1e3 * one.high:.3f}"
                )


if __name__ == "__main__":
    main()
