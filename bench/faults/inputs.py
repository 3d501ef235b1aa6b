"""Bad inputs at the command line: must be refused in seconds, in little memory, with a clean message."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from threading import Timer
from unicodedata import category

from bench.campaign.ledger import Row
from bench.faults.nasty import small_scene
from bench.faults.signals import PALPATE

SECONDS = 5.0
"""Most processor time: wall time would depend on other processes."""
MEMORY = 1.0e9
"""Most bytes."""
GIVE_UP = 30
"""s after which a process is killed."""

Make = Callable[[Path], Path]
"""Writes the input into a folder, and returns its path."""

BOX = '<geom type="box" size=".02 .02 .02"/>'


@dataclass(frozen=True, slots=True)
class Bad:
    """Input for the command line, as scene or as `plan`; `refused`: it must be refused."""

    name: str
    make: Make
    plan: bool = False
    refused: bool = True

    def blank(self) -> Row:
        return Row.named("inputs", self.name, self.name)


def _scene(worldbody: str, more: str = "") -> Make:
    return _file(f"<mujoco>{more}<worldbody>{worldbody}</worldbody></mujoco>")


def _file(content: str | bytes) -> Make:
    def make(folder: Path) -> Path:
        path = folder / "input"
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        return path

    return make


def _named(path: str) -> Make:
    return lambda _: Path(path)


def _fifo(folder: Path) -> Path:
    path = folder / "fifo"
    os.mkfifo(path)
    return path


def _sparse(folder: Path) -> Path:
    path = folder / "large.xml"
    with path.open("wb") as file:
        file.truncate(8_000_000_000)
    return path


def _loop(folder: Path) -> Path:
    path = folder / "loop.xml"
    path.symlink_to(path)
    return path


def _includes_itself(folder: Path) -> Path:
    path = folder / "scene.xml"
    path.write_text('<mujoco><include file="scene.xml"/></mujoco>', encoding="utf-8")
    return path


def _mesh_of_zeros(folder: Path) -> Path:
    (folder / "zeros.obj").symlink_to("/dev/zero")
    path = folder / "scene.xml"
    path.write_text(
        '<mujoco><asset><mesh name="m" file="zeros.obj"/></asset><worldbody><body name="b">'
        '<freejoint/><geom type="mesh" mesh="m"/></body></worldbody></mujoco>',
        encoding="utf-8",
    )
    return path


def _tree(tree: object) -> Make:
    return _file(json.dumps({"parameters": [], "tree": tree, "explanation": ""}))


def _deep(levels: int) -> str:
    open_, close = '{"type": "Sequence", "children": [', "]}"
    return '{"parameters": [], "tree": ' + open_ * levels + close * levels + "}"


_BILLION = (
    '<!DOCTYPE mujoco [<!ENTITY a "aaaaaaaaaa">'
    + "".join(f'<!ENTITY a{i} "{10 * (f"&a{i - 1};" if i else "&a;")}">' for i in range(10))
    + "]><mujoco><worldbody><body name='&a9;'/></worldbody></mujoco>"
)
_ESCAPE = "\x1b]0;pwned\x07\x1b[31mred"

BAD: tuple[Bad, ...] = (
    Bad("/dev/zero", _named("/dev/zero")),
    Bad("/dev/random", _named("/dev/random")),
    Bad("a folder", _named("/")),
    Bad("no file", _named("/nowhere/scene.xml")),
    Bad("a FIFO", _fifo),
    Bad("8 GB of nothing", _sparse),
    Bad("a link to itself", _loop),
    Bad("includes itself", _includes_itself),
    Bad("a mesh of zeros", _mesh_of_zeros),
    Bad("billion laughs", _file(_BILLION)),
    Bad("bytes", _file(bytes(range(256)) * 100)),
    Bad("half a document", _file("<mujoco><worldbody>")),
    Bad(
        "a million copies",
        _scene(
            f'<replicate count="1000000" offset=".1 0 0"><body><freejoint/>{BOX}</body></replicate>'
        ),
    ),
    Bad(
        "copies of copies",
        _scene(
            '<replicate count="1000" offset=".1 0 0"><replicate count="1000" offset="0 .1 0">'
            f"{BOX}</replicate></replicate>"
        ),
    ),
    Bad(
        "a huge flex",
        _scene(
            '<flexcomp name="f" type="grid" count="200 200 200" spacing=".01 .01 .01" dim="3" mass="1"/>'
        ),
    ),
    Bad(
        "a huge height field",
        _scene(
            '<geom type="hfield" hfield="h"/>',
            '<asset><hfield name="h" nrow="30000" ncol="30000" size="1 1 1 1"/></asset>',
        ),
    ),
    Bad(
        "a huge texture",
        _scene(
            BOX,
            '<asset><texture name="t" type="2d" builtin="flat" width="60000" height="60000"/></asset>',
        ),
    ),
    Bad(
        "a composite of a million",
        _scene(
            '<composite type="cable" count="1000000 1 1" size="1"><geom size=".01"/></composite>'
        ),
    ),
    Bad("memory of its own", _scene(BOX, '<size memory="100G"/>')),
    Bad("100 000 geoms", _scene(BOX * 100_000)),
    Bad("deep bodies", _scene("<body>" * 5000 + BOX + "</body>" * 5000)),
    Bad(
        "NaN sizes",
        _scene('<body name="b"><freejoint/><geom type="box" size="nan nan nan"/></body>'),
    ),
    Bad(
        "huge sizes",
        _scene('<body name="b"><freejoint/><geom type="box" size="1e300 1e300 1e300"/></body>'),
    ),
    Bad(
        "escape sequences in a name",
        _scene(
            '<body name="&#x9b;31m b" pos="0 0 ?"><geom type="box" size="1 1 1"/></body>'
            f'<body name="\u202eevil"><freejoint/>{BOX}</body>'
        ),
        refused=False,
    ),
    Bad("plan: /dev/zero", _named("/dev/zero"), plan=True),
    Bad("plan: a FIFO", _fifo, plan=True),
    Bad("plan: 8 GB", _sparse, plan=True),
    Bad("plan: deep", _file(_deep(100_000)), plan=True),
    Bad("plan: 30 deep", _file(_deep(40)), plan=True),
    Bad(
        "plan: wide",
        _tree({"type": "Sequence", "children": [{"type": "OpenGripper"}] * 20_000}),
        plan=True,
    ),
    Bad(
        "plan: huge number",
        _file(
            '{"parameters": [], "tree": {"type": "MoveJoints", "joints": [1' + "0" * 100_000 + "]}}"
        ),
        plan=True,
    ),
    Bad("plan: escape sequences", _tree({"type": _ESCAPE, "children": []}), plan=True),
    Bad(
        "plan: escape in a pose",
        _tree({"type": "Sequence", "children": [{"type": "MovePose", "pose": _ESCAPE}]}),
        plan=True,
    ),
    Bad(
        "plan: bad pose at once",
        _tree(
            {
                "type": "Parallel",
                "children": [{"type": "MovePose", "pose": "x +"}, {"type": "MeasureForces"}],
            }
        ),
        plan=True,
    ),
    Bad(
        "plan: half a surrogate",
        _file('{"parameters": [], "tree": {"type": "\\ud800"}}'),
        plan=True,
    ),
    Bad("plan: wrong types", _file('{"parameters": {}, "tree": 7}'), plan=True),
)


_LAUNCHER = """
import json, resource, subprocess, sys
code = subprocess.call(sys.argv[2:])
used = resource.getrusage(resource.RUSAGE_CHILDREN)
with open(sys.argv[1], "w") as usage:
    json.dump([code, used.ru_utime + used.ru_stime, used.ru_maxrss], usage)
