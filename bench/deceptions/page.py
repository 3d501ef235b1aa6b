"""Coverage of the intervals over all worlds, and the verdicts in each, as an HTML page."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
from statistics import NormalDist
from typing import Any

import numpy as np

from bench.campaign.ledger import Row
from bench.campaign.page import framed
from bench.deceptions.world import Deception, deceptions

TITLES = {
    "deceptive": "Deceptive worlds",
    "innocent": "Innocent worlds",
    "not observable": "Not observable from any recording",
}
"""Kinds of worlds, in the order of the page."""


HALF = NormalDist().inv_cdf(0.75)
"""Half width of the central 50 % interval of a normal distribution, in standard deviations."""
TINY = 1e-12
"""Least mean square of z, for values without any error."""
FAR, FARTHEST = 4.0, 5.0
"""Stated standard deviations beyond which values are counted."""


@dataclass(frozen=True, slots=True)
class Coverage:
    """Coverage of the `values` identified values of a quantity, or of all.

    Attributes:
        covered95, covered50: shares whose central interval holds the truth.
        stated: 1 / RMS(z), z = error / stated standard deviation; 1 for calibrated estimates.
        far, farthest: number of values beyond 4 and 5 stated standard deviations.
        worst: largest |z|.
    """

    quantity: str
    values: int
    covered95: float
    covered50: float
    stated: float
    far: int
    farthest: int
    worst: float


def coverage(rows: Iterable[Row]) -> list[Coverage]:
    """Coverage over all worlds in which verdicts are judged: pooled, then by quantity."""
    found: dict[str, list[dict[str, Any]]] = {}
    for row in rows:
        if row.figures.get("kind") == "not observable":
            continue
        for score in row.figures.get("scores", ()):
            if score["verdict"] == "identified":
                quantity = score["parameter"].rpartition(".")[2]
                found.setdefault(quantity, []).append(score)
    everything = [score for scores in found.values() for score in scores]
    if not everything:
        return []
    groups = [("all", everything), *sorted(found.items())]
    return [_coverage(quantity, scores) for quantity, scores in groups]


def _coverage(quantity: str, scores: Sequence[dict[str, Any]]) -> Coverage:
    z = np.array([score["z"] for score in scores])
    return Coverage(
        quantity,
        values=len(z),
        covered95=float(np.mean([score["covered"] for score in scores])),
        covered50=float(np.mean(z < HALF)),
        stated=float(1.0 / np.sqrt(max(float(np.mean(z**2)), TINY))),
        far=int(np.sum(z > FAR)),
        farthest=int(np.sum(z > FARTHEST)),
        worst=float(z.max()),
    )


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
    return framed("Deceptions", "Verdicts in deceptive and innocent worlds", parts)


def by_world(rows: Sequence[Row]) -> dict[str, list[Row]]:
    """Rows by world, in the order of `worlds.toml`; rows of removed worlds are left out."""
    found: dict[str, list[Row]] = {name: [] for name in deceptions()}
    for row in rows:
        found.get(str(row.figures.get("world")), []).append(row)
    return {name: group for name, group in found.items() if group}


def worst(rows: Sequence[Row]) -> float | None:
    """Largest |z| of the identified values; None without any."""
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
    lines = [
        "<tr><th>world</th><th>verdicts</th><th class=number>worst |z|</th><th>estimates</th></tr>"
    ]
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
