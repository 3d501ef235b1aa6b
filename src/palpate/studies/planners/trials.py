"""Independent trials of planners, several in parallel, each appended to a file on completion.

A killed study goes on where it was: what is in the file is not asked again.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from dataclasses import asdict, dataclass, field
from itertools import islice, product
from pathlib import Path
from typing import Any, Literal

from pydantic import TypeAdapter, ValidationError

from palpate.errors import Unavailable
from palpate.studies.engine.lines import Lines

OUTAGES = 3
"""Trials in a row that find the provider unavailable, after which no further one is begun."""


Outcome = Literal[
    "not judged", "acquired", "stopped rightly", "refused rightly", "refused", "failed"
]
"""Outcome of a trial. Successes: the right quantities were acquired; the arm had to be stopped and
was; nothing could be measured and the planner said so."""
SUCCESSES: tuple[Outcome, ...] = ("acquired", "stopped rightly", "refused rightly")


@dataclass(frozen=True, slots=True, order=True)
class Trial:
    """Independent attempt of a planner at a scenario's task.

    Attributes:
        scenario: its name.
        planner: planner string.
        configuration: what was left out of the prompt, `full` if nothing.
        number: from 0; also the seed of the simulated world's sensors.
        prompt: which system prompt, `full` or `lean`.
        critic: the second model that may object; empty if none.
    """

    scenario: str
    planner: str
    configuration: str
    number: int
    prompt: str = "full"
    critic: str = ""

    @property
    def asked(self) -> str:
        """Planner, prompt style and critic, as a label; defaults left out."""
        words = [self.planner]
        if self.prompt != "full":
            words.append(f"{self.prompt} prompt")
        if self.critic:
            words.append(f"critic {self.critic}")
        return ", ".join(words)


def every_trial(
    scenarios: Iterable[str],
    planners: Iterable[str],
    configurations: Iterable[str],
    number: int,
    prompts: Iterable[str] = ("full",),
    critic: str = "",
) -> list[Trial]:
    """`number` trials of every configuration of every prompt with every planner, scenario by
    scenario and planner by planner."""
    trials: list[Trial] = []
    each = product(scenarios, planners, prompts, configurations, range(number))
    for scenario, planner, prompt, configuration, i in each:
        trials.append(Trial(scenario, planner, configuration, i, prompt, critic))
    return trials


@dataclass(frozen=True, slots=True)
class Found:
    """Estimate and true value in the quantity's SI unit, a number per component."""

    value: tuple[float, ...]
    std: tuple[float, ...]
    truth: tuple[float, ...]
    unit: str
    verdict: str


@dataclass(frozen=True, slots=True)
class Record:
    """Record of a trial, a line of the results file.

    Attributes:
        syntax: the first answer is a plan that compiles to a behavior tree.
        valid: a plan, or an explanation why there is none, passed the check.
        success: whether the outcome is one of `SUCCESSES`; None where the task defines none.
        reason: why not.
        figures: tokens, cost, latency, the model's name as the provider reports it.
        found: what was estimated, by parameter.
        actions: leaves that were started.
        robot_seconds: how long they took.
    """

    trial: Trial
    syntax: bool
    valid: bool
    success: bool | None
    reason: str = ""
    figures: dict[str, Any] = field(default_factory=dict[str, Any])
    outcome: Outcome = "not judged"
    found: dict[str, Found] = field(default_factory=dict[str, Found])
    actions: int = 0
    robot_seconds: float = 0.0

    @property
    def tokens(self) -> int:
        """Tokens of all prompts and answers of the trial."""
        return self.figures.get("input_tokens", 0) + self.figures.get("output_tokens", 0)

    @property
    def cost(self) -> float | None:
        """US dollars; None where an answer has no known price."""
        return self.figures.get("cost_usd")


def run_trials(
    trials: Sequence[Trial],
    attempt: Callable[[Trial], Record],
    file: Path,
    in_flight: int = 4,
    say: Callable[[str], None] = lambda _: None,
) -> list[Record]:
    """All trials' records, in order: those in `file` as they are, the others by `attempt`, appended
    to it.

    Raises:
        InputError: `file` is not a results file.
        Unavailable: the provider could not be reached; what is done is kept.
    """
    kept = {record.trial: record for record in read_records(file)}
    Lines(file).add()  # what is paid for can be kept
    todo = [trial for trial in trials if trial not in kept]
    done = len(trials) - len(todo)
    say(f"{done} of {len(trials)} trials are done already")
    for record in _attempted(todo, attempt, in_flight):
        Lines(file).add(asdict(record))
        kept[record.trial] = record
        done += 1
        say(f"{done} of {len(trials)}: {_told(record)}")
    return [kept[trial] for trial in trials]


def read_records(file: Path) -> list[Record]:
    """The records in a results file, none when there is no file.

    Raises:
        InputError: it is another file.
    """
    lines = Lines(file)
    record = TypeAdapter(Record)
    try:
        return [record.validate_python(line) for line in lines.read()]
    except ValidationError:
        raise lines.other() from None


def _attempted(
    trials: Sequence[Trial], attempt: Callable[[Trial], Record], in_flight: int
) -> Iterator[Record]:
    """Records as they come, at most `in_flight` trials at a time; ends early when the provider
    stays out."""
    waiting = iter(trials)
    outage: Unavailable | None = None
    in_a_row = 0
    with ThreadPoolExecutor(in_flight) as pool:
        running = {pool.submit(attempt, trial) for trial in islice(waiting, in_flight)}
        while running:
            done, running = wait(running, return_when=FIRST_COMPLETED)
            for future in done:
                try:
                    yield future.result()
                    in_a_row = 0
                except Unavailable as error:
                    outage, in_a_row = error, in_a_row + 1
            # As many begin as have ended, so that no more than `in_flight` are under way.
            if in_a_row < OUTAGES:
                running |= {pool.submit(attempt, trial) for trial in islice(waiting, len(done))}
    if outage is not None:
        raise Unavailable(f"{outage} — the finished trials are kept; run the study again to go on")


def _told(record: Record) -> str:
    """A record in one line."""
    trial = record.trial
    syntax = "syntax valid" if record.syntax else "syntax not valid"
    asked = f"{trial.scenario}, {trial.configuration}, {trial.asked}"
    return f"{asked}, trial {trial.number}: {syntax}, {_ended(record)}"


def _ended(record: Record) -> str:
    if record.success is None:
        return "not judged"
    if record.success:
        return record.outcome
    return f"{record.outcome} ({record.reason})"
