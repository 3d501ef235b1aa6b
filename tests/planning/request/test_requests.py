"""Requests as people write them, in many scenes: what each asks for, or that it is refused.

`before.txt`, `after.txt` and `later.txt` in `requests/` were there when the grammar was written.
The others came afterwards, from three pens: short ones (`everyday.txt`), long ones in which
most is said beside the request (`polite.txt`), and such as are easily misread (`tricky.txt`). On
them the grammar's first try, before any of them was looked at:

    everyday   115 requests, 57 of  75 measurable ones read, 18 refused, none misread
    polite     113 requests,  5 of  70 measurable ones read, 65 refused, none misread
    tricky     129 requests, 16 of  79 measurable ones read, 63 refused, none misread

that is 78 accepted, all of them rightly; recall 76, 7 and 20 %. A fourth batch came when these had
been mended, of what people type into a command line (`ordinary.txt`):

    ordinary   150 requests, 84 of 108 measurable ones read, 24 refused, none misread

of the other 42 one was weighed, "weigh the cubes and put them back in the toy box", and told that it
is not put anywhere; there is no toy box, so it was to be refused. 84 of 85 accepted were right, recall
was 78 %. What could be mended in kind has been since: `LEAST` is what is read at least.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest
from request_scenes import scene

from palpate.errors import InputError, PlanRejected
from palpate.planning.request.grounding import ground

REQUESTS = Path(__file__).parent / "requests"


class Line(NamedTuple):
    """One request: `asked` is empty where it is to be refused."""

    scene: str
    kind: str
    request: str
    asked: frozenset[str]


def lines(file: str) -> Iterator[Line]:
    """What is written in a file of requests."""
    for text in (REQUESTS / file).read_text(encoding="utf-8").splitlines():
        if text and not text.startswith("#"):
            where, kind, request, asked = (part.strip() for part in text.split(" | "))
            yield Line(where, kind, request, frozenset(asked.replace("-", "").split()))


def read(line: Line) -> frozenset[str]:
    """What is understood of it: nothing where it is refused."""
    try:
        found = ground(line.request, scene(line.scene))
    except (InputError, PlanRejected):
        return frozenset()
    return frozenset(str(parameter) for parameter in found.asked)


LEAST = {
    "before.txt": 0.98,
    "after.txt": 0.98,
    "later.txt": 0.95,
    "everyday.txt": 0.95,
    "polite.txt": 0.45,
    "tricky.txt": 0.3,
    "ordinary.txt": 0.85,
}
"""Share of the measurable requests of each file that is understood."""


@pytest.mark.parametrize("file", LEAST)
def test_what_is_read_is_what_was_asked_and_else_it_is_refused(file: str):
    asked = [line for line in lines(file) if line.asked]
    wrong: list[str] = []
    missed = 0
    for line in lines(file):
        found = read(line)
        if found and found != line.asked:
            wrong.append(f"{line.request} -> {' '.join(sorted(found))}")
        missed += bool(line.asked and not found)
    assert not wrong, "\n".join(wrong)
    assert len(asked) - missed >= LEAST[file] * len(asked)


def test_the_corpus_is_large_and_of_many_kinds():
    everything = [line for file in LEAST for line in lines(file)]
    assert len(everything) >= 400
    assert len({line.scene for line in everything}) >= 10
    assert len({line.kind for line in everything}) >= 14


@pytest.mark.parametrize(
    ("request_", "named"),
    [
        ("Tell me a joke about the mug.", "joke"),
        ("What does the bottle weigh by the sea?", "sea"),
        ("Put the mug on the red box.", "Put"),
        ("Is the bottle full?", "full"),
        ("What is the mass of the mug's handle?", "handle"),
    ],
)
def test_a_refusal_names_what_was_not_understood_and_what_can_be_asked(request_: str, named: str):
    try:
        said = " ".join(ground(request_, scene("kitchen")).cannot)
    except PlanRejected as rejection:
        said = str(rejection)
    assert f"'{named.lower()}'" in said
    assert "sliding friction" in said


@pytest.mark.parametrize(
    ("request_", "remark"),
    [
        ("hieght of the table", "'hieght' is read as 'height'"),
        ("weight of the cup", "'cup' is taken for 'mug'"),
        ("mass of the left box", "'left' is as the robot sees it"),
        ("mass of the box closest to the mug", "The nearest is 'blue_box', by 16 mm."),
        ("weigh all containers", "'containers' are taken to be 'bottle' and 'mug' and 'red_box'"),
    ],
)
def test_what_is_not_quite_what_was_said_is_remarked_on(request_: str, remark: str):
    where = scene("boxes") if "left" in request_ else scene("kitchen")
    assert any(remark in told for told in ground(request_, where).remarks)


@pytest.mark.parametrize(
    "request_", ["Which weighs more, the mug or the bottle?", "masses of boxes"]
)
def test_inflected_words_are_no_slips(request_: str):
    assert ground(request_, scene("kitchen")).remarks == ()


@pytest.mark.parametrize(
    "request_", ["Quanto pesa il mostro?", "Is the mug 3 kg wide of the mark?"]
)
def test_a_refusal_shows_the_words_of_the_request(request_: str):
    with pytest.raises((PlanRejected, InputError)) as refusal:
        ground(request_, scene("kitchen"))
    assert "§" not in str(refusal.value)
    assert request_ in str(refusal.value) or "the scene has no" in str(refusal.value)


def test_a_side_remark_is_told_and_is_not_what_a_pronoun_means():
    told = "The phone is ringing, so please weigh the mug."
    assert (
        "'the phone is ringing' is taken for a side remark."
        in ground(told, scene("kitchen")).remarks
    )
    with pytest.raises(PlanRejected, match="it is not clear"):
        ground("My aunt brought something. How heavy is it?", scene("kitchen"))
