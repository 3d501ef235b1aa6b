"""A scene's file with everything unknown believed: the basis of simulated models and of the twin."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace

import mujoco

from palpate.geometry.standing import tipped
from palpate.mjcf.body import Body, BodyDescription
from palpate.mjcf.compile import compile_spec, model_tree
from palpate.mjcf.document import Document
from palpate.mjcf.edits import Change, Edit
from palpate.mjcf.shapes import RESTING, Shapes, compile_shapes
from palpate.parameter import Parameter
from palpate.quantities.catalogue import Catalogue
from palpate.quantities.quantity import Prior, Status, Values
from palpate.scene.describe import Description, describe
from palpate.scene.fill import beliefs, changes, completed
from palpate.scene.poses import Poses
from palpate.scene.words import thing_words

SHAPELESS = frozenset({"mass", "density", "friction", "priority"})
"""Attributes of geoms that leave the scene's geometry as it is."""


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class ResolvedScene:
    """A description, what is believed of its unknowns, and the geometry that follows.

    Attributes:
        poses: what came with the scene.
        priors: of every missing quantity.
        shapes: compiled with the priors in place.
    """

    description: Description
    poses: Poses
    catalogue: Catalogue
    priors: Mapping[Parameter, Prior]
    shapes: Shapes

    def __repr__(self) -> str:
        return f"<ResolvedScene: {', '.join(self.description.bodies)}>"

    @property
    def document(self) -> Document:
        """The parsed file."""
        return self.description.document

    def means(self) -> dict[Parameter, tuple[float, ...]]:
        """The believed values."""
        return {parameter: prior.mean for parameter, prior in self.priors.items()}

    def completed(self, priors: Values, values: Values) -> dict[Parameter, tuple[float, ...]]:
        """`values`, and for the other parameters of `priors` what is believed once those are
        known."""
        return completed(self.description.bodies, self.catalogue, priors, values)

    def changes(self, values: Values, known: Values) -> list[Change]:
        """The changes of the file that state `values`; `known` is what they rest on.

        Raises:
            InputError: a value that has no place in the file.
        """
        return list(changes(self.description.bodies, self.catalogue, values, known, {}))

    def spec(self, values: Values) -> mujoco.MjSpec:
        """An editable model without any robot in which `values` hold, and beliefs for the rest."""
        stated = self.changes(self.completed(self.means(), values), {})
        made = [*self.description.placed, *stated]
        return compile_spec(model_tree(self.document, self.description.roles, made))

    def bodies(self) -> dict[str, Body]:
        """Objects and surfaces by name, in document order."""
        found: dict[str, Body] = {}
        for name, body in self.description.bodies.items():
            found[name] = self._body(replace(body, shapes=self.shapes))
        for name, body in found.items():
            if body.role == "surface":
                found[name] = replace(body, carries=tuple(_resting_on(body, found.values())))
        for surface in [body for body in found.values() if body.carries]:
            for name in surface.carries:
                found[name] = self._at_rest(found[name])
        return found

    def _at_rest(self, body: Body) -> Body:
        described = replace(self.description.bodies[body.name], shapes=self.shapes)
        middle = body.pose_world.apply(body.centre)
        return replace(body, tipped=tipped(described.cloud, middle))

    def _body(self, body: BodyDescription) -> Body:
        known: dict[str, tuple[float, ...]] = {}
        others: dict[Status, set[str]] = {"missing": set(), "assumed": set()}
        for quantity in self.catalogue.of(body.role):
            status = quantity.status(body)
            if status == "known":
                known[quantity.id] = quantity.known(body)
            elif status in others:
                others[status].add(quantity.id)
        centre, size = body.box()
        return Body(
            body.name,
            body.role,
            self._words(body),
            body.pose_world,
            centre,
            size,
            known,
            missing=frozenset(others["missing"]),
            assumed=frozenset(others["assumed"]),
            accuracy=self.poses.accuracy,
        )

    def _words(self, body: BodyDescription) -> frozenset[str]:
        is_object = body.role == "object"
        geoms = body.elements.geoms if is_object else (body.carrier,)
        element = body.elements.element if is_object else body.carrier
        return thing_words(body.name, element, geoms, body.defaults, shapes=is_object)


def resolve(document: Document, poses: Poses, catalogue: Catalogue) -> ResolvedScene:
    """Describe the document's bodies, believe what is missing, and compile the geometry.

    Raises:
        InputError: a `?` where nothing can be measured, names that do not match, scenes MuJoCo does
            not accept.
    """
    description = describe(document, poses, catalogue)
    priors = beliefs(description.bodies, catalogue)
    resolved = ResolvedScene(description, poses, catalogue, priors, description.shapes)
    stated = resolved.changes(resolved.means(), {})
    if any(_moves_something(change) for change in stated):
        edits = [*description.placed, *stated]
        resolved = replace(resolved, shapes=compile_shapes(document, description.roles, edits))
    _confirm(resolved)
    return resolved


def _moves_something(change: Change) -> bool:
    """True if a change may show in the scene's geometry; a mass or a friction does not, and the
    stand-in is as good for looking."""
    return not (isinstance(change, Edit) and change.attribute in SHAPELESS)


def _resting_on(surface: Body, bodies: Iterable[Body]) -> Iterator[str]:
    """Names of the objects that stand on a surface."""
    for body in bodies:
        x, y, _ = body.pose_world.position.tolist()
        if (
            body.role == "object"
            and surface.covers(x, y)
            and abs(body.bottom_z() - surface.top_z()) < RESTING
        ):
            yield body.name


def _confirm(resolved: ResolvedScene) -> None:
    """Require that the believed values show in the compiled geometry."""
    for parameter, prior in resolved.priors.items():
        body = resolved.description.bodies[parameter.object]
        quantity = resolved.catalogue[parameter.quantity]
        quantity.confirm(replace(body, shapes=resolved.shapes), prior.mean)
