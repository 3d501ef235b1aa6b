"""Poses that a camera saw, as a table or as JSON."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import TYPE_CHECKING

from palpate.cli.console import confirmed, err, figure_table, out, print_json, printing
from palpate.live.console import SafeConsole

if TYPE_CHECKING:
    from rich.table import Table

    from palpate.geometry.pose import Pose
    from palpate.seeing.look import Seen


def show_seen(seen: Seen, written: Path | None, as_json: bool) -> None:
    """Print where every object was seen, and what was not."""
    with printing():
        if as_json:
            rest = {"unseen": list(seen.unseen), "notes": list(seen.notes), "noise_px": seen.noise}
            print_json(seen.content | rest)
        else:
            out.print(_poses(seen))
        _remark(seen, err)
        if written is not None:
            err.print(f"written to {written}", markup=False)


def confirm_seen(ask: bool) -> Callable[[Seen], bool]:
    """Callback that shows what a camera saw before it is planned with, and asks where a real robot will move
    by it; no answer is a no."""

    def looked(seen: Seen) -> bool:
        console = SafeConsole(stderr=True, highlight=False) if ask else err
        console.print(_poses(seen))
        _remark(seen, console)
        if not ask:
            return True
        if seen.outlines is not None:
            console.print(f"outlined in {_picture(seen.outlines.png())}", soft_wrap=True)
        return confirmed("Are they there? (--yes skips this question)")

    return looked


def _picture(png: bytes) -> Path:
    """A file to look at before there is a run folder."""
    with NamedTemporaryFile(prefix="palpate-seen-", suffix=".png", delete=False) as file:
        file.write(png)
    return Path(file.name)


def _poses(seen: Seen) -> Table:
    table = figure_table("object", "place (m)", "± (mm)", "turn ± (°)", no_wrap=True)
    for name, pose in seen.poses.items():
        place, turn = seen.std(name)
        table.add_row(name, _where(pose), f"{1e3 * place:.2f}", f"{math.degrees(turn):.2f}")
    for name, pose in seen.surfaces.items():
        height = math.sqrt(seen.covariances[name][2, 2])
        table.add_row(name, _where(pose), f"{1e3 * height:.2f} in z", "")
    return table


def _where(pose: Pose) -> str:
    return ", ".join(f"{part:.4f}" for part in pose.position.tolist())


def _remark(seen: Seen, console: SafeConsole) -> None:
    for note in seen.notes:
        console.print(note, markup=False)
    if seen.unseen:
        console.print(f"not seen: {', '.join(seen.unseen)}", markup=False)


def show_sheet(file: Path, pages: int) -> None:
    """Say where the tags are."""
    out.print(
        f"{pages} page{'s' * (pages > 1)} written to {file}; print at 100 %, and measure the line of 100 mm",
        markup=False,
    )
