"""Content of the report page: a run, and what belongs to it from elsewhere."""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from palpate.perception.renderer import gl_available
from palpate.runs.export import read_proof
from palpate.runs.reproduce import reproduce_command, use_seen_poses

if TYPE_CHECKING:
    from palpate.perception.film import Film
    from palpate.runs.proof import Proof
    from palpate.runs.run import Run
    from palpate.twin.validate import ReplayResidual, Validation


@dataclass(frozen=True, slots=True)
class Pictures:
    """Pictures (PNG) and film (MP4) of a run; None for those that do not exist."""

    workspace: bytes | None = None
    before: bytes | None = None
    after: bytes | None = None
    seen: bytes | None = None
    film: Film | None = None


@dataclass(frozen=True, slots=True, eq=False)
class ReportData:
    """Content of the page. A section without data is left out."""

    run: Run  # the run
    pictures: Pictures = Pictures()  # of it, with its film
    proof: Proof | None = None  # tasks planned with the twin
    files: tuple[str, ...] = ()  # paths in the run folder, relative to the page
    command: str = ""  # reproduces the run, from the page's folder
    warnings: tuple[str, ...] = ()  # one line each, e.g. how to get pictures.


def report_data(run: Run, pictures: Pictures, scratch: Path, place: Path) -> ReportData:
    """Collect the page's data; `scratch` holds the run's files, which are or will be at `place`."""
    # The page links to the files that exist already.
    files = (path for path in scratch.rglob("*") if path.is_file())
    names = sorted(str(path.relative_to(scratch)) for path in files)
    # The command is relative to the folder.
    command, folder = "", place.absolute()
    if not run.is_recorded:
        command = shlex.join(reproduce_command(use_seen_poses(run.settings, folder), folder))
    proof, warnings = read_proof(scratch), tuple(run_warnings(run))
    return ReportData(run, pictures, proof, tuple(names), command, warnings)


def run_warnings(run: Run) -> Iterator[str]:
    if run.drawn:
        yield (
            "Simulated, and made up: the run was given neither a robot nor a world, so the true values were "
            f"drawn from priors (seed {run.settings.seed}). No value here is one of a real thing."
        )
    available, remedy = gl_available()
    if not available:
        yield remedy


def twin_checks(validation: Validation) -> dict[str, str]:
    """Validation of the twin, as label and text."""
    rests = "yes" if validation.settled else "no"
    return {
        "Comes to rest": f"{rests}, after moving {1e3 * validation.drift:.2f} mm",
        "Plan replayed in the twin": residual_text(validation.twin),
        "Plan replayed in the scene as given": residual_text(validation.template),
    }


def residual_text(residual: ReplayResidual) -> str:
    parts: list[str] = []
    if residual.force is not None:
        parts.append(f"{residual.force:.3f} N")
    if residual.position is not None:
        parts.append(f"{1e3 * residual.position:.2f} mm")
    if not parts:
        return residual.note or "nothing to compare"
    if residual.note:
        parts.append(residual.note)
    return f"off by {', '.join(parts)}"
