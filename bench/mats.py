"""Indentation of the twin against the truth: mats of known stiffness in worlds of two solvers."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from palpate import pipeline
from palpate.mjcf.contacts import FINGERTIPS
from palpate.scenarios.catalogue import scenario
from palpate.scene.load import parse_scene
from palpate.twin.pressed import press, rest_depth

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


def world(text: str, option: str, stiffness: float) -> str:
    """The scene with a mat that gives way by `stiffness`, N/m, under the fingertips."""
    k = stiffness * (1.0 - IMPEDANCE) / FINGERTIPS
    d = 2.0 * DAMPING * (stiffness / FINGERTIPS) ** 0.5 * (1.0 - IMPEDANCE)
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
            made = world(text, option, stiffness)
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
