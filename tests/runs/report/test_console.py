"""The console: sentences for people, commands to be copied."""

from __future__ import annotations

from io import StringIO

import pytest

from palpate.runs.report.console import SafeConsole


@pytest.mark.parametrize("terminal", [True, False])
def test_a_sentence_breaks_between_words_on_a_terminal_and_a_command_never(terminal: bool) -> None:
    file, line = StringIO(), "one sentence that is longer than the line of this console"
    console = SafeConsole(file=file, width=30, force_terminal=terminal)
    console.prose(line)
    console.print(line, soft_wrap=True)
    *sentence, command = file.getvalue().splitlines()
    assert command == line
    assert len(sentence) == (2 if terminal else 1)
    assert " ".join(part.strip() for part in sentence) == line
