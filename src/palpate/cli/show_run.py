"""Result of a run, its live views, and questions before a real robot moves."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from palpate.cli.console import EXIT, ask_yes_no, err, escape, guard_printing, out, print_json, say
from palpate.cli.show_plan import print_plan, show_notes, show_proposal, understood
from palpate.cli.show_stored import show_estimates
from palpate.common.display import visible
from palpate.common.errors import Unavailable
from palpate.runs.answer import answer
from palpate.runs.figures import significant
from palpate.runs.report.console import SafeConsole

if TYPE_CHECKING:
    from palpate.common.processes import Interrupts
    from palpate.execution.runner import Observer
    from palpate.runs.callbacks import Confirm, Progress
    from palpate.runs.held_out import HeldOutMotion
    from palpate.runs.report.live_page import LivePage
    from palpate.runs.report.live_terminal import RealTime
    from palpate.runs.run import Run
    from palpate.runs.settings import Settings


MANY_MOTIONS = 4  # Count of agreeing motions above which one line summarizes them


@contextmanager
def live_view(*others: Observer | None) -> Generator[tuple[Observer, Callable[[str], None]]]:
    """Show the run on stderr and on other views.

    Yield the observer, and the callback for the name of the present stage.
    """
    from palpate.runs.report.live_terminal import LiveTree, Observers

    with LiveTree(err) as live:
        views = Observers(live, *(view for view in others if view is not None))
        yield views, views.progress


@contextmanager
def live_page(wanted: bool) -> Generator[LivePage | None]:
    """Serve the live page if it is requested. Raises Unavailable: viser is not installed, or the
    page cannot be served."""
    if not wanted:
        yield None
        return
    try:
        from palpate.runs.report.live_page import LivePage
    except ImportError as error:
        reason = f"the live page needs viser: pip install 'palpate[live]' ({error})"
        raise Unavailable(reason) from None

    with LivePage() as page:
        err.print(f"[dim]live[/] {page.url}", soft_wrap=True)
        yield page


def pace(live: bool, settings: Settings) -> RealTime | None:
    """Slow a simulated arm down to real time, if a person watches it on the page."""
    from palpate.runs.report.live_terminal import RealTime

    return RealTime() if live and settings.robot is None else None


def play_again(page: LivePage, run: Run, signals: Interrupts) -> None:
    """Offer the finished run for playback on the page until it is closed or Ctrl-C is pressed."""
    page.offer_playback(run)
    err.print(f"[dim]played again at[/] {page.url} [dim]until Ctrl-C[/]", soft_wrap=True)
    while not page.closed and not signals.count_new():
        time.sleep(0.2)
    signals.forget()


def show_plan_early(run: Run) -> None:
    """Print the plan, even with --quiet, to be read while it is rehearsed."""
    print_plan(run.plan, SafeConsole(stderr=True, highlight=False))


def confirm_plan(run: Run) -> bool:
    """Ask for permission to move; no answer means no."""
    question = f"Let {visible(str(run.settings.robot))} move? (--yes skips this question)"
    return ask_yes_no(question)


def confirm_proposal(run: Run) -> bool:
    """Show a possible meaning of a request, and ask for permission to measure it. Without a
    terminal it is refused.
    """
    if not sys.stdin.isatty():
        return False
    err.prose(escape(understood(run.plan)))
    return ask_yes_no("Measure that?", default=True)


def unless(yes: bool, ask: Confirm) -> Confirm:
    """Make a callback that asks for permission to move, unless it was given beforehand (`--yes`)."""

    def may_move(run: Run) -> bool:
        return yes or ask(run)

    return may_move


def resuming(progress: Progress) -> Callable[[str], bool]:
    """Make a callback that shows the stop of the robot and asks for permission to continue.

    Without a terminal it is refused.
    """

    def may_resume(reason: str) -> bool:
        progress("the robot was stopped")
        if not sys.stdin.isatty():
            return False
        err.print(visible(reason), markup=False)
        return ask_yes_no("Have you seen what stopped it, and is the way clear? Let it go on?")

    return may_resume


def warn_of_drawn_truth(settings: Settings) -> None:
    """Warn before the run if the true values will be drawn at random."""
    if settings.world is None and settings.robot is None and settings.scene is not None:
        err.prose(
            "[bold yellow]simulated[/] without --robot or --world: values that the scene does not state are "
            f"drawn at random (--seed {settings.seed}), then measured. No value below is of a real object."
        )


class ValuesFirst:
    """Callback that prints the values when they are final, before twin, film and report.

    Attributes:
        shown: the values were printed.
    """

    def __init__(self, as_json: bool) -> None:
        self.shown = False
        self._as_json = as_json

    def __call__(self, run: Run) -> None:
        """Print the values of `run`; with --json as lines on stderr."""
        if self._as_json:
            for estimate in run.estimates:
                err.print(escape(f"final: {repr(estimate).strip('<>')}"), soft_wrap=True)
            return
        with guard_printing():
            _show_values(run)
            # Explain the difference between live values and the table.
            if run.trace_if_any is not None and run.trace_if_any.conversions:
                out.prose(
                    "[dim]Final values use the whole recording; live values used the part recorded so far.[/]"
                )
        self.shown = True


def show_result(run: Run, as_json: bool, values_shown: bool = False) -> int:
    """Print the result on stdout and its shortfalls on stderr, a line each; return the exit status.

    `values_shown` leaves out the values, which were printed before.
    """
    with guard_printing():
        show_run(run, as_json, values_shown)
    for line in run.shortfalls:
        say(line)
    kept = f"; what there is, is in '{run.folder}'" if run.folder else ""
    if run.interrupted is not None:
        say(f"{run.interrupted}{kept}: `palpate report` finishes it")
    elif run.status == "aborted" and run.execution is not None:
        # The table above already contains the reason.
        reason = f": {run.execution.stopped_by}" if as_json else ""
        say(f"stopped{reason}{kept}")
    if run.lost:
        say(f"missing or damaged in '{run.folder}': {', '.join(run.lost)}; keep the values above")
        return EXIT["aborted"]
    return EXIT[run.status]


def show_run(run: Run, as_json: bool, values_shown: bool = False) -> None:
    """Print the result: values with error bars, and the paths of the files."""
    from palpate.runs.result import result_json

    if as_json:
        print_json(result_json(run, run.folder))
        return
    if run.status == "rejected":
        out.print("[bold yellow]no plan[/]", escape(run.plan.explanation))
        show_proposal(run)
        for finding in run.findings:
            place, message = escape(finding.path), escape(finding.message)
            out.print(f"  [yellow]{finding.rule}[/] {place}: {message}")
    elif run.execution is None:
        # Print the part of the explanation that the notes do not repeat.
        explanation = run.plan.explanation
        for note in (*run.plan.notes, "Nothing is missing."):
            explanation = explanation.replace(note, "")
        out.print("[bold green]nothing is missing[/]", escape(explanation.strip()))
    elif not values_shown:
        _show_values(run)
    show_notes(run.plan, out)
    _show_files(run)


def _show_values(run: Run) -> None:
    _show_estimates(run)
    # The end of the execution.
    assert run.execution is not None
    for setback in run.execution.setbacks:
        out.prose(f"[yellow]went on after[/] {escape(setback)}")
    if run.execution.stopped_by:
        out.prose(f"[bold red]stopped[/] {escape(run.execution.stopped_by)}")
    # Values of a simulation, perhaps with a truth that was drawn at random.
    if run.simulated and run.world is not None:
        where = escape(run.world.removeprefix("simulated").strip())
        out.prose(f"[bold yellow]simulated[/] {where}")
    if run.drawn:
        out.prose("[bold yellow]made up[/] no value above is of a real object")


def _show_estimates(run: Run) -> None:
    if run.estimates:
        show_estimates(run.estimates, run.truth)
    elif not run.plan.parameters:
        out.prose("[bold]nothing was to be estimated[/]:", escape(run.plan.explanation))
    else:
        out.print("[bold red]no estimates[/]: the run ended before any was made")
    if answered := answer(run):
        out.prose(f"[bold]answer[/] {escape(answered)}")
    # Outcomes of requested widths.
    for estimate in run.estimates:
        precision = run.settings.within.precision(estimate)
        if precision is not None:
            colour = "yellow" if precision.outcome == "rounds used up" else "green"
            name, text = str(estimate.parameter), precision.in_words(estimate.unit)
            out.prose(f"[{colour}]{precision.outcome}[/] {escape(name)}: {escape(text)}")
    _show_held_out(run)
    for name, belief in run.beliefs.items():
        if belief.contradiction:
            out.prose(f"[bold red]contradicted[/] pose of {escape(name)}: {belief.contradiction}")


def _show_held_out(run: Run) -> None:
    """Print the held-out validation: a line per motion, or one line for many that agree."""
    if run.held_out is None:
        return
    # Summarize many agreeing motions by the worst of them.
    agreeing = [motion for motion in run.held_out.motions if motion.agrees and motion.is_better]
    if len(agreeing) > MANY_MOTIONS:
        worst = max(motion.rms for motion in agreeing)
        out.prose(
            f"[green]validation agrees[/] {len(agreeing)} held-out motions: predicted to "
            f"{significant(1e3 * worst, 2)} mN·m or better"
        )
    # Print the others one by one.
    for motion in run.held_out.motions:
        if motion in agreeing and len(agreeing) > MANY_MOTIONS:
            continue
        heading, sentence = "[green]validation agrees[/]", _prediction(motion)
        if motion.disagreement:
            sentence += f". {motion.disagreement}"
        if not motion.agrees:
            heading = "[bold red]validation disagrees[/]"
        elif not motion.is_better:
            heading, sentence = "[yellow]validation open[/]", f"{sentence}, which is no worse"
        out.prose(f"{heading} {escape(sentence)}")
    for note in run.held_out.notes:
        out.prose(f"[dim]not validated[/] {escape(note)}")


def _prediction(motion: HeldOutMotion) -> str:
    return (
        f"{motion.motion}: predicted to {significant(1e3 * motion.rms, 2)} mN·m (χ² {motion.chi2:.0f} of "
        f"{motion.dof}, p {motion.p:.2g}); by the scene as given to "
        f"{significant(1e3 * motion.rms_template, 3)} mN·m"
    )


def _show_files(run: Run) -> None:
    from palpate.runs.tools import gl_available

    if run.folder is None:  # of estimates in memory
        return
    out.print(f"[dim]run folder[/]  {run.folder}", soft_wrap=True)
    if (run.folder / "report.html").exists():
        out.print(f"[dim]report[/]      {run.folder / 'report.html'}", soft_wrap=True)
    possible, remedy = gl_available()
    if not possible:
        out.prose(f"[dim]no pictures[/] {escape(remedy)}")
