"""What the commands print: tables for people on a terminal, one JSON object for scripts."""

from __future__ import annotations

import json
import shlex
import sys
from collections.abc import Callable, Generator, Iterable
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.text import Text

from palpate.cli.console import err, escape, out, plain_table, print_json, printing, say
from palpate.cli.exits import EXIT
from palpate.display import visible
from palpate.live.console import SafeConsole
from palpate.redaction import redact

if TYPE_CHECKING:
    from palpate.api import Plan as CheckedPlan
    from palpate.api import Scene
    from palpate.estimation.estimate import Estimate
    from palpate.execution.runner import Observer
    from palpate.mjcf.body import Body
    from palpate.planning.check.check import Finding
    from palpate.planning.plan import Plan
    from palpate.runs.fuse import Fusion
    from palpate.runs.run import Run
    from palpate.scaffold.folder import Scaffold
    from palpate.scenarios.catalogue import Scenario
    from palpate.settings import Settings
    from palpate.twin.export.export import Export
    from palpate.twin.held_out import Motion
    from palpate.vocabulary.base import Primitive


FUSION_WIDTH = 130
"""Characters of a table whose rows end in the name of a run, whatever the terminal has."""


@contextmanager
def live_view() -> Generator[tuple[Observer, Callable[[str], None]]]:
    """The live view on stderr and a way to name the present stage."""
    from palpate.live.terminal import LiveTree

    with LiveTree(err) as live:
        yield live, live.progress


