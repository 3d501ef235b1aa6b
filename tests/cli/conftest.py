"""Runs the command line in this process, as a shell would see it."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from installed import install

from palpate.cli.main import main
from palpate.execution.cell_drivers import drivers

TABLE = """<mujoco model="cell">
  <worldbody>
    <site name="robot_base"/>
    <body name="table" pos="0.35 0 -0.03"><geom type="box" size=".6 .6 .03" friction="0.6 0.005 0.0001"/></body>
    {bodies}
  </worldbody>
</mujoco>
"""
CUBE = """<body name="{name}" pos="{x} {y} 0.03"><freejoint/>
      <geom type="box" size="{half} {half} 0.03" friction="0.6 0.005 0.0001" {mass}/></body>"""


def cube(
    name: str = "cube", x: float = 0.5, y: float = 0.0, half: float = 0.025, mass: str = ""
) -> str:
    return CUBE.format(name=name, x=x, y=y, half=half, mass=mass)


@dataclass(frozen=True)
class Answer:
    status: int
    out: str
    err: str


@pytest.fixture
def palpate(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> Callable[..., Answer]:
    """`palpate("gap", "scene.xml")` → exit status, stdout, stderr; the working folder is empty and
    pictures are off."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MUJOCO_GL", "disable")

    def call(*args: object) -> Answer:
        monkeypatch.setattr(sys, "argv", ["palpate", *map(str, args)])
        try:
            main()
            status = 0
        except SystemExit as exit_:
            status = int(exit_.code or 0)
        captured = capsys.readouterr()
        return Answer(status, captured.out, captured.err)

    return call


@pytest.fixture
def scene(tmp_path: Path) -> Callable[..., Path]:
    """Writes a scene of the given bodies on a table."""

    def write(*bodies: str, name: str = "scene.xml") -> Path:
        path = tmp_path / name
        path.write_text(TABLE.format(bodies="\n    ".join(bodies)), encoding="utf-8")
        return path

    return write


GONE = """from palpate.execution.cell_drivers import Driver
from palpate.common.errors import Unavailable


def connect(url, scene):
    if scene is not None:
        raise Unavailable(f"{url} hung up")


driver = Driver("bench", connect)
"""
"""A driver whose robot answers at first, and not any more when it is to move."""


@pytest.fixture
def driver(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """It is installed, as an installer leaves it."""
    point = {"palpate.cells": "bench = bench_arm_driver"}
    install(tmp_path, "bench_arm", point, {"bench_arm_driver": GONE})
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "bench_arm_driver", raising=False)
    drivers.cache_clear()
    yield
    drivers.cache_clear()
