"""Violation of a rule by an action."""

from __future__ import annotations

from dataclasses import dataclass

PRECONDITION = "precondition"
"""Rule of all requirements of a primitive that have no rule of their own."""


@dataclass(frozen=True, slots=True)
class Violation:
    """Violation of one rule by an action in a state.

    Attributes:
        rule: its id, one of `planning.check.rules`; a third party's primitive mostly uses
            `precondition`.
        message: the problem and its remedy, by which a model or a person can repair the plan.
    """

    rule: str
    message: str

    @property
    def finding(self) -> str:
        """The message without the remedy, which is for the author of a plan."""
        return self.message.partition(";")[0]

    def __str__(self) -> str:
        return self.message
