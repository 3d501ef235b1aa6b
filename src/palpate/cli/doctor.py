"""`palpate doctor`: availability of libraries, robots and models, with remedies."""

from __future__ import annotations

import os
import platform
from collections.abc import Callable, Iterable, Iterator
from importlib.metadata import PackageNotFoundError, version
from typing import NamedTuple

from rich.markup import escape
from rich.table import Table

from palpate.cli.console import out
from palpate.common.version import __version__
from palpate.planning.model.settings import ModelSettings
from palpate.runs.settings import Settings

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
"""Providers of models: the distribution of the client, and the environment variable of the key."""

EXTRAS = {
    "live": ("page for --live", "viser"),
    "export": ("export to USD", "mujoco-usd-converter"),
}
"""Optional packages: purpose and distribution."""


class DoctorLine(NamedTuple):
    """Line of the examination: availability, subject, and version or remedy."""

    good: bool
    what: str
    detail: str


def examine() -> int:
    """Print the table. Return 0 if the embedded robot and the symbolic planner are usable, else
    5."""
    core = [_core(name) for name in CORE]
    table = Table(box=None, show_header=False, pad_edge=False)
    for line in (_palpate(), *core, _pictures(), *_robots_and_planners(), *_extras()):
        mark = "[green]✓[/]" if line.good else "[yellow]–[/]"
        table.add_row(mark, line.what, f"[dim]{escape(line.detail)}[/]")
    out.print(table)
    return 0 if all(line.good for line in core) else 5


def examine_robot(asked: Settings, may_hold: Callable[[], bool]) -> int:
    """Print a line for each requirement of a real robot. Return 0 if all are met, else 5."""
    from palpate.runs.tools import examine_real_robot

    return _print_checks(examine_real_robot(asked, may_hold))


def examine_planner(planner: str, model: ModelSettings) -> int:
    """Print a line for each requirement of a planner. Return 0 if all are met, else 5.

    The planner's server is asked for its models and for a word.
    """
    from palpate.runs.tools import examined_planner

    return _print_checks(examined_planner(planner, model.base_url, model.budget.seconds))


def _print_checks(lines: Iterable[tuple[bool, str, str]]) -> int:
    """Print the lines as they arrive. Return 0 if all are good, else 5."""
    well = True
    for good, what, detail in lines:
        mark = "[green]✓[/]" if good else "[red]✗[/]"
        out.print(f"{mark} {escape(what):18} [dim]{escape(detail)}[/]", soft_wrap=True)
        well = well and good
    return 0 if well else 5


def _palpate() -> DoctorLine:
    system = f"Python {platform.python_version()} on {platform.system()} {platform.machine()}"
    return DoctorLine(True, "palpate", f"{__version__}, {system}")


def _core(name: str) -> DoctorLine:
    found = _installed_version(name)
    if found is None:
        return DoctorLine(False, name, f"missing: pip install {name}")
    return DoctorLine(True, name, found)


def _pictures() -> DoctorLine:
    from palpate.runs.tools import pictures

    good, detail = pictures()
    return DoctorLine(good, "pictures (OpenGL)", detail)


def _robots_and_planners() -> Iterator[DoctorLine]:
    yield DoctorLine(True, "embedded robot", "an arm in a MuJoCo world; needs nothing else")
    yield DoctorLine(True, "planner symbolic", "needs no key and no network")
    for provider, (distribution, key) in PROVIDERS.items():
        yield _provider(provider, distribution, key)


def _provider(provider: str, distribution: str, key: str) -> DoctorLine:
    what = f"planner {provider}"
    if _installed_version(distribution) is None:
        return DoctorLine(False, what, f"missing: pip install 'palpate[{provider}]'")
    if not os.environ.get(key):
        return DoctorLine(False, what, f"set {key} to use it")
    return DoctorLine(True, what, f"{key} is set")


def _extras() -> Iterator[DoctorLine]:
    for extra, (what, distribution) in EXTRAS.items():
        found = _installed_version(distribution)
        yield DoctorLine(bool(found), what, found or f"missing: pip install 'palpate[{extra}]'")


def _installed_version(distribution: str) -> str | None:
    """Installed version of a distribution; None if it is missing."""
    try:
        return version(distribution)
    except PackageNotFoundError:
        return None
