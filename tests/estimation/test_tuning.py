"""Every tuning constant of the estimators states its unit, its reason and how sensitive an estimate is to it."""

import ast
from pathlib import Path

import pytest

from palpate.estimation import regression

ESTIMATION = Path(regression.__file__).parent
NOT_TUNED = {"Z95", "OUTSIDE"}
"""Probabilities of intervals."""


def constants():
    """Float constants of the estimators with the text below each."""
    for file in sorted(ESTIMATION.rglob("*.py")):
        if not (lines := ast.parse(file.read_text("utf-8")).body):
            continue
        for line, below in zip(lines, [*lines, None][1:], strict=True):
            if not isinstance(line, ast.Assign) or not isinstance(line.value, ast.Constant):
                continue
            if isinstance(line.value.value, float) and line.value.value > 1e-9:
                text = below.value.value if isinstance(below, ast.Expr) else ""
                yield pytest.param(file, line.lineno, text, id=f"{file.stem}.{line.targets[0].id}")


@pytest.mark.parametrize(("file", "row", "text"), list(constants()))
def test_a_constant_states_unit_reason_and_sensitivity(file, row, text):
    line = file.read_text("utf-8").splitlines()[row - 1]
    assert len(text) > 20 or line.partition("#")[2].strip()
    if file.parent == ESTIMATION and line.split()[0] not in NOT_TUNED:
        assert "ensitiv" in text
