"""The example programs, each in a process of its own as a user runs it, and what they print."""

from __future__ import annotations

import ast
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from long_cases import mark_long

EXAMPLES = Path(__file__).parents[2] / "examples"
PROGRAMS = sorted(EXAMPLES.glob("[0-9]*.py"))
SHORT = ("03", "04", "05", "06")
LONGEST = 30
"""Lines of code, without the docstring and blank lines."""
PRINTED = {
    "01_weigh": (
        r"<Run complete: mug\.mass = 0\.\d+, simulated>",
        r"<mug\.mass = [\d.]+ ± [\d.]+ kg, 95 % \[[\d., ]+\], identified, simulated>",
    ),
    "02_own_scene": (
        r"<Scene 'kitchen': 1 object, 1 surface, 1 missing>",
        r"missing: tin\.mass",
        r'<geom type="cylinder" size="\.033 \.05" mass="0\.\d+"',
        r'name="palpate_tin_mass"',
    ),
    "03_plan_only": (
        r"<Plan by symbolic: mug\.mass, 12 actions>",
        r"  MovePose\(mug_pose \+ z_offset\)",
        r"findings of the check: none",
        r"None The temperature \('warm'\) cannot be measured",
    ),
    "04_own_planner": (
        r"lazy: 2 actions, [1-9]\d* findings",
        r"tree\.children\[1\]: the gripper must be open",
        r"symbolic: 12 actions, 0 findings",
    ),
    "05_own_primitive": (r"findings:\s*\n", r"Wait\(2\.0\): SUCCESS, waited 2\.0 s, at 2\.0 s"),
    "06_own_quantity": (
        r'friction="0\.7 0\.005 0\.0001": missing mug\.mass\n',
        r'friction="0\.7": missing mug\.mass mug\.rolling\n',
    ),
    "07_read_a_trace": (
        r"<Run complete: mug\.mass",
        r"<Trace: [\d.]+ s, \d+ samples, 12 actions, 1 recording>",
        r"gripper_forces, holding the mug: F_z = \d\.\d\d N",
    ),
    "08_compare_runs": (r"none +0\.\d+ kg", r"lab +0\.\d+ kg", r"datasheet +0\.\d+ kg"),
    "09_another_arm": (
        r"lifts 3\.0 kg, 12 actions\n<mug\.mass = ",
        r"lifts [\d.]+ kg, 12 actions\n<mug\.mass = ",
    ),
    "10_own_estimator": (r"truth: +0\.\d+", r"palpate: +<mug\.mass", r"bare mean: <mug\.mass"),
    "11_soft_mat": (r"<mat\.stiffness = \d+", r"yields by .* as measured", r"solref=\"-\d+"),
    "12_prove": (r"mug +topple +[\d.]+ N +[+-][\d.]+ N +[+-]0\.0\d\d N",),
    "13_drawer": (
        r"<drawer\.frictionloss = [\d.]+ ± [\d.]+ N, 95 % \[[\d., ]+\], identified, simulated>",
        r"<drawer\.damping = [\d.]+ ± [\d.]+ N·s/m, 95 % \[[\d., ]+\], identified, simulated>",
        r'damping="[\d.]+" frictionloss="[\d.]+"',
    ),
}


@pytest.mark.parametrize(
    "program",
    mark_long(PROGRAMS, lambda file: file.stem[:2] not in SHORT, name=lambda file: file.stem),
)
def test_a_program_runs_and_prints_what_it_promises(program: Path, tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, str(program)],
        capture_output=True,
        text=True,
        check=False,
        cwd=tmp_path,
        env={**os.environ, "MUJOCO_GL": "disabled"},
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    for pattern in PRINTED[program.stem]:
        assert re.search(pattern, done.stdout), (pattern, done.stdout)
    assert list(tmp_path.iterdir()) == [], "a program leaves nothing behind"


def test_every_entry_point_has_an_example_program() -> None:
    assert [program.stem for program in PROGRAMS] == sorted(PRINTED)
    assert len(PROGRAMS) >= 8


@pytest.mark.parametrize("program", PROGRAMS, ids=lambda program: program.stem)
def test_a_program_says_what_it_shows_and_is_short(program: Path) -> None:
    tree = ast.parse(program.read_text(encoding="utf-8"))
    assert ast.get_docstring(tree)
    lines = program.read_text(encoding="utf-8").splitlines()
    code = [line for line in lines[tree.body[0].end_lineno :] if line.strip()]
    assert len(code) <= LONGEST
