"""MJCF defaults classes, and the elements of an object, a surface or a fixture."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Literal

from palpate.common.errors import InputError
from palpate.mjcf.document import (
    UNKNOWN,
    Element,
    children,
    compiler_settings,
    has_unknown,
    iter_ancestors,
    label,
    tokens,
)
from palpate.mjcf.edits import Edit

# MuJoCo's default sliding, torsional and rolling friction.
MUJOCO_FRICTION = ("1", "0.005", "0.0001")
# MuJoCo's default friction of a `<pair>`: sliding along two axes, torsional, rolling about two
# axes.
MUJOCO_PAIR_FRICTION = "1 1 0.005 0.0001 0.0001"
# Attributes of geoms that a defaults class may leave open. Once every element has its own value,
# these numbers replace the `?`, or the attribute is removed (None).
INHERITED: Mapping[str, tuple[str, ...] | None] = {
    "mass": None,
    "density": None,
    "friction": MUJOCO_FRICTION,
}
# Numbers in place of a `?` while models are compiled. Without them an outer class would apply.
STAND_INS: Mapping[str, tuple[str, ...]] = {
    "mass": ("1",),
    "density": ("1000",),
    "friction": MUJOCO_FRICTION,
}


def replace_unknowns(
    element: Element, values: Mapping[str, tuple[str, ...] | None]
) -> Iterator[Edit]:
    """Yield the changes that replace each `?` in an element's inherited attributes by its number in `values`,
    or remove the attribute (None).
    """
    # The last number serves all further positions.
    for attribute, numbers in values.items():
        parts = tokens(element.get(attribute))
        unknown = [i for i, part in enumerate(parts) if part == UNKNOWN]
        if unknown and numbers is None:
            yield Edit(element, attribute, None)
        elif unknown and numbers is not None:
            yield Edit(element, attribute, {i: numbers[min(i, len(numbers) - 1)] for i in unknown})


class Defaults:
    """The `<default>` classes of a document and of each model that it attaches."""

    def __init__(self, root: Element, *attached: Element) -> None:
        # For each class of a model, its `<default>` elements, the outermost first.
        self._models: dict[Element, dict[str, list[Element]]] = {}
        for model in (root, *attached):
            classes = self._models[model] = {}
            pending = [(top, [top]) for top in model.iterfind("default")]
            while pending:
                default, chain = pending.pop(0)
                classes.setdefault(default.get("class") or "main", []).extend(chain)
                inner = [(child, [*chain, child]) for child in default.iterfind("default")]
                pending = [*inner, *pending]
        self._only = None if attached else root

    def attribute(self, element: Element, name: str) -> str | None:
        """Return the attribute with defaults applied, or None if it is stated nowhere."""
        own = element.get(name)
        if own is not None:
            return own
        # Its own class, else the `childclass` of the nearest ancestor, else the top class.
        outer = element.iterancestors("body", "frame", "worldbody")
        called = element.get("class")
        called = called or next((c for above in outer if (c := above.get("childclass"))), None)
        root = element.getroottree().getroot() if self._only is None else self._only
        if called is None:
            top = root.find("default")
            called = "" if top is None else top.get("class") or "main"
        # The innermost class that states the attribute decides.
        for default in reversed(self._models[root].get(called, [])):
            for entry in default.iterfind(str(element.tag)):
                inherited = entry.get(name)
                if inherited is not None:
                    return inherited
        return None


# Elements of an object, a surface or a fixture: its body, its relevant geoms, its `<inertial>`.


Role = Literal["object", "surface", "fixture"]
# Attributes that place a body, a frame or a site.
PLACING = frozenset({"pos", "quat", "axisangle", "xyaxes", "zaxis", "euler"})
TRANSPARENT = ("frame", "replicate")  # Elements that only arrange their content


@dataclass(frozen=True, slots=True, eq=False)
class Elements:
    """The elements of an object, a surface or a fixture."""

    name: str  # its compiled name; with several copies, that of the first, which represents all
    role: Role
    element: Element  # its body; for a surface in the worldbody, its geom
    # All geoms of its body and of bodies fixed to it; for a surface, those that may carry.
    geoms: tuple[Element, ...]
    colliding: tuple[Element, ...]  # the geoms that can collide, else all
    inertial: Element | None  # its `<inertial>`, if any
    defaults: Defaults  # defaults classes of its elements
    parts: tuple[Element, ...] = ()  # an object's other bodies, which move with it
    # The `<attach>` elements that bring it from another model, the outermost first.
    attachments: tuple[Element, ...] = ()
    joint: Element | None = None  # a fixture's `<joint>`

    def posed_ancestor(self) -> Element | None:
        """Find the nearest ancestor with a pose, so that the element's own pose is not the world's."""
        for outer in iter_ancestors(self.element, self.attachments):
            moves = outer.tag == "replicate" or PLACING & set(outer.keys())
            if outer.tag in (*TRANSPARENT, "body") and moves:
                return outer
        return None


def inertial_of(body: Element) -> Element | None:
    """Return a body's `<inertial>`, unless the compiler ignores it (`inertiafromgeom`)."""
    settings = compiler_settings(body.getroottree().getroot())
    if settings.get("inertiafromgeom") == "true":
        return None
    return body.find("inertial")


