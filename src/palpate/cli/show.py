"""What the commands print: tables for people on a terminal, one JSON object for scripts."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

if TYPE_CHECKING:
    from palpate.execution.runner import Observer
    from palpate.mjcf.body import Body
    from palpate.planning.check.check import Finding
    from palpate.planning.plan import Node, Plan
    from palpate.runs.run import Run
    from palpate.scene.scene import Scene
    from palpate.settings import Settings

out = Console(highlight=False)
err = Console(stderr=True, highlight=False)


def print_json(content: Any) -> None:
    """One object on stdout, strict JSON."""
    sys.stdout.write(json.dumps(content, ensure_ascii=False, allow_nan=False) + "\n")


@contextmanager
def live_view() -> Generator[tuple[Observer, Callable[[str], None]]]:
    """The live view on stderr and a way to name the present stage."""
    from palpate.live.terminal import LiveView

    with LiveView(err) as view:
        yield view, view.say


def show_outcome(run: Run, as_json: bool) -> None:
    """The result: values with error bars, and where the files are."""
    from palpate.pictures.renderer import gl_available
    from palpate.runs.result import result_json

    if as_json:
        print_json(result_json(run, run.folder))
        return
    if run.status == "rejected":
        _show_rejection(run)
    elif run.execution is None:
        out.print("[bold green]nothing is missing[/]")
    else:
        _show_estimates(run)
    for note in run.plan.notes:
        out.print(f"[dim]note[/] {escape(note)}")
    out.print(f"[dim]run folder[/]  {run.folder}", soft_wrap=True)
    if run.folder:
        out.print(f"[dim]report[/]      {run.folder / 'report.html'}", soft_wrap=True)
    pictures, remedy = gl_available()
    if not pictures:
        out.print(f"[dim]no pictures[/] {escape(remedy)}", soft_wrap=True)


def escape(text: str) -> str:
    """Untrusted text for rich."""
    from rich.markup import escape as rich_escape

    return rich_escape(text)


def _show_rejection(run: Run) -> None:
    out.print("[bold yellow]no plan[/]", escape(run.plan.explanation))
    for finding in run.findings:
        out.print(f"  [yellow]{finding.rule}[/] {escape(finding.path)}: {escape(finding.message)}")


def _show_estimates(run: Run) -> None:
    table = Table(box=None, header_style="dim", pad_edge=False)
    for heading in ("object", "quantity", "value", "± std", "95 % interval", "verdict"):
        table.add_column(heading, no_wrap=True)
    if run.simulated:
        table.add_column("truth", style="dim", no_wrap=True)
    for estimate in run.estimates:
        unit = estimate.unit.removesuffix("1")
        value = f"[bold]{_numbers(estimate.value)}[/] {unit}" if estimate.has_value else "–"
        row = [
            escape(estimate.parameter.object),
            estimate.parameter.quantity,
            value,
            _numbers(estimate.std, 2),
            "\n".join(f"{low:.5g} … {high:.5g}" for low, high in estimate.ci95),
            estimate.verdict,
        ]
        if run.simulated:
            truth = run.truth.get(estimate.parameter)
            row.append(_numbers(truth) if truth else "–")
        table.add_row(*row)
    out.print(table)
    for setback in run.execution.setbacks if run.execution else ():
        out.print(f"[yellow]went on after[/] {escape(setback)}")
    if run.execution and run.execution.stopped_by:
        out.print(f"[bold red]stopped[/] {escape(run.execution.stopped_by)}")


def _numbers(values: Iterable[float], digits: int = 5) -> str:
    """One number a line."""
    return "\n".join(f"{v:.{digits}g}" for v in values)


def show_scenarios(as_json: bool) -> None:
    """The bundled scenarios."""
    from palpate.scenarios.catalogue import scenarios

    found = scenarios().values()
    if as_json:
        print_json(
            [
                {
                    "name": s.name,
                    "title": s.title,
                    "request": s.request,
                    "planner": s.planner.split("/")[0],
                    "expects": [str(g) for g in s.expects],
                }
                for s in found
            ]
        )
        return
    table = Table(box=None, header_style="dim", pad_edge=False)
    table.add_column("scenario", style="bold")
    table.add_column("what it shows")
    table.add_column("request")
    for s in found:
        table.add_row(
            s.name, s.title, Text(s.request or "– (whatever the scene lacks)", style="italic")
        )
    out.print(table)
    out.print("\nRun one with [bold]palpate demo NAME[/].")


def show_gap(scene: Scene, as_json: bool) -> None:
    """What is known and what is missing, body by body."""
    if as_json:
        print_json(
            {
                "missing": [{"object": g.object, "quantity": g.quantity} for g in scene.missing()],
                "bodies": [_body_json(b) for b in scene.bodies.values()],
            }
        )
        return
    table = Table(box=None, header_style="dim", pad_edge=False)
    for heading in ("name", "role", "missing", "known", "assumed"):
        table.add_column(heading)
    for body in scene.bodies.values():
        known = ", ".join(f"{k} {' '.join(f'{x:.4g}' for x in v)}" for k, v in body.known.items())
        table.add_row(
            escape(body.name),
            body.role,
            f"[bold red]{', '.join(sorted(body.missing))}[/]"
            if body.missing
            else "[green]nothing[/]",
            f"[dim]{known}[/]",
            f"[dim]{', '.join(sorted(body.assumed))}[/]",
        )
    out.print(table)


def _body_json(body: Body) -> dict[str, Any]:
    return {
        "name": body.name,
        "role": body.role,
        "missing": sorted(body.missing),
        "assumed": sorted(body.assumed),
        "known": {k: list(v) for k, v in body.known.items()},
    }


def show_plan(run: Run, as_json: bool, file: Path | None) -> None:
    """A plan: parameters, tree in the paper's notation, explanation, findings."""
    from palpate.runs.result import plan_text

    if file:
        file.write_text(plan_text(run), encoding="utf-8")
    if as_json:
        print_json(
            json.loads(plan_text(run)) | {"findings": [finding_json(f) for f in run.findings]}
        )
        return
    _print_plan(run.plan, out)
    for finding in run.findings:
        out.print(f"[yellow]{finding.rule}[/] {finding.path}: {escape(finding.message)}")


