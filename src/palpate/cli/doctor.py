"""`palpate doctor`: availability of libraries, robots and models, with remedies."""

from __future__ import annotations

import os
import platform
from collections.abc import Iterable
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING, NamedTuple

from rich.markup import escape
from rich.table import Table

from palpate.cli.console import out
from palpate.common.version import __version__

if TYPE_CHECKING:
    pass


# Required distributions.
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

# Providers of models: the distribution of the client, and the environment variable of the key.
PROVIDERS = {
    "openai": ("openai", "OPENAI_API_KEY"),
    "google": ("google-genai", "GOOGLE_API_KEY"),
    "anthropic": ("anthropic", "ANTHROPIC_API_KEY"),
}

# Optional packages: purpose and distribution.
EXTRAS = {"live": ("page for --live", "viser"), "export": ("export to USD", "mujoco-usd-converter")}


class DoctorLine(NamedTuple):
    """Line of the examination: availability, subject, and version or remedy."""

    good: bool
    what: str
    detail: str


def examine() -> int:
    """Print the table. Return 0 if the embedded robot and the symbolic planner are usable, else 5."""
    from palpate.runs.tools import gl_available

    system = f"Python {platform.python_version()} on {platform.system()} {platform.machine()}"
    core = [_library(name, name, name) for name in CORE]
    lines = [
        DoctorLine(True, "palpate", f"{__version__}, {system}"),
        *core,
        DoctorLine(gl_available()[0], "pictures (OpenGL)", gl_available()[1]),
        DoctorLine(True, "embedded robot", "an arm in a MuJoCo world; needs nothing else"),
        DoctorLine(True, "planner symbolic", "needs no key and no network"),
        *(_provider(provider, *needed) for provider, needed in PROVIDERS.items()),
        *(_library(name, what, f"'palpate[{extra}]'") for extra, (what, name) in EXTRAS.items()),
    ]
    table = Table(box=None, show_header=False, pad_edge=False)
    for line in lines:
        mark = "[green]✓[/]" if line.good else "[yellow]–[/]"
        table.add_row(mark, line.what, f"[dim]{escape(line.detail)}[/]")
    out.print(table)
    return 0 if all(line.good for line in core) else 5


def print_checks(lines: Iterable[tuple[bool, str, str]]) -> int:
    """Print the lines as they arrive. Return 0 if all are good, else 5."""
    well = True
    for good, what, detail in lines:
        mark = "[green]✓[/]" if good else "[red]✗[/]"
        out.print(f"{mark} {escape(what):18} [dim]{escape(detail)}[/]", soft_wrap=True)
        well = well and good
    return 0 if well else 5


def _library(distribution: str, what: str, package: str) -> DoctorLine:
    """Installed version of a distribution, or the package that brings it."""
    try:
        return DoctorLine(True, what, version(distribution))
    except PackageNotFoundError:
        return DoctorLine(False, what, f"missing: pip install {package}")


def _provider(provider: str, distribution: str, key: str) -> DoctorLine:
    line = _library(distribution, f"planner {provider}", f"'palpate[{provider}]'")
    if not line.good:
        return line
    has_key = bool(os.environ.get(key))
    return DoctorLine(has_key, line.what, f"{key} is set" if has_key else f"set {key} to use it")
