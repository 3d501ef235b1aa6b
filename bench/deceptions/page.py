"""What was answered in every world, as one HTML page."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from html import escape

from bench.campaign.ledger import Row
from bench.campaign.page import framed
from bench.deceptions.coverage import Coverage, coverage
from bench.deceptions.world import Deception, deceptions

TITLES = {
    "deceptive": "Worlds that deceive",
    "innocent": "Innocent worlds",
    "not observable": "What no recording can tell",
}
"""Kinds of worlds, in the order of the page."""


def page(rows: Sequence[Row]) -> str:
    """The page of all rows."""
    parts = [_covered(coverage(rows))]
    for kind, title in TITLES.items():
        found = [row for row in rows if row.figures.get("kind") == kind]
        if found:
            parts += [f"<h2>{title}</h2>", _worlds(found)]
    crashed = [row for row in rows if row.crash]
    for row in crashed:
        parts.append(f"<p class=beyond>{escape(row.case)}</p><pre>{escape(row.crash)}</pre>")
    return framed("Deceptions", "Who is deceived", parts)


def by_world(rows: Sequence[Row]) -> dict[str, list[Row]]:
    """Rows of worlds that are still known, in the worlds' order."""
    found: dict[str, list[Row]] = {name: [] for name in deceptions()}
    for row in rows:
        found.get(str(row.figures.get("world")), []).append(row)
    return {name: group for name, group in found.items() if group}


def worst(rows: Sequence[Row]) -> float | None:
    """The most stated standard deviations that an identified value is off; None without any."""
    return max(
        (
            float(score["z"])
            for row in rows
            for score in row.figures.get("scores", ())
            if score["verdict"] == "identified"
        ),
        default=None,
    )


def _covered(found: Sequence[Coverage]) -> str:
    heads = (
        "",
        "identified",
        "in 95 %",
        "in 50 %",
        "stated / actual",
        "beyond 4",
        "beyond 5",
        "worst",
    )
    lines = [_line("th", heads)]
    for row in found:
        figures = (
            row.quantity,
            str(row.values),
            f"{row.covered95:.1%}",
            f"{row.covered50:.1%}",
            f"{row.stated:.2f}",
            str(row.far),
            str(row.farthest),
            f"{row.worst:.1f}",
        )
        lines.append(_line("td", figures))
    return f"<table>{''.join(lines)}</table>"


def _line(tag: str, cells: Sequence[str]) -> str:
    first, *others = map(escape, cells)
    numbers = "".join(f"<{tag} class=number>{cell}</{tag}>" for cell in others)
    return f"<tr><{tag}>{first}</{tag}>{numbers}</tr>"


def _worlds(rows: Sequence[Row]) -> str:
    lines = ["<tr><th>world</th><th>answers</th><th class=number>worst std</th><th>said</th></tr>"]
    for name, group in by_world(rows).items():
        lines.append(_world(deceptions()[name], group))
    return f"<table>{''.join(lines)}</table>"


def _world(world: Deception, rows: Sequence[Row]) -> str:
    answers = Counter(row.outcome for row in rows).most_common()
    off = worst(rows)
    shown = "–" if off is None else f"{off:.1f}"
    reason = f"<br><span class=small>{escape(world.why)}</span>" if world.why else ""
    beyond = [text for row in rows for text in row.beyond]
    said = escape("; ".join(beyond or rows[0].said)[:400])
    return (
        f"<tr><td><b>{escape(world.name)}</b><br>{escape(world.story)}{reason}</td>"
        f"<td>{escape(', '.join(f'{outcome} {count}' for outcome, count in answers))}</td>"
        f"<td class=number>{shown}</td>"
        f"<td class='{'beyond' if beyond else 'small'}'>{said}</td></tr>"
    )
