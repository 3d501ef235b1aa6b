import pytest

from palpate.runs.report.console import TreeLine, note, outline, to_html

HOSTILE = "<img src=x onerror=alert(1)> & \x1b[31m\x9b31m\u202e"

SHOWN = {
    "text of a node": outline([TreeLine(HOSTILE, 1, "RUNNING")]),
    "message of a node": outline([TreeLine("reach", 1, "FAILURE", HOSTILE)]),
    "headline": note(HOSTILE),
    "line below a headline": note("Estimates", HOSTILE),
    "explanation": to_html(HOSTILE),
}


@pytest.mark.parametrize("place", SHOWN)
def test_text_from_elsewhere_is_no_markup(place: str) -> None:
    html = SHOWN[place]
    assert "<img" not in html
    assert "&lt;img src=x onerror=alert(1)&gt; &amp;" in html
    assert not any(character in html for character in "\x1b\x9b\u202e")
