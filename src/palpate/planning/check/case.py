"""Subject of the rules of whole plans: the plan, its nodes read once, and the request."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from pydantic import ValidationError

from palpate.parameter import Parameter
from palpate.planning.plan import Node, Plan
from palpate.planning.request.item import GRIPPER
from palpate.quantities.catalogue import catalogue
from palpate.scene.scene import Scene
from palpate.vocabulary.base import Primitive
from palpate.vocabulary.registry import Vocabulary


@dataclass(frozen=True, eq=False)
class Form:
    """The nodes of a tree, each leaf made into its primitive where that is possible.

    Attributes:
        nodes: all of them, depth first, by path.
        primitives: what the leaves stand for, by path.
        refused: why the arguments of the other leaves do not fit, by path.
    """

    nodes: Mapping[str, Node]
    primitives: Mapping[str, Primitive]
    refused: Mapping[str, ValidationError | TypeError]

    @classmethod
    def of(cls, tree: Node | None, words: Vocabulary) -> Form:
        """The form of a tree; an empty one without."""
        nodes = dict(tree.walk()) if tree is not None else {}
        primitives: dict[str, Primitive] = {}
        refused: dict[str, ValidationError | TypeError] = {}
        for path, node in nodes.items():
            if node.type not in words.primitives:
                continue
            try:
                primitives[path] = words.make(node.type, dict(node.args))
            except (ValidationError, TypeError) as error:
                refused[path] = error
        return cls(nodes, primitives, refused)

    def owners(self, path: str) -> dict[str, list[str]]:
        """The leaves below `path` that move, relative to it, by what they claim."""
        found: dict[str, list[str]] = {}
        for where, primitive in self.primitives.items():
            if where.startswith(f"{path}."):
                for resource in sorted(primitive.claims):
                    found.setdefault(resource, []).append(where.removeprefix(f"{path}."))
        return found


@dataclass(frozen=True, eq=False)
class Case:
    """A plan before the check.

    Attributes:
        plan, form: the plan, and its tree read.
        words: the vocabulary that it may use.
        scene: where it is to run; None when only its grammar is checked.
        remeasure: whether what the scene states may be measured.
        requested: the parameters that it must measure, no more and no fewer; None when open.
        repeated: whether a parameter may be measured several times, to know it better.
    """

    plan: Plan
    form: Form
    words: Vocabulary
    scene: Scene | None
    remeasure: bool = False
    requested: tuple[Parameter, ...] | None = None
    repeated: bool = False

    @property
    def unclear(self) -> bool:
        """True if a parameter names what there is not: what the plan is for is not known then."""
        return any(not self.exists(parameter) for parameter in self.plan.parameters)

    def exists(self, parameter: Parameter) -> bool:
        """True if there is such a quantity, and such a thing."""
        quantity = catalogue().get(parameter.quantity)
        if quantity is None or self.scene is None or not quantity.identifiable:
            return quantity is not None
        hand = parameter.object == GRIPPER == quantity.subject
        return hand or parameter.object in self.scene.bodies

    def is_of_its_kind(self, parameter: Parameter) -> bool:
        """True if an existing thing carries an existing quantity."""
        quantity = catalogue()[parameter.quantity]
        if self.scene is None or parameter.object not in self.scene.bodies:
            return True
        return quantity.subject in (self.scene.bodies[parameter.object].role, GRIPPER)

    def is_known(self, parameter: Parameter) -> bool:
        """True if the scene states it."""
        if self.scene is None or parameter.object not in self.scene.bodies:
            return False
        return parameter.quantity in self.scene.bodies[parameter.object].known
