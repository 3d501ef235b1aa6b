"""Effort of a plan: slow passes, repeated recordings, and errands with a tool."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from palpate.common.errors import InputError
from palpate.common.parameter import Parameter, PlanRejected
from palpate.estimation.quantities.catalogue import catalogue
from palpate.estimation.quantities.quantity import Effort, Evidence, Quantity, Site
from palpate.estimation.quantities.temperature import Temperature
from palpate.estimation.quantities.within import Within, noise_std
from palpate.planning.check.walk import evidence_amount
from palpate.planning.request.grounding import ground
from palpate.planning.symbolic.shortest import Tail
from palpate.planning.symbolic.steps import Step, is_away, is_clear
from palpate.primitives.base import Primitive, Surroundings
from palpate.primitives.gripper import CloseGripper, OpenGripper
from palpate.primitives.motion import MovePose
from palpate.primitives.registry import Vocabulary
from palpate.primitives.rules.profile import NEAR_SPEED
from palpate.primitives.state import SymbolicState, during
from palpate.scene.scene import Scene

# Quantities outside the catalogue that a person reads off a tool.
MANUAL: tuple[Quantity, ...] = (Temperature(),)
_DENYING = re.compile(r"\b(?:not?|never|without|except|but|unless|if|instead|nor)\b|n't\b")
_JOINING = re.compile(r"\band\b|[,;.!?]")
_BEFORE_THING = re.compile(r"\b(?:of|in|inside|on|over|at)\b")


@dataclass(frozen=True, slots=True)
class Errand:
    """Transport of a tool to some objects, where a person reads it."""

    quantity: Quantity  # the quantity that a person reads off the tool
    tool: str  # the carried object
    spots: tuple[str, ...]  # pose expressions where it is held, in order
    objects: tuple[str, ...]  # the objects that are read there

    @property
    def explanation(self) -> str:
        over = " and ".join(f"'{name}'" for name in self.objects)
        return (
            f"'{self.tool}' is fetched, held over {over} and returned. No primitive reads the "
            f"{self.quantity.label}. {self.how.capitalize()}."
        )

    @property
    def how(self) -> str:
        """Instruction for the reading."""
        return "; ".join(evidence.how for evidence in self.quantity.evidence)


def errand(request: str, scene: Scene) -> Errand | None:
    """Return the errand that a request consists of; None for any other request."""
    sentence = " ".join(request.lower().split())
    if _DENYING.search(sentence):
        return None
    for quantity, evidence in iter_tool_quantities():
        # Require one object named after the tool, and the words "with" or "using" before it.
        tools = [
            name for name in scene.objects if evidence.tool in re.split(r"[\W_]+", name.lower())
        ]
        used = re.search(rf"\b(?:with|using) (?:the|a|my) {re.escape(evidence.tool)}\b", sentence)
        if used is None or len(tools) != 1:
            continue
        # The remaining words must name the quantity, then the objects.
        rest = (sentence[: used.start()] + sentence[used.end() :]).strip(" ,.?!")
        words = "|".join(quantity.words.get("en", ()))
        asked = re.search(rf"\b(?:{words})\b", rest)
        # A joining word before the quantity starts a separate request.
        if asked is None or _JOINING.search(rest[: asked.start()]):
            continue
        objects = objects_of(rest[asked.end() :], scene)
        if not objects or tools[0] in objects:
            continue
        spots = tuple(f"{name}_{evidence.place}" for name in objects)
        for spot in spots:
            scene.symbols.resolve(spot)
        return Errand(quantity, tools[0], spots, objects)
    return None


def iter_tool_quantities() -> Iterator[tuple[Quantity, Evidence]]:
    """Yield the quantities that no primitive reads, with the evidence that names their tool."""
    known = catalogue()
    every = [*MANUAL, *(each for each in known.values() if not each.identifiable)]
    for quantity in every:
        if quantity.id in known and known[quantity.id].identifiable:
            continue  # a primitive reads it
        for evidence in quantity.evidence:
            if evidence.tool:
                yield quantity, evidence


def objects_of(sentence: str, scene: Scene) -> tuple[str, ...]:
    """Return the objects at the end of a phrase, after its first preposition that can be grounded."""
    for place in _BEFORE_THING.finditer(sentence):
        if _JOINING.search(sentence[: place.start()]):
            break
        phrase = sentence[place.end() :].strip()
        first, second = (objects_of_quantity(id, phrase, scene) for id in ("mass", "friction"))
        # The phrase names objects alone if two different quantities give the same objects.
        if first and first == second:
            return first
    return ()


def objects_of_quantity(id: str, phrase: str, scene: Scene) -> tuple[str, ...]:
    """Return the objects that `phrase` names, if "the QUANTITY of PHRASE" requests nothing else."""
    try:
        answer = ground(f"the {id} of {phrase}", scene)
    except (InputError, PlanRejected):
        return ()
    plain = not (answer.remarks or answer.cannot) and all(p.quantity == id for p in answer.asked)
    return tuple(dict.fromkeys(parameter.object for parameter in answer.asked)) if plain else ()


# Effort beyond the minimum: slow passes between grasp and lift, and repeated cycles of grasp, lift
# and release. Empty and loaded passes over the same path alternate.


Efforts = Mapping[Parameter, Effort]


def efforts(scene: Scene, parameters: Iterable[Parameter], within: Within) -> Efforts:
    """Return the initial effort of each parameter with a requested width, if its quantity can predict one."""
    effort_of: dict[Parameter, Effort] = {}
    for parameter in parameters:
        # Convert the width to a noise standard deviation, less the floor of the quantity.
        width, site = within.of(parameter), site_of(scene, parameter)
        if width is not None and site is not None:
            quantity = scene.catalogue[parameter.quantity]
            effort = quantity.effort(site, noise_std(width, quantity.floor(site)), None)
            if effort is not None:
                effort_of[parameter] = effort
    return effort_of


def site_of(scene: Scene, parameter: Parameter, value: Sequence[float] = ()) -> Site | None:
    """Return the site of an object with the believed `value` of the parameter; None without one."""
    name = parameter.object
    if name not in scene.objects:
        return None
    # Believed value: the given one, else the stated one, else the prior.
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
        start: the state before the steps.
        steps: the steps.
        state: the state after them.
        name: the object.
        effort: speed of the passes and number of cycles. Fewer cycles are made where more would
            break a rule.

    Returns:
        The steps with the effort, and the state after them.
    """
    # Find the pose expressions of the last grasp and still recording in the log.
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
    # Slow the passes between grasp and lift to the speed of the effort.
    grasp, above = lift
    slowed = list(slow_steps(start.at, steps, {grasp, above}, effort.speed))
    # One cycle: down, grasp, up; down, release, up.
    cycle: list[Step] = []
    for fingers in (CloseGripper(), OpenGripper()):
        down, up = (MovePose(pose=pose, speed=effort.speed) for pose in lift)
        cycle += [Step((primitive,)) for primitive in (down, fingers, up)]
    # Append cycles as long as they pass the exact check.
    for _ in range(effort.cycles - 1):
        after = after_cycle(cycle, state, name, above)
        if after is None:
            break
        slowed += cycle
        state = after
    return slowed, state