def has_open_height(geom: Element, defaults: Defaults) -> bool:
    """Test if the z or the half height of a geom is `?`."""
    index = half_height_index(geom, defaults)
    open_size = index is not None and has_unknown(geom, "size", index)
    return open_size or has_unknown(geom, "pos", 2)


def half_height_index(geom: Element, defaults: Defaults) -> int | None:
    """Return the index of the half height in `size`: box 2, cylinder 1, others None."""
    return {"box": 2, "cylinder": 1}.get(defaults.attribute(geom, "type") or "sphere")


def colliding(geoms: tuple[Element, ...], defaults: Defaults) -> tuple[Element, ...]:
    """Return the geoms that can collide (`contype` or `conaffinity` not 0); all geoms if none can."""
    # An absent mask has MuJoCo's default, 1.
    touching: list[Element] = []
    for geom in geoms:
        masks = [defaults.attribute(geom, name) or "1" for name in ("contype", "conaffinity")]
        if any(mask.strip() != "0" for mask in masks):
            touching.append(geom)
    return tuple(touching) or geoms


def meets_hand(geom: Element, defaults: Defaults) -> bool:
    """Test if a geom collides with an arm's hand, which has MuJoCo's default masks, 1."""
    masks = [defaults.attribute(geom, name) or "1" for name in ("contype", "conaffinity")]
    return any(mask.strip().lstrip("+-").isdigit() and int(mask) & 1 for mask in masks)


def carrying(
    element: Element, geoms: tuple[Element, ...], defaults: Defaults
) -> tuple[Element, ...]:
    """Return the geoms that may be the top of a surface: a geom of open height, else all."""
    marked = tuple(geom for geom in geoms if has_open_height(geom, defaults))
    if len(marked) > 1:
        raise InputError(
            f"surface {label(element)} has `?` in several geoms; only one can be its top"
        )
    return marked or geoms


def is_free(body: Element, defaults: Defaults) -> bool:
    """Test if a body has a free joint."""
    for child in iter_children(body):
        is_free = child.tag == "joint" and defaults.attribute(child, "type") == "free"
        if is_free or child.tag == "freejoint":
            return True
    return False


def has_joint(body: Element) -> bool:
    """Test if a body has its own joint."""
    return any(child.tag in ("joint", "freejoint") for child in iter_children(body))


def hinged_by(body: Element, defaults: Defaults) -> Element | None:
    """Return the only slide or hinge joint of a body without other joints below; None for other bodies."""
    # The joint must be the only one, and its body's own.
    below = list(body.iter("joint", "freejoint", "attach", "replicate"))
    own = [child for child in iter_children(body) if child.tag == "joint"]
    if len(below) != 1 or below != own:
        return None
    kind = defaults.attribute(own[0], "type") or "hinge"
    return own[0] if kind in ("slide", "hinge") else None


def iter_children(body: Element) -> Iterator[Element]:
    """Yield a body's children, including those inside frames."""
    for child in children(body):
        if child.tag in TRANSPARENT:
            yield from iter_children(child)
        else:
            yield child


def copy_mark(element: Element) -> str:
    """Return MuJoCo's suffix for names in the first copy that `<replicate>` makes of an element.

    It has a zero for each digit of the count. Suffixes of outer elements come last.
    """
    mark = ""
    for replicate in element.iterancestors("replicate"):
        mark += (replicate.get("sep") or "") + "0" * len((replicate.get("count") or "").strip())
    return mark
