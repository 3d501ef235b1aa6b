"""A run's result, and what it falls short of."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from palpate.cli.console import err, escape, out, print_json, printing, say
from palpate.cli.exits import EXIT
from palpate.cli.show.estimates import show_estimates
from palpate.cli.show.plan import print_plan, show_notes
from palpate.display import visible
from palpate.errors import Unavailable
from palpate.live.console import SafeConsole
from palpate.runs.answer import answer
from palpate.runs.figures import significant

if TYPE_CHECKING:
    from palpate.cli.options import WatchOptions
    from palpate.estimation.estimate import Estimate
    from palpate.execution.runner import Observer
    from palpate.interrupt import Interrupts
    from palpate.live.groot import GrootPublisher
    from palpate.live.observers import RealTime, View
    from palpate.live.page import LivePage
    from palpate.runs.run import Run
    from palpate.settings import Settings
    from palpate.twin.held_out.judged import Motion


MANY_MOTIONS = 4
"""More motions that agree are told in one line."""


@contextmanager
def live_view(*others: View | None) -> Generator[tuple[Observer, Callable[[str], None]]]:
    """The live view on stderr, and on the others that there are, and a way to name the present
    stage."""
    from palpate.live.observers import Views
    from palpate.live.terminal import LiveTree

    with LiveTree(err) as live:
        views = Views(live, *(view for view in others if view is not None))
        yield views, views.progress


@contextmanager
def live_page(wanted: bool) -> Generator[LivePage | None]:
    """The page in the browser, where it is wanted.

    Raises:
        Unavailable: viser is not installed, or the page cannot be served.
    """
    if not wanted:
        yield None
        return
    try:
        from palpate.live.page import LivePage
    except ImportError as error:
        why = f"the live page needs viser: pip install 'palpate[live]' ({error})"
        raise Unavailable(why) from None

    with LivePage() as page:
        err.print(f"[dim]live[/] {page.url}", soft_wrap=True)
        yield page


@contextmanager
def groot(wanted: WatchOptions) -> Generator[GrootPublisher | None]:
    """The publisher that Groot2 connects to, where it is wanted.

    Raises:
        Unavailable: pyzmq is not installed, or the port is taken.
    """
    if not wanted.groot:
        yield None
        return
    from palpate.live.groot import GrootPublisher

    with GrootPublisher(wanted.groot_port) as publisher:
        err.print(f"[dim]Groot2[/] {publisher.url}", soft_wrap=True)
        yield publisher


def pace(wanted: WatchOptions, settings: Settings) -> RealTime | None:
    """A simulated arm takes its time where somebody watches elsewhere than here."""
    from palpate.live.observers import RealTime

    watched = wanted.live or wanted.groot
    return RealTime() if watched and settings.robot is None else None


def play_again(page: LivePage, run: Run, signals: Interrupts) -> None:
    """Let the finished run be played again on the page until it is closed there, or Ctrl-C."""
    page.finished(run)
    err.print(f"[dim]played again at[/] {page.url} [dim]until Ctrl-C[/]", soft_wrap=True)
    while not page.closed and not signals.pressed():
        time.sleep(0.2)
    signals.forget()


def confirm_plan(run: Run) -> bool:
    """Show the plan, however quiet it is otherwise, and ask whether the robot may move; no answer is a
    no."""
    print_plan(run.plan, SafeConsole(stderr=True, highlight=False))
    question = f"Let {visible(str(run.settings.robot))} move? (--yes skips this question)"
    return _confirmed(question)


def confirm_resuming(why: str) -> bool:
    """Ask whether a robot that was stopped may go on; where nobody sits at a terminal, nobody says so."""
    if not sys.stdin.isatty():
        return False
    err.print(visible(why), markup=False)
    return _confirmed("Have you seen what stopped it, and is the way clear? Let it go on?")


def _confirmed(question: str) -> bool:
    """The answer of whoever sits there; none is a no."""
    import typer

    try:
        return typer.confirm(question, err=True)
    except typer.Abort:
        err.print()
        return False


def warn_of_invented(settings: Settings) -> None:
    """Say first of all where what will be measured is made up."""
    if settings.world is None and settings.robot is None and settings.scene is not None:
        err.prose(
            "[bold yellow]simulated[/] without --robot or --world: what the scene does not know is drawn at "
            f"random (--seed {settings.seed}), and then measured. No value below is one of a real thing.",
        )


class ValuesFirst:
    """Prints the values of a run as soon as they are final, while twin, film and report are made.

    Attributes:
        shown: whether it has done so.
    """

    def __init__(self, as_json: bool) -> None:
        self.shown = False
        self._as_json = as_json

    def __call__(self, run: Run) -> None:
        """Show the values of `run`; where an object is printed in the end, on stderr, a line each."""
        if self._as_json:
            for estimate in run.estimates:
                err.print(escape(f"final: {repr(estimate).strip('<>')}"), soft_wrap=True)
            return
        with printing():
            _show_values(run)
            _explain_live(run)
        self.shown = True


def show_ended(run: Run, as_json: bool, values_shown: bool = False) -> int:
    """The result on stdout, without its values where these were shown already, and on stderr, a line
    each, what it falls short of; the exit status."""
    with printing():
        show_run(run, as_json, values_shown)
    for line in run.shortfalls:
        say(line)
    kept = f"; what there is, is in '{run.folder}'" if run.folder else ""
    if run.interrupted is not None:
        say(f"{run.interrupted}{kept}: `palpate report` finishes it")
    elif run.status == "aborted" and run.execution is not None:
        # The table above has the reason already.
        why = f": {run.execution.stopped_by}" if as_json else ""
        say(f"stopped{why}{kept}")
    return EXIT[run.status]


def show_run(run: Run, as_json: bool, values_shown: bool = False) -> None:
    """The result: values with error bars, and where the files are."""
    from palpate.runs.result import result_json

    if as_json:
        print_json(result_json(run, run.folder))
        return
    if run.status == "rejected":
        _show_rejection(run)
    elif run.execution is None:
        out.print("[bold green]nothing is missing[/]")
    elif not values_shown:
        _show_values(run)
    show_notes(run.plan, out)
    _show_files(run)


def _show_values(run: Run) -> None:
    _show_measured(run)
    _show_setbacks(run)
    _show_world(run)


def _show_rejection(run: Run) -> None:
    out.print("[bold yellow]no plan[/]", escape(run.plan.explanation))
    for finding in run.findings:
        out.print(f"  [yellow]{finding.rule}[/] {escape(finding.path)}: {escape(finding.message)}")


def _explain_live(run: Run) -> None:
    """Explain the difference between live values and the table."""
    if run.trace_if_any is not None and run.trace_if_any.conversions:
        out.prose(
            "[dim]Final values use the whole recording; live values used the part recorded so far.[/]",
        )


def _show_measured(run: Run) -> None:
    if run.estimates:
        show_estimates(run.estimates, run.truth)
    elif not run.plan.parameters:
        out.prose("[bold]nothing was to be estimated[/]:", escape(run.plan.explanation))
    else:
        out.print("[bold red]no estimates[/]: the run ended before any was made")
    if answered := answer(run):
        out.prose(f"[bold]answer[/] {escape(answered)}")
    for estimate in run.estimates:
        _show_precision(run, estimate)
    _show_held_out(run)


def _show_held_out(run: Run) -> None:
    """Print the predictions of held-out motions: a line each, or one for many that agree."""
    if run.held_out is None:
        return
    agreeing = [motion for motion in run.held_out.motions if motion.agrees]
    if len(agreeing) > MANY_MOTIONS:
        worst = max(motion.rms for motion in agreeing)
        out.prose(
            f"[green]validation agrees[/] {len(agreeing)} motions, after what they show was measured: predicted to "
            f"{significant(1e3 * worst, 2)} mN·m or better",
        )
    for motion in run.held_out.motions:
        if motion.agrees and len(agreeing) > MANY_MOTIONS:
            continue
        heading, said = "[green]validation agrees[/]", _prediction(motion)
        if motion.disagreement:
            said += f". {motion.disagreement}"
        if not motion.agrees:
            heading = "[bold red]validation disagrees[/]"
        out.prose(f"{heading} {escape(said)}")
    for note in run.held_out.notes:
        out.prose(f"[dim]not validated[/] {escape(note)}")


def _prediction(motion: Motion) -> str:
    return (
        f"{motion.motion}: predicted to {significant(1e3 * motion.rms, 2)} mN·m (χ² {motion.chi2:.0f} of "
        f"{motion.dof}, p {motion.p:.2g}); by the scene as given to "
        f"{significant(1e3 * motion.rms_template, 3)} mN·m"
    )


def _show_precision(run: Run, estimate: Estimate) -> None:
    """Print the outcome of a requested width."""
    precision = run.settings.within.precision(estimate)
    if precision is not None:
        colour = "yellow" if precision.outcome == "rounds used up" else "green"
        name, said = escape(str(estimate.parameter)), escape(precision.in_words(estimate.unit))
        out.prose(f"[{colour}]{precision.outcome}[/] {name}: {said}")


def _show_setbacks(run: Run) -> None:
    assert run.execution is not None
    for setback in run.execution.setbacks:
        out.prose(f"[yellow]went on after[/] {escape(setback)}")
    if run.execution.stopped_by:
        out.prose(f"[bold red]stopped[/] {escape(run.execution.stopped_by)}")


def _show_world(run: Run) -> None:
    """Values that nothing real stands behind look no different: it is said."""
    if run.simulated and run.world is not None:
        where = escape(run.world.removeprefix("simulated").strip())
        out.prose(f"[bold yellow]simulated[/] {where}")
    if run.drawn:
        out.prose("[bold yellow]made up[/] no value above is one of a real thing")


def _show_files(run: Run) -> None:
    from palpate.tools import pictures

    out.print(f"[dim]run folder[/]  {run.folder}", soft_wrap=True)
    if run.folder and (run.folder / "report.html").exists():
        out.print(f"[dim]report[/]      {run.folder / 'report.html'}", soft_wrap=True)
    possible, remedy = pictures()
    if not possible:
        out.prose(f"[dim]no pictures[/] {escape(remedy)}")
