"""A campaign as an HTML page: counts, force histograms, worst contacts, cases beyond the limits."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from html import escape

from bench.campaign.ledger import Row
from bench.harm.judge import UNSEEN
from palpate.execution.harm import SHOWN
from palpate.runs.report.page import style as shared_style

TITLES = {
    "plans": "Corrupted plans, checked",
    "accepted": "Corrupted plans that the check accepts, executed",
    "bypass": "Corrupted plans that the check refuses, executed without it",
    "nasty": "Plans written by hand",
    "physics": "Plans written by hand whose harm is physics'",
    "sensible": "Sensible plans written by hand, to be accepted",
    "runtime": "Faults during a run",
    "signals": "Signals",
    "stops": "Stops in the middle of every primitive",
    "astray": "Stops in worlds that differ from the scene",
    "poses": "Poses up to 20 mm off",
    "obstacles": "Posts that the scene does not show",
    "cautious": "Posts that the scene does not show, with a cautious arm",
    "light": "Light objects that the scene does not show",
    "inputs": "Bad inputs",
    "schema": "Random scenes over MuJoCo's schema",
}
"""Kinds in the order of the page."""
WORST = 10
"""Number of contacts listed for each kind, the largest forces first."""
STEP, MOST = 10, 200
"""N: width of the histogram's bins, and start of the last one."""
WIDTH, HEIGHT, MARGIN = 640, 150, 24
"""Size of a histogram, px."""

STYLE = """
body { max-width: 62rem; margin: 2rem auto; padding: 0 1rem; }
h2 { margin-top: 2.5rem; } h3 { margin-top: 1.5rem; } table { margin: .5rem 0 1rem; }
td.number, th.number { text-align: right; font-variant-numeric: tabular-nums; }
th, td { padding: .3rem .6rem .3rem 0; }
code { font: .8rem var(--mono); overflow-wrap: anywhere; }
.beyond { color: var(--bad); } .small { color: var(--muted); }
svg text { font: 11px var(--sans); fill: var(--muted); }
rect { fill: var(--accent); } rect.beyond { fill: var(--bad); } line { stroke: var(--bad); }
"""
"""In addition to the style of all pages."""


def framed(title: str, heading: str, parts: Iterable[str]) -> str:
    """Join parts to a page."""
    head = (
        "<!doctype html><html lang=en><meta charset=utf-8>"
        "<meta name=viewport content='width=device-width, initial-scale=1'>"
        f"<title>{escape(title)}</title><style>{shared_style()}{STYLE}</style>"
    )
    return "\n".join([f"{head}<h1>{escape(heading)}</h1>", *parts]) + "</html>\n"


def page(rows: Mapping[str, Sequence[Row]], about: str) -> str:
    """The page; `rows` by kind, `about`: version and method."""
    kinds = [kind for kind in TITLES if rows.get(kind)]
    parts = [
        f"<p class=small>{escape(about)}</p>",
        _summary({kind: rows[kind] for kind in kinds}),
    ]
    for kind in kinds:
        parts += _section(kind, rows[kind])
    return framed("Faults", "Harm and crashes under faults", parts)


def counts(rows: Sequence[Row]) -> dict[str, int]:
    """Numbers of cases, of crashes, and of cases beyond the limits."""
    return {
        "cases": len(rows),
        "crashes": sum(bool(row.crash) for row in rows),
        "beyond": sum(bool(row.beyond) for row in rows),
    }


def _summary(rows: Mapping[str, Sequence[Row]]) -> str:
    lines: list[str] = []
    for kind, found in rows.items():
        figures = counts(found)
        endings = Counter(row.outcome for row in found).most_common(6)
        ended = ", ".join(f"{outcome} {number}" for outcome, number in endings)
        cells = "".join(f"<td class=number>{figure}</td>" for figure in figures.values())
        lines.append(f"<tr><td>{escape(TITLES[kind])}</td>{cells}<td>{escape(ended)}</td></tr>")
    head = "<tr><th></th><th class=number>cases</th><th class=number>crashes</th>"
    return f"<table>{head}<th class=number>beyond</th><th>ended</th></tr>{''.join(lines)}</table>"


