"""Result of a calibration, as a table or as JSON."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING

from palpate.cli.console import figure_table, out, print_json, printing

if TYPE_CHECKING:
    from palpate.calibration.calibrate import Calibration, Found

SHOWN = {
    "1": (100.0, "%", 3),
    "m": (1e3, "mm", 3),
    "rad": (1e3, "mrad", 2),
    "m/N": (1e6, "µm/N", 1),
}
"""Display of a figure by its SI unit: factor, unit shown, decimals."""


def show_calibration(done: Calibration, as_json: bool) -> None:
    """Print every figure before and after, and the path of the file."""
    with printing():
        if as_json:
            print_json(
                {
                    "file": str(done.file),
                    "robot_seconds": round(done.robot_seconds, 2),
                    "figures": [asdict(found) for found in done.found],
                }
            )
            return
        table = figure_table("figure", "before", "now", no_wrap=True)
        for found in done.found:
            table.add_row(found.name, _shown(found, found.before), _shown(found, found.after))
        out.print(table)
        for by in dict.fromkeys(found.by for found in done.found):
            out.print(f"measured with {by}", markup=False)
        out.print(f"{done.robot_seconds:.0f} s of robot time; written to {done.file}", markup=False)


def _shown(found: Found, figure: tuple[float, float]) -> str:
    scale, unit, decimals = SHOWN[found.unit]
    value, std = (part * scale for part in figure)
    return f"{value:.{decimals}f} ± {std:.{decimals}f} {unit}"
