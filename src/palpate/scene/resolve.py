"""A scene's file with beliefs for all unknowns: the basis of simulated models and of the twin.

One set of rules converts values of quantities into changes of the file. The simulated model applies
them to a parsed copy, and the twin to the user's text, so both agree. Each quantity states its own
changes. `mjcf.inertial` combines the statements of several quantities on one `<inertial>`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from palpate.common.errors import InputError
from palpate.common.outline import tip_to_rest
from palpate.common.parameter import Parameter
from palpate.common.pose import Array
from palpate.estimation.quantities.catalogue import Catalogue
from palpate.estimation.quantities.quantity import Prior, Status, Values
from palpate.mjcf.body import Body, BodyDescription
from palpate.mjcf.compile import compile_spec, model_tree
from palpate.mjcf.document import Document
from palpate.mjcf.edits import Change, Edit
from palpate.mjcf.inertial import Statement, write_inertia
from palpate.mjcf.shapes import RESTING, Shapes, compile_shapes
from palpate.scene.describe import Description, body_words, describe
from palpate.scene.poses import ObjectEntry, Poses

# Attributes of geoms and joints that do not affect the scene's geometry.
SHAPELESS = frozenset(
    {"mass", "density", "friction", "priority", "solref", "solimp", "solmix"}
    | {"damping", "frictionloss", "stiffness"}
)
Bodies = Mapping[str, BodyDescription]


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class ResolvedScene:
    """A description, the beliefs about its unknowns, and the geometry that follows."""

    description: Description
    poses: Poses  # content of poses.yaml.
    catalogue: Catalogue
    priors: Mapping[Parameter, Prior]  # prior of every missing parameter
    shapes: Shapes  # geometry compiled with the prior means

    def __repr__(self) -> str:
        return f"<ResolvedScene: {', '.join(self.description.bodies)}>"

    @property
    def document(self) -> Document:
        return self.description.document

    def means(self) -> dict[Parameter, tuple[float, ...]]:
        """Mean of each prior."""
        return {parameter: prior.mean for parameter, prior in self.priors.items()}

    def complete_values(self, priors: Values, values: Values) -> dict[Parameter, tuple[float, ...]]:
        """Return `values` and, for the other parameters of `priors`, prior means given `values`."""
        # Priors that depend on given values are computed again.
        merged = {**priors, **values}
        for parameter in merged:
            if parameter not in values:
                body = self.description.bodies[parameter.object]
                merged[parameter] = self.catalogue[parameter.quantity].prior(body, merged).mean
        return merged

    def changes(self, values: Values, known: Values) -> list[Change]:
        """Changes of the file that state `values`; these may depend on `known` values."""
        return list(changes(self.description.bodies, self.catalogue, values, known, {}))

    def spec(self, values: Values) -> mujoco.MjSpec:
        """An editable model without any robot, with `values`, and prior means for the rest."""
        return compile_spec(model_tree(self.document, self.description.roles, self._edits(values)))

    def _edits(self, values: Values) -> list[Change]:
        """Changes of the file that place bodies and state `values`, and prior means for the rest."""
        stated = self.changes(self.complete_values(self.means(), values), {})
        return [*self.description.placed, *stated]

    def compiled(self, values: Values) -> Bodies:
        """Every body in the model that `spec` makes of the same `values`."""
        roles = self.description.roles
        shapes = compile_shapes(self.document, roles, self._edits(values))
        bodies: dict[str, BodyDescription] = {}
        for name, body in self.description.bodies.items():
            bodies[name] = replace(body, shapes=shapes, others=bodies)
        return bodies

    def bodies(self) -> dict[str, Body]:
        """Objects, surfaces and fixtures by name, in document order."""
        bodies: dict[str, Body] = {}
        for name, body in self.description.bodies.items():
            bodies[name] = self._body(replace(body, shapes=self.shapes))
        # Objects that rest on each surface.
        for surface in [body for body in bodies.values() if body.role == "surface"]:
            carried: list[str] = []
            for body in bodies.values():
                x, y, _ = body.pose_world.position.tolist()
                if (
                    body.role == "object"
                    and surface.covers(x, y)
                    and abs(body.bottom_z() - surface.top_z()) < RESTING
                ):
                    carried.append(body.name)
            bodies[surface.name] = replace(surface, carries=tuple(carried))
        # An object on a surface that is not stable there tips to a stable pose.
        for surface in [body for body in bodies.values() if body.carries]:
            for name in surface.carries:
                body = bodies[name]
                cloud = replace(self.description.bodies[name], shapes=self.shapes).cloud
                rest = tip_to_rest(cloud, body.pose_world.apply(body.centre))
                bodies[name] = replace(body, tipped=rest)
        return bodies

    def _body(self, body: BodyDescription) -> Body:
        """Body of the scene from its description: status of its quantities, geometry, words."""
        # Known values, and quantities that are missing or assumed.
        known: dict[str, tuple[float, ...]] = {}
        others: dict[Status, set[str]] = {"missing": set(), "assumed": set()}
        for quantity in self.catalogue.of(body.role):
            status = quantity.status(body)
            if status == "known":
                known[quantity.id] = quantity.known(body)
            elif status in others:
                others[status].add(quantity.id)
        centre, size = body.box()
        is_object, is_surface = body.role == "object", body.role == "surface"
        entry = self.poses.objects.get(body.name)
        words = body_words(
            body.name,
            body.carrier if is_surface else body.elements.element,
            body.elements.geoms if is_object else (body.carrier,) if is_surface else (),
            body.defaults,
            shapes=is_object,
        )
        return Body(
            name=body.name,
            role=body.role,
            words=words,
            pose_world=body.pose_world,
            centre=centre,
            size=size,
            known=known,
            missing=frozenset(others["missing"]),
            assumed=frozenset(others["assumed"]),
            accuracy=(entry.accuracy if entry is not None else None) or self.poses.accuracy,
            covariance=None if entry is None else _covariance(entry),
            seen=entry is not None and entry.is_unsure,
            joint=body.joint,
        )


def _covariance(entry: ObjectEntry) -> Array | None:
    """Covariance (6, 6) of an entry of poses.yaml; its `std` concerns only the position."""
    if entry.covariance is not None:
        return np.array(entry.covariance)
    return None if entry.std is None else np.diag([entry.std**2] * 3 + [0.0] * 3)


def resolve(document: Document, poses: Poses, catalogue: Catalogue) -> ResolvedScene:
    """Describe the document's bodies, set priors for missing parameters, and compile the geometry."""
    # A world has no open quantity, and begins exactly as MuJoCo compiles it.
    description = describe(document, poses, catalogue, settled=bool(catalogue))
    priors = beliefs(description.bodies, catalogue)
    resolved = ResolvedScene(description, poses, catalogue, priors, description.shapes)
    stated = resolved.changes(resolved.means(), {})
    # Masses and frictions do not affect the geometry: the one with placeholders remains valid.
    if not all(isinstance(change, Edit) and change.attribute in SHAPELESS for change in stated):
        edits = [*description.placed, *stated]
        resolved = replace(resolved, shapes=compile_shapes(document, description.roles, edits))
    # Verify that the compiled geometry has the believed values.
    for parameter, prior in priors.items():
        body = replace(description.bodies[parameter.object], shapes=resolved.shapes)
        catalogue[parameter.quantity].confirm(body, prior.mean)
    return resolved


