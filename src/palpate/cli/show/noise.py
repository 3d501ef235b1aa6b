"""Noise of an arm beside the noise models, as a table or as JSON."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

from palpate.cli.console import out, print_json, printing

if TYPE_CHECKING:
    from palpate.api.noise import ArmNoise

TITLES = {
    "white": ("white noise of a sample at rest, N m", 1.0),
    "quantisation": ("step of a sample, N m", 1.0),
    "offset": ("offset, N m; of the models its standard deviation", 1.0),
    "coulomb": ("Coulomb friction, N m", 1.0),
    "presliding": ("presliding distance, mrad", 1e3),
    "position": ("variation of the friction over a turn, relative", 1.0),
    "ripple": ("ripple, N m rms; of the models without the gain of a control loop", 1.0),
    "second": ("second harmonic of the ripple, N m rms", 1.0),
    "cycles": ("cycles of the ripple in a turn", 1.0),
    "encoder_ripple": ("ripple of the encoders, µrad rms", 1e6),
    "residual": ("left of the torque below 5 Hz, N m rms", 1.0),
    "shaking": ("torque from 8 to 30 Hz, N m rms", 1.0),
    "shaking_left": ("torque from 8 to 30 Hz less M ddq, N m rms", 1.0),
    "drift": ("drift, N m/min", 1.0),
}
"""Heading of each figure, and the factor to its unit."""
LABEL, CELL = 14, 9
UNSEEN = "–"


def show_noise(found: ArmNoise, written: Path | None, as_json: bool) -> None:
    """Print every figure of the recording with its interval, and below it those of the models."""
    with printing():
        if as_json:
            print_json({**found.record(), "file": None if written is None else str(written)})
            return
        out.print(f"{found.source}: {found.seconds:.0f} s of free motion", markup=False)
        for note in found.notes:
            out.print(note, markup=False)
        models = found.models
        _line("joint", [str(i + 1) for i in range(len(found.arm.joints))], "dim")
        for name, figure in found.figures.items():
            title, factor = TITLES[name]
            out.print(title, style="bold", highlight=False)
            _line("this arm", [_cell(x, factor) for x in figure.value.tolist()])
            halves = [_cell(x, factor) for x in ((figure.high - figure.low) / 2).tolist()]
            if set(halves) - {UNSEEN, "0.0000"}:
                _line("± (95 %)", halves, "dim")
            for model, stated in models.items():
                rippled = name != "cycles" or any(stated["ripple"])
                if any(stated.get(name, ())) and rippled:
                    _line(model, [_cell(x, factor) for x in stated[name]])
        out.print(f"{UNSEEN}: not seen in this recording", markup=False)
        if written is not None:
            out.print(f"written to {written}", markup=False, soft_wrap=True)


def _line(label: str, cells: list[str], style: str = "") -> None:
    """Print a row of one figure a joint."""
    row = f"  {label:<{LABEL - 2}}" + "".join(f"{cell:>{CELL}}" for cell in cells)
    out.print(row, style=style, highlight=False, markup=False, soft_wrap=True)


def _cell(value: float, factor: float) -> str:
    """Write a figure with two or three digits."""
    value *= factor
    if math.isnan(value) or value == 0.0:
        return UNSEEN
    if abs(value) >= 20.0:
        return f"{value:.0f}"
    return f"{value:.2f}" if abs(value) >= 0.1 else f"{value:.4f}"