"""
"""Small process in between: Linux counts the memory of the forking parent as the child's."""


def give(case: Bad, blank: Row) -> Row:
    """Give a bad input to the command line."""
    with tempfile.TemporaryDirectory() as folder:
        return _given(case, blank, Path(folder))


def _given(case: Bad, blank: Row, folder: Path) -> Row:
    path = case.make(folder)
    command = ["plan", "--scene", str(path)]
    if case.plan:
        scene = folder / "can.xml"
        scene.write_text(small_scene("can").text, encoding="utf-8")
        command = ["check", str(path), "--scene", str(scene)]
    began = time.perf_counter()
    usage = folder / "used"
    with (folder / "said").open("w+b") as said:
        launched = [sys.executable, "-c", _LAUNCHER, str(usage), *PALPATE, *command]
        process = subprocess.Popen(launched, stdout=said, stderr=said, start_new_session=True)
        watchdog = Timer(GIVE_UP, os.killpg, (process.pid, signal.SIGKILL))
        watchdog.start()
        process.wait()
        watchdog.cancel()
        seconds = time.perf_counter() - began
        said.seek(0)
        text = said.read().decode("utf-8", "replace")
    code, work, memory = -signal.SIGKILL, float(GIVE_UP), 0.0
    if usage.exists():  # the launcher of a killed process writes nothing
        code, work, kilobytes = json.loads(usage.read_text("utf-8"))
        memory = kilobytes * 1024
    found = problems(code, work, memory, text)
    beyond = [problem for problem in found if case.refused or problem != "exit 0"]
    shown = tuple(text.strip().splitlines()[-2:])
    figures = {
        "code": code,
        "seconds": round(seconds, 2),
        "cpu": round(work, 2),
        "megabytes": round(memory / 1e6),
    }
    return replace(blank, outcome=f"exit {code}", said=shown, beyond=tuple(beyond), figures=figures)


def problems(code: int, seconds: float, memory: float, text: str) -> list[str]:
    """List what is wrong with a refusal: exit status, processor time in s, bytes, output."""
    found: list[str] = []
    if code not in (2, 3):
        found.append(f"exit {code}")
    if "Traceback" in text:
        found.append("a traceback")
    if seconds > SECONDS:
        found.append(f"{seconds:.0f} s")
    if memory > MEMORY:
        found.append(f"{memory / 1e9:.1f} GB")
    if any(category(c) in ("Cc", "Cf") and c not in "\t\n\r" for c in text):
        found.append("control characters reach the terminal")
    return found
