"""The code keeps to the two tables of docs/architecture.md: who may import whom, and where each
third party lives."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SOURCE = ROOT / "src" / "palpate"
HEAVY = {
    "mujoco",
    "numpy",
    "scipy",
    "py_trees",
    "pydantic_ai",
    "plotly",
    "mink",
    "lxml",
    "mcap",
    "jinja2",
    "imageio_ffmpeg",
    "PIL",
    "yaml",
}
"""Not pydantic, which typer itself loads for a command's help."""


def table(heading: str) -> dict[str, str]:
    """First cell (each of its names) to second cell, of the table that begins with `heading`."""
    text = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    rows = re.findall(
        r"^\| (.+?) \| (.+?) \|$", text[text.index(heading) :].partition("\n\n")[0], re.MULTILINE
    )[1:]
    return {name: second for first, second in rows for name in re.findall(r"`([\w.]+)`", first)}


@cache
def rooms() -> dict[str, int]:
    """Height of each room: its row in the table, the top one 0."""
    return {name: row for row, name in enumerate(table("| room |"))}


def is_for_types(node: ast.stmt) -> bool:
    return isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)


def statements(
    body: list[ast.stmt], inside_functions: bool, for_types: bool = False
) -> Iterator[ast.stmt]:
    """Statements of a body: also those inside functions, also those for types alone."""
    for node in body:
        if is_for_types(node) and not for_types:
            continue
        if isinstance(node, ast.FunctionDef) and not inside_functions:
            continue
        yield node
        for part in ("body", "orelse", "finalbody", "handlers", "cases"):
            yield from statements(getattr(node, part, []), inside_functions, for_types)


def name_of(file: Path) -> str:
    parts = file.relative_to(SOURCE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


@cache
def modules() -> dict[str, ast.Module]:
    return {
        name_of(file): ast.parse(file.read_text(encoding="utf-8"))
        for file in sorted(SOURCE.rglob("*.py"))
    }


def imported(name: str, inside_functions: bool = True, for_types: bool = False) -> set[str]:
    """Full names of the modules that a module imports."""
    found: set[str] = set()
    for node in statements(modules()[name].body, inside_functions, for_types):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{name} imports relatively"
            members = {f"{node.module}.{alias.name}" for alias in node.names}
            found |= {m for m in members if m in modules()} or {str(node.module)}
    return found


def is_part(module: str, of: str) -> bool:
    return module == of or module.startswith(f"{of}.")


def room(module: str) -> str:
    """`mjcf` of `palpate.mjcf.roles`."""
    return module.split(".")[1]


def test_every_module_has_its_row() -> None:
    assert {room(name) for name in modules() if name != "palpate"} == set(rooms())


@pytest.mark.parametrize("name", [name for name in modules() if name != "palpate"])
def test_imports_point_down(name: str) -> None:
    mine = room(name)
    every = imported(name, for_types=True)
    others = {m for m in every if m.startswith("palpate.") and room(m) != mine}
    upwards = {m for m in others if rooms()[room(m)] < rooms()[mine]}
    assert not upwards, f"{name} must not import {sorted(upwards)}"


FRONT = {"runs", "studies", "common", "cli"}
"""What the command line may import."""


@pytest.mark.parametrize("name", [name for name in modules() if name.startswith("palpate.cli")])
def test_the_command_line_stands_on_the_front_door(name: str) -> None:
    rooms_seen = {room(m) for m in imported(name) if m.startswith("palpate.")}
    assert rooms_seen <= FRONT


@pytest.mark.parametrize(
    "of", ["estimation", "primitives", "planning", "trace", "scene", "robots.franky"]
)
def test_estimation_imports_no_simulated_robots(of: str) -> None:
    """What a world hides cannot leak into what is not imported. A real robot needs no simulated one."""
    for name in modules():
        if is_part(name, f"palpate.{of}") and not is_part(name, "palpate.estimation.logs"):
            hidden = {m for m in imported(name) if is_part(m, "palpate.robots.simulated")}
            assert not hidden, f"{name} must not import {sorted(hidden)}"


def test_third_parties_have_one_home() -> None:
    homes = {
        name: re.findall(r"`([\w.]+)`", cell) for name, cell in table("| third party |").items()
    }
    strays = {
        (name, package)
        for name in modules()
        for m in imported(name)
        if (package := m.split(".")[0]) in homes
        and not any(is_part(name, f"palpate.{home}") for home in homes[package])
    }
    assert not strays


def test_no_modules_import_each_other_in_a_circle() -> None:
    graph = {
        name: {m for m in imported(name, for_types=True) if m in modules()} for name in modules()
    }
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        pytest.fail(f"import cycle: {' → '.join(error.args[1])}")


@pytest.mark.parametrize(
    ("statement", "heavy"),
    [
        ("import palpate", HEAVY),
        ("from palpate.cli.app import app; app(['--help'], standalone_mode=False)", HEAVY),
        ("from palpate.cli.app import app; app(['run', '--help'], standalone_mode=False)", HEAVY),
        (
            "from palpate import dynamics, estimate, noise, run, see",
            {"scipy", "cv2", "mink", "py_trees", "pydantic_ai"},
        ),
    ],
)
def test_the_way_in_loads_nothing_heavy(statement: str, heavy: set[str]) -> None:
    code = f"import sys\n{statement}\nprint('loaded:', *{{m.split('.')[0] for m in sys.modules}})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = set(done.stdout.rpartition("loaded:")[2].split())
    assert "palpate" in loaded
    assert not loaded & heavy
