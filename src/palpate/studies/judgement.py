"""Judgement of a trial: did the run acquire exactly the parameters that the scenario asks for?

The evidence is the execution trace, as in the paper, and the values in the twin against the hidden
truth.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass

from palpate.common.parameter import Parameter
from palpate.estimation.estimate import Estimate
from palpate.estimation.quantities.catalogue import catalogue
from palpate.runs.run import Run
from palpate.studies.scenarios.catalogue import Scenario
from palpate.studies.trials import SUCCESSES, Outcome
from palpate.trace.samples import Trace

FAR = 4.0  # Stated standard deviations: an identified value with a larger error is wrong


@dataclass(frozen=True, slots=True)
class Ruling:
    """Outcome of a trial, with the reason of a failure."""

    outcome: Outcome
    reason: str = ""

    @property
    def success(self) -> bool:
        """True if the outcome is the one that the scenario expects."""
        return self.outcome in SUCCESSES


def rule(run: Run, task: Scenario, looks: bool) -> Ruling:
    """Judge a run of a scenario by its trace, and by the values in its twin against the truth.

    `looks` is true if the planner sees pictures. A scenario that only a picture explains then
    counts as solvable.
    """
    if not run.ready:
        return judge_without_motion(run, task, looks)
    # A planner without pictures is not blamed for what only a picture shows.
    blind = task.only_seen and not looks
    if task.status == "rejected" and not blind:
        return Ruling("failed", "the arm moved where nothing can be measured")
    if task.status != "complete":
        return judge_stopped_run(run, task, blind)
    assert run.trace_if_any is not None
    # Judge the trace first, then the values.
    if reason := objection(run.trace_if_any, task.expects, task.may_touch):
        return Ruling("failed", reason)
    if wrong := next(value_errors(run, task.expects), None):
        return Ruling("failed", wrong)
    return Ruling("acquired")


def is_valid(run: Run) -> bool:
    """True if the plan, or the explanation for making none, passed the check."""
    if run.findings:
        return False
    if run.conversation is None or not run.conversation.rounds:
        return True
    return not run.conversation.rounds[-1].findings


def judge_without_motion(run: Run, task: Scenario, looks: bool) -> Ruling:
    """Judge a run without an execution. It is right only if nothing can be measured."""
    if not is_valid(run):
        # The check's findings, else those of the last answer.
        findings: Sequence[str] = [finding.message for finding in run.findings]
        if not findings and run.conversation is not None:
            findings = run.conversation.rounds[-1].findings
        return Ruling("failed", "; ".join(findings[:3])[:500])
    if run.plan.satisfied:
        return Ruling("failed", "it says that nothing is missing")
    if not task.expects or (task.only_seen and not looks):
        return Ruling("refused rightly")
    return Ruling("refused", f"no tree: {run.plan.explanation[:300]}")


def judge_stopped_run(run: Run, task: Scenario, blind: bool) -> Ruling:
    """Judge a run of a scenario in which the arm must be stopped.

    A planner that is `blind` to the obstacle may have any plan, others need the right one.
    """
    # A plan is right if it measures exactly the expected parameters.
    needless = set(run.plan.parameters) ^ set(task.expects)
    if needless and not blind:
        return Ruling("failed", f"what to measure is another: {names_of(needless)}")
    if run.status != "aborted":
        return Ruling("failed", f"ended {run.status} where the arm had to stop")
    named = [estimate.parameter for estimate in run.estimates if estimate.identified]
    if wrong := next(value_errors(run, named), None):
        return Ruling("failed", wrong)
    return Ruling("stopped rightly")


def value_errors(run: Run, expected: Iterable[Parameter]) -> Iterator[str]:
    """Yield reasons against the twin: expected parameters that are not identified, not written, or
    more than FAR stated standard deviations off.
    """
    # Each expected value: identified, written, and near the truth.
    estimates = {estimate.parameter: estimate for estimate in run.estimates}
    unwritten = run.finished.unwritten if run.finished else ()
    for parameter in expected:
        estimate = estimates.get(parameter)
        if estimate is None or not run.suffices(estimate):
            yield f"{parameter} is {estimate.verdict if estimate else 'not identified'}"
            continue
        if parameter in unwritten:
            yield f"{parameter} is not in the twin"
        truth = run.truth.get(parameter)
        if truth is None:
            yield f"the truth of {parameter} is not known"
        elif (off := worst_deviation(estimate, truth)) > FAR:
            yield f"{parameter} is off by {off:.1f} of its standard deviations"


def worst_deviation(estimate: Estimate, truth: Sequence[float]) -> float:
    """Largest |z| = |error| / stated standard deviation of the identified components."""
    worst = 0.0
    for i, verdict in enumerate(estimate.verdicts):
        error = abs(float(estimate.values[i]) - truth[i])
        # Skip other verdicts: they promise no accuracy.
        if verdict == "identified" and error > 0.0:
            std = float(estimate.stds[i])
            worst = max(worst, error / std if std > 0.0 else float("inf"))
    return worst


def objection(
    trace: Trace, expected: Collection[Parameter], may_touch: Collection[str] = ()
) -> str:
    """First reason against a success; empty for a success.

    A success has the right sensing on the right objects, and no action that failed, was stopped or was redundant.
    Objects of `may_touch` may be moved out of the way.
    """
    return next(all_objections(trace, expected, may_touch), "")


def all_objections(
    trace: Trace, expected: Collection[Parameter], may_touch: Collection[str]
) -> Iterator[str]:
    """Yield the reasons against a success, the most serious first."""
    # Failed or stopped actions are the most serious.
    for leaf in trace.leaves:
        if leaf.status != "SUCCESS":
            yield f"{leaf.label} failed: {leaf.message}"[:300]
    # Compare the acquired parameters with the expected ones.
    acquired = Counter(acquired_parameters(trace, expected))
    if missed := set(expected) - set(acquired):
        yield f"not acquired: {names_of(missed)}"
    if needless := set(acquired) - set(expected):
        yield f"not asked for: {names_of(needless)}"
    if twice := [parameter for parameter, count in acquired.items() if count > 1]:
        yield f"acquired more than once: {names_of(twice)}"
    for node in unused_recordings(trace, expected):
        yield f"measured without need at {node}"
    # Every object that was in the hand must be requested, or be in the way.
    wanted = {parameter.object for parameter in expected}
    names = {leaf.context.holding for leaf in trace.leaves if leaf.context and leaf.context.holding}
    if unexpected := names - wanted - set(may_touch):
        yield f"touched needlessly: {', '.join(sorted(unexpected))}"


def acquired_parameters(trace: Trace, expected: Collection[Parameter]) -> Iterator[Parameter]:
    """Yield the converted parameters, and the expected derived ones with a raw force recording."""
    for conversion in trace.conversions:
        yield Parameter(conversion.object, conversion.quantity)
    # Derived quantities have recordings but no conversion.
    logged = [(r.buffer, r.context) for r in trace.recordings]
    for parameter in expected:
        quantity = catalogue()[parameter.quantity]
        if quantity.derived and quantity.is_evidenced(parameter, logged):
            yield parameter


def unused_recordings(trace: Trace, expected: Collection[Parameter]) -> Iterator[str]:
    """Yield the nodes of recordings that nothing uses.

    Such a recording has no conversion, and is not evidence for an expected derived quantity.
    """
    # A conversion uses its recording.
    converted = {(c.recording.buffer, c.recording.start) for c in trace.conversions}
    for recording in trace.recordings:
        if (recording.buffer, recording.start) in converted:
            continue
        pieces = [catalogue().piece(p, recording.buffer, recording.context) for p in expected]
        if all(piece is None for piece in pieces):
            yield recording.node


def names_of(parameters: Iterable[Parameter]) -> str:
    return ", ".join(str(parameter) for parameter in sorted(parameters))
