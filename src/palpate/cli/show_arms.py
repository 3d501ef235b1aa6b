"""Output of results about an arm or a camera: calibration, dynamics, noise, poses."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import TYPE_CHECKING

from palpate.cli.console import (
    ask_yes_no,
    err,
    escape,
    figure_table,
    guard_printing,
    in_flags,
    out,
    print_json,
)
from palpate.common.display import to_json
from palpate.common.errors import InputError
from palpate.runs.report.console import SafeConsole

if TYPE_CHECKING:
    from rich.table import Table

    from palpate.common.pose import Pose
    from palpate.estimation.arm_dynamics import JointFigure
    from palpate.perception.look import Seen
    from palpate.runs.calibration.calibrate import CalibratedFigure, Calibration
    from palpate.runs.recordings import ArmDynamics, ArmNoise


# Display of a figure by its SI unit: factor, unit shown, decimals.
SHOWN = {
    "1": (100.0, "%", 3),
    "m": (1e3, "mm", 3),
    "rad": (1e3, "mrad", 2),
    "m/N": (1e6, "µm/N", 1),
}


def show_calibration(done: Calibration, as_json: bool) -> None:
    """Print every figure before and after, and the path of the file."""
    with guard_printing():
        if as_json:
            seconds = round(done.robot_seconds, 2)
            content = {"file": done.file, "robot_seconds": seconds, "figures": done.figures}
            print_json(to_json(content))
            return
        table = figure_table("figure", "before", "now", no_wrap=True)
        for figure in done.figures:
            table.add_row(
                figure.name,
                _format_figure(figure, figure.before),
                _format_figure(figure, figure.after),
            )
        out.print(table)
        for by in dict.fromkeys(figure.by for figure in done.figures):
            out.print(f"measured with {by}", markup=False)
        out.print(f"{done.robot_seconds:.0f} s of robot time; written to {done.file}", markup=False)


def _format_figure(calibrated: CalibratedFigure, figure: tuple[float, float]) -> str:
    scale, unit, decimals = SHOWN[calibrated.unit]
    value, std = (part * scale for part in figure)
    return f"{value:.{decimals}f} ± {std:.{decimals}f} {unit}"


# Dynamics of an arm, as tables or as JSON.

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
NOT_OBSERVABLE = "not observable"


def mass_of(hand: str) -> float | None:
    """Parse `--hand`, kg; None means that the mass is to be identified. Raises InputError: neither
    `found` nor a mass."""
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


def show_dynamics(dynamics: ArmDynamics, written: Sequence[Path], as_json: bool) -> None:
    """Print the figures of each joint, the hand, and the held-out torque; or all of it as JSON."""
    with guard_printing():
        if as_json:
            print_json({**dynamics.record(), "files": [str(path) for path in written]})
            return
        # Figures of the joints, then the hand, then the held-out torques; contradicted ones are in parentheses.
        form = "({})" if dynamics.contradictions else "{}"
        if dynamics.contradictions:
            out.print("contradicted: figures in parentheses have no meaning", style="bold red")
        table = figure_table("joint", *FIGURES.values())
        for i in range(len(dynamics.arm.joints)):
            cells = [_figure_cell(getattr(dynamics, name), i, form) for name in FIGURES]
            table.add_row(str(i + 1), *cells)
        out.print(table)
        if dynamics.hand is not None:
            low, high = dynamics.hand.interval
            mass, std = dynamics.hand.mass, dynamics.hand.mass_std
            interval = f"{mass:.3f} ± {std:.3f} kg, 95 % [{low:.3f}, {high:.3f}]"
            out.print(f"hand {form.format(interval)}", markup=False)
            if dynamics.hand.centre is None:
                out.print(f"its centre of mass is {NOT_OBSERVABLE}", markup=False)
            else:
                centre = ", ".join(f"{1e3 * part:.0f}" for part in dynamics.hand.centre.tolist())
                place = form.format(f"{centre} mm from the TCP, along x y z")
                out.print(f"its centre of mass {place}", markup=False)
        # Root mean square of each joint and over all joints, for each model.
        title = f"torque left in the last {dynamics.held_out:.0f} s, N m rms, joints 1 to 7"
        held_out = figure_table(
            "model", *(str(i + 1) for i in range(len(dynamics.arm.joints))), "all", title=title
        )
        for name, rms in dynamics.rms.items():
            together = float((rms**2).mean() ** 0.5)
            held_out.add_row(MODELS[name], *(f"{part:.2f}" for part in (*rms.tolist(), together)))
        out.print(held_out)
        for note in dynamics.notes:
            out.print(note, style="dim", markup=False)
        for text in dynamics.contradictions:
            out.prose(f"[bold red]contradicted[/] {escape(in_flags(text))}")
        for path in written:
            out.print(f"written to {path}", markup=False, soft_wrap=True)


def _figure_cell(figure: JointFigure, joint: int, form: str) -> str:
    if not figure.observed[joint]:
        return NOT_OBSERVABLE
    return form.format(f"{figure.value[joint]:.2f} ± {figure.std[joint]:.2f}")


# Noise of an arm compared with the noise models, as a table or as JSON.

# Heading of each figure, and the factor to its unit.
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
LABEL, CELL = 14, 9
NO_FIGURE = "–"


def show_noise(noise: ArmNoise, written: Path | None, as_json: bool) -> None:
    """Print every figure of the recording with its interval, and below it those of the models."""
    with guard_printing():
        if as_json:
            print_json({**noise.record(), "file": None if written is None else str(written)})
            return
        out.print(f"{noise.source}: {noise.seconds:.0f} s of free motion", markup=False)
        for note in noise.notes:
            out.print(note, markup=False)
        models = noise.models
        _line("joint", [str(i + 1) for i in range(len(noise.arm.joints))], "dim")
        # For each figure: the arm, its half width, and the models that state it.
        for name, figure in noise.figures.items():
            title, factor = TITLES[name]
            out.print(title, style="bold", highlight=False)
            _line("this arm", [_noise_cell(x, factor) for x in figure.value.tolist()])
            halves = [_noise_cell(x, factor) for x in ((figure.high - figure.low) / 2).tolist()]
            if set(halves) - {NO_FIGURE, "0.0000"}:
                _line("± (95 %)", halves, "dim")
            for model, stated in models.items():
                # The count of cycles needs a ripple.
                rippled = name != "cycles" or any(stated["ripple"])
                if any(stated.get(name, ())) and rippled:
                    _line(model, [_noise_cell(x, factor) for x in stated[name]])
        out.print(f"{NO_FIGURE}: not seen in this recording", markup=False)
        if written is not None:
            out.print(f"written to {written}", markup=False, soft_wrap=True)


def _line(label: str, cells: list[str], style: str = "") -> None:
    """Print a row with one figure per joint."""
    row = f"  {label:<{LABEL - 2}}" + "".join(f"{cell:>{CELL}}" for cell in cells)
    out.print(row, style=style, highlight=False, markup=False, soft_wrap=True)


def _noise_cell(value: float, factor: float) -> str:
    """Format a figure with two or three digits."""
    value *= factor
    if math.isnan(value) or value == 0.0:
        return NO_FIGURE
    if abs(value) >= 20.0:
        return f"{value:.0f}"
    return f"{value:.2f}" if abs(value) >= 0.1 else f"{value:.4f}"


# Poses that a camera saw, as a table or as JSON.


def show_seen(seen: Seen, written: Path | None, as_json: bool) -> None:
    """Print the pose of every object that was seen, and the names of the others."""
    with guard_printing():
        if as_json:
            rest = {"unseen": list(seen.unseen), "notes": list(seen.notes), "noise_px": seen.noise}
            print_json(seen.content | rest)
        else:
            out.print(_poses(seen))
        _remark(seen, err)
        if written is not None:
            err.print(f"written to {written}", markup=False)


def confirm_seen(ask: bool) -> Callable[[Seen], bool]:
    """Make a callback that shows a look before the plan.

    It asks for confirmation if a real robot will move by it; no answer means no.
    """

    def confirm_look(seen: Seen) -> bool:
        console = SafeConsole(stderr=True, highlight=False) if ask else err
        console.print(_poses(seen))
        _remark(seen, console)
        if not ask:
            return True
        if seen.outlines is not None:
            console.print(f"outlined in {_picture(seen.outlines.png())}", soft_wrap=True)
        return ask_yes_no("Are they there? (--yes skips this question)")

    return confirm_look


def _picture(png: bytes) -> Path:
    """Write a picture to a temporary file, because there is no run folder yet."""
    with NamedTemporaryFile(prefix="palpate-seen-", suffix=".png", delete=False) as file:
        file.write(png)
    return Path(file.name)


def _poses(seen: Seen) -> Table:
    # Objects with position and rotation, surfaces with their height only.
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
