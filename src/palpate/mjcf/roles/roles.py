"""Roles of the bodies in a document."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from palpate.mjcf.attached import Brought, prefix
from palpate.mjcf.defaults import Defaults
from palpate.mjcf.document import Element
from palpate.mjcf.roles.elements import Elements, Role
from palpate.mjcf.roles.robots import copy_mark


@dataclass(slots=True, eq=False)
class Roles:
    """Roles of the bodies in a document, in its order.

    Attributes:
        root: the scene's.
        robots: the bodies that robots begin with, or the `<attach>`s that bring them.
        ignored: bodies with other joints, which are neither robot nor object: drawers and doors.
        replicated: free bodies of which `<replicate>` or `<attach>` makes the parts, so that one
            element is many shapes.
        brought: the parts of attached models.
        copied: the `<attach>`s of what is there already, where values are written.
    """

    root: Element
    defaults: Defaults
    bodies: dict[str, Elements] = field(default_factory=dict[str, Elements])
    robots: list[Element] = field(default_factory=list[Element])
    ignored: list[Element] = field(default_factory=list[Element])
    replicated: list[Element] = field(default_factory=list[Element])
    brought: list[Brought] = field(default_factory=list[Brought])
    copied: list[Element] = field(default_factory=list[Element])

    @property
    def objects(self) -> dict[str, Elements]:
        """Objects by name."""
        return self._of("object")

    @property
    def surfaces(self) -> dict[str, Elements]:
        """Candidates for surfaces, by name."""
        return self._of("surface")

    def compiled_name(self, element: Element, own: str) -> str | None:
        """Compiled name of an element called `own`; None if it is in no model."""
        part = self._bringing(element)
        if part is None and element.getroottree().getroot() is not self.root:
            return None
        return compiled_name(element, own, () if part is None else part.through)

    def _bringing(self, element: Element) -> Brought | None:
        contents = {part.content: part for part in self.brought}
        around = (element, *element.iterancestors()) if contents else ()
        return next((contents[outer] for outer in around if outer in contents), None)

    def _of(self, role: Role) -> dict[str, Elements]:
        return {name: body for name, body in self.bodies.items() if body.role == role}


def compiled_name(element: Element, own: str, through: Sequence[Element]) -> str:
    """Compiled name of an element called `own` that comes `through` some `<attach>`s."""
    marks = [copy_mark(part) for part in (element, *reversed(through))]
    return prefix(through) + own + "".join(marks)
