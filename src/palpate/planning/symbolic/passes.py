"""More work for a parameter than its evidence takes: the ways between grasp and lift gone slowly,
and the object taken, lifted and put back again and again, so that empty and loaded passes over the
same path alternate."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

from palpate.parameter import Parameter
from palpate.planning.symbolic.steps import Step, is_away, is_clear
from palpate.quantities.precision.effort import Effort, Site
from palpate.quantities.precision.within import Within, noise_std
from palpate.scene.scene import Scene
from palpate.vocabulary.admissible.profile import NEAR_SPEED
from palpate.vocabulary.gripper import CloseGripper, OpenGripper
from palpate.vocabulary.motion import MovePose
from palpate.vocabulary.state import SymbolicState

Efforts = Mapping[Parameter, Effort]
Lift = tuple[str, str]
"""Pose expressions at which an object was taken, and to which it was lifted."""


def efforts(scene: Scene, parameters: Iterable[Parameter], within: Within) -> Efforts:
    """Initial effort of each parameter with a requested width, where its quantity can predict it."""
    found: dict[Parameter, Effort] = {}
    for parameter in parameters:
        width, site = within.of(parameter), site_of(scene, parameter)
        if width is not None and site is not None:
            quantity = scene.catalogue[parameter.quantity]
            effort = quantity.effort(site, noise_std(width, quantity.floor(site)), None)
            if effort is not None:
                found[parameter] = effort
    return found


def site_of(scene: Scene, parameter: Parameter, value: Sequence[float] = ()) -> Site | None:
    """Workplace of an object with the believed `value` of the parameter. None for other bodies, or
    without a belief."""
    name = parameter.object
    if name not in scene.objects:
        return None
    known = scene.bodies[name].known.get(parameter.quantity)
    believed = tuple(value) or known or scene.priors.get(parameter)
    if believed is None:
        return None
    grasp, above = (scene.symbols.resolve(at) for at in _default_lift(name))
    base, gravity = scene.pose_world_base, scene.gravity
    return Site(parameter, scene.arm, base, grasp, above, believed, gravity, NEAR_SPEED)


def with_effort(
    start: SymbolicState, steps: Sequence[Step], state: SymbolicState, name: str, effort: Effort
) -> tuple[list[Step], SymbolicState]:
    """Steps that measure something of an object from `start` on and lead to `state`, with that
    effort, and the state after them; fewer cycles where something speaks against more."""
    lift = _lift(state, name)
    if lift is None:
        return list(steps), state
    found = list(_slowed(start.at, steps, lift, effort.speed))
    again = list(_cycle(lift, effort.speed))
    for _ in range(effort.cycles - 1):
        after = _after(again, state, name, lift)
        if after is None:
            break
        found += again
        state = after
    return found, state


def _lift(state: SymbolicState, name: str) -> Lift | None:
    """Last lift and hold of the object, by the recordings."""
    for _, context in reversed(state.logged):
        if context.holding == name and context.activity == "still" and context.grasp and context.at:
            return context.grasp, context.at
    return None


def _default_lift(name: str) -> Lift:
    return f"{name}_pose", f"{name}_pose + z_offset"


def _slowed(
    at: str | None, steps: Iterable[Step], lift: Lift, speed: float | None
) -> Iterator[Step]:
    """The steps, the ways from one end of the lift to the other at that speed."""
    for step in steps:
        (first, *beside), start = step.primitives, at
        if isinstance(first, MovePose):
            at = first.pose
            if {start, at} == set(lift) and not beside:
                step = Step((first.model_copy(update={"speed": speed}),), step.touches)
        elif "arm" in first.claims:
            at = None
        yield step


def _cycle(lift: Lift, speed: float | None) -> Iterator[Step]:
    """Down, take, up; down, let go, up."""
    grasp, above = lift
    for fingers in (CloseGripper(), OpenGripper()):
        for primitive in (MovePose(pose=grasp, speed=speed), fingers):
            yield Step((primitive,))
        yield Step((MovePose(pose=above, speed=speed),))


def _after(
    steps: Iterable[Step], state: SymbolicState, name: str, lift: Lift
) -> SymbolicState | None:
    """The state after a cycle; None where it cannot be made from `state`, or does harm."""
    if state.at != lift[1] or not is_clear(state):
        return None
    for step in steps:
        after = step.applied(state)
        if after is None or step.harm(state) is not None:
            return None
        state = after
    return None if is_away(state, name) else state
