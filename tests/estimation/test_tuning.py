"""Every tuning constant of the estimators states its unit and reason."""

import ast
from pathlib import Path

import pytest

from palpate.estimation import regression

ESTIMATION = Path(regression.__file__).parent


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


@pytest.mark.parametrize(("file", "row", "text"), constants())
def test_a_constant_states_unit_and_reason(file, row, text):
    comment = file.read_text("utf-8").splitlines()[row - 1].partition("#")[2]
    assert len(text) > 20 or comment.strip()
