from __future__ import annotations

import re

import plotly.graph_objects as go

from palpate.report.efficiency import Effort, efficiency_figure, efficiency_page

ROWS = [Effort("one_missing_mass", (20, 8), (41.5, 17.25)), Effort("a<b", (30, 12), (60.0, 30.0))]
PAPER = Effort("the paper", (29, 12), (62.0, 33.0))


def test_plotly_accepts_the_figure() -> None:
    figure = go.Figure(efficiency_figure(ROWS, PAPER))
    bars = {(bar.name, bar.yaxis): list(bar.y) for bar in figure.data}
    assert bars == {
        ("exhaustive", "y"): [20, 30, 29],
        ("intent-driven", "y"): [8, 12, 12],
        ("exhaustive", "y2"): [41.5, 60.0, 62.0],
        ("intent-driven", "y2"): [17.25, 30.0, 33.0],
    }


def test_the_paper_is_paler_than_what_was_measured() -> None:
    for bar in efficiency_figure(ROWS, PAPER)["data"]:
        *measured, paper = bar["marker"]["opacity"]
        assert all(paper < opacity for opacity in measured)


def test_names_are_escaped() -> None:
    assert efficiency_figure(ROWS, PAPER)["data"][0]["x"][1] == "a&lt;b"


def test_page_loads_nothing() -> None:
    page = efficiency_page(ROWS, PAPER)
    assert "Plotly.newPlot" in page
    assert "one_missing_mass" in page
    assert not re.search(r"<(script|link|img)[^>]*\s(src|href)=", page)
