"""Proof of a twin: distances from the goal of tasks that were planned in the prior and in the twin.

Each task is planned in the prior (the scene as given) and in the twin. It is carried out in the
scene with the true values of a simulated world. Where they are not known, it is carried out in
scenes drawn from the twin's intervals. The distances that the twin's plan reaches in those draws
are its promise.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import ClassVar, Generic

import numpy as np

from palpate.common.display import table, text_table
from palpate.common.errors import InputError
from palpate.common.parameter import Parameter
from palpate.common.pose import Array
from palpate.estimation.estimate import Estimate
from palpate.runs.tasks import JOINT_TASKS, TASKS, Task, Tasks, World, joint_trial_of
from palpate.runs.trial import Values, trial_of
from palpate.scene.scene import Scene
from palpate.twin.inject import part_names, stated_parameter, values_to_write
from palpate.twin.twin import twin_estimates

DRAWS = 20  # Count of worlds drawn from the twin's intervals
TRIES = 5  # Attempts for each draw, on average. A draw that no body can have is repeated.
SAME = 1e-3  # Share of a goal, or of a force. Plans that differ by less count as equal.
COLUMNS = ("object", "task", "goal", "prior off by", "twin off by", "95 % of draws")


@dataclass(frozen=True, slots=True)
class ProvedTask:
    """A task with one object. Errors are signed distances from the goal, in `unit`."""

    object: str
    task: str  # its name
    says: str  # description
    unit: str  # `m` or `N`
    goal: float  # m to the mark; for a threshold the force of the judging world, N
    # Errors of the prior's plan in each judging world; not finite where it fails.
    prior: tuple[float, ...]
    twin: tuple[float, ...]  # errors of the twin's plan there
    drawn: tuple[float, ...]  # errors of the twin's plan in worlds drawn from its intervals

    @property
    def promise(self) -> tuple[float, float]:
        """Central 95 % of the errors that the twin's intervals allow."""
        # Use the nearest sample: interpolation with an infinite error would give NaN.
        low, high = np.quantile(self.drawn, (0.025, 0.975), method="nearest").tolist()
        return low, high

    @property
    def depends(self) -> bool:
        """True if the plans of prior and twin differ: a measured value acts on the task."""
        return not np.allclose(self.prior, self.twin, rtol=0, atol=SAME * abs(self.goal))

    def cells(self) -> tuple[str, ...]:
        """Row of a table with `COLUMNS`."""
        # Where both plans agree, the errors show nothing.
        goal = f"{self._number(self.goal)} {self._symbol}"
        if not self.depends:
            return self.object, self.task, goal, "nothing measured matters", "", ""
        low, high = (self._format_sign(end) for end in self.promise)
        promise = f"{low} … {high} {self._symbol}"
        return self.object, self.task, goal, self._text(self.prior), self._text(self.twin), promise

    def _text(self, errors: Sequence[float]) -> str:
        """Format one error, or the root mean square of several."""
        error = typical(errors)
        if not np.isfinite(error):
            return "fails"
        number = self._format_sign(error) if len(errors) == 1 else f"± {self._number(error)}"
        return f"{number} {self._symbol}"

    def _format_sign(self, error: float) -> str:
        if not np.isfinite(error):
            return "fails"
        return f"{'+' if error >= 0 else '-'}{self._number(abs(error))}"

    def _number(self, size: float) -> str:
        return f"{1e3 * size:.1f}" if self.unit == "m" else f"{size:.3f}"

    @property
    def _symbol(self) -> str:
        return "mm" if self.unit == "m" else self.unit


def typical(errors: Sequence[float]) -> float:
    """Return one error, or the root mean square of several; infinite if any is."""
    return errors[0] if len(errors) == 1 else float(np.sqrt(np.mean(np.square(errors))))


@dataclass(frozen=True, eq=False, repr=False)
class Proof:
    """Tasks planned with a twin, and their distances from the goals.

    Attributes:
        rows: one for each object and task that can be done.
        judge: `truth`, or `draws` where the truth is not known.
        left_out: objects and tasks that cannot be done, a line each.
    """

    rows: tuple[ProvedTask, ...]
    judge: str
    left_out: tuple[str, ...]
    columns: ClassVar[tuple[str, ...]] = COLUMNS

    def __repr__(self) -> str:
        return f"<Proof by {self.judge}: {len(self.rows)} tasks>"

    def __str__(self) -> str:
        """The tasks as a table of text."""
        return text_table(COLUMNS, [row.cells() for row in self.rows])

    def _repr_html_(self) -> str:
        return table(repr(self), COLUMNS, [row.cells() for row in self.rows])


