"""Dynamics of an arm, as tables or as JSON."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from palpate.cli.console import escape, figure_table, out, print_json, printing
from palpate.cli.exits import in_flags
from palpate.errors import InputError

if TYPE_CHECKING:
    from palpate.api.dynamics import ArmDynamics
    from palpate.estimation.arm.dynamics import Figure

FIGURES = {
    "coulomb": "friction N m",
    "viscous": "damping N m s/rad",
    "armature": "armature kg m²",
    "offset": "offset N m",
}
MODELS = {
    "described": "as described",
    "friction": "friction identified",
    "all": "all identified",
    "controller": "tau_ext of the log",
}
UNSEEN = "not observable"


def mass_of(hand: str) -> float | None:
    """kg of `--hand`; None: to be found.

    Raises:
        InputError: neither `found` nor a mass.
    """
    if hand == "found":
        return None
    try:
        mass = float(hand.removesuffix("kg"))
    except ValueError:
        mass = math.nan
    if not mass >= 0.0:
        raise InputError(
            f"--hand '{hand[:40]}' is neither 'found' nor a mass in kg, e.g. 0.73 or 0"
        )
    return mass


def show_dynamics(found: ArmDynamics, written: Sequence[Path], as_json: bool) -> None:
    """Print the figures of each joint, the hand, and the held-out torque; or all of it as JSON."""
    with printing():
        if as_json:
            print_json({**found.record(), "files": [str(path) for path in written]})
            return
        table = figure_table("joint", *FIGURES.values())
        for i in range(len(found.arm.joints)):
            cells = [_cell(getattr(found, name), i) for name in FIGURES]
            table.add_row(str(i + 1), *cells)
        out.print(table)
        if found.hand is not None:
            low, high = found.hand.interval
            mass, std = found.hand.mass, found.hand.mass_std
            out.print(f"hand {mass:.3f} ± {std:.3f} kg, 95 % [{low:.3f}, {high:.3f}]", markup=False)
            if found.hand.centre is None:
                out.print(f"its centre of mass is {UNSEEN}", markup=False)
            else:
                centre = ", ".join(f"{1e3 * part:.0f}" for part in found.hand.centre.tolist())
                out.print(f"its centre of mass {centre} mm from the TCP, along x y z", markup=False)
        title = f"torque left in the last {found.held_out:.0f} s, N m rms, joints 1 to 7"
        held_out = figure_table(
            "model", *(str(i + 1) for i in range(len(found.arm.joints))), "all", title=title
        )
        for name, rms in found.rms.items():
            together = float((rms**2).mean() ** 0.5)
            held_out.add_row(MODELS[name], *(f"{part:.2f}" for part in (*rms.tolist(), together)))
        out.print(held_out)
        for note in found.notes:
            out.print(note, style="dim", markup=False)
        for text in found.contradictions:
            out.prose(f"[bold red]contradicted[/] {escape(in_flags(text))}")
        for path in written:
            out.print(f"written to {path}", markup=False, soft_wrap=True)


def _cell(figure: Figure, joint: int) -> str:
    if not figure.observed[joint]:
        return UNSEEN
    return f"{figure.value[joint]:.2f} ± {figure.std[joint]:.2f}"