def show_prompt(settings: Settings, as_json: bool) -> None:
    """System prompt, user message and images, as they would be sent."""
    from palpate.pipeline import load
    from palpate.planning.model.prompt.compose import compose
    from palpate.scene.from_picture import SceneBuilder
    from palpate.scene.poses import Poses, read_poses
    from palpate.vocabulary.registry import vocabulary

    scene = load(settings)
    poses = read_poses(settings.poses) if settings.poses else Poses()
    symbols = SceneBuilder(poses).symbols if scene is None else None
    prompt = compose(
        vocabulary(),
        settings.request or "",
        scene,
        settings.images,
        symbols,
        settings.model_settings.without,
    )
    images = [str(path) for path in prompt.images]
    if as_json:
        print_json({"system": prompt.system, "user": prompt.user, "images": images})
        return
    attached = "\n".join(["", "Attach:", *images]) if images else ""
    sys.stdout.write(
        "\n\n".join(part for part in (prompt.system.rstrip(), prompt.user) if part)
        + attached
        + "\n"
    )


def confirm_plan(run: Run) -> bool:
    """Show the plan and ask whether the robot may move; no answer is a no."""
    import typer

    _print_plan(run.plan, err)
    try:
        return typer.confirm(
            f"Let {run.settings.robot} move? (--yes skips this question)", err=True
        )
    except typer.Abort:
        err.print()
        return False


def _print_plan(plan: Plan, console: Console) -> None:
    console.print(
        "measures  ", ", ".join(str(g) for g in plan.parameters) or "nothing", markup=False
    )
    if plan.tree:
        console.print(*tree_lines(plan.tree), sep="\n", markup=False)
    console.print(f"\n{plan.explanation}", markup=False)
    for note in plan.notes:
        console.print(f"[dim]note[/] {escape(note)}")


def finding_json(finding: Finding) -> dict[str, str]:
    """The contract's form of a finding."""
    return {"path": finding.path, "rule": finding.rule, "message": finding.message}


def tree_lines(node: Node, depth: int = 0) -> Iterator[str]:
    """The paper's notation: {-} Sequence, /_/ Parallel, -> action."""
    from palpate.vocabulary.composites import COMPOSITES

    symbol = COMPOSITES[node.type].symbol if node.type in COMPOSITES else "→"
    args = ", ".join(str(v) for _, v in node.args)
    yield f"{'    ' * depth}{symbol} {node.type}" + (
        f"({args})" if node.type not in COMPOSITES else ""
    )
    for child in node.children:
        yield from tree_lines(child, depth + 1)


def check_plan_file(path: Path, scene: Path | None, poses: Path | None, as_json: bool) -> int:
    """Check a plan file; the exit status is 0 when valid and 3 when not."""
    from palpate.planning.check.check import check
    from palpate.planning.recorded import load_proposal
    from palpate.scene.from_picture import DetectedScene, SceneBuilder
    from palpate.scene.load import load_scene
    from palpate.scene.poses import read_poses

    proposal = load_proposal(path)
    known = load_scene(scene, poses) if scene else None
    if known is None and poses and proposal.scene:
        known = DetectedScene(SceneBuilder(read_poses(poses)), proposal.scene).scene()
    findings = check(proposal.plan, known)
    if as_json:
        print_json({"valid": not findings, "findings": [finding_json(f) for f in findings]})
    elif not findings:
        out.print("[green]valid[/]")
    for finding in () if as_json else findings:
        out.print(f"[yellow]{finding.rule}[/] {finding.path}: {escape(finding.message)}")
    return 3 if findings else 0


def show_vocabulary(as_json: bool, btcpp: bool) -> None:
    """The vocabulary for people, as JSON schema, or as BT.CPP TreeNodesModel."""
    from palpate.execution.btcpp import tree_nodes_model
    from palpate.vocabulary.registry import vocabulary
    from palpate.vocabulary.schema import plan_schema

    words = vocabulary()
    if as_json:
        print_json(plan_schema(words))
        return
    if btcpp:
        sys.stdout.write(tree_nodes_model(words))
        return
    for name, cls in words.primitives.items():
        fields = ", ".join(cls.model_fields)
        buffers = "".join(
            [
                f" reads {cls.reads}" if cls.reads else "",
                f" writes {cls.writes}" if cls.writes else "",
            ]
        )
        out.print(f"→ [bold]{name}[/]({fields})[dim]{buffers}[/]\n  {escape(cls.summary())}")
    for composite in words.composites.values():
        out.print(
            f"{escape(composite.symbol)} [bold]{composite.name}[/]\n  {escape(composite.summary)}"
        )