def beliefs(bodies: Bodies, catalogue: Catalogue) -> dict[Parameter, Prior]:
    """Priors of all missing parameters: surfaces and fixtures first, then the objects on them."""
    priors: dict[Parameter, Prior] = {}
    means: dict[Parameter, tuple[float, ...]] = {}
    # Surfaces come first: the prior of an object's z depends on its surface.
    for role in ("surface", "fixture", "object"):
        for body in bodies.values():
            # Earlier prior means are input for the later ones.
            for quantity in catalogue.of(role) if body.role == role else ():
                if quantity.status(body) == "missing":
                    prior = quantity.prior(body, means)
                    parameter = Parameter(body.name, quantity.id)
                    priors[parameter], means[parameter] = prior, prior.mean
    return priors


def changes(
    bodies: Bodies,
    catalogue: Catalogue,
    values: Values,
    known: Values,
    std: Mapping[Parameter, float],
) -> Iterator[Change]:
    """Yield the changes that state `values`.

    The changes may depend on `known` values, which are not written. The standard deviations `std`
    determine the number of digits.
    Raises InputError: a value of a body that the scene does not have, or without a place in the file.
    """
    for name in dict.fromkeys(parameter.object for parameter in values):
        ids = [parameter.quantity for parameter in values if parameter.object == name]
        body = bodies.get(name)
        fitting = [] if body is None else [quantity.id for quantity in catalogue.of(body.role)]
        if body is None or not fitting or (body.role != "object" and not set(fitting) & set(ids)):
            raise InputError(f"no object or surface '{name}' of the scene has a {' or '.join(ids)}")
        # Combine all statements on one `<inertial>`, then the other changes.
        statements, others = _state_inertial(body, catalogue, values, std)
        depends_on, _ = _state_inertial(body, catalogue, known, {})
        yield from write_inertia(body, statements, depends_on)
        yield from others
    # Changes that follow, e.g. the resting height of an object on a surface of measured height.
    believed = {**known, **values}
    for body in bodies.values():
        for quantity in catalogue.of(body.role):
            yield from quantity.follows(body, believed)


def _state_inertial(
    body: BodyDescription, catalogue: Catalogue, values: Values, std: Mapping[Parameter, float]
) -> tuple[list[Statement], list[Change]]:
    """Statements of a body's `<inertial>`, and its other changes, in the catalogue's order."""
    statements: list[Statement] = []
    others: list[Change] = []
    for quantity in catalogue.of(body.role):
        parameter = Parameter(body.name, quantity.id)
        if parameter not in values:
            continue
        # Statements are combined later; other changes are used unchanged.
        for change in quantity.write(body, values[parameter], std.get(parameter)):
            if isinstance(change, Statement):
                statements.append(change)
            else:
                others.append(change)
    return statements, others
