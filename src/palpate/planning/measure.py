"""Parameters by name: `bottle.mass`, `bottle.*`, `*.mass`, `missing`. No language is involved."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from fnmatch import fnmatchcase

from palpate.errors import InputError, unknown_name
from palpate.parameter import Parameter
from palpate.planning.request.item import GRIPPER
from palpate.scene.describe import AN_OBJECT
from palpate.scene.scene import Scene

MISSING = "missing"
"""Name of everything that the scene misses."""
HINT = "Give measure=bottle.mass, measure=bottle.*, measure=*.mass or measure=missing."


def named_parameters(names: Iterable[str], scene: Scene) -> tuple[Parameter, ...]:
    """Resolve names of parameters in a scene, each name a parameter, a pattern, or a comma list.

    A pattern stands for what the scene misses: `bottle.*` for all of the bottle, `*.mass` for every
    mass, `missing` for everything. It may match nothing, where nothing is missing.

    Raises:
        InputError: no such body or quantity, or a quantity that such a body does not have.
    """
    found: list[Parameter] = []
    listed = [part.strip() for given in names for part in given.split(",")]
    if listed and not any(listed):
        raise InputError(f"measure= is empty. {HINT}")
    for name in listed:
        if name == MISSING:
            found += scene.missing
        elif "*" in name:
            found += _matching(name, scene)
        elif name:
            found.append(_parameter(name, scene))
    return tuple(dict.fromkeys(found))


def in_words(parameters: Sequence[Parameter]) -> str:
    """State the parameters as a request, for a planner that reads one."""
    listed = ", ".join(str(parameter) for parameter in parameters) or "nothing"
    return f"Measure exactly these parameters, no more and no fewer: {listed}."


def _matching(pattern: str, scene: Scene) -> list[Parameter]:
    body, _, quantity = pattern.rpartition(".")
    if not any(fnmatchcase(name, body) for name in scene.bodies):
        raise unknown_name("object or surface in measure=", body, scene.bodies, HINT)
    if not any(fnmatchcase(id, quantity) for id in scene.catalogue):
        raise unknown_name("quantity in measure=", quantity, scene.catalogue, HINT)
    return [one for one in scene.missing if fnmatchcase(str(one), pattern)]


def _parameter(name: str, scene: Scene) -> Parameter:
    object, dot, id = name.rpartition(".")
    bodies = [*scene.bodies, GRIPPER]
    if not dot and name in bodies:
        raise InputError(f"measure={name} names no quantity. {HINT.replace('bottle', name)}")
    if object not in bodies:
        why = scene.resolved.description.why_no_body(object or name)
        raise unknown_name("object or surface in measure=", object or name, bodies, why or HINT)
    if id not in scene.catalogue:
        meant = scene.catalogue.meant(id)
        raise unknown_name("quantity in measure=", id, scene.catalogue, HINT, meant)
    subject = scene.catalogue[id].subject
    role = GRIPPER if object == GRIPPER else scene.bodies[object].role
    # What the gripper has, the object that it holds has, too.
    if role != subject and not (subject == GRIPPER and role == "object"):
        raise InputError(
            f"measure={name}: '{object}' is a{'n' if role == 'object' else ''} {role}, and the "
            f"{scene.catalogue[id].label} is measured of a{'n' if subject == 'object' else ''} {subject}"
            f"{'; ' + AN_OBJECT if (role, subject) == ('surface', 'object') else ''}"
        )
    return Parameter(object, id)
