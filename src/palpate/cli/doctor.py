"""`palpate doctor`: what is and is not available here, and what to do about it."""

from __future__ import annotations

import os
import platform
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, version

from rich.markup import escape
from rich.table import Table

from palpate import __version__
from palpate.cli.show import out

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
PROVIDERS = {
    "openai": ("openai", "OPENAI_API_KEY"),
    "google": ("google-genai", "GOOGLE_API_KEY"),
    "anthropic": ("anthropic", "ANTHROPIC_API_KEY"),
}

Line = tuple[bool, str, str]
"""Whether it is available, what it is, and its version or the remedy."""


def examine() -> int:
    """Print the table; 0 when the embedded robot and the symbolic planner can work, else 5."""
    lines = list(_lines())
    table = Table(box=None, show_header=False, pad_edge=False)
    for good, what, detail in lines:
        table.add_row("[green]✓[/]" if good else "[yellow]–[/]", what, f"[dim]{escape(detail)}[/]")
    out.print(table)
    return 0 if all(_installed(name) for name in CORE) else 5


def _lines() -> Iterator[Line]:
    system = f"Python {platform.python_version()} on {platform.system()} {platform.machine()}"
    yield True, "palpate", f"{__version__}, {system}"
    for name in CORE:
        found = _installed(name)
        yield found is not None, name, found or f"missing: pip install {name}"
    yield _pictures()
    yield True, "embedded robot", "FR3 in a MuJoCo world; needs nothing else"
    yield True, "planner symbolic", "needs no key and no network"
    for provider, (package, key) in PROVIDERS.items():
        yield _provider(provider, package, key)


def _installed(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None


def _pictures() -> Line:
    from palpate.pictures.renderer import gl_available

    good, detail = gl_available()
    return good, "pictures (OpenGL)", detail


def _provider(provider: str, package: str, key: str) -> Line:
    if _installed(package) is None:
        return False, f"planner {provider}", f"missing: pip install 'palpate[{provider}]'"
    if not os.environ.get(key):
        return False, f"planner {provider}", f"set {key} to use it"
    return True, f"planner {provider}", f"{key} is set"
