"""The paper's table III: the same task over and over, with different models."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from palpate.studies.attempt import Conditions, attempt, with_image
from palpate.studies.trials import Record, Trial, every_trial, run_trials

PAPER: dict[str, tuple[int, int]] = {"GPT-4": (20, 20), "Gemini 1.5 Pro": (20, 20)}
"""Valid syntax and task success of 20: table III of the paper."""

TRIALS = 20


def published() -> dict[str, str]:
    """The paper's syntax and success in words, by configuration; each pair of rates once."""
    rates = {f"{syntax}/20, {success}/20" for syntax, success in PAPER.values()}
    return {"full": "; ".join(sorted(rates))}


def repeatability(
    scenario: str,
    planners: Sequence[str],
    file: Path,
    conditions: Conditions,
    trials: int = TRIALS,
    in_flight: int = 4,
    say: Callable[[str], None] = lambda _: None,
) -> list[Record]:
    """The full prompt with every planner, `trials` times each; results are appended to `file`.

    Raises:
        InputError: unknown scenario or planner.
        Unavailable: the provider could not be reached; what is done is kept.
    """
    conditions = with_image(scenario, conditions, file)
    wanted = every_trial(scenario, planners, ["full"], trials)

    def attempted(trial: Trial) -> Record:
        return attempt(trial, frozenset(), conditions)

    return run_trials(wanted, attempted, file, in_flight, say)
