"""Independent trials of planners, several in parallel, and their success rates.

Each is appended to a file on completion. A killed study can be continued: trials in the file are
not repeated.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from dataclasses import asdict, dataclass, field
from itertools import islice
from pathlib import Path
from statistics import fmean
from typing import Any, Literal, TypeVar

from palpate.common.errors import Unavailable
from palpate.studies.efficiency import Rate
from palpate.studies.workers import Lines

# Consecutive trials with an unavailable provider after which no further trial is started.
OUTAGES = 3

# Outcome of a trial. The successes are: the right quantities were acquired; the arm was stopped
# where it had to be; nothing could be measured and the planner refused.
Outcome = Literal[
    "not judged", "acquired", "stopped rightly", "refused rightly", "refused", "failed"
]
SUCCESSES: tuple[Outcome, ...] = ("acquired", "stopped rightly", "refused rightly")

Key = TypeVar("Key")


@dataclass(frozen=True, slots=True, order=True)
class PlannerTrial:
    """Independent attempt of a planner at a scenario's task."""

    scenario: str  # its name
    planner: str  # planner string
    configuration: str  # omitted part of the prompt, `full` for none
    number: int  # from 0; also the seed of the simulated world's sensors
    prompt: str = "full"  # style of the system prompt, `full` or `lean`
    critic: str = ""  # the second model that may object; empty if none

    @property
    def asked(self) -> str:
        """Planner, prompt style and critic, as a label without defaults."""
        words = [self.planner]
        if self.prompt != "full":
            words.append(f"{self.prompt} prompt")
        if self.critic:
            words.append(f"critic {self.critic}")
        return ", ".join(words)

    def __str__(self) -> str:
        return f"{self.scenario}, {self.configuration}, {self.asked}"


@dataclass(frozen=True, slots=True)
class MeasuredValue:
    """Estimate and true value in the quantity's SI unit, a number per component."""

    value: tuple[float, ...]
    std: tuple[float, ...]
    truth: tuple[float, ...]
    unit: str
    verdict: str


@dataclass(frozen=True, slots=True)
class TrialRecord:
    """Record of a trial, a line of the results file."""

    trial: PlannerTrial  # identity
    syntax: bool  # the first answer is a plan that compiles to a behavior tree
    valid: bool  # a plan, or an explanation for making none, passed the check
    success: bool | None  # the outcome is one of `SUCCESSES`; None if the task defines none
    reason: str = ""  # of a failure
    # Tokens, cost, latency, the model's name as the provider reports it.
    figures: dict[str, Any] = field(default_factory=dict[str, Any])
    outcome: Outcome = "not judged"  # of the trial
    # Estimates by parameter.
    found: dict[str, MeasuredValue] = field(default_factory=dict[str, MeasuredValue])
    actions: int = 0  # leaves that were started
    robot_seconds: float = 0.0  # duration of the execution

    @property
    def tokens(self) -> int:
        """Tokens of all prompts and answers of the trial."""
        return self.figures.get("input_tokens", 0) + self.figures.get("output_tokens", 0)

    @property
    def cost(self) -> float | None:
        """US dollars; None if an answer has no known price."""
        return self.figures.get("cost_usd")

    def __str__(self) -> str:
        syntax = "syntax valid" if self.syntax else "syntax not valid"
        ended = "not judged" if self.success is None else str(self.outcome)
        if self.success is False:
            ended += f" ({self.reason})"
        return f"{self.trial}, trial {self.trial.number}: {syntax}, {ended}"


def run_trials(
    trials: Sequence[PlannerTrial],
    attempt: Callable[[PlannerTrial], TrialRecord],
    file: Path,
    in_flight: int = 4,
    say: Callable[[str], None] = lambda _: None,
) -> list[TrialRecord]:
    """Return the records of all trials, in order.

    Records in `file` are read, the others are made by `attempt` and appended.
    """
    # Continue a study: only trials without a record are made.
    kept = {record.trial: record for record in read_records(file)}
    Lines(file).add()  # fails before anything is paid for, if the file cannot be written
    todo = [trial for trial in trials if trial not in kept]
    done = len(trials) - len(todo)
    say(f"{done} of {len(trials)} trials are done already")
    for record in attempt_in_parallel(todo, attempt, in_flight):
        Lines(file).add(asdict(record))
        kept[record.trial] = record
        done += 1
        say(f"{done} of {len(trials)}: {record}")
    return [kept[trial] for trial in trials]


