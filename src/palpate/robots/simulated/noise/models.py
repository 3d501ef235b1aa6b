"""Registry of noise models: palpate's own levels, models of other packages, and files."""

from __future__ import annotations

from functools import cache, lru_cache
from pathlib import Path
from typing import Any, cast

import numpy as np
from pydantic import ValidationError

from palpate.common.errors import InputError, unknown_name
from palpate.common.extensions import Registry, iter_entry_points
from palpate.common.files import describe_error, plain_yaml, read_text
from palpate.robots.description import RobotDescription
from palpate.robots.noise_levels import LEVELS
from palpate.robots.owner import load_description
from palpate.robots.sheet import merge_sections
from palpate.robots.simulated.noise.model import NoiseModel

GROUP = "palpate.noise"
MAX_BYTES = 100_000  # largest noise model
FR3_JOINTS, UPPER_ARM = 7, 2  # joints, and the index of the one that arms with six joints lack
MOST_BASES = 8  # longest chain of files that extend each other

Content = dict[str, Any]


class NoiseModels(Registry[NoiseModel]):
    """Noise models of other packages by name; palpate's own are read from files for an arm."""

    kind = "noise"

    @property
    def names(self) -> tuple[str, ...]:
        """Names that `--noise` takes in place of a file."""
        return (*LEVELS, *self)

    def load(self, name_or_path: str, arm: RobotDescription | None = None) -> NoiseModel:
        """Load the model of `--noise NAME|FILE.yaml` for an arm, by default the FR3.

        Raises InputError: unknown (the message lists the names), or the file is no valid model.
        """
        arm = arm or load_description()
        count = len(arm.joints)
        if name_or_path in self:
            model = self[name_or_path]
            if len(model.torque.white) != count:
                raise InputError(
                    f"the noise model '{name_or_path}' is for {len(model.torque.white)} joints, and "
                    f"'{arm.name}' has {count}; give one of {', '.join(LEVELS)}, or a FILE.yaml"
                )
            return model
        if name_or_path in LEVELS:
            content = own_content(name_or_path, arm)
        elif means_file(name_or_path):
            content = file_content(Path(name_or_path), arm)
        else:
            raise unknown_name("noise", name_or_path, self.names, "Or give a file: FILE.yaml")
        try:
            return NoiseModel.model_validate(content, context={"joints": count})
        except ValidationError as error:
            raise InputError(f"{name_or_path}: {describe_error(error, NoiseModel)}") from None

    def title(self, name_or_path: str) -> str:
        """Return a model's title in report and result: its name, or the file's if it is invalid."""
        try:
            return self.load(name_or_path).name
        except InputError:
            return Path(name_or_path).stem


def means_file(name_or_path: str) -> bool:
    """Test if the text is a file's path, by its folder or ending; the file need not exist."""
    path = Path(name_or_path)
    return path.suffix in (".yaml", ".yml") or len(path.parts) > 1


def own_content(name: str, arm: RobotDescription) -> Content:
    """Read palpate's own noise model of an FR3, scaled to the figures of the arm's description."""
    content = merge_sections({}, content_of(Path(__file__).with_name(f"{name}.yaml")))
    below = content.pop("extends", None)
    if arm is not load_description():
        scale(content, arm)
    return content if below is None else merge_sections(own_content(str(below), arm), content)


def file_content(path: Path, arm: RobotDescription, chain: tuple[Path, ...] = ()) -> Content:
    """Read a file, completed with the model that it extends."""
    if path.resolve() in chain or len(chain) >= MOST_BASES:
        raise InputError(f"{path}: extends itself, or more than {MOST_BASES} others one by one")
    content = merge_sections({"name": path.stem}, content_of(path))
    below = content.pop("extends", None) or "none"
    if not isinstance(below, str):
        raise InputError(f"{path}: 'extends': give {', '.join(LEVELS)}, or another FILE.yaml")
    if below in LEVELS:
        return merge_sections(own_content(below, arm), content)
    other = path.parent / below
    if not other.exists():
        raise unknown_name("noise", below, LEVELS, f"It is named by 'extends' in {path}.")
    return merge_sections(file_content(other, arm, (*chain, path.resolve())), content)


def content_of(path: Path) -> Content:
    """Read the keys and values of a file; a change of the file is noticed by its time."""
    return _read(path, path.stat().st_mtime_ns if path.is_file() else 0)


@lru_cache(32)
def _read(path: Path, version: int) -> Content:
    content: Any = plain_yaml(read_text(path, MAX_BYTES, "a noise model"), str(path))
    if not isinstance(content, dict):
        raise InputError(f"{path}: give the keys of a noise model, e.g. 'extends: lab'")
    said = cast("dict[Any, Any]", content)
    return {str(key): value for key, value in said.items() if value is not None}


def scale(content: Content, arm: RobotDescription) -> None:
    """Scale figures of an FR3 in place by the ratio of an arm's stated figures to the FR3's.

    An arm with six joints takes the figures of the FR3's joints but the turn of its upper arm.
    """
    if len(arm.joints) < FR3_JOINTS:
        omit_joint(content)
    mine, theirs = stated_figures(load_description()), stated_figures(arm)
    for place, figure in mine.items():
        *sections, key = place.split(".")
        section = content
        for name in sections:
            section = section.get(name, {})
        if key in section:
            own = (
                np.delete(figure, UPPER_ARM) if np.size(figure) > np.size(theirs[place]) else figure
            )
            larger = np.array(section[key], dtype=float) * (theirs[place] / own)
            section[key] = larger.tolist()


def omit_joint(content: Content) -> None:
    """Remove the figure of the FR3's upper arm from the lists of a section and of those in it, in place."""
    for key, value in content.items():
        if isinstance(value, dict):
            omit_joint(cast("Content", value))
        elif isinstance(value, list) and len(each := cast("list[Any]", value)) == FR3_JOINTS:
            content[key] = [*each[:UPPER_ARM], *each[UPPER_ARM + 1 :]]


def stated_figures(arm: RobotDescription) -> dict[str, Any]:
    """Return the figures of a description that noise models have too, by their keys in a noise model."""
    sensors, accuracy = arm.sensors, arm.accuracy
    return {
        "datasheet.torque_gain_max": accuracy.torque_gain,
        "torque.white": sensors.torque_noise,
        "torque.drift.size": sensors.drift,
        "torque.gain_max": accuracy.torque_gain,
        "torque.range": arm.limits.tau_max,
        "friction.coulomb": sensors.friction,
        "sticking.force": accuracy.force_repeatability,
        "model.link_mass": sensors.link_mass,
        "model.link_com": sensors.link_com,
        "model.tip_offset": accuracy.tip_offset_std,
        "pose.repeatability": accuracy.pose_repeatability,
    }


@cache
def noise_models() -> NoiseModels:
    """Return palpate's own noise models, and every public `NoiseModel` of the modules in the entry-point
    group `palpate.noise`.

    Palpate's own names cannot be replaced.
    """
    models = (part for part in iter_entry_points(GROUP) if isinstance(part, NoiseModel))
    return NoiseModels([(model.name, model) for model in models if model.name not in LEVELS])
