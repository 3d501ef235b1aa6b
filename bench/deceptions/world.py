"""Deceptive and innocent worlds: hidden worlds of bundled scenarios with small edits, and the verdicts
that are right in them."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Literal

from pydantic import Field

from palpate.common.errors import unknown_name
from palpate.common.files import Section
from palpate.runs.settings import Settings
from palpate.studies.scenarios.catalogue import scenario

FILE = Path(__file__).with_name("worlds.toml")

Kind = Literal["deceptive", "innocent", "not observable"]
Point = tuple[float, float, float]


class Cord(Section):
    """Cord from a point of the world to one of a body; it only pulls.

    Attributes:
        stiffness: N/m, from the length `length`, m, on.
        damping: N s/m, both ways.
    """

    anchor: Point
    body: str
    at: Point
    stiffness: float = 0.0
    length: float = 0.0
    damping: float = 0.0

    def mjcf(self) -> str:
        """MJCF of the model, without the sites at its ends."""
        return (
            f'<tendon><spatial name="cord" stiffness="{self.stiffness}" damping="{self.damping}" '
            f'springlength="0 {self.length}">{_ENDS}</spatial></tendon>'
        )


class Magnet(Section):
    """Pull on a point of a body towards one of the world: `force` N at no distance, falling linearly to
    zero at `reach` m; constant without a reach."""

    anchor: Point
    body: str
    at: Point
    force: float
    reach: float = float("inf")

    def mjcf(self) -> str:
        """MJCF of the model, without the sites at its ends."""
        slope = self.force / self.reach
        return (
            f'<tendon><spatial name="field">{_ENDS}</spatial></tendon>'
            '<actuator><general tendon="field" gainprm="0" biastype="affine" '
            f'biasprm="{-self.force} {slope} 0" forcelimited="true" forcerange="{-self.force} 0"/>'
            "</actuator>"
        )


_ENDS = '<site site="anchor"/><site site="end"/>'


class Jump(Section):
    """Jump of the sensors' zero by `force`, N at the TCP, at the share `at` of the run."""

    force: Point
    at: float


class Deception(Section):
    """A world and its truth.

    Attributes:
        base: the scenario, or the scene of `worlds.toml`, whose hidden world is edited.
        story: description of the world.
        why: reason why it is not observable.
        request: instead of the base's.
        replace: texts of the world's MJCF and their replacements.
        inside: MJCF to add to bodies, by name.
        world, root: MJCF to add to the worldbody and to the model.
        noise: keys of the noise model to override.
        truth: of parameters without a value in the MJCF, all values that are equally true.
    """

    name: str
    base: str
    story: str
    kind: Kind = "deceptive"
    why: str = ""
    request: str | None = None
    replace: tuple[tuple[str, str], ...] = ()
    inside: Mapping[str, str] = Field(default_factory=dict)
    world: str = ""
    root: str = ""
    cord: Cord | None = None
    magnet: Magnet | None = None
    jump: Jump | None = None
    noise: Mapping[str, Mapping[str, object]] = Field(default_factory=dict)
    truth: Mapping[str, tuple[tuple[float, ...], ...]] = Field(default_factory=dict)

    def edited(self, text: str) -> str:
        """Edit the base's MJCF.

        Raises:
            ValueError: a text to replace does not occur exactly once.
        """
        for old, new in self.replace:
            if text.count(old) != 1:
                raise ValueError(f"{self.name}: '{old}' stands there {text.count(old)} times")
            text = text.replace(old, new)
        for body, more in self.inside.items():
            text = _inside(text, body, more)
        text = _before(text, "</worldbody>", self.world)
        for force in (self.cord, self.magnet):
            if force is not None:
                text = _inside(text, force.body, f'<site name="end" pos="{_at(force.at)}"/>')
                anchor = f'<site name="anchor" pos="{_at(force.anchor)}"/>'
                text = _before(text, "</worldbody>", anchor)
                text = _before(text, "</mujoco>", force.mjcf())
        return _before(text, "</mujoco>", self.root)


class Base(Section):
    """A scene of `worlds.toml`: request, the user's scene, and the hidden world."""

    request: str
    scene: str
    world: str


class _Content(Section):
    base: Mapping[str, Base]
    world: tuple[Deception, ...]


@cache
def _content() -> _Content:
    return _Content.model_validate(tomllib.loads(FILE.read_text(encoding="utf-8")))


@cache
def deceptions() -> Mapping[str, Deception]:
    """All worlds, by name."""
    return MappingProxyType({world.name: world for world in _content().world})


def deception(name: str) -> Deception:
    """The world `name`.

    Raises:
        InputError: there is none; the message lists those there are.
    """
    if name not in deceptions():
        raise unknown_name("world", name, deceptions())
    return deceptions()[name]


def task(world: Deception) -> tuple[Settings, str | None, str]:
    """Settings with the world's request, the user's MJCF (None: the settings name its file), and the
    MJCF of the hidden world."""
    base = _content().base.get(world.base)
    if base is not None:
        return Settings(request=world.request or base.request), base.scene, world.edited(base.world)
    settings = scenario(world.base).settings()
    assert settings.world is not None
    text = world.edited(settings.world.read_text(encoding="utf-8"))
    return replace(settings, request=world.request or settings.request), None, text


def _inside(text: str, body: str, more: str) -> str:
    """Insert `more` at the beginning of a body, after its free joint."""
    opening = re.search(rf'<body name="{re.escape(body)}"[^>]*>\s*(<freejoint/>)?', text)
    if opening is None:
        raise ValueError(f"the world has no body '{body}'")
    return text[: opening.end()] + more + text[opening.end() :]


def _before(text: str, end: str, more: str) -> str:
    head, found, tail = text.rpartition(end)
    return head + more + found + tail


def _at(point: Point) -> str:
    return " ".join(f"{part:g}" for part in point)