def warn_of_invented(settings: Settings) -> None:
    """Say first of all where what will be measured is made up."""
    if settings.world is None and settings.robot is None and settings.scene is not None:
        err.print(
            "[bold yellow]simulated[/] without --robot or --world: what the scene does not know is drawn at "
            f"random (--seed {settings.seed}), and then measured. No value below is one of a real thing.",
            soft_wrap=True,
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
                say(f"final: {estimate!r}")
            return
        with printing():
            _show_values(run)
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
        say(f"stopped: {run.execution.stopped_by}{kept}")
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
    _show_notes(run.plan, out)
    _show_files(run)


def _show_values(run: Run) -> None:
    _show_estimates(run)
    if run.drawn:
        out.print(
            "[bold yellow]made up[/] the true values were drawn from priors: these are of no real thing",
            soft_wrap=True,
        )
    _show_setbacks(run)


def _show_rejection(run: Run) -> None:
    out.print("[bold yellow]no plan[/]", escape(run.plan.explanation))
    for finding in run.findings:
        out.print(f"  [yellow]{finding.rule}[/] {escape(finding.path)}: {escape(finding.message)}")


def _show_estimates(run: Run) -> None:
    headings = ["object", "quantity", "value", "± std", "95 % interval", "verdict"]
    table = plain_table(*headings, no_wrap=True)
    if run.simulated:
        table.add_column("truth", style="dim", no_wrap=True)
    for estimate in run.estimates:
        cells = _estimate_cells(estimate)
        if run.simulated:
            truth = run.truth.get(estimate.parameter, ())
            cells.append(_numbers(truth) or "–")
        table.add_row(*cells)
    out.print(table)
    for estimate in run.estimates:
        if estimate.contradiction:
            name, finding = escape(str(estimate.parameter)), escape(estimate.contradiction)
            out.print(f"[bold red]contradicted[/] {name}: {finding}")
    for estimate in run.estimates:
        _show_precision(run, estimate)
    _show_held_out(run)


def show_fusion(fusion: Fusion, as_json: bool) -> None:
    """What each run says of each parameter, and what they say together."""
    from palpate.runs.fuse import fusion_json

    if as_json:
        print_json(fusion_json(fusion, fusion.folder))
        return
    headings = ["object", "quantity", "value", "± std", "95 % interval", "verdict", "by"]
    table = plain_table(*headings, no_wrap=True)
    for estimate in fusion.estimates:
        for name, run in zip(fusion.names, fusion.runs, strict=True):
            for one in run.estimates:
                if one.parameter == estimate.parameter:
                    table.add_row(*_estimate_cells(one), escape(name), style="dim")
        table.add_row(*_estimate_cells(estimate), "[bold]together[/]")
    wide = max(out.width, FUSION_WIDTH)
    SafeConsole(highlight=False, width=wide).print(table)
    for estimate in fusion.estimates:
        if estimate.contradiction:
            name, finding = escape(str(estimate.parameter)), escape(estimate.contradiction)
            out.print(f"[bold red]contradicted[/] {name}: {finding}", soft_wrap=True)
    for line in fusion.left_out:
        out.print(f"[yellow]left out[/] {escape(line)}", soft_wrap=True)
    for note in fusion.twin.notes:
        out.print(f"[dim]note[/] {escape(note)}", soft_wrap=True)
    if fusion.folder is not None:
        out.print(f"[dim]twin[/] {fusion.folder / 'twin.xml'}", soft_wrap=True)


def show_export(run: Run, export: Export, as_json: bool) -> None:
    """What became of each estimate, and what else is not as it was."""
    from palpate.runs.export import export_json

    if as_json:
        print_json(export_json(run, export) | {"file": str(export.file)})
        return
    table = plain_table("object", "quantity", "value", "± std", "95 % interval", "verdict", "")
    for estimate in run.estimates:
        if estimate.parameter in export.held:
            table.add_row(*_estimate_cells(estimate), "[green]read back[/]")
        elif estimate.parameter in export.lost:
            table.add_row(*_estimate_cells(estimate), f"[yellow]not in {export.format}[/]")
    SafeConsole(highlight=False, width=max(out.width, FUSION_WIDTH)).print(table)
    for note in export.notes:
        out.print(f"[dim]note[/] {escape(note)}", soft_wrap=True)
    out.print(f"[dim]{export.format}[/] {export.file}", soft_wrap=True)


def show_scaffold(made: Scaffold, as_json: bool) -> None:
    """The files of a new scene, and what to do next."""
    if as_json:
        files = {"scene": str(made.scene), "poses": str(made.poses)}
        print_json(files | {"objects": list(made.objects)})
        return
    scene = shlex.quote(str(made.scene))
    out.print(f"wrote {escape(str(made.scene))}", soft_wrap=True)
    out.print(f"      {escape(str(made.poses))}", soft_wrap=True)
    out.print("Put a ruler to your table, correct places and sizes in them, then:")
    out.print(f"  palpate gap {escape(scene)}", soft_wrap=True)
    if made.objects:
        question = shlex.quote(f"how heavy is the {made.objects[0].replace('_', ' ')}?")
        out.print(f"  palpate run --scene {escape(scene)} -r {escape(question)}", soft_wrap=True)


def _show_held_out(run: Run) -> None:
    """How well motions were predicted that nothing was fitted to, a line each."""
    if run.held_out is None:
        return
    for motion in run.held_out.motions:
        heading, said = "[green]validation agrees[/]", _prediction(motion)
        if motion.disagreement:
            said += f". {motion.disagreement}"
        if not motion.agrees:
            heading = "[bold red]validation disagrees[/]"
        out.print(f"{heading} {escape(said)}", soft_wrap=True)
    for note in run.held_out.notes:
        out.print(f"[dim]not validated[/] {escape(note)}", soft_wrap=True)


def _prediction(motion: Motion) -> str:
    return (
        f"{motion.motion}: predicted to {1e3 * motion.rms:.2g} mN·m (χ² {motion.chi2:.0f} of "
        f"{motion.dof}, p {motion.p:.2g}); by the scene as given to {1e3 * motion.rms_template:.3g} mN·m"
    )


def _show_precision(run: Run, estimate: Estimate) -> None:
    """What came of the width that was asked."""
    precision = run.settings.within.precision(estimate)
    if precision is not None:
        colour = "yellow" if precision.outcome == "rounds used up" else "green"
        name, said = escape(str(estimate.parameter)), escape(precision.in_words(estimate.unit))
        out.print(f"[{colour}]{precision.outcome}[/] {name}: {said}")


def _estimate_cells(estimate: Estimate) -> list[str]:
    """A row of the table, a line for each component."""
    unit = estimate.unit.removesuffix("1")
    value = "–"
    if estimate.has_value:
        value = f"[bold]{_numbers(estimate.value)}[/] {unit}"
    return [
        escape(estimate.parameter.object),
        estimate.parameter.quantity,
        value,
        _numbers(estimate.std, 2),
        "\n".join(f"{low:.5g} … {high:.5g}" for low, high in estimate.ci95),
        estimate.verdict,
    ]


def _numbers(values: Iterable[float], digits: int = 5) -> str:
    """One number a line."""
    return "\n".join(f"{v:.{digits}g}" for v in values)


def _show_setbacks(run: Run) -> None:
    assert run.execution is not None
    for setback in run.execution.setbacks:
        out.print(f"[yellow]went on after[/] {escape(setback)}")
    if run.execution.stopped_by:
        out.print(f"[bold red]stopped[/] {escape(run.execution.stopped_by)}")


def _show_notes(plan: Plan, console: Console) -> None:
    for note in plan.notes:
        console.print(f"[dim]note[/] {escape(note)}")


def _show_files(run: Run) -> None:
    from palpate.tools import pictures

    out.print(f"[dim]run folder[/]  {run.folder}", soft_wrap=True)
    if run.folder:
        out.print(f"[dim]report[/]      {run.folder / 'report.html'}", soft_wrap=True)
    possible, remedy = pictures()
    if not possible:
        out.print(f"[dim]no pictures[/] {escape(remedy)}", soft_wrap=True)


def show_scenarios(as_json: bool) -> None:
    """The bundled scenarios."""
    from palpate.scenarios.catalogue import scenarios

    found = scenarios().values()
    if as_json:
        print_json([_scenario_json(scenario) for scenario in found])
        return
    table = plain_table()
    table.add_column("scenario", style="bold")
    table.add_column("what it shows")
    table.add_column("request")
    for scenario in found:
        request = scenario.request or "– (whatever the scene lacks)"
        table.add_row(scenario.name, scenario.title, Text(request, style="italic"))
    out.print(table)
    out.print("\nRun one with [bold]palpate demo NAME[/].")


def _scenario_json(scenario: Scenario) -> dict[str, Any]:
    return {
        "name": scenario.name,
        "title": scenario.title,
        "request": scenario.request,
        "planner": scenario.planner.split("/")[0],
        "expects": [str(parameter) for parameter in scenario.expects],
    }


def show_gap(scene: Scene, as_json: bool) -> None:
    """What is known and what is missing, body by body."""
    if as_json:
        print_json(_gap_json(scene))
        return
    table = plain_table("name", "role", "missing", "known", "assumed")
    for body in scene.bodies.values():
        table.add_row(*_body_cells(body))
    out.print(table)
    for remark in scene.remarks:
        out.print(f"[dim]{escape(remark)}[/]")


def _gap_json(scene: Scene) -> dict[str, Any]:
    missing: list[dict[str, str]] = []
    for parameter in scene.missing:
        missing.append({"object": parameter.object, "quantity": parameter.quantity})
    return {
        "missing": missing,
        "bodies": [_body_json(body) for body in scene.bodies.values()],
        "remarks": list(scene.remarks),
    }


def _body_json(body: Body) -> dict[str, Any]:
    return {
        "name": body.name,
        "role": body.role,
        "missing": sorted(body.missing),
        "assumed": sorted(body.assumed),
        "known": {quantity: list(values) for quantity, values in body.known.items()},
    }


def _body_cells(body: Body) -> list[str]:
    known: list[str] = []
    for quantity, values in body.known.items():
        numbers = " ".join(f"{value:.4g}" for value in values)
        known.append(f"{quantity} {numbers}")
    missing = "[green]nothing[/]"
    if body.missing:
        missing = f"[bold red]{', '.join(sorted(body.missing))}[/]"
    return [
        escape(body.name),
        body.role,
        missing,
        f"[dim]{', '.join(known)}[/]",
        f"[dim]{', '.join(sorted(body.assumed))}[/]",
    ]


def show_plan(plan: CheckedPlan, as_json: bool, file: Path | None) -> None:
    """A plan: parameters, tree in the paper's notation, explanation, findings; also to a file."""
    from palpate.runs.result import plan_text

    text = plan_text(plan.made)
    if file:
        file.write_text(redact(text), encoding="utf-8")
    if as_json:
        print_json(json.loads(text) | {"findings": _findings_json(plan.findings)})
        return
    _print_plan(plan, out)
    _print_findings(plan.findings)


def _print_plan(plan: Plan, console: Console) -> None:
    from palpate.tools import paper_notation

    names = ", ".join(str(parameter) for parameter in plan.parameters)
    console.print("measures  ", names or "nothing", markup=False)
    if plan.tree:
        console.print(*paper_notation(plan.tree), sep="\n", markup=False)
    console.print(f"\n{plan.explanation}", markup=False)
    _show_notes(plan, console)


def show_findings(findings: Iterable[Finding], as_json: bool) -> None:
    """What the check says against a plan."""
    found = _findings_json(findings)
    if as_json:
        print_json({"valid": not found, "findings": found})
    elif found:
        _print_findings(findings)
    else:
        out.print("[green]valid[/]")


def _print_findings(findings: Iterable[Finding]) -> None:
    for finding in findings:
        out.print(f"[yellow]{finding.rule}[/] {finding.path}: {escape(finding.message)}")


def _findings_json(findings: Iterable[Finding]) -> list[dict[str, str]]:
    """The contract's form of findings."""
    return [{"path": f.path, "rule": f.rule, "message": f.message} for f in findings]


def show_prompt(settings: Settings, as_json: bool) -> None:
    """System prompt, user message and images, as they would be sent."""
    from palpate.tools import prompt as compose

    prompt = compose(settings)
    images = [str(path) for path in prompt.images]
    if as_json:
        print_json({"system": prompt.system, "user": prompt.user, "images": images})
        return
    parts = [part for part in (prompt.system.rstrip(), prompt.user) if part]
    text = "\n\n".join(parts)
    if images:
        text = "\n".join([text, "Attach:", *images])
    sys.stdout.write(visible(text) + "\n")


def confirm_plan(run: Run) -> bool:
    """Show the plan and ask whether the robot may move; no answer is a no."""
    import typer

    _print_plan(run.plan, err)
    question = f"Let {visible(str(run.settings.robot))} move? (--yes skips this question)"
    try:
        return typer.confirm(question, err=True)
    except typer.Abort:
        err.print()
        return False


def show_vocabulary(as_json: bool, btcpp: bool) -> None:
    """The vocabulary for people, as JSON schema, or as BT.CPP TreeNodesModel."""
    from palpate.tools import plan_schema, tree_nodes_model, vocabulary

    if as_json:
        print_json(plan_schema())
        return
    if btcpp:
        sys.stdout.write(tree_nodes_model())
        return
    words = vocabulary()
    for name, primitive in words.primitives.items():
        out.print(_primitive_text(name, primitive))
    for composite in words.composites.values():
        symbol, summary = escape(composite.symbol), escape(composite.summary)
        out.print(f"{symbol} [bold]{composite.name}[/]\n  {summary}")


def _primitive_text(name: str, primitive: type[Primitive]) -> str:
    """A primitive with its arguments, its buffers and what it does."""
    buffers = ""
    if primitive.reads:
        buffers += f" reads {primitive.reads}"
    if primitive.writes:
        buffers += f" writes {primitive.writes}"
    arguments = ", ".join(primitive.model_fields)
    return f"→ [bold]{name}[/]({arguments})[dim]{buffers}[/]\n  {escape(primitive.summary())}"
