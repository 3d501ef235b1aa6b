"""What speaks against an action where it stands."""

from __future__ import annotations

from dataclasses import dataclass

PRECONDITION = "precondition"
"""Rule of whatever a primitive requires that no other rule names."""


@dataclass(frozen=True, slots=True)
class Violation:
    """One rule that an action would break where it stands.

    Attributes:
        rule: its id, one of `planning.check.rules`; a third party's primitive mostly uses `precondition`.
        message: what is wrong and what to do, so that a model or a person can repair the plan.
    """

    rule: str
    message: str

    def __str__(self) -> str:
        return self.message
