"""Root bodies of a document's robots: those that actuators drive, and those that end in a hand.

Joints alone make no robot: cabinets and ovens have many.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from palpate.mjcf.defaults import Defaults
from palpate.mjcf.document import Element, children, elements

NOBODY = "none"
"""Said instead of a body's name where nothing in the scene is a robot."""

HANDS = frozenset({"hand", "gripper", "finger", "fingers"})
"""Words of a body's name that say that an arm ends there."""

TRANSPARENT = ("frame", "replicate")
"""Elements that only arrange those inside them."""

_JOINTS = ("joint", "freejoint")


@dataclass(frozen=True, slots=True, eq=False)
class Robots:
    """Evidence that distinguishes robots from furniture.

    Attributes:
        named: bodies that somebody said robots begin with; these alone are robots then.
        driven: names of joints, sites and bodies that an actuator drives.
    """

    named: tuple[str, ...]
    driven: frozenset[str]
    defaults: Defaults

    def begin_with(self, body: Element) -> bool:
        """True if a robot begins here: with its first joint, or with the fixed base that carries
        that."""
        if self.named:
            return body.get("name") in self.named
        if has_joint(body):
            return self._is_robot(body)
        moving = (c for c in through_frames(body) if c.tag == "body" and has_joint(c))
        return any(self._is_robot(child) for child in moving)

    def within(self, prefix: str, root: Element) -> Robots:
        """Robots of an attached model, `root`, whose names have a prefix in the scene."""
        named = [name.removeprefix(prefix) for name in self.named if name.startswith(prefix)]
        if self.named and not named:
            named = [NOBODY]
        return Robots(tuple(named), _driven(root), self.defaults)

    def _is_robot(self, body: Element) -> bool:
        """True if a body with joints is one: an actuator drives a part of it, or it ends in a hand
        and is held by something. A thing that is driven as a whole, by its site, is none."""
        parts = [part for part in elements(body) if part.tag in _PARTS]
        if self._drives(parts):
            return any(part.tag == "joint" for part in parts)
        return _ends_in_hand(parts) and not is_free(body, self.defaults)

    def _drives(self, parts: Sequence[Element]) -> bool:
        return any(part.get("name") in self.driven for part in parts)


_PARTS = ("joint", "site", "body")
"""Whatever an actuator may drive of a body."""


def find_robots(root: Element, named: Sequence[str], defaults: Defaults) -> Robots:
    """Find the evidence for robots in a document; `named` as in `Robots`."""
    return Robots(tuple(named), _driven(root), defaults)


def is_free(body: Element, defaults: Defaults) -> bool:
    """True if nothing holds a body."""
    for child in through_frames(body):
        is_free = child.tag == "joint" and defaults.attribute(child, "type") == "free"
        if is_free or child.tag == "freejoint":
            return True
    return False


def has_joint(body: Element) -> bool:
    """True if a body has a joint of its own."""
    return any(child.tag in _JOINTS for child in through_frames(body))


def through_frames(body: Element) -> Iterator[Element]:
    """A body's children, those in frames among them."""
    for child in children(body):
        if child.tag in TRANSPARENT:
            yield from through_frames(child)
        else:
            yield child


def copy_mark(element: Element) -> str:
    """Suffix of MuJoCo for names in the first copy that `<replicate>` makes of an element; suffixes
    of outer ones come last."""
    mark = ""
    for replicate in element.iterancestors("replicate"):
        mark += (replicate.get("sep") or "") + "0" * len((replicate.get("count") or "").strip())
    return mark


def _ends_in_hand(parts: Sequence[Element]) -> bool:
    return any(part.tag == "body" and _is_hand(part) for part in parts)


def _is_hand(body: Element) -> bool:
    """True if a body is called a hand; `handle` is none."""
    words = re.findall(r"[A-Z]?[a-z]+|[A-Z]+", body.get("name") or "")
    return any(word.lower() in HANDS for word in words)


def _driven(root: Element) -> frozenset[str]:
    """Names of joints, sites and bodies that an actuator drives, tendons followed."""
    driven: set[str] = set()
    tendons: set[str] = set()
    for actuator in _entries(root, "actuator"):
        driven |= _mentioned(actuator, ("joint", "jointinparent", "site", "body", "cranksite"))
        tendons |= _mentioned(actuator, ("tendon",))
    for tendon in _entries(root, "tendon"):
        if tendon.get("name") in tendons:
            for part in children(tendon):
                driven |= _mentioned(part, ("joint", "site"))
    return frozenset(driven)


def _entries(root: Element, section: str) -> Iterator[Element]:
    for part in root.iterfind(section):
        yield from children(part)


def _mentioned(element: Element, attributes: tuple[str, ...]) -> set[str]:
    return {str(value) for key, value in element.items() if key in attributes}
