"""Run: settings, scene and plan, and the results of every stage."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from pathlib import Path
from textwrap import shorten
from typing import TYPE_CHECKING, Literal

from palpate.common.belief import Belief
from palpate.common.errors import InputError
from palpate.common.parameter import Parameter
from palpate.common.pose import Array
from palpate.estimation.estimate import Estimate, Estimates
from palpate.estimation.quantities.catalogue import catalogue
from palpate.execution.stop import HeldObject
from palpate.planning.check.finding import Finding
from palpate.planning.plan import MAX_REASON, Plan
from palpate.primitives.state import SymbolicState
from palpate.runs.figures import format_values
from palpate.runs.held_out import HeldOut
from palpate.runs.settings import Settings
from palpate.scene.picture_scene import DetectedScene
from palpate.scene.scene import Scene
from palpate.trace.mcap import read_mcap
from palpate.trace.samples import Trace
from palpate.twin.inject import stated_parameter
from palpate.twin.twin import Twin

if TYPE_CHECKING:
    from palpate.execution.rehearsal import Rehearsal
    from palpate.execution.runner import Execution
    from palpate.perception.film import Footage
    from palpate.planning.model.conversation import Conversation


Status = Literal["running", "complete", "rejected", "aborted", "failed"]
Stage = Literal["executing", "estimating", "building the twin", "writing the report"]
RECORDING = "recording"  # Planner of a run that is another program's recording
TRACE = "trace.mcap"  # File of the trace in a run folder


@dataclass(frozen=True, slots=True)
class Ending:
    """Course and end of an execution, as in `result.json`."""

    status: Literal["complete", "stopped"]  # `complete` if the tree succeeded, else `stopped`
    stopped_by: str | None  # reason, or None
    actions: int  # leaves of the plan that were started
    # robot_seconds, wall_seconds: duration, s.
    robot_seconds: float
    wall_seconds: float
    setbacks: tuple[str, ...] = ()  # reasons of earlier stops after which the run continued
    # Object in the fingers at the stop and its whereabouts; None for nothing.
    held: HeldObject | None = None

    @classmethod
    def of(cls, done: Execution) -> Ending:
        """The figures of an execution."""
        return cls(**{field.name: getattr(done, field.name) for field in fields(cls)})


@dataclass(frozen=True, eq=False, repr=False)
class Run(Estimates):
    """Results of a run. Results of stages that were not reached are None or empty.

    Attributes:
        scene: D, or the scene built from a picture.
        plan: without a tree if it was rejected.
        findings: findings of the check.
        conversation: dialogue with a model, if the planner is one.
        seen: objects that a model detected, without D.
        picture: PNG of the workspace that was shown to the model, if no image was given.
        looked: PNG of a look of a camera before the plan, with the outlines of the objects.
        rehearsal: prediction of the simulation before the execution, if any.
        world: place of the execution.
        simulated: no real robot moved.
        execution: course and end of the execution.
        final_state: symbolic state of the cell after the execution.
        beliefs: poses of the objects by sight and touch, where a covariance is stated.
        recorded: the trace, unless it is in the folder (see `trace_if_any`).
        footage: frames of the cell's camera.
        black_box: every cycle of a real robot's last seconds before a stop, by signal; `cycles.npz`
            in the folder.
        estimates: one per parameter of the plan.
        truth: true values, if known.
        held_out: predictions of motions that were left out of the fits; None if nothing was lifted.
        finished: the twin, None until it is built.
        folder: the run folder, if any.
        stage: present stage, or the one at which the run was cut off; None when all is done.
        interrupted: description of a signal that ended the run.
        shortfalls: failures and their reasons, a line each.
        lost: names of files that could not be written into the folder, or are damaged there.
        begun: `time.perf_counter()` at the start of the command.
        total_seconds: wall time since then, s; None if unknown.
    """

    _ABSENT = "was not measured by this run; measured:"

    settings: Settings
    scene: Scene
    plan: Plan
    findings: tuple[Finding, ...] = ()
    conversation: Conversation | None = None
    seen: DetectedScene | None = None
    picture: bytes | None = None
    looked: bytes | None = None
    rehearsal: Rehearsal | None = None
    world: str | None = None
    simulated: bool = True
    execution: Ending | None = None
    final_state: SymbolicState | None = None
    beliefs: Mapping[str, Belief] = field(default_factory=dict[str, "Belief"])
    recorded: Trace | None = None
    footage: Footage | None = None
    black_box: Mapping[str, Array] | None = None
    estimates: tuple[Estimate, ...] = ()
    truth: Mapping[Parameter, tuple[float, ...]] = field(
        default_factory=dict[Parameter, tuple[float, ...]]
    )
    held_out: HeldOut | None = None
    finished: Twin | None = None
    folder: Path | None = None
    stage: Stage | None = None
    interrupted: str | None = None
    shortfalls: tuple[str, ...] = ()
    lost: tuple[str, ...] = ()
    begun: float | None = None
    total_seconds: float | None = None

    def __post_init__(self) -> None:
        # Label the estimates of a simulation.
        if any(estimate.simulated != self.simulated for estimate in self.estimates):
            labelled = (replace(estimate, simulated=self.simulated) for estimate in self.estimates)
            object.__setattr__(self, "estimates", tuple(labelled))

    @property
    def ready(self) -> bool:
        """True if the plan has a tree and no findings."""
        return self.plan.tree is not None and not self.findings

    @property
    def status(self) -> Status:
        """Status of the run.

        It is `complete` if every parameter of the plan is identified and written to the twin, or
        nothing is missing, and touch contradicts no pose. It is `running` before the last stage.
        """
        # The order matters: a signal, then the stage, then the results.
        if self.interrupted is not None:
            return "aborted"
        if self.stage is not None:
            return "running"
        if self.execution is None:
            return "complete" if self.plan.satisfied else "rejected"
        if self.execution.status == "stopped":
            return "aborted"
        return "failed" if any(self._failures()) else "complete"

    @property
    def reason(self) -> str:
        """Reason for a status that is neither `complete` nor `running`; else empty."""
        if self.status == "rejected":
            return self.findings[0].message if self.findings else self.plan.explanation
        if self.status == "aborted":
            return self.interrupted or (self.execution and self.execution.stopped_by) or ""
        return "; ".join(self._failures()) if self.status == "failed" else ""

    def _failures(self) -> Iterator[str]:
        """Reasons why a finished run is not complete."""
        # Parameters that the plan could not measure, and values that the twin could not take.
        yield from map(str, self.plan.unmeasured)
        yield from self.unwritten
        # Poses that touch contradicts.
        for name, belief in self.beliefs.items():
            if belief.contradiction:
                yield f"the pose of {name} is contradicted: {belief.contradiction}"
        # Estimates that are missing, uncertain or too wide.
        estimates = {estimate.parameter: estimate for estimate in self.estimates}
        for parameter in self.plan.parameters:
            estimate = estimates.get(parameter)
            if estimate is None:
                yield f"{parameter}: there is no estimate"
            elif not self.suffices(estimate):
                is_wide = estimate.identified and not estimate.unseen
                verdict = "the interval is wider than asked" if is_wide else estimate.whole
                # Reason of a doubtful value, or of a missing one.
                why = estimate.doubt if estimate.has_value else estimate.method
                clause = f" ({why.rstrip('.')})" if why and not is_wide else ""
                yield f"{parameter}: {estimate.contradiction or verdict + clause}"

    @property
    def unwritten(self) -> tuple[str, ...]:
        """Notes of the twin on requested values that were measured and could not be written."""
        if self.finished is None:
            return ()
        # Compare under the names that the file uses.
        stated = {stated_parameter(parameter, catalogue()) for parameter in self.plan.parameters}
        begun = [f"{p} is not in the twin" for p in self.finished.unwritten if p in stated]
        notes = self.finished.notes
        return tuple(next((note for note in notes if note.startswith(p)), p) for p in begun)

    @property
    def is_recorded(self) -> bool:
        """True if another program recorded the run: nothing was planned, and no robot was used."""
        return self.plan.planner == RECORDING

    @property
    def drawn(self) -> bool:
        """True if the truth was drawn from priors in a simulation."""
        from palpate.execution.simulated_cell import DRAWN

        return self.simulated and self.world == DRAWN

    def suffices(self, estimate: Estimate) -> bool:
        """True if an estimate is identified and as narrow as requested or as possible.

        All axes must be identified where the quantity promises them.
        """
        # A width that no further round can reach counts as sufficient.
        precision = self.settings.within.precision(estimate)
        narrow = precision is None or precision.outcome != "rounds used up"
        quantity = catalogue().get(estimate.parameter.quantity)
        entire = not estimate.unseen or quantity is None or not quantity.entire
        return estimate.identified and narrow and entire

    @property
    def trace(self) -> Trace:
        """The trace. Raises InputError: nothing was recorded; the message says why."""
        if self.trace_if_any is None:
            raise InputError(f"this run has no trace: {self._explain_missing_result()}")
        return self.trace_if_any

    @property
    def twin(self) -> Twin:
        """The finished scene. Raises InputError: no twin was built; the message says why."""
        if self.finished is None:
            raise InputError(f"this run has no twin: {self._explain_missing_result()}")
        return self.finished

    def _explain_missing_result(self) -> str:
        """Explain why the run lacks a result."""
        if self.plan.satisfied:
            return f"nothing was to be measured ({self.plan.explanation})"
        if self.plan.tree is None:
            return f"its plan was rejected ({self.plan.explanation})"
        if self.findings:
            return f"its plan did not pass the check ({self.findings[0].message})"
        if self.execution is not None and self.execution.stopped_by:
            return f"it was stopped ({self.execution.stopped_by})"
        return f"its status is {self.status}; estimates that are made again bring no twin"

    @cached_property
    def trace_if_any(self) -> Trace | None:
        """The trace, or None; a run opened from its folder reads the file at first use."""
        # In memory, or else in the folder.
        if self.recorded is not None or self.folder is None:
            return self.recorded
        # Before the first motion the folder has no trace.
        nothing_moved = self.execution is None and self.stage is None
        if nothing_moved or not (self.folder / TRACE).exists():
            return None
        return read_mcap(self.folder / TRACE)

    def __repr__(self) -> str:
        parts = [", ".join(_brief(estimate) for estimate in self.estimates)]
        parts.append(shorten(self.reason, MAX_REASON, placeholder=" …"))
        details = "; ".join(filter(None, parts))
        return f"<Run {self.status}{': ' * bool(details)}{details}{self._where()}>"

    def _where(self) -> str:
        if self.execution is None:
            return ""
        return ", simulated" if self.simulated else ", on the real robot"


def _brief(estimate: Estimate) -> str:
    """Abbreviate an estimate to a few characters."""
    if not estimate.has_value:
        return f"{estimate.parameter} unknown"
    if any(estimate.at_bound):
        return f"{estimate.parameter} {format_values(estimate)}"
    values = " ".join(f"{value:.4g}" for value in estimate.values.tolist())
    if estimate.contradiction:
        return f"{estimate.parameter} = {values}, contradicted"
    return f"{estimate.parameter} = {values}"
