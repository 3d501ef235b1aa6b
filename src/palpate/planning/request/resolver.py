"""Resolution of mentions to the parameters of a scene, with reasons for failures."""

from __future__ import annotations

from collections.abc import Sequence

from palpate.common.errors import InputError
from palpate.common.parameter import Parameter, PlanRejected
from palpate.estimation.quantities.catalogue import Catalogue
from palpate.planning.request.query import GRIPPER
from palpate.planning.request.spots import Thing
from palpate.scene.describe import AN_OBJECT
from palpate.scene.scene import Scene

SHOWN = 6
"""Maximum number of bodies in a message."""
HINT = "; say e.g. "
"""Separator between the reason of a rejection and its advice. A proposal replaces the advice."""
LONG = 60
"""Maximum number of characters of a quoted sentence."""


class Resolver:
    """Resolver of mentions in one scene.

    Attributes:
        scene: the scene.
        request: the request, for messages.
        catalogue: its quantities.
        cannot: one sentence for each request that no plan can measure.
    """

    def __init__(self, scene: Scene, request: str) -> None:
        self.scene, self.request = scene, request
        self.catalogue = scene.catalogue
        self.cannot: list[str] = []

    def parameters(self, id: str, things: Sequence[Thing]) -> list[Parameter]:
        """Return the parameters of a quantity of the given bodies.

        Without bodies, these are all that miss it, else all that can have it.
        Raises PlanRejected: a mention is ambiguous.
        """
        id = self._meant(id, things)
        if not self.catalogue[id].identifiable:
            self.cannot.append(self.not_measurable(id, id))
            return []
        if not things:
            # Without bodies, missing parameters have priority over known ones.
            missing = [parameter for parameter in self.scene.missing if parameter.quantity == id]
            return missing or [Parameter(name, id) for name in self.carriers(id)]
        names = [name for thing in things for name in self._chosen(thing, id)]
        if not names:
            self.cannot.append(self._wrong_subject(id, things))
        return [Parameter(name, id) for name in names]

    def _meant(self, id: str, things: Sequence[Thing]) -> str:
        """Return the quantity that a word refers to for these bodies.

        For example, the height of a crate is part of its size.
        """
        # Use the other quantity only if the bodies have that one alone.
        elsewhere = self.catalogue[id].elsewhere if id in self.catalogue else None
        if not elsewhere or self._any_carries(things, id):
            return id
        return elsewhere if self._any_carries(things, elsewhere) else id

    def _any_carries(self, things: Sequence[Thing], id: str) -> bool:
        return any(self._carries(name, id) for thing in things for name in thing.names)

    def is_assumed(self, parameter: Parameter) -> bool:
        """True if the scene has the value from an assumption, such as uniform density."""
        body = self.scene.bodies.get(parameter.object)
        quantity = self.catalogue[parameter.quantity].known_as()
        return body is not None and quantity in body.assumed

    def can_have(self, things: Sequence[Thing], id: str) -> bool:
        """True if one of the bodies can have the quantity."""
        return self._any_carries(things, self._meant(id, things))

    def exclusions(self, id: str | None, thing: Thing) -> list[Parameter]:
        """Return the parameters of bodies that "except …" or "we know …" excludes.

        Without a quantity, these are all quantities. An ambiguous mention excludes all of its bodies.
        """
        ids = list(self.catalogue) if id is None else [self._meant(id, [thing])]
        return [Parameter(name, one) for one in ids for name in thing.names]

    def missing(self, things: Sequence[Thing]) -> tuple[list[Parameter], str]:
        """Return the missing parameters of the bodies, or of all bodies, with a remark.

        Raises PlanRejected: a mention is ambiguous.
        """
        missing = list(self.scene.missing)
        names = [name for thing in things for name in self._chosen(thing, None)]
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

    def not_understood(self, words: Sequence[str]) -> PlanRejected:
        """Make the error for a request that names no parameter, with an example request."""
        said = " ".join(self.request.split())
        if len(said) > LONG:
            said = f"{said[:LONG].rsplit(' ', 1)[0]} …"
        listed = ", ".join(f"'{word}'" for word in list(dict.fromkeys(words))[:4])
        listed = f"{listed} in '{said}'" if words else f"'{said}'"
        objects = [f"mass of the {name}" for name in self.scene.objects]
        example = (objects or ["everything that is missing"])[0]
        return PlanRejected(
            f"I did not understand {listed}{HINT}'{example}'; measurable are "
            f"{_measurable(self.catalogue)} of {self._listed_bodies()}"
        )

    def absent(self, thing: Thing) -> InputError | PlanRejected:
        """Make the error for a noun that names no body; an unknown word may still mean one.

        If a body of the scene's file has that name, the message states why it is not measured.
        """
        why = self.scene.resolved.description.explain_refusal(thing.text)
        if not thing.known and not why:
            return self.not_understood([thing.text])
        names = ", ".join(self.scene.bodies) or "no objects"
        return InputError(f"the scene has no '{thing.text}'; it has {names}{why and '. ' + why}")

    def of_what(self, id: str) -> str:
        """Message on a quantity without a body."""
        label, names = self.catalogue[id].label, self.carriers(id)
        if not names:
            return f"nothing in the scene has a {label}; it has {self._listed_bodies()}"
        return (
            f"it is not clear of what the {label} is wanted{HINT}'{label} of the {names[0]}' or "
            f"'every {label}'; the scene has {self._listed_bodies()}"
        )

    def _chosen(self, thing: Thing, id: str | None) -> list[str]:
        """Return the bodies of a mention that can have the quantity.

        Raises PlanRejected: a singular mention has several such bodies.
        """
        # Bodies that cannot have the quantity do not count as ambiguous.
        names = list(thing.names)
        if id is not None:
            names = [name for name in names if self._carries(name, id)]
        if thing.plural or len(names) <= 1:
            return names
        # A singular mention with several candidates is ambiguous.
        choices = " or ".join(f"'{name}'" for name in names)
        what = f"the {self.catalogue[id].label} of " if id else ""
        raise PlanRejected(
            f"'the {thing.text}' may be {choices}; name one, e.g. '{what}{names[0]}', or ask for all of "
            f"them, e.g. '{what}all of {', '.join(names)}'"
        )

    def carriers(self, id: str) -> list[str]:
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

    def not_measurable(self, id: str, word: str) -> str:
        """Message on a property that nothing measures."""
        known = self.catalogue.get(id)
        reason = known.how if known else "no primitive of the robot senses it"
        label = known.label if known else id
        said = f" ('{word}')" if word != label else ""
        return (
            f"The {label}{said} cannot be measured: {reason}; what can be is "
            f"{_measurable(self.catalogue)}."
        )

    def _wrong_subject(self, id: str, things: Sequence[Thing]) -> str:
        subject = self.catalogue[id].subject
        article = "an" if subject[0] in "aeiou" else "a"
        carriers = ", ".join(self.carriers(id)) or "none here"
        is_fixed = subject == "object" and set(things[0].names) & set(self.scene.surfaces)
        hint = f"; {AN_OBJECT}" if is_fixed else ""
        return (
            f"The {self.catalogue[id].label} of '{things[0].text}' cannot be measured: it is measured of "
            f"{article} {subject} ({carriers}){hint}."
        )

    def _listed_bodies(self) -> str:
        bodies, more = list(self.scene.bodies), len(self.scene.bodies) - SHOWN
        listed = ", ".join(bodies if more <= 1 else bodies[:SHOWN]) or "no objects at all"
        return listed if more <= 1 else f"{listed} and {more} more"


def _measurable(catalogue: Catalogue) -> str:
    return ", ".join(q.label for q in catalogue.values() if q.identifiable)
