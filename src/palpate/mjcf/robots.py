"""Root bodies of a document's robots: those that actuators drive, and those that end in a hand.

Joints alone are no evidence of a robot: cabinets and ovens have many.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from palpate.mjcf.defaults import Defaults
from palpate.mjcf.document import Element, children, elements
from palpate.mjcf.elements import has_joint, is_free, through_frames

NOBODY = "none"
"""Given in place of a body's name where nothing in the scene is a robot."""

HANDS = frozenset({"hand", "gripper", "finger", "fingers"})
"""Words of a body's name that identify the end of an arm."""


@dataclass(frozen=True, slots=True, eq=False)
class Robots:
    """Evidence that distinguishes robots from furniture.

    Attributes:
        named: root bodies of robots as the user names them; then these alone are robots.
        driven: names of joints, sites and bodies that an actuator drives.
    """

    named: tuple[str, ...]
    driven: frozenset[str]
    defaults: Defaults

    def begin_with(self, body: Element) -> bool:
        """True if a body is a robot's root: it has the robot's first joint, or is the fixed base
        of the body that has it."""
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
        return Robots(tuple(named), driven(root), self.defaults)

    def _is_robot(self, body: Element) -> bool:
        """True if a body with joints is a robot: an actuator drives a part of it, or it ends in a
        hand and is not free."""
        parts = [part for part in elements(body) if part.tag in ("joint", "site", "body")]
        if any(part.get("name") in self.driven for part in parts):
            # A drone is driven as a whole, by its site, and has no joint but a free one.
            return any(part.tag == "joint" for part in parts)
        words: set[str] = set()
        for part in parts:
            if part.tag == "body":  # whole words: a `handle` is no hand
                words |= set(re.findall(r"[A-Z]?[a-z]+|[A-Z]+", part.get("name") or ""))
        ends_in_hand = not HANDS.isdisjoint(word.lower() for word in words)
        return ends_in_hand and not is_free(body, self.defaults)


def driven(root: Element) -> frozenset[str]:
    """Names of joints, sites and bodies that an actuator drives, also through tendons."""

    def mentioned(element: Element, *attributes: str) -> set[str]:
        return {str(value) for key, value in element.items() if key in attributes}

    found: set[str] = set()
    tendons: set[str] = set()
    for section in root.iterfind("actuator"):
        for actuator in children(section):
            found |= mentioned(actuator, "joint", "jointinparent", "site", "body", "cranksite")
            tendons |= mentioned(actuator, "tendon")
    for section in root.iterfind("tendon"):
        for tendon in children(section):
            if tendon.get("name") in tendons:
                for part in children(tendon):
                    found |= mentioned(part, "joint", "site")
    return frozenset(found)