def slow_steps(
    at: str | None, steps: Iterable[Step], ends: set[str], speed: float | None
) -> Iterator[Step]:
    """Yield the steps from pose `at` on, with passes between the two `ends` at `speed` (m/s)."""
    for step in steps:
        (first, *others), start = step.primitives, at
        if isinstance(first, MovePose):
            at = first.pose
            if {start, at} == ends and not others:
                step = Step((first.model_copy(update={"speed": speed}),), step.touches)
        elif "arm" in first.claims:
            at = None
        yield step


def after_cycle(
    steps: Iterable[Step], state: SymbolicState, name: str, above: str
) -> SymbolicState | None:
    """Return the state after a cycle; None if the cycle is not possible or is refused."""
    if state.at != above or not is_clear(state):
        return None
    for step in steps:
        after = step.apply(state)
        if after is None or step.harm(state) is not None:
            return None
        state = after
    return None if is_away(state, name) else state


# Steps that record evidence: sensing and conversion.


def conversion_tail(
    parameter: Parameter, operators: Sequence[Primitive], words: Vocabulary, around: Surroundings
) -> Tail:
    """Return a tail that senses and converts a parameter, alone or in parallel with a motion."""
    chains = list(recording_chains(parameter.quantity, words, around))
    motions = [operator for operator in operators if "arm" in operator.claims]

    def tail(state: SymbolicState) -> list[Step] | None:
        # Prefer a recording at rest; else record during one of the motions.
        for first, *others in chains:
            following = [Step((primitive,)) for primitive in others]
            steps = [Step((first,)), *following]
            if adds_evidence(parameter, steps, state):
                return steps
            for operator in motions:
                steps = [Step((operator, first)), *following]
                if not state.contact and adds_evidence(parameter, steps, state):
                    return steps
        return None

    return tail


def recording_chains(
    quantity: str, words: Vocabulary, around: Surroundings
) -> Iterator[tuple[Primitive, ...]]:
    """Yield pairs of sensing and conversion that end in `quantity`; the sensing alone for a derived one."""

    def iter_primitives(classes: Iterable[type[Primitive]]) -> Iterator[Primitive]:
        for cls in classes:
            yield from cls.groundings(around)

    known = around.state.scene.catalogue[quantity]
    # The value of a derived quantity is computed after the run, so no conversion is needed.
    if known.derived:
        for buffer in dict.fromkeys(evidence.buffer for evidence in known.evidence):
            for sensing in iter_primitives(words.sensors(buffer)):
                yield (sensing,)
    for conversion in iter_primitives(words.converters(quantity)):
        if conversion.reads is None:
            yield (conversion,)
            continue
        for sensing in iter_primitives(words.sensors(conversion.reads)):
            yield sensing, conversion


def adds_evidence(parameter: Parameter, steps: Iterable[Step], state: SymbolicState) -> bool:
    """True if the steps are possible and add evidence of the parameter."""
    before, quantity = evidence_amount(parameter, state), state.scene.catalogue[parameter.quantity]
    for step in steps:
        written = [primitive.writes for primitive in step.primitives if primitive.writes]
        if written and quantity.evidence:
            # Test the context of the recording before the slower execution of the step.
            context = during(step.moving, state).context()
            if not any(quantity.piece(parameter, buffer, context) for buffer in written):
                return False
        after = step.apply(state)
        if after is None:
            return False
        state = after
    return evidence_amount(parameter, state) > before
