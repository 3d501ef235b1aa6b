"""The command that does the same again."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

if TYPE_CHECKING:
    from palpate.settings import Settings

BUNDLED = Path(__file__).parents[1] / "scenarios"
"""The scenarios that come with palpate go by name."""
SCENE = ("poses", "root", "robot_body", "arm")
MOTION = ("world", "robot", "robot_config", "cautious", "noise", "seed", "rehearse", "on_failure")
PLANNING = ("remeasure", "within")
ALWAYS = ("noise", "seed")
"""Said even where they are as they are by default: another version may have others."""


def running(settings: Settings, start: Path | None = None) -> list[str]:
    """`palpate run …` of these settings, where only what is not the default is said.

    Args:
        start: folder that paths are relative to; None leaves them as they are.
    """
    command = ["palpate", "run"]
    if settings.scene is not None:
        command += ["--scene", _path(settings.scene, start)]
    if settings.request is not None:
        command += ["-r", settings.request]
    for image in settings.images:
        command += ["--image", _path(image, start)]
    if settings.planner != "symbolic":
        command += ["--planner", _planner(settings.planner, start), *_asking(settings)]
    return command + list(_options(settings, (*SCENE, *MOTION, *PLANNING), start))


def executing(settings: Settings, plan: Path, start: Path | None = None) -> list[str]:
    """`palpate execute PLAN …` in the scene of these settings."""
    command = ["palpate", "execute", _path(plan, start)]
    if settings.scene is not None:
        command += ["--scene", _path(settings.scene, start)]
    return command + list(_options(settings, (*SCENE, *MOTION), start))


def reproducing(settings: Settings, start: Path | None = None) -> list[str]:
    """Command that repeats a finished run: `palpate demo` for a scenario."""
    name = scenario_of(settings)
    if name is None:
        return _seeded(running(settings, start), settings)
    command = ["palpate", "demo", name]
    if not settings.planner.startswith("replay:"):
        command += ["--planner", settings.planner]
    of_demo = ("arm", "robot_config", "cautious", "within", "noise", "seed")
    return _seeded(command + list(_options(settings, of_demo, start)), settings)


def scenario_of(settings: Settings) -> str | None:
    """The bundled scenario whose scene it is, or whose picture."""
    for file in (settings.scene, settings.poses, *settings.images):
        if file is not None and file.is_relative_to(BUNDLED):
            return file.parent.relative_to(BUNDLED).as_posix()
    return None


def _seeded(command: list[str], settings: Settings) -> list[str]:
    """With noise and seed of a simulated run, whatever the defaults are."""
    if settings.robot is not None:
        return command
    for name in ALWAYS:
        if f"--{name}" not in command:
            command += [f"--{name}", str(getattr(settings, name))]
    return command


def _options(settings: Settings, names: tuple[str, ...], start: Path | None) -> Iterator[str]:
    """Options whose values are not the defaults."""
    for field in fields(settings):
        value = getattr(settings, field.name)
        default = type(settings)()
        if field.name in names and value != getattr(default, field.name):
            yield from _option(field.name, value, start)


def _option(name: str, value: Any, start: Path | None) -> Iterator[str]:
    flag = "--" + name.replace("_", "-")
    if isinstance(value, bool):
        yield flag if value else f"--no-{name}"
    elif name == "within":
        for of, width in value:
            yield from (flag, f"{of}={width}")
    elif isinstance(value, tuple):
        for part in cast("tuple[str, ...]", value):
            yield from (flag, part)
    elif isinstance(value, Path):
        yield from (flag, _path(value, start))
    else:
        yield from (flag, str(value))


def _planner(planner: str, start: Path | None) -> str:
    kind, colon, file = planner.partition(":")
    return kind + colon + _path(Path(file), start) if kind == "replay" else planner


def _asking(settings: Settings) -> Iterator[str]:
    """Options of the model, without its budget."""
    asking = settings.model_settings
    if asking.base_url is not None:
        yield from ("--base-url", asking.base_url)
    if asking.native:
        yield "--native"
    for module in sorted(asking.without):
        yield from ("--without", module)


def _path(file: Path, start: Path | None) -> str:
    return str(file) if start is None else os.path.relpath(file, start)
