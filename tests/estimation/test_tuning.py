"""The table of tuning numbers is complete."""

import ast
from pathlib import Path

import pytest

from palpate.estimation import tuning

TABLE = Path(tuning.__file__).parent
ESTIMATION = TABLE.parent


def documented():
    """Each number's name with the text below it."""
    for file in sorted(TABLE.glob("*.py")):
        lines = ast.parse(file.read_text("utf-8")).body
        for line, below in zip(lines, [*lines[1:], None], strict=True):
            if isinstance(line, ast.Assign):
                name = line.targets[0].id
                text = below.value.value if isinstance(below, ast.Expr) else ""
                yield pytest.param(name, " ".join(text.split()), id=name)


def test_a_number_stands_once_and_is_found():
    names = [param.id for param in documented()]
    assert len(names) == len(set(names))
    assert all(hasattr(tuning, name) for name in names)


@pytest.mark.parametrize(("name", "text"), documented())
def test_a_number_says_its_unit_its_reason_and_how_sensitive_it_is(name, text):
    reason, _, sensitive = text.partition("Sensitive: ")
    assert len(reason) > 20, name
    assert sensitive.endswith("."), name


@pytest.mark.parametrize("file", sorted(ESTIMATION.rglob("*.py")), ids=lambda f: f.stem)
def test_no_number_is_tuned_elsewhere(file):
    """Constants of the estimators stand in the table, but for the interval's half width and what
    only keeps arithmetic finite."""
    for line in ast.parse(file.read_text("utf-8")).body:
        named = isinstance(line, ast.Assign) and isinstance(line.value, ast.Constant)
        if named and isinstance(line.value.value, float):
            elsewhere = line.targets[0].id == "Z95" or line.value.value <= 1e-9
            assert file.parent == TABLE or elsewhere
