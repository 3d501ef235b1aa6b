"""Data of the report page."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from palpate.estimation.estimate import Estimate
from palpate.execution.stop import Held
from palpate.planning.plan import Plan
from palpate.trace.samples import Trace
from palpate.twin.held_out.judged import HeldOut

State = Literal["known", "missing", "assumed"]


@dataclass(frozen=True, slots=True)
class ParameterRow:
    """Quantity of an object: its status in the scene, and whether the request names it."""

    object: str
    quantity: str
    state: State
    asked: bool
    value: tuple[float, ...] | None = None


@dataclass(frozen=True, slots=True)
class Measured:
    """An estimate, and what is true in a simulated world (None on a real robot)."""

    estimate: Estimate
    truth: tuple[float, ...] | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ReportData:
    """All the page shows. What did not come to be stays empty, and its section is left out.

    Attributes:
        request: the sentence; None when only a scene was given.
        status: of the run, as in `result.json`.
        plan: with `tree` None when the request was rejected.
        world: where it ran, in words.
        parameters: what the scene knows and lacks.
        measured: the estimates.
        findings: why the plan did not pass the check, one line each.
        trace: None when nothing was executed.
        stopped_by: why the robot stopped early.
        held: what the fingers held then, and what became of it.
        robot_seconds: duration of the execution, robot time.
        total_seconds: wall time from the start of the command to this page.
        workspace, before, after: PNG or JPEG.
        video: MP4, played `video_speed` times faster than robot time.
        `video_believed`: no camera saw it, it is the trace, played again.
        twin_diff: unified diff from the user's MJCF to the twin.
        twin_checks: label to value, e.g. the residual of the replayed measurement.
        held_out: predictions of motions that were left out of the fits.
        twin_notes: remarks about the twin.
        versions: name to version.
        seed, noise: of a simulated world.
        files: paths in the run folder, relative to the page.
        answer: to a request that compares.
        warnings: one line each, e.g. how to get pictures.
        simulated: whether no real thing moved.
        drawn: whether what was measured was made up, drawn from priors.
        command: what carries the run out again, from the page's folder.
    """

    request: str | None
    status: Literal["running", "complete", "rejected", "aborted", "failed"]
    plan: Plan
    world: str
    parameters: tuple[ParameterRow, ...] = ()
    measured: tuple[Measured, ...] = ()
    findings: tuple[str, ...] = ()
    trace: Trace | None = None
    stopped_by: str | None = None
    held: Held | None = None
    robot_seconds: float | None = None
    total_seconds: float | None = None
    workspace: bytes | None = None
    before: bytes | None = None
    after: bytes | None = None
    video: bytes | None = None
    video_speed: float = 1.0
    video_believed: bool = False
    twin_diff: str = ""
    twin_checks: Mapping[str, str] = field(default_factory=dict[str, str])
    held_out: HeldOut | None = None
    twin_notes: tuple[str, ...] = ()
    versions: Mapping[str, str] = field(default_factory=dict[str, str])
    seed: int | None = None
    noise: str | None = None
    files: tuple[str, ...] = ()
    answer: str | None = None
    warnings: tuple[str, ...] = ()
    simulated: bool = False
    drawn: bool = False
    command: str = ""
