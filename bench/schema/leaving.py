"""Remove some values of a complete scene, and write it in one of many styles."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from random import Random
from xml.sax.saxutils import escape

from lxml import etree

Element = etree._Element


def opened(root: Element, random: Random) -> tuple[Element, set[str]]:
    """Remove some values, or write them `?`; return the scene and their names, `thing_0.mass`."""
    root = copy.deepcopy(root)
    opened: set[str] = set()
    for body in root.iter("body", "geom"):
        name = body.get("name") or ""
        if name.startswith("thing_") and body.tag == "body":
            for quantity, leave in _OF_THINGS.items():
                if random.random() < 0.4 and leave(body, random):
                    opened.add(f"{name}.{quantity}")
        if name.startswith("stand_") and random.random() < 0.5 and _height(body, random):
            opened.add(f"{name}.height")
    return root, opened


def _geoms(body: Element) -> list[Element]:
    return list(body.iter("geom"))


def _touching(body: Element) -> list[Element]:
    """Geoms that may collide; in doubt they do."""
    off = ("contype", "conaffinity")
    return [g for g in _geoms(body) if any(g.get(which, "1").strip() != "0" for which in off)]


def _mass(body: Element, random: Random) -> bool:
    inertial = body.find("inertial")
    if inertial is not None:
        if "mass" not in inertial.attrib:
            return False
        inertial.set("mass", "?")
        return True
    if next(body.iter("replicate"), None) is not None or body.find(".//inertial") is not None:
        return False
    for geom in _geoms(body):
        geom.attrib.pop("density", None)
        geom.set("mass", "?")
    return True


def _friction(body: Element, random: Random) -> bool:
    geoms = _touching(body)
    if not geoms or next(body.iter("replicate"), None) is not None:
        return False
    entire = random.random() < 0.3
    for geom in geoms:
        rest = geom.get("friction", "1 .005 .0001").split()[1:]
        geom.set("friction", "?" if entire else " ".join(["?", *rest]))
    return True


def _position(body: Element, random: Random) -> bool:
    parent = body.getparent()
    numbers = body.get("pos", "").split()
    if parent is None or parent.tag != "worldbody" or len(numbers) != 3:
        return False
    body.set("pos", f"? ? {numbers[2]}")
    return True


def _com(body: Element, random: Random) -> bool:
    inertial = body.find("inertial")
    if inertial is None or "pos" not in inertial.attrib or body.find(".//body") is not None:
        return False
    inertial.set("pos", random.choice(["?", "? ? ?"]))
    return True


def _inertia(body: Element, random: Random) -> bool:
    inertial = body.find("inertial")
    if inertial is None or body.find(".//body") is not None:
        return False
    for attribute, count in (("diaginertia", 3), ("fullinertia", 6)):
        if attribute in inertial.attrib:
            inertial.set(attribute, " ".join(["?"] * count))
            return True
    return False


_OF_THINGS = {
    "mass": _mass,
    "friction": _friction,
    "position": _position,
    "com": _com,
    "inertia": _inertia,
}


def _height(stand: Element, random: Random) -> bool:
    geoms = _geoms(stand)
    parent = stand.getparent()
    if len(geoms) != 1 or parent is None or parent.tag != "worldbody":
        return False
    geom = geoms[0]
    if set(geom.attrib) & {"fromto", "quat", "euler", "axisangle", "xyaxes", "zaxis"}:
        return False
    if random.random() < 0.5:
        numbers = geom.get("size", "").split()
        geom.set("size", " ".join([*numbers[:2], "?"]))
    else:
        numbers = stand.get("pos", "").split()
        stand.set("pos", " ".join([*numbers[:2], "?"]))
    return True


def written(root: Element, random: Random) -> str:
    """The file's text, in a random style: order, quotes, white space, comments, line ends."""
    text = "".join(_written(root, random, 0))
    if random.random() < 0.5:
        text = f'<?xml version="1.0" encoding="utf-8"?>\n<!-- ünder test: "?" & \'<>\' -->\n{text}'
    if random.random() < 0.2:
        text = text.replace("\n", "\r\n")
    return text + random.choice(["", "\n", "\n\n"])


def _written(element: Element, random: Random, depth: int) -> Iterator[str]:
    line = "\n" + random.choice(["  ", "\t", "    "]) * depth if random.random() < 0.95 else ""
    yield line if depth else ""
    if random.random() < 0.05:
        yield f"<!-- {random.choice(['mass', 'a > b', 'é'])} -->{line}"
    yield f"<{element.tag}"
    attributes = list(element.items())
    random.shuffle(attributes)
    for name, value in attributes:
        yield f"{random.choice([' ', ' ', ' ', '  ', line or ' '])}{name}"
        yield random.choice(["=", "=", "=", " = "])
        yield _quoted(str(value), random)
    if not len(element) and random.random() < 0.8:
        yield random.choice(["/>", " />"])
        return
    yield ">"
    for child in element:
        yield from _written(child, random, depth + 1)
    yield f"{line}</{element.tag}{random.choice(['', '', ' '])}>"


def _quoted(value: str, random: Random) -> str:
    quote = random.choice(['"', '"', "'"])
    text = escape(value, {'"': "&quot;", "'": "&apos;"})
    if value and random.random() < 0.1:
        text = f"{random.choice([' ', '  '])}{text} " if " " in value else text
    return f"{quote}{text}{quote}"
