"""`palpate teach`: record poses, one line per object, until an empty line."""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from palpate.cli.console import err, out
from palpate.common.errors import InputError

if TYPE_CHECKING:
    from palpate.execution.cell import GuidedHand, Lesson
    from palpate.runs.settings import Settings


LENGTH = {"": 1.0, "m": 1.0, "cm": 1e-2, "mm": 1e-3}
FARTHEST = 5.0  # m: largest distance from the arm's base. Beyond it a unit is missing or wrong.
_NUMBER = re.compile(r"([-+]?(?:\d+(?:\.\d*)?|\.\d+))\s*(mm|cm|m|°)?")


def give_lesson(asked: Settings, file: Path) -> None:
    """Read lines from stdin, print their interpretation and the missing objects, and write the file.

    Raises:
        InputError: the file exists.
        Unavailable: the robot.
    """
    from palpate.runs.tools import guided_hand, lesson, write_poses

    if file.exists():
        raise InputError(f"'{file}' exists already: choose another out=, nothing is overwritten")
    taught = lesson(asked)
    hand = None if asked.robot is None else guided_hand(asked.robot, taught)
    try:
        _introduce(taught, hand is not None)
        # Enter one pose a line; an error is printed, and the next line is read.
        for line in _lines():
            try:
                message = (
                    _enter_by_ruler(taught, line)
                    if hand is None
                    else _enter_by_hand(taught, hand, line)
                )
            except InputError as error:
                message = str(error)
            err.print(message, markup=False)
            if taught.missing:
                err.print(f"still missing: {', '.join(taught.missing)}", markup=False)
            else:
                err.print("every object is taught", markup=False)
    except KeyboardInterrupt:
        # An interrupted lesson keeps the poses so far.
        if taught.content:
            write_poses(file, taught)
            err.print(f"interrupted: what was taught so far is written to {file}", markup=False)
        raise
    finally:
        if hand is not None:
            hand.close()
    if not taught.content:
        raise InputError("nothing was taught, and nothing is written")
    write_poses(file, taught)
    out.print(f"written to {file}", markup=False)


def _introduce(taught: Lesson, by_hand: bool) -> None:
    names = taught.names if by_hand else tuple(taught.scene.objects)
    if by_hand:
        how = (
            "Lead the hand to a thing as it would grasp it, pointing down, type its name, press Enter. "
            "Another name is a place. Fingers closed on a thing tell its width."
        )
    else:
        how = (
            "NAME AHEAD LEFT [TURN]: the middle of a thing from the arm's foot, in m or with mm or cm, and "
            "by how much it is turned from the scene's, in °; e.g. bottle 50cm -12cm 30°"
        )
    err.print(f"{how} An empty line ends. Names: {', '.join(names)}", markup=False)


def _lines() -> Iterator[str]:
    """Yield the lines of stdin up to an empty one."""
    while True:
        err.print("> ", end="")
        line = sys.stdin.readline()
        if not line.strip():
            return
        yield line.strip()


def _enter_by_hand(taught: Lesson, hand: GuidedHand, name: str) -> str:
    if not re.fullmatch(r"[A-Za-z_]\w{0,99}", name):
        raise InputError(f"'{name[:80]}' is no name: letters, digits and _")
    return taught.shown(name, *hand.where())


def _enter_by_ruler(taught: Lesson, line: str) -> str:
    name, _, rest = line.partition(" ")
    # Two lengths and at most one angle, and nothing else.
    numbers = _NUMBER.findall(rest)
    if len(numbers) not in (2, 3) or _NUMBER.sub("", rest).strip(" ,"):
        raise InputError(f"'{line[:80]}' is not NAME AHEAD LEFT [TURN], e.g. bottle 50cm -12cm 30°")
    (ahead, left), turn = numbers[:2], numbers[2:]
    angle = math.radians(float(turn[0][0])) if turn else 0.0
    return taught.measured(name, _metres(ahead), _metres(left), angle)


def _metres(number: tuple[str, str]) -> float:
    value, unit = number
    if unit not in LENGTH:
        raise InputError(f"{value}{unit} is no length")
    length = float(value) * LENGTH[unit]
    if abs(length) > FARTHEST:
        hint = (
            ""
            if unit
            else f": did you mean {value}mm or {value}cm? A number without a unit is in m"
        )
        raise InputError(f"{value}{unit or ' m'} is out of every arm's reach{hint}")
    return length
