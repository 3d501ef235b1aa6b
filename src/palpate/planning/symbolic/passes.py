"""Effort beyond the evidence that a parameter needs: slow passes between grasp and lift, and repeated
cycles of grasp, lift and put-back, in which empty and loaded passes over the same path alternate."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

from palpate.parameter import Parameter
from palpate.planning.symbolic.steps import Step, is_away, is_clear
from palpate.quantities.quantity import Effort, Site
from palpate.quantities.within import Within, noise_std
from palpate.scene.scene import Scene
from palpate.vocabulary.admissible.profile import NEAR_SPEED
from palpate.vocabulary.gripper import CloseGripper, OpenGripper
from palpate.vocabulary.motion import MovePose
from palpate.vocabulary.state import SymbolicState

Efforts = Mapping[Parameter, Effort]


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
    grasp, above = (scene.symbols.resolve(at) for at in (f"{name}_pose", f"{name}_pose + z_offset"))
    base, gravity = scene.pose_world_base, scene.gravity
    return Site(
        parameter=parameter,
        arm=scene.arm,
        pose_world_base=base,
        grasp=grasp,
        above=above,
        believed=believed,
        gravity=gravity,
        near_speed=NEAR_SPEED,
    )


def with_effort(
    start: SymbolicState, steps: Sequence[Step], state: SymbolicState, name: str, effort: Effort
) -> tuple[list[Step], SymbolicState]:
    """Add an effort to the steps that measure an object.

    Args:
        start, steps, state: the state before, the steps, and the state after them.
        name: the object.
        effort: speed of the passes and number of cycles; fewer where more would do harm.

    Returns:
        The steps with the effort, and the state after them.
    """
    # The recordings tell at which pose expressions the object was last grasped and held still.
    lift = next(
        (
            (context.grasp, context.at)
            for _, context in reversed(state.logged)
            if context.holding == name and context.activity == "still"
            if context.grasp and context.at
        ),
        None,
    )
    if lift is None:
        return list(steps), state
    grasp, above = lift
    found = list(slowed(start.at, steps, {grasp, above}, effort.speed))
    # Down, grasp, up; down, release, up.
    cycle: list[Step] = []
    for fingers in (CloseGripper(), OpenGripper()):
        down, up = (MovePose(pose=pose, speed=effort.speed) for pose in lift)
        cycle += [Step((primitive,)) for primitive in (down, fingers, up)]
    for _ in range(effort.cycles - 1):
        after = after_cycle(cycle, state, name, above)
        if after is None:
            break
        found += cycle
        state = after
    return found, state


def slowed(
    at: str | None, steps: Iterable[Step], ends: set[str], speed: float | None
) -> Iterator[Step]:
    """The steps from pose `at` on, those between both `ends` of the lift at that speed (m/s)."""
    for step in steps:
        (first, *beside), start = step.primitives, at
        if isinstance(first, MovePose):
            at = first.pose
            if {start, at} == ends and not beside:
                step = Step((first.model_copy(update={"speed": speed}),), step.touches)
        elif "arm" in first.claims:
            at = None
        yield step


def after_cycle(
    steps: Iterable[Step], state: SymbolicState, name: str, above: str
) -> SymbolicState | None:
    """The state after a cycle; None where it cannot be made from `state`, or does harm."""
    if state.at != above or not is_clear(state):
        return None
    for step in steps:
        after = step.applied(state)
        if after is None or step.harm(state) is not None:
            return None
        state = after
    return None if is_away(state, name) else state
