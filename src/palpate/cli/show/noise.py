"""Noise of an arm beside the noise models, as a table or as JSON."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

from palpate.cli.console import figure_table, out, print_json, printing

if TYPE_CHECKING:
    from palpate.api.noise import ArmNoise

TITLES = {
    "white": ("white noise of a sample at rest, N m", 1.0),
    "quantisation": ("step of a sample, N m", 1.0),
    "offset": ("offset, N m (of the models: its standard deviation)", 1.0),
    "coulomb": ("Coulomb friction, N m", 1.0),
    "presliding": ("presliding distance, mrad", 1e3),
    "position": ("friction's variation over a turn, 1", 1.0),
    "ripple": ("ripple, N m rms (of the models: without a loop's gain)", 1.0),
    "second": ("its second harmonic, N m rms", 1.0),
    "cycles": ("its cycles a turn", 1.0),
    "encoder_ripple": ("the same in the encoders, µrad rms", 1e6),
    "residual": ("left below 5 Hz, N m rms", 1.0),
    "shaking": ("torque from 8 to 30 Hz, N m rms", 1.0),
    "shaking_left": ("the same without M ddq of the velocities, N m rms", 1.0),
    "drift": ("drift, N m/min", 1.0),
}
"""Heading of each figure, and the factor to its unit."""
UNSEEN = "–"


def show_noise(found: ArmNoise, written: Path | None, as_json: bool) -> None:
    """Print every figure of the recording with its interval, and below it those of the models."""
    with printing():
        if as_json:
            print_json({**found.record(), "file": None if written is None else str(written)})
            return
        joints = len(found.arm.joints)
        table = figure_table("joint", *(str(i + 1) for i in range(joints)), no_wrap=True)
        models, figures = found.models, found.figures
        for name, (title, factor) in TITLES.items():
            figure = figures[name]
            table.add_row(f"[bold]{title}[/]")
            halves = [(high - low) / 2 for low, high in zip(figure.low, figure.high, strict=True)]
            table.add_row("  this arm", *(_cell(x, factor) for x in figure.value.tolist()))
            if any(half == half and half > 0 for half in halves):
                table.add_row(
                    "[dim]    ±, 95 %[/]", *(f"[dim]{_cell(x, factor)}[/]" for x in halves)
                )
            for model, stated in models.items():
                if name in stated:
                    table.add_row(f"  {model}", *(_cell(x, factor) for x in stated[name]))
        out.print(f"{found.source}: {found.seconds:.0f} s of free motion", markup=False)
        for note in found.notes:
            out.print(note, markup=False)
        out.print(table)
        out.print(f"{UNSEEN} is not seen in this recording, or none.", markup=False)
        if written is not None:
            out.print(f"written to {written}", markup=False, soft_wrap=True)


def _cell(value: float, factor: float) -> str:
    """Write a figure with two or three digits."""
    value *= factor
    if math.isnan(value) or value == 0.0:
        return UNSEEN
    return (
        f"{value:.0f}"
        if abs(value) >= 20
        else f"{value:.2g}"
        if abs(value) < 0.1
        else f"{value:.2f}"
    )
