"""Finding of the check."""

from __future__ import annotations

from dataclasses import dataclass

from palpate.vocabulary.violation import Violation


@dataclass(frozen=True, slots=True)
class Finding:
    """Something wrong with a plan: where (`tree.children[3]`), and what."""

    path: str
    violation: Violation

    @classmethod
    def of(cls, path: str, rule: str, message: str) -> Finding:
        """A finding of one of the rules of whole plans."""
        return cls(path, Violation(rule, message))

    @property
    def rule(self) -> str:
        """Id of the rule that is broken, one of `check.RULES`."""
        return self.violation.rule

    @property
    def message(self) -> str:
        """Description with a remedy."""
        return self.violation.message
