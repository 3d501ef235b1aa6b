"""How a bad input is refused, and how not."""

from __future__ import annotations

import pytest

from bench.campaign.ledger import judged
from bench.faults.inputs import BAD, give, problems


def test_a_bad_input_is_refused_in_little_time_and_memory() -> None:
    (case,) = [case for case in BAD if case.name == "a million copies"]
    row = judged(case, give)
    assert (row.outcome, row.beyond) == ("exit 2", ())


@pytest.mark.parametrize(
    ("code", "seconds", "memory", "text", "found"),
    [
        (2, 1.0, 1e8, "Error: no such file\n", []),
        (0, 1.0, 1e8, "", ["exit 0"]),
        (1, 1.0, 1e8, "Traceback (most recent call last)", ["exit 1", "a traceback"]),
        (2, 6.0, 2e9, "", ["6 s", "2.0 GB"]),
        (2, 1.0, 1e8, "\x1b[31mred", ["control characters reach the terminal"]),
        (2, 1.0, 1e8, "\u202eevil", ["control characters reach the terminal"]),
    ],
)
def test_the_judge_finds_faults_of_a_refusal(
    code: int, seconds: float, memory: float, text: str, found: list[str]
) -> None:
    assert problems(code, seconds, memory, text) == found
