"""Plan under check, and findings of the check."""

from __future__ import annotations

import re
from collections.abc import Hashable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

from pydantic import ValidationError

from palpate.common.parameter import Parameter
from palpate.estimation.quantities.catalogue import catalogue
from palpate.planning.plan import Node, Plan
from palpate.planning.request.query import GRIPPER
from palpate.primitives.base import Primitive
from palpate.primitives.registry import Vocabulary
from palpate.scene.scene import Scene


@dataclass(frozen=True, slots=True)
class Finding:
    """Fault of a plan."""

    path: str  # place in the plan, such as `tree.children[3]`
    rule: str  # id of the broken rule, one of `check.RULES`
    message: str  # description with a remedy


@dataclass(frozen=True, eq=False)
class Form:
    """Nodes of a tree by path, with the primitives of its leaves."""

    nodes: Mapping[str, Node]  # all nodes, depth first
    primitives: Mapping[str, Primitive]  # the primitives of leaves with valid arguments
    # The errors of leaves with invalid arguments.
    refused: Mapping[str, ValidationError | TypeError]

    @classmethod
    def of(cls, tree: Node | None, words: Vocabulary) -> Form:
        """Read a tree; without one the form is empty."""
        nodes = dict(tree.walk()) if tree is not None else {}
        primitives: dict[str, Primitive] = {}
        refused: dict[str, ValidationError | TypeError] = {}
        for path, node in nodes.items():
            # An invalid argument becomes a finding later, so keep its error here.
            if node.type in words.primitives:
                try:
                    primitives[path] = words.make(node.type, dict(node.args))
                except (ValidationError, TypeError) as error:
                    refused[path] = error
        return cls(nodes, primitives, refused)

    def owners(self, path: str) -> dict[str, list[str]]:
        """Return the moving leaves below `path` by claimed resource, as relative paths."""
        paths_of: dict[str, list[str]] = {}
        for where, primitive in self.primitives.items():
            # Only leaves strictly below the path count.
            if where.startswith(f"{path}."):
                for resource in sorted(primitive.claims):
                    paths_of.setdefault(resource, []).append(where.removeprefix(f"{path}."))
        return paths_of


@dataclass(frozen=True, eq=False)
class CheckedPlan:
    """Plan under check, with the scene and the request for comparison."""

    plan: Plan  # the plan
    words: Vocabulary  # the permitted vocabulary
    scene: Scene | None  # the scene of the run; None to check the grammar alone
    remeasure: bool = False  # allows measurement of quantities that the scene states
    # The exact set of parameters that the plan must measure; None for any.
    requested: tuple[Parameter, ...] | None = None
    repeated: bool = False  # allows several measurements of one parameter, for a narrower interval

    @cached_property
    def form(self) -> Form:
        """The tree, read once."""
        return Form.of(self.plan.tree, self.words)

    @property
    def is_unclear(self) -> bool:
        """True if a parameter names an unknown object or quantity, so that the aim of the plan is unknown."""
        return any(not self.exists(parameter) for parameter in self.plan.parameters)

    def iter_parameters(self) -> Iterator[tuple[str, Parameter]]:
        """Yield the parameters of the plan with their paths."""
        for i, parameter in enumerate(self.plan.parameters):
            yield f"parameters[{i}]", parameter

    def exists(self, parameter: Parameter) -> bool:
        """True if the catalogue has the quantity and the scene has the object."""
        quantity = catalogue().get(parameter.quantity)
        if quantity is None or self.scene is None or not quantity.identifiable:
            return quantity is not None
        # The gripper is no body of the scene, but has quantities.
        hand = parameter.object == GRIPPER == quantity.subject
        return hand or parameter.object in self.scene.bodies

    def is_of_its_kind(self, parameter: Parameter) -> bool:
        """True if this kind of object has the quantity; both must exist."""
        quantity = catalogue()[parameter.quantity]
        if self.scene is None or parameter.object not in self.scene.bodies:
            return True
        # Quantities of the gripper are allowed for any body.
        return quantity.subject in (self.scene.bodies[parameter.object].role, GRIPPER)

    def is_known(self, parameter: Parameter) -> bool:
        """True if the scene states the parameter."""
        if self.scene is None or parameter.object not in self.scene.bodies:
            return False
        return parameter.quantity in self.scene.bodies[parameter.object].known


# Findings as lines of text, grouped by cause and remedy.


SHOWN = 4  # Maximum number of further paths in one line
_OBSTACLE = re.compile(r" into ('[^']+')")


def digest(findings: Iterable[Finding]) -> list[str]:
    """Return one line per cause with all its paths, in the order of the findings."""
    # Group by cause; the first finding represents its group.
    groups: dict[Hashable, list[Finding]] = {}
    for finding in findings:
        groups.setdefault(cause(finding), []).append(finding)
    return [line(group[0], [each.path for each in group]) for group in groups.values()]


def cause(finding: Finding) -> Hashable:
    """Return the key of a remedy: the object to be carried away, else rule and message."""
    problem, _, remedy = finding.message.partition("; ")
    # Collisions with one object have one remedy: carry it away.
    obstacle = _OBSTACLE.search(problem)
    if obstacle is not None and "carry it " in remedy:
        return obstacle[1]
    return finding.rule, finding.message


def line(finding: Finding, paths: Iterable[str]) -> str:
    """Format a finding with its further paths."""
    others = [path for path in dict.fromkeys(paths) if path != finding.path]
    text = f"{finding.rule}: {finding.message}"
    if not others:
        return f"{finding.path}, {text}"
    # The paths come first, because a long message may be cut. Their number is limited.
    more = f" and {len(others) - SHOWN} more" if len(others) > SHOWN else ""
    return f"{finding.path} (the same at {', '.join(others[:SHOWN])}{more}), {text}"