def _section(kind: str, rows: Sequence[Row]) -> Iterable[str]:
    yield f"<h2>{escape(TITLES[kind])}</h2>"
    rules = Counter[str]()
    for row in rows:
        rules.update(row.figures.get("rules", ()))
    if rules:
        listed = ", ".join(f"{rule} {number}" for rule, number in rules.most_common())
        yield f"<p class=small>Findings by rule: {escape(listed)}</p>"
    forces = [touch["mean10"] for row in rows for touch in row.touches]
    if forces:
        limit = UNSEEN.mean10 if kind == "obstacles" else SHOWN.mean10
        yield histogram(forces, limit)
        yield "<h3>Worst forces</h3>" + _worst(rows)
    unseen = Counter[str]()
    for row in rows:
        unseen.update(row.figures.get("unseen", ()))
    if unseen:
        listed = "; ".join(f"{fate} ({number})" for fate, number in unseen.most_common())
        yield f"<p class=small>Things that the scene does not show: {escape(listed)}</p>"
    bad = [row for row in rows if row.beyond or row.crash]
    yield f"<h3>Beyond the limits, or crashed: {len(bad)} of {len(rows)}</h3>"
    if bad:
        yield _listed(bad)


def histogram(forces: Sequence[float], limit: float) -> str:
    """Histogram of contacts by their largest 10 ms mean, N, with the limit as a line."""
    bins = [0] * (MOST // STEP + 1)
    for force in forces:
        bins[min(int(force // STEP), len(bins) - 1)] += 1
    tallest = max(bins)
    across, up = (WIDTH - 2 * MARGIN) / len(bins), HEIGHT - 2 * MARGIN
    drawn: list[str] = []
    for i, number in enumerate(bins):
        tall = up * number / tallest
        x, y = MARGIN + i * across, HEIGHT - MARGIN - tall
        place = f'x="{x:.1f}" y="{y:.1f}" width="{across - 1:.1f}" height="{tall:.1f}"'
        mark = ' class="beyond"' if i * STEP >= limit else ""
        drawn.append(f"<rect {place}{mark}/>")
        if number:
            drawn.append(f'<text x="{x:.1f}" y="{y - 3:.1f}">{number}</text>')
        if i % 5 == 0:
            drawn.append(f'<text x="{x:.1f}" y="{HEIGHT - 8}">{i * STEP}</text>')
    at = MARGIN + across * limit / STEP
    drawn.append(f'<line x1="{at:.1f}" x2="{at:.1f}" y1="4" y2="{HEIGHT - MARGIN}"/>')
    caption = "<p class=small>Contacts by their largest 10 ms mean, N; the line is the limit.</p>"
    return f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" width="{WIDTH}">{"".join(drawn)}</svg>{caption}'


def _worst(rows: Sequence[Row]) -> str:
    found = [(touch, row) for row in rows for touch in row.touches]
    found.sort(key=lambda pair: -pair[0]["mean10"])
    lines: list[str] = []
    for touch, row in found[:WORST]:
        forces = "".join(
            f"<td class=number>{touch[name]:.0f}</td>"
            for name in ("peak", "mean10", "mean20", "tail")
        )
        who = escape(f"{touch['part']} on {touch['thing']}")
        lines.append(f"<tr><td>{escape(row.case)}</td><td>{who}</td>{forces}</tr>")
    heads = "".join(
        f"<th class=number>{head}</th>" for head in ("peak N", "10 ms", "20 ms", "from 100 ms")
    )
    return f"<table><tr><th>case</th><th>contact</th>{heads}</tr>{''.join(lines)}</table>"


def _listed(rows: Sequence[Row]) -> str:
    lines: list[str] = []
    for row in rows:
        beyond = "; ".join(row.beyond) or row.crash.strip().splitlines()[-1]
        said = "; ".join(row.said)[:200]
        lines.append(
            f"<tr><td>{escape(row.what)}<br><code>{escape(row.command)}</code></td>"
            f"<td>{escape(row.outcome)}<br><span class=small>{escape(said)}</span></td>"
            f"<td class=beyond>{escape(beyond)}</td></tr>"
        )
    return f"<table><tr><th>case</th><th>ended</th><th>beyond</th></tr>{''.join(lines)}</table>"
