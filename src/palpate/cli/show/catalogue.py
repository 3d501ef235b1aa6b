"""Bundled scenarios, and the vocabulary of plans."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

from rich.text import Text

from palpate.cli.console import escape, out, print_json
from palpate.cli.show.layout import Column, print_rows

if TYPE_CHECKING:
    from palpate.scenarios.catalogue import Scenario
    from palpate.vocabulary.base import Primitive

SCENARIOS = (
    Column("scenario", style="bold"),
    Column("what it shows", words=True),
    Column("request", words=True, style="italic"),
)


def show_scenarios(as_json: bool) -> None:
    """Print the bundled scenarios."""
    from palpate.scenarios.catalogue import scenarios

    found = scenarios().values()
    if as_json:
        print_json([_scenario_json(scenario) for scenario in found])
        return
    rows: list[list[Text]] = []
    for scenario in found:
        request = scenario.request or "– (whatever the scene lacks)"
        rows.append([Text(part) for part in (scenario.name, scenario.title, request)])
    print_rows(SCENARIOS, rows)
    out.print("\nRun one with [bold]palpate demo NAME[/].")


def _scenario_json(scenario: Scenario) -> dict[str, Any]:
    return {
        "name": scenario.name,
        "title": scenario.title,
        "request": scenario.request,
        "planner": scenario.planner.split("/")[0],
        "expects": [str(parameter) for parameter in scenario.expects],
    }


def show_vocabulary(as_json: bool, btcpp: bool) -> None:
    """Print the vocabulary as text, as JSON schema, or as BT.CPP TreeNodesModel."""
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
    """Name, arguments, buffers and summary of a primitive."""
    buffers = f" reads {primitive.reads}" if primitive.reads else ""
    buffers += f" writes {primitive.writes}" if primitive.writes else ""
    arguments = ", ".join(primitive.model_fields)
    return f"→ [bold]{name}[/]({arguments})[dim]{buffers}[/]\n  {escape(primitive.summary())}"
