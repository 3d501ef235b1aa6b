"""Text from elsewhere, as it is shown."""

from __future__ import annotations

import io
import json
import math
from pathlib import Path

import numpy as np
from rich.table import Table

from palpate.common.belief import BeliefTouch
from palpate.common.display import json_text, to_json, visible
from palpate.runs.report.console import SafeConsole

EVIL = "a\x1b[31m\x07\r\x7f\x9b\u202e\u2066\U000e0041\ud800\tb\nc é 漢 👍"


def test_control_characters_are_seen() -> None:
    assert visible(EVIL) == (
        "a\\x1b[31m\\x07\\x0d\\x7f\\x9b\\u202e\\u2066\\ue0041\\ud800\tb\nc é 漢 👍"
    )


def test_json_says_the_same() -> None:
    text = json_text({"a": EVIL})
    assert json.loads(text) == {"a": EVIL}
    assert "é 漢 👍" in text
    assert not set("\x9b\u202e\U000e0041\ud800") & set(text)


def test_nothing_on_the_console_is_a_command() -> None:
    console = SafeConsole(file=io.StringIO(), force_terminal=True, width=60)
    table = Table("name\x1b]0;owned", title="\x9btitle")
    table.add_row("\x1b[2Jcell")
    console.print(table, "plain\x1b]0;owned", "[bold]bold[/]\x1b[2J")
    text = console.file.getvalue()
    assert "\x1b[1m" in text  # its own
    assert "\x1b]0" not in text
    assert "\x1b[2J" not in text
    assert "\x9b" not in text
    assert "\\x1b[2Jcell" in text


def test_values_of_python_become_json_and_what_is_not_finite_becomes_null() -> None:
    touch = BeliefTouch("probe", (0.0, 0.0, 1.0), (0.1, 0.2, 0.3), math.inf, 1e-3, math.nan)
    result = to_json({"touch": touch, "file": Path("a/b"), "numbers": np.array([[1.0, np.nan]])})
    assert result == {
        "touch": {
            "means": "probe",
            "along": [0.0, 0.0, 1.0],
            "point": [0.1, 0.2, 0.3],
            "apart": None,
            "std": 1e-3,
            "believed_std": None,
        },
        "file": "a/b",
        "numbers": [[1.0, None]],
    }
