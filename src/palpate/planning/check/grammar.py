"""Rules of a tree's form, which need no scene."""

from __future__ import annotations

from collections.abc import Iterator

from pydantic import ValidationError

from palpate.errors import perhaps
from palpate.planning.check.case import Case
from palpate.planning.check.finding import Finding

SHOWN = 4
"""Leaves and problems that one message names."""


def unknown_primitive(case: Case) -> Iterator[Finding]:
    """Every node's type is a primitive or composite of the vocabulary."""
    names = [*case.words.primitives, *case.words.composites]
    for path, node in case.form.nodes.items():
        if node.type not in names:
            hint = perhaps(node.type, names) or f" valid: {', '.join(names)}"
            message = f"there is no '{node.type[:80]}';{hint}"
            yield Finding.of(path, "unknown-primitive", message)


def bad_argument(case: Case) -> Iterator[Finding]:
    """A leaf's arguments are those its primitive declares, of the declared types; composites have none."""
    for path, node in case.form.nodes.items():
        if node.type in case.words.composites and node.args:
            given = ", ".join(repr(key[:40]) for key, _ in node.args)
            message = f"{node.type} takes only 'children' and 'name', not {given}"
            yield Finding.of(path, "bad-argument", message)
        elif path in case.form.refused:
            for problem in _problems(case, node.type, case.form.refused[path]):
                yield Finding.of(path, "bad-argument", problem)


def _problems(case: Case, name: str, error: ValidationError | TypeError) -> Iterator[str]:
    if isinstance(error, TypeError):
        yield f"the arguments of {name} have no proper names"
        return
    fields = case.words.primitives[name].model_fields
    takes = ", ".join(f"'{field}' ({info.description})" for field, info in fields.items())
    problems = error.errors(include_url=False)[:3]
    lacking = [str(problem["loc"][0]) for problem in problems if problem["type"] == "missing"]
    for problem in problems:
        where = ".".join(str(part) for part in problem["loc"])[:60]
        meant = problem["type"] == "extra_forbidden" and len(lacking) == 1
        guess = f"; did you mean '{lacking[0]}'?" if meant else ""
        yield f"{name}: '{where}': {problem['msg']}{guess}; it takes {takes or 'no arguments'}"


def leaf_children(case: Case) -> Iterator[Finding]:
    """Only composites have children."""
    for path, node in case.form.nodes.items():
        if node.type in case.words.primitives and node.children:
            message = f"{node.type} takes no children; put them beside it, in a Sequence"
            yield Finding.of(path, "leaf-children", message)


def empty_composite(case: Case) -> Iterator[Finding]:
    """A Sequence or Parallel has at least one child."""
    for path, node in case.form.nodes.items():
        if node.type in case.words.composites and not node.children:
            message = f"an empty {node.type} does nothing; give it children or remove it"
            yield Finding.of(path, "empty-composite", message)


def one_owner(case: Case) -> Iterator[Finding]:
    """At most one leaf below a Parallel moves the arm, and at most one the gripper."""
    for path, node in case.form.nodes.items():
        if node.type != "Parallel":
            continue
        for resource, owners in case.form.owners(path).items():
            if len(owners) > 1:
                more = " …" if len(owners) > SHOWN else ""
                message = (
                    f"{len(owners)} leaves would move the {resource} at once "
                    f"({', '.join(owners[:SHOWN])}{more}); there is one: put all but one after "
                    "another, in a Sequence"
                )
                yield Finding.of(path, "one-owner", message)


def order_of_buffers(case: Case) -> Iterator[Finding]:
    """A conversion comes after the sensing that fills its buffer."""
    # With a scene the walk judges it, branch by branch of a Parallel.
    if case.scene is not None:
        return
    written: set[str | None] = set()
    for path, primitive in case.form.primitives.items():
        if primitive.reads and primitive.reads not in written:
            yield Finding(path, primitive.unwritten())
        written.add(primitive.writes)
