"""Violation of a rule by an action."""

from __future__ import annotations

from dataclasses import dataclass

PRECONDITION = "precondition"
"""Rule of whatever a primitive requires that no other rule names."""


@dataclass(frozen=True, slots=True)
class Violation:
    """Violation of one rule by an action in a state.

    Attributes:
        rule: its id, one of `planning.check.rules`; a third party's primitive mostly uses `precondition`.
        message: what is wrong and what to do, so that a model or a person can repair the plan.
    """

    rule: str
    message: str

    @property
    def finding(self) -> str:
        """The message without its advice, which is for the author of a plan."""
        return self.message.partition(";")[0]

    def __str__(self) -> str:
        return self.message
