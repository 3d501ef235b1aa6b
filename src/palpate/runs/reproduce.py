"""Command lines that repeat a run."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import replace
from operator import attrgetter
from pathlib import Path
from typing import Any, cast

from palpate.common.extensions import iter_options
from palpate.runs.settings import Settings

# Folder of the bundled scenarios, which are called by name.
BUNDLED = Path(__file__).parents[1] / "studies" / "scenarios"
POSES = "poses.yaml"  # File in a run folder with the poses that a camera saw
SCENE = ("images", "poses", "root", "robot_body", "arm")
MOTION = ("world", "robot", "robot_config", "cautious", "noise", "seed", "rehearse", "on_failure")
PLANNING = ("planner", "remeasure", "within", "model_settings")
# Options that are printed even with default values: another version may have other defaults.
ALWAYS = ("noise", "seed")


def use_seen_poses(settings: Settings, folder: Path) -> Settings:
    """Replace the poses by those that the camera saw, which the run folder keeps."""
    return settings if settings.camera is None else replace(settings, poses=folder / POSES)


def run_command(settings: Settings, start: Path | None = None) -> list[str]:
    """Build `palpate run …` of these settings, without default values; paths are relative to `start`, if given."""
    # Scene and request first, then all options with other values than the defaults.
    command = ["palpate", "run"]
    if settings.scene is not None:
        command += ["--scene", _path(settings.scene, start)]
    if settings.request is not None:
        command += ["-r", settings.request]
    if settings.measure:
        command += ["-m", ",".join(settings.measure)]
    return command + list(_options(settings, (*SCENE, *MOTION, *PLANNING), start))


def execute_command(settings: Settings, plan: Path, start: Path | None = None) -> list[str]:
    """Build `palpate execute PLAN …` in the scene of these settings."""
    command = ["palpate", "execute", _path(plan, start)]
    if settings.scene is not None:
        command += ["--scene", _path(settings.scene, start)]
    of_plan = (*SCENE[1:], *MOTION)
    return command + list(_options(settings, of_plan, start))


def reproduce_command(settings: Settings, start: Path | None = None) -> list[str]:
    """Build the command that repeats a finished run: `palpate demo` for a scenario."""
    # A scenario is repeated by its name, with the options of `demo`.
    name = scenario_of(settings)
    if name is None:
        return _add_seed(run_command(settings, start), settings)
    command = ["palpate", "demo", name]
    if not settings.planner.startswith("replay:"):
        command += ["--planner", settings.planner]
    of_demo = ("arm", "robot_config", "cautious", "within", "noise", "seed")
    return _add_seed(command + list(_options(settings, of_demo, start)), settings)


def scenario_of(settings: Settings) -> str | None:
    """Name the bundled scenario to which the scene or a picture belongs; None for other runs."""
    for file in (settings.scene, settings.poses, *settings.images):
        if file is not None and file.is_relative_to(BUNDLED):
            return file.parent.relative_to(BUNDLED).as_posix()
    return None


def _add_seed(command: list[str], settings: Settings) -> list[str]:
    """Add noise and seed of a simulated run, even with default values."""
    if settings.robot is not None:
        return command
    # Defaults may change between versions.
    for name in ALWAYS:
        if f"--{name}" not in command:
            command += [f"--{name}", str(getattr(settings, name))]
    return command


def _options(settings: Settings, names: tuple[str, ...], start: Path | None) -> Iterator[str]:
    """Yield the options with values other than the defaults; for a model, all except its budget."""
    # Compare each option with its default; a model's address is compared without user and password.
    default = type(settings)()
    for declared in iter_options(type(settings)):
        value = attrgetter(declared.name)(settings)
        nested = declared.name.rpartition(".")[0]
        if (nested or declared.name) in names and value != attrgetter(declared.name)(default):
            if declared.name == "model_settings.base_url":
                value = settings.model_settings.address
            yield from _option(declared.name, declared.flags[-1], value, start)


def _option(name: str, flag: str, value: Any, start: Path | None) -> Iterator[str]:
    if isinstance(value, bool):
        # A switch has a flag for each value.
        on, _, off = flag.partition("/")
        yield on if value else off
    elif name == "within":
        for of, width in value:
            yield from (flag, f"{of}={width}")
    elif isinstance(value, frozenset):
        yield from _option(name, flag, tuple(sorted(cast("frozenset[str]", value))), start)
    elif isinstance(value, tuple):
        for part in cast("tuple[Any, ...]", value):
            yield from _option(name, flag, part, start)
    elif isinstance(value, Path):
        yield from (flag, _path(value, start))
    elif name == "planner" and value.startswith("replay:"):
        yield from (flag, f"replay:{_path(Path(value.removeprefix('replay:')), start)}")
    else:
        yield from (flag, str(value))


def _path(file: Path, start: Path | None) -> str:
    return str(file) if start is None else os.path.relpath(file, start)
