"""Output of bundled scenarios, vocabulary, and parameters of a scene."""

from __future__ import annotations

import shlex
import sys
from typing import TYPE_CHECKING

from rich.text import Text

from palpate.cli.console import escape, out, print_json
from palpate.cli.show_layout import TableColumn, print_rows, show_next
from palpate.common.display import to_json
from palpate.runs.reproduce import run_command

if TYPE_CHECKING:
    from palpate.mjcf.body import Body
    from palpate.runs.api import Scene
    from palpate.scene.scaffold import Scaffold


SCENARIOS = (
    TableColumn("scenario", style="bold"),
    TableColumn("what it shows", words=True),
    TableColumn("request", words=True, style="italic"),
)


def show_scenarios(as_json: bool) -> None:
    """Print the bundled scenarios."""
    from palpate.studies.scenarios.catalogue import scenarios

    catalogue = scenarios().values()
    if as_json:
        listed = [
            {
                "name": scenario.name,
                "title": scenario.title,
                "request": scenario.request,
                "planner": scenario.planner.split("/")[0],
                "expects": [str(parameter) for parameter in scenario.expects],
            }
            for scenario in catalogue
        ]
        print_json(listed)
        return
    rows: list[list[Text]] = []
    for scenario in catalogue:
        request = scenario.request or "– (whatever the scene lacks)"
        rows.append([Text(part) for part in (scenario.name, scenario.title, request)])
    print_rows(SCENARIOS, rows)
    out.print("\nRun one with [bold]palpate demo NAME[/].")


def show_vocabulary(as_json: bool, btcpp: bool) -> None:
    """Print the vocabulary as text, as JSON schema, or as BT.CPP TreeNodesModel."""
    from palpate.runs.tools import plan_schema, tree_nodes_model, vocabulary

    if as_json:
        print_json(plan_schema(vocabulary()))
        return
    if btcpp:
        sys.stdout.write(tree_nodes_model(vocabulary()))
        return
    words = vocabulary()
    for name, primitive in words.primitives.items():
        buffers = f" reads {primitive.reads}" if primitive.reads else ""
        buffers += f" writes {primitive.writes}" if primitive.writes else ""
        arguments, summary = ", ".join(primitive.model_fields), escape(primitive.summary())
        out.print(f"→ [bold]{name}[/]({arguments})[dim]{buffers}[/]\n  {summary}")
    for composite in words.composites.values():
        symbol, summary = escape(composite.symbol), escape(composite.summary)
        out.print(f"{symbol} [bold]{composite.name}[/]\n  {summary}")


# Known and missing parameters of a scene, and the files of a new one.

GAP = (
    TableColumn("name", style="bold"),
    TableColumn("role"),
    TableColumn("missing", words=True),
    TableColumn("known", words=True, style="dim"),
    TableColumn("assumed", words=True, style="dim"),
)


def show_gap(scene: Scene, as_json: bool) -> None:
    """Print known and missing parameters, body by body, with the next command."""
    if as_json:
        bodies = [
            {
                "name": body.name,
                "role": body.role,
                "missing": sorted(body.missing),
                "assumed": sorted(body.assumed),
                "known": body.known,
            }
            for body in scene.bodies.values()
        ]
        content = {"missing": scene.missing, "bodies": bodies, "remarks": scene.remarks}
        print_json(to_json(content))
        return
    if scene.bodies:
        print_rows(GAP, [_body_cells(body, scene) for body in scene.bodies.values()])
    else:
        out.print(
            "no object and no surface: a body with a free joint is an object, a named body or"
        )
        out.print("geom that stands still and carries something is a surface")
    for remark in scene.remarks:
        out.print(f"[dim]{escape(remark)}[/]")
    if scene.missing:
        show_next("measure what is missing", run_command(scene.given))


def _body_cells(body: Body, scene: Scene) -> list[str]:
    # Known values with four digits and their unit.
    known: list[str] = []
    for quantity, values in body.known.items():
        words = [quantity, *(f"{value:.4g}" for value in values)]
        described = scene.catalogue.get(quantity)
        if described is not None and described.unit != "1":
            words.append(described.unit)
        known.append(" ".join(words))
    missing = "[green]nothing[/]"
    if body.missing:
        missing = f"[bold red]{', '.join(sorted(body.missing))}[/]"
    return [
        escape(body.name),
        body.role,
        missing,
        ", ".join(known) or "–",
        ", ".join(sorted(body.assumed)) or "–",
    ]


def show_scaffold(scaffold: Scaffold, as_json: bool) -> None:
    """Print the files of a new scene, and the next steps."""
    if as_json:
        print_json(to_json(scaffold))
        return
    scene = shlex.quote(str(scaffold.scene))
    out.print(f"wrote {escape(str(scaffold.scene))}", soft_wrap=True)
    out.print(f"      {escape(str(scaffold.poses))}", soft_wrap=True)
    out.print("Put a ruler to your table, correct places and sizes in them, then:")
    out.print(f"  palpate gap {escape(scene)}", soft_wrap=True)
    if scaffold.objects:
        question = shlex.quote(f"how heavy is the {scaffold.objects[0].replace('_', ' ')}?")
        out.print(f"  palpate run --scene {escape(scene)} -r {escape(question)}", soft_wrap=True)
