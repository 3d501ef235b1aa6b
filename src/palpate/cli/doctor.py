"""`palpate doctor`: what is and is not available here, and what to do about it."""

from __future__ import annotations

import os
import platform
from collections.abc import Callable, Iterable, Iterator
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING, NamedTuple

from rich.markup import escape
from rich.table import Table

from palpate import __version__
from palpate.cli.console import out

if TYPE_CHECKING:
    from palpate.planning.model.settings import ModelSettings
    from palpate.settings import Settings

CORE = (
    "mujoco",
    "mink",
    "py_trees",
    "pydantic",
    "lxml",
    "scipy",
    "plotly",
    "mcap",
    "imageio-ffmpeg",
)
"""Required distributions."""

PROVIDERS = {
    "openai": ("openai", "OPENAI_API_KEY"),
    "google": ("google-genai", "GOOGLE_API_KEY"),
    "anthropic": ("anthropic", "ANTHROPIC_API_KEY"),
}
"""Models' providers: the distribution of the client, and the environment variable of the key."""

EXTRAS = {
    "live": ("page for --live", "viser"),
    "groot": ("Groot2 for --groot", "pyzmq"),
    "export": ("export to USD", "mujoco-usd-converter"),
}
"""Optional packages: purpose and distribution."""


class Line(NamedTuple):
    """Line of the examination: available or not, subject, and version or remedy."""

    good: bool
    what: str
    detail: str


def examine() -> int:
    """Print the table; return 0 if the embedded robot and the symbolic planner can work, else 5."""
    core = [_core(name) for name in CORE]
    table = Table(box=None, show_header=False, pad_edge=False)
    for line in (_palpate(), *core, _pictures(), *_robots_and_planners(), *_extras()):
        mark = "[green]✓[/]" if line.good else "[yellow]–[/]"
        table.add_row(mark, line.what, f"[dim]{escape(line.detail)}[/]")
    out.print(table)
    return 0 if all(line.good for line in core) else 5


def examine_robot(asked: Settings, may_hold: Callable[[], bool]) -> int:
    """Print a line for each requirement of a real robot; return 0 if all are met, else 5."""
    from palpate.tools import examined

    return _told(examined(asked, may_hold))


def examine_planner(planner: str, model: ModelSettings) -> int:
    """Print a line for each requirement of a planner, whose server is asked for its models and for a
    word; return 0 if all are met, else 5."""
    from palpate.tools import examined_planner

    return _told(examined_planner(planner, model.base_url, model.budget.seconds))


def _told(lines: Iterable[tuple[bool, str, str]]) -> int:
    """Print the lines as they come; return 0 if all are good, else 5."""
    well = True
    for good, what, detail in lines:
        mark = "[green]✓[/]" if good else "[red]✗[/]"
        out.print(f"{mark} {escape(what):18} [dim]{escape(detail)}[/]", soft_wrap=True)
        well = well and good
    return 0 if well else 5


def _palpate() -> Line:
    system = f"Python {platform.python_version()} on {platform.system()} {platform.machine()}"
    return Line(True, "palpate", f"{__version__}, {system}")


def _core(name: str) -> Line:
    found = _installed(name)
    if found is None:
        return Line(False, name, f"missing: pip install {name}")
    return Line(True, name, found)


def _pictures() -> Line:
    from palpate.tools import pictures

    good, detail = pictures()
    return Line(good, "pictures (OpenGL)", detail)


def _robots_and_planners() -> Iterator[Line]:
    yield Line(True, "embedded robot", "an arm in a MuJoCo world; needs nothing else")
    yield Line(True, "planner symbolic", "needs no key and no network")
    for provider, (distribution, key) in PROVIDERS.items():
        yield _provider(provider, distribution, key)


def _provider(provider: str, distribution: str, key: str) -> Line:
    what = f"planner {provider}"
    if _installed(distribution) is None:
        return Line(False, what, f"missing: pip install 'palpate[{provider}]'")
    if not os.environ.get(key):
        return Line(False, what, f"set {key} to use it")
    return Line(True, what, f"{key} is set")


def _extras() -> Iterator[Line]:
    for extra, (what, distribution) in EXTRAS.items():
        found = _installed(distribution)
        yield Line(bool(found), what, found or f"missing: pip install 'palpate[{extra}]'")


def _installed(distribution: str) -> str | None:
    """Its version."""
    try:
        return version(distribution)
    except PackageNotFoundError:
        return None
