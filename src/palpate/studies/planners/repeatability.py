"""The paper's table III: the same task over and over, with different models."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

from palpate.studies.planners.ablation import ablation
from palpate.studies.planners.attempt import Conditions
from palpate.studies.planners.trials import Record

PAPER: dict[str, tuple[int, int]] = {"GPT-4": (20, 20), "Gemini 1.5 Pro": (20, 20)}
"""Valid syntax and task success of 20: table III of the paper."""

TRIALS = 20


def published() -> dict[str, str]:
    """The paper's syntax and success in words, by configuration; each pair of rates once."""
    rates = {f"{syntax}/20, {success}/20" for syntax, success in PAPER.values()}
    return {"full": "; ".join(sorted(rates))}


def repeatability(
    names: Sequence[str],
    planners: Sequence[str],
    file: Path,
    conditions: Conditions,
    trials: int = TRIALS,
    in_flight: int = 4,
    say: Callable[[str], None] = lambda _: None,
    prompts: Iterable[str] = ("full",),
) -> list[Record]:
    """Whole prompts with every planner in every scenario, `trials` times each; results are appended
    to `file`.

    Raises:
        InputError: unknown scenario or planner.
        Unavailable: the provider could not be reached; what is done is kept.
    """
    return ablation(names, planners, file, conditions, trials, ["full"], in_flight, say, prompts)
