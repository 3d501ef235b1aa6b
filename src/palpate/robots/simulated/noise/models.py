"""The noise models there are: palpate's own by name, those that other packages bring, and any
file.

`none`: perfect. `lab`: noise, residual friction and drift of the joint torque signals. `datasheet`:
`lab` and what the manufacturer's accuracy figures leave open. `hardware`: what is published of real
arms, and what their owners meet. Their files stand beside this one, every figure with its source.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path
from typing import Any, cast

import numpy as np
from pydantic import ValidationError

from palpate.errors import InputError, unknown_name
from palpate.extensions import extensions, public
from palpate.files.plain_yaml import plain_yaml, worded
from palpate.files.read import read_text
from palpate.robots.description import RobotDescription
from palpate.robots.registry import load_description
from palpate.robots.simulated.noise.model import NoiseModel

GROUP = "palpate.noise"
OWN = ("none", "lab", "datasheet", "hardware")
MAX_BYTES = 100_000
"""Largest noise model."""
MOST_BASES = 8
"""Longest chain of files that extend each other."""

Content = dict[str, Any]


@dataclass(frozen=True, slots=True)
class NoiseModels:
    """Noise models by name, or by the path of a file.

    Attributes:
        brought: those of other packages.
    """

    brought: Mapping[str, NoiseModel]

    @property
    def names(self) -> tuple[str, ...]:
        """Names that `--noise` takes in place of a file."""
        return (*OWN, *self.brought)

    def load(self, name_or_path: str, arm: RobotDescription | None = None) -> NoiseModel:
        """The model that `--noise NAME|FILE.yaml` means for an arm, by default the FR3.

        Raises:
            InputError: unknown (the message lists the names), or the file is no valid model.
        """
        if name_or_path in self.brought:
            return self.brought[name_or_path]
        if name_or_path in OWN:
            return _validated(_own(name_or_path, arm or load_description()), name_or_path)
        if not means_file(name_or_path):
            raise unknown_name("noise", name_or_path, self.names, "Or give a file: FILE.yaml")
        content = _file(Path(name_or_path), arm or load_description())
        return _validated(content, name_or_path)

    def check(self, name_or_path: str) -> None:
        """Raises InputError as `load` does."""
        self.load(name_or_path)

    def title(self, name_or_path: str) -> str:
        """Return a model's title in report and result: its name, or its file's if that cannot be
        read."""
        try:
            return self.load(name_or_path).name
        except InputError:
            return Path(name_or_path).stem


def means_file(name_or_path: str) -> bool:
    """Test if the text is a file's path, by its folder or ending; the file need not exist."""
    path = Path(name_or_path)
    return path.suffix in (".yaml", ".yml") or len(path.parts) > 1


def _validated(content: Content, where: str) -> NoiseModel:
    try:
        return NoiseModel.model_validate(content)
    except ValidationError as error:
        raise InputError(f"{where}: {worded(error, NoiseModel)}") from None


def _own(name: str, arm: RobotDescription) -> Content:
    """palpate's own noise model of an FR3, scaled by what the arm's description states."""
    path = Path(__file__).with_name(f"{name}.yaml")
    content = _merged({}, _read(path, path.stat().st_mtime_ns))
    below = content.pop("extends", None)
    if arm is not load_description():
        _scale(content, arm)
    return content if below is None else _merged(_own(str(below), arm), content)


def _file(path: Path, arm: RobotDescription, chain: tuple[Path, ...] = ()) -> Content:
    """Read a file, completed with the model that it extends."""
    if path.resolve() in chain or len(chain) >= MOST_BASES:
        raise InputError(f"{path}: extends itself, or more than {MOST_BASES} others one by one")
    content = _merged({"name": path.stem}, _content(path))
    below = content.pop("extends", None) or "none"
    if not isinstance(below, str):
        raise InputError(f"{path}: 'extends': give {', '.join(OWN)}, or another FILE.yaml")
    if below in OWN:
        return _merged(_own(below, arm), content)
    other = path.parent / below
    if not other.exists():
        raise unknown_name("noise", below, OWN, f"It is named by 'extends' in {path}.")
    return _merged(_file(other, arm, (*chain, path.resolve())), content)


def _content(path: Path) -> Content:
    version = path.stat().st_mtime_ns if path.is_file() else 0
    return _read(path, version)


@lru_cache(32)
def _read(path: Path, version: int) -> Content:
    """The keys and values in a file, which is read again when its `version` changes."""
    text = read_text(path, MAX_BYTES, "a noise model")
    content: Any = plain_yaml(text, str(path))
    if not isinstance(content, dict):
        raise InputError(f"{path}: give the keys of a noise model, e.g. 'extends: lab'")
    said = cast("dict[Any, Any]", content)
    return {str(key): value for key, value in said.items() if value is not None}


def _merged(below: Mapping[str, Any], above: Mapping[str, Any]) -> Content:
    """`below` where `above` says nothing, key by key; a fixed value is one thing."""
    merged: Content = {**below}
    for key, value in above.items():
        under = below.get(key)
        if not isinstance(under, dict) or "fixed" in under:
            under = {}
        if isinstance(value, dict) and "fixed" not in value:
            value = _merged(cast("Content", under), cast("Content", value))
        merged[key] = value
    return merged


def _scale(content: Content, arm: RobotDescription) -> None:
    """Palpate's own figures are an FR3's; another arm's are as much larger as its description
    states."""
    mine, theirs = _stated(load_description()), _stated(arm)
    for place, figure in mine.items():
        *sections, key = place.split(".")
        section = content
        for name in sections:
            section = section.get(name, {})
        if key in section:
            larger = np.array(section[key], dtype=float) * (theirs[place] / figure)
            section[key] = larger.tolist()


def _stated(arm: RobotDescription) -> dict[str, Any]:
    """The figures of a description that noise models have too."""
    sensors, stated = arm.sensors, arm.accuracy
    return {
        "datasheet.torque_gain_max": stated.torque_gain,
        "torque.white": sensors.torque_noise,
        "torque.drift.size": sensors.drift,
        "torque.gain_max": stated.torque_gain,
        "torque.range": arm.limits.tau_max,
        "friction.coulomb": sensors.friction,
        "sticking.force": stated.force_repeatability,
        "model.link_mass": sensors.link_mass,
        "model.link_com": sensors.link_com,
        "model.tip_offset": stated.tip_offset_std,
        "pose.repeatability": stated.pose_repeatability,
    }


@cache
def noise_models() -> NoiseModels:
    """Palpate's own noise models, and every public `NoiseModel` of the modules in the entry-point
    group `palpate.noise`. Palpate's own names cannot be taken.

    Raises:
        InputError: an entry point's module cannot be loaded; the message names it.
    """
    found: dict[str, NoiseModel] = {}
    for module in extensions(GROUP):
        for thing in public(module):
            if isinstance(thing, NoiseModel) and thing.name not in OWN:
                found.setdefault(thing.name, thing)
    return NoiseModels(found)