def read_records(file: Path) -> list[TrialRecord]:
    """Read the records of a results file; empty without a file."""
    return Lines(file).read_as(TrialRecord)


def attempt_in_parallel(
    trials: Sequence[PlannerTrial], attempt: Callable[[PlannerTrial], TrialRecord], in_flight: int
) -> Iterator[TrialRecord]:
    """Yield records in order of completion, with at most `in_flight` trials at a time.

    The iteration ends early if the provider stays unavailable.
    """
    # Count consecutive outages; a success resets the count.
    waiting = iter(trials)
    outage: Unavailable | None = None
    in_a_row = 0
    with ThreadPoolExecutor(in_flight) as pool:
        running = {pool.submit(attempt, trial) for trial in islice(waiting, in_flight)}
        while running:
            done, running = wait(running, return_when=FIRST_COMPLETED)
            # An unavailable provider gives no record: the trial is repeated in the next session.
            for future in done:
                try:
                    yield future.result()
                    in_a_row = 0
                except Unavailable as error:  # no result: the trial is repeated next time
                    outage, in_a_row = error, in_a_row + 1
            # Start as many trials as have ended.
            if in_a_row < OUTAGES:
                running |= {pool.submit(attempt, trial) for trial in islice(waiting, len(done))}
    if outage is not None:
        raise Unavailable(f"{outage} — the finished trials are kept; run the study again to go on")


@dataclass(frozen=True, slots=True, kw_only=True)
class ConfigurationRow:
    """Row of a results table: trials of one prompt configuration with one planner."""

    configuration: str  # of the prompt
    planner: str  # planner string
    # syntax, valid: rates of all trials.
    syntax: Rate
    valid: Rate
    success: Rate | None  # rate of the judged trials; None if none was judged
    tokens: float  # mean of a trial
    cost: float | None  # US dollars of all trials together; None if an answer has no known price
    asked: str = ""  # planner, prompt style and critic, as a label
    scenario: str = ""  # of all trials; empty if they are of several


def table(records: Iterable[TrialRecord]) -> list[ConfigurationRow]:
    """Make a row for each combination of configuration, prompt and planner, in order of first appearance."""
    groups = group_records(records, lambda r: (r.trial.configuration, r.trial.asked))
    return [summary_row(group) for group in groups.values()]


def by_scenario(records: Iterable[TrialRecord]) -> list[ConfigurationRow]:
    """Make the rows of `table` for each scenario."""
    groups = group_records(
        records, lambda r: (r.trial.scenario, r.trial.configuration, r.trial.asked)
    )
    return [summary_row(group) for group in groups.values()]


def group_records(
    records: Iterable[TrialRecord], key: Callable[[TrialRecord], Key]
) -> dict[Key, list[TrialRecord]]:
    """Group records by `key`, in order of first appearance."""
    groups: dict[Key, list[TrialRecord]] = {}
    for record in records:
        groups.setdefault(key(record), []).append(record)
    return groups


def success_rate(records: Iterable[TrialRecord]) -> Rate | None:
    """Rate of success of the judged trials; None if none was judged."""
    judged = [record.success for record in records if record.success is not None]
    return Rate.of(judged) if judged else None


def summary_row(records: Sequence[TrialRecord]) -> ConfigurationRow:
    # The total cost is known only if every answer has a price.
    costs = [record.cost for record in records]
    priced = [cost for cost in costs if cost is not None]
    scenarios = {record.trial.scenario for record in records}
    trial = records[0].trial
    return ConfigurationRow(
        configuration=trial.configuration,
        planner=trial.planner,
        syntax=Rate.of(record.syntax for record in records),
        valid=Rate.of(record.valid for record in records),
        success=success_rate(records),
        tokens=fmean(record.tokens for record in records),
        cost=sum(priced, 0.0) if len(priced) == len(costs) else None,
        asked=trial.asked,
        scenario=trial.scenario if len(scenarios) == 1 else "",
    )
