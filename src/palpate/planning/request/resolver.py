"""Resolution of mentions to the parameters of a scene, with reasons for failures."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NoReturn

from palpate.common.parameter import Parameter, PlanRejected
from palpate.estimation.quantities.catalogue import Catalogue
from palpate.planning.request.query import GRIPPER, Item, NamedQuantity
from palpate.scene.describe import AN_OBJECT
from palpate.scene.scene import Scene

SHOWN = 6
"""Maximum number of bodies in a message."""
HINT = "; say e.g. "
"""Separator between the reason of a rejection and its advice. A proposal replaces the advice."""
LONG = 60
"""Maximum number of characters of a quoted sentence."""
_NOT_SENSED = "no primitive of the robot senses it"


class Resolver:
    """Resolver of mentions in one scene.

    Attributes:
        scene: the scene.
        catalogue: its quantities.
        cannot: one sentence for each request that no plan can measure.
    """

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.catalogue = scene.catalogue
        self.cannot: list[str] = []

    def parameters(self, quantity: NamedQuantity, objects: Sequence[Item]) -> list[Parameter]:
        """Return the parameters of a quantity of the given objects.

        Without objects, these are all bodies that miss it, else all that can have it.

        Raises:
            PlanRejected: a mention is ambiguous.
        """
        id = self._meant(quantity.id, objects)
        if not quantity.measurable or not self.catalogue[id].identifiable:
            self.cannot.append(self.not_measurable(quantity))
            return []
        if not objects:
            # Without objects, missing parameters have priority over known ones.
            missing = [parameter for parameter in self.scene.missing if parameter.quantity == id]
            return missing or [Parameter(name, id) for name in self._carriers(id)]
        names = [name for item in objects for name in self._chosen(item, id)]
        found = [Parameter(name, id) for name in names]
        if not found:
            self.cannot.append(self._wrong_subject(id, objects))
        return found

    def _meant(self, id: str, objects: Sequence[Item]) -> str:
        """Return the quantity that a word refers to for these `objects`.

        For example, the height of a crate is part of its size.
        """
        # Use the other quantity only if the objects have that one alone.
        elsewhere = self.catalogue[id].elsewhere if id in self.catalogue else None
        if not elsewhere or self._any_carries(objects, id):
            return id
        return elsewhere if self._any_carries(objects, elsewhere) else id

    def _any_carries(self, objects: Sequence[Item], id: str) -> bool:
        return any(self._carries(name, id) for item in objects for name in item.names)

    def is_assumed(self, parameter: Parameter) -> bool:
        """True if the scene has the value from an assumption, such as uniform density."""
        body = self.scene.bodies.get(parameter.object)
        quantity = self.catalogue[parameter.quantity].known_as()
        return body is not None and quantity in body.assumed

    def can_have(self, objects: Sequence[Item], quantity: NamedQuantity) -> bool:
        """True if one of the `objects` can have the quantity."""
        id = self._meant(quantity.id, objects)
        return id not in self.catalogue or self._any_carries(objects, id)

    def exclusions(
        self, quantity: NamedQuantity | None, objects: Sequence[Item]
    ) -> list[Parameter]:
        """Return the parameters that "except …" or "we know …" excludes.

        Without a quantity, all quantities of the objects are excluded.

        Raises:
            PlanRejected: a mention is ambiguous.
        """
        # All quantities, or the one that the word refers to for these objects.
        ids = list(self.catalogue)
        if quantity is not None:
            ids = [id for id in ids if id == self._meant(quantity.id, objects)]
        chosen = [name for item in objects for name in self._chosen(item, None)]
        return [
            Parameter(name, id)
            for id in ids
            for name in (chosen if objects else self._carriers(id))
        ]

    def missing(self, objects: Sequence[Item]) -> tuple[list[Parameter], str]:
        """Return the missing parameters of the objects, or of all bodies, with a remark.

        Raises:
            PlanRejected: a mention is ambiguous.
        """
        missing = list(self.scene.missing)
        names = [name for item in objects for name in self._chosen(item, None)]
        if not names or set(names) >= set(self.scene.bodies):
            return missing, "Everything that the scene misses is meant."
        found = [parameter for parameter in missing if parameter.object in names]
        listed = ", ".join(dict.fromkeys(names))
        end = "." if found else f"; nothing of {listed} is missing."
        return found, (
            f"The request names no quantity, so everything the scene misses of {listed} is meant{end}"
        )

    def order_parameters(self, parameters: Sequence[Parameter]) -> list[Parameter]:
        """Sort parameters without duplicates.

        Surfaces come first, then objects and fixtures, each in document order. Quantities are in
        catalogue order.
        """
        scene = self.scene
        # Sort by the position in the list of all possible parameters.
        names = [*scene.surfaces, *scene.objects, *scene.fixtures, GRIPPER]
        every = [Parameter(name, id) for name in names for id in self.catalogue]
        return sorted(dict.fromkeys(parameters), key=every.index)

    def not_understood(self, words: Sequence[str], sentence: str) -> PlanRejected:
        """Make the error for words that were not understood, with an example request."""
        said = " ".join(sentence.split())
        # Quote at most four words, and a long sentence only in part.
        told = [word for word in dict.fromkeys(words) if word in said.lower()][:4]
        listed = ", ".join(f"'{word}'" for word in told)
        if len(said) > LONG:
            said = f"{said[:LONG].rsplit(' ', 1)[0]} …"
        listed = f"{listed} in '{said}'" if told else f"'{said}'"
        return PlanRejected(
            f"I did not understand {listed}{HINT}'{self._example()}'; measurable are {_measurable(self.catalogue)} of "
            f"{self._listed_bodies()}"
        )

    def _example(self) -> str:
        """Return an example request."""
        if self.scene.objects:
            return f"mass of the {next(iter(self.scene.objects))}"
        return "everything that is missing"

    def reject(self, request: str) -> NoReturn:
        """Reject a request without any known word.

        Raises:
            PlanRejected: always; it states possible requests.
        """
        shown = " ".join(request.split())[:80]
        raise PlanRejected(
            f"nothing in '{shown}' names a quantity or an object of this scene; ask for "
            f"{_measurable(self.catalogue)} of {self._listed_bodies()}"
        )

    def _chosen(self, item: Item, id: str | None) -> list[str]:
        """Return the bodies of a mention that can have the quantity.

        Raises:
            PlanRejected: a singular mention has several such bodies.
        """
        # Bodies that cannot have the quantity do not count as ambiguous.
        names = list(item.names)
        if id is not None:
            names = [name for name in names if self._carries(name, id)]
        if item.plural or len(names) <= 1:
            return names
        # A singular mention with several candidates is ambiguous.
        choices = " or ".join(f"'{name}'" for name in names)
        what = f"the {self.catalogue[id].label} of " if id else ""
        raise PlanRejected(
            f"'the {item.text}' may be {choices}; name one, e.g. '{what}{names[0]}', or ask for all of "
            f"them, e.g. '{what}all of {', '.join(names)}'"
        )

    def _carriers(self, id: str) -> list[str]:
        """Return the bodies that can have the quantity; the gripper for its own quantities."""
        if self.catalogue[id].subject == "gripper":
            return [GRIPPER]
        return [name for name in self.scene.bodies if self._carries(name, id)]

    def _carries(self, name: str, id: str) -> bool:
        """True if a body can have the quantity; a held object also has those of the gripper."""
        subject = self.catalogue[id].subject
        if name == GRIPPER:
            return subject == "gripper"
        if subject == "gripper":
            return name in self.scene.objects
        return subject == self.scene.bodies[name].role

    def not_measurable(self, quantity: NamedQuantity) -> str:
        """Message on a property that nothing measures."""
        # A quantity of the catalogue states its own reason.
        reason, label = _NOT_SENSED, quantity.id
        if quantity.id in self.catalogue:
            reason, label = self.catalogue[quantity.id].how, self.catalogue[quantity.id].label
        said = f" ('{quantity.word}')" if quantity.word != label else ""
        measurable = _measurable(self.catalogue)
        return f"The {label}{said} cannot be measured: {reason}; what can be is {measurable}."

    def _wrong_subject(self, id: str, objects: Sequence[Item]) -> str:
        subject = self.catalogue[id].subject
        article = "an" if subject[0] in "aeiou" else "a"
        carriers = ", ".join(self._carriers(id)) or "none here"
        is_fixed = subject == "object" and objects[0].names[0] in self.scene.surfaces
        hint = f"; {AN_OBJECT}" if is_fixed else ""
        return (
            f"The {self.catalogue[id].label} of '{objects[0].text}' cannot be measured: it is measured of "
            f"{article} {subject} ({carriers}){hint}."
        )

    def _listed_bodies(self) -> str:
        # Shorten a long list of bodies.
        bodies = list(self.scene.bodies)
        if len(bodies) > SHOWN + 1:
            return f"{', '.join(bodies[:SHOWN])} and {len(bodies) - SHOWN} more"
        return ", ".join(bodies) or "no objects at all"


def _measurable(catalogue: Catalogue) -> str:
    return ", ".join(q.label for q in catalogue.values() if q.identifiable)