def prove(
    scene: Scene,
    estimates: Sequence[Estimate],
    truth: Mapping[Parameter, tuple[float, ...]],
    seed: int = 0,
    draws: int = DRAWS,
) -> Proof:
    """Plan tasks in prior and twin, and carry them out in the truth, or in draws where it is not known.

    Raises InputError: neither an object was measured, nor its support, nor a drawer or a door.
    """
    # Find the objects and fixtures on which a measured value acts.
    named = partial(stated_parameter, quantities=scene.catalogue)
    stated = [replace(each, parameter=named(each.parameter)) for each in twin_estimates(estimates)]
    values, _ = values_to_write(scene, stated, {estimate.parameter for estimate in stated})
    objects = [name for name in scene.objects if _acts_on(scene, name, values)]
    fixtures = [name for name in scene.fixtures if _acts_on(scene, name, values)]
    # Without a measured value both plans are equal.
    if not objects + fixtures:
        raise InputError(
            "there is nothing to prove: no object was measured, nor what it stands on, nor a drawer or a door"
        )
    # Complete the truth with the twin's values: a plan then differs only by the measured ones.
    true = {**values, **{named(parameter): value for parameter, value in truth.items()}}
    spread, rng = spread_of(stated, values), np.random.default_rng(seed)
    # Draw the worlds of each subject once, and do all its tasks in them.
    rows: list[ProvedTask] = []
    left_out: list[str] = []

    def add(name: str, make: Callable[[Values], World], tasks: Tasks[World]) -> None:
        drawn = drawn_worlds(name, make, values, spread, rng, draws)
        judges = [make(true)] if truth else drawn
        worlds = _Worlds(make({}), make(values), judges, drawn)
        for kinds in tasks:
            row = worlds.prove_task(name, kinds)
            if row is None:
                left_out.append(f"{name}: {kinds[0].name} cannot be done in the twin")
            else:
                rows.append(row)

    for name in objects:
        add(name, partial(trial_of, scene, name), TASKS)
    for name in fixtures:
        add(name, partial(joint_trial_of, scene, name), JOINT_TASKS)
    return Proof(tuple(rows), "truth" if truth else "draws", tuple(left_out))


@dataclass(frozen=True, slots=True)
class _Worlds(Generic[World]):
    """Worlds of one object or fixture: planned in `prior` and `twin`, carried out in `judges` and `drawn`."""

    prior: World
    twin: World
    judges: Sequence[World]
    drawn: Sequence[World]

    def prove_task(self, name: str, kinds: Sequence[type[Task[World]]]) -> ProvedTask | None:
        """Plan and carry out the first of `kinds` that can be done in the twin, in the first possible direction."""
        for task in (kind(variant) for kind in kinds for variant in kind.ways):
            action = task.plan(self.twin)
            if action is not None:
                return self._carried_out(name, task, action)
        return None

    def _carried_out(self, name: str, task: Task[World], action: float) -> ProvedTask:
        # The twin's plan in the draws gives its promise.
        drawn = errors(task, action, self.drawn)
        return ProvedTask(
            name,
            task.name,
            task.says,
            task.unit,
            task.goal or action,
            errors(task, task.plan(self.prior), self.judges),
            drawn if self.judges is self.drawn else errors(task, action, self.judges),
            drawn,
        )


def errors(task: Task[World], action: float | None, worlds: Sequence[World]) -> tuple[float, ...]:
    """Distances from the goal after an action in each world; infinite without an action."""
    if action is None:
        return (np.inf,) * len(worlds)
    return tuple(task.outcome(world, action) - task.goal for world in worlds)


def _acts_on(scene: Scene, name: str, values: Values) -> bool:
    """True if a value belongs to an object or to one of its carriers."""
    # A value of a support acts on the objects on it.
    carriers = {body.name for body in scene.bodies.values() if name in body.carries}
    return any(parameter.object in carriers | {name} for parameter in values)


def spread_of(estimates: Sequence[Estimate], values: Values) -> dict[Parameter, Array]:
    """Standard deviations (n,) of each written value. The value may be a part of the estimate of another quantity."""
    # Own estimates first, then parts of the estimates of other quantities.
    stds = {each.parameter: each.stds for each in estimates}
    for parameter in values.keys() - stds.keys():
        names = part_names(parameter.quantity, len(values[parameter]))
        parts = next(
            each.parts
            for each in estimates
            if each.parameter.object == parameter.object and names[0] in each.parts
        )
        stds[parameter] = np.array([parts[name].std for name in names])
    return stds


def drawn_worlds(
    name: str,
    make: Callable[[Values], World],
    values: Values,
    spread: Mapping[Parameter, Array],
    rng: np.random.Generator,
    draws: int,
) -> list[World]:
    """Draw worlds with values from the estimates' normal distributions.

    Values that no body can have, as a negative mass, are drawn again.
    Raises InputError: fewer than `draws` worlds in `TRIES` times as many attempts.
    """
    # Rejection sampling from independent normal distributions.
    worlds: list[World] = []
    for _ in range(TRIES * draws):
        drawn = {
            parameter: tuple(rng.normal(value, spread[parameter]).tolist())
            for parameter, value in values.items()
        }
        with suppress(InputError):
            worlds.append(make(drawn))
        if len(worlds) == draws:
            return worlds
    raise InputError(f"the intervals of '{name}' hold hardly any body that can exist")
