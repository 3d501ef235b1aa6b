"""The page of a campaign: every figure is one that plotly draws, and nothing is left to the reader's
trust."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import plotly.graph_objects as go
import pytest

from palpate.common.parameter import Parameter
from palpate.studies.accuracy import MissingComponent, ScoredEstimate, SeedRun
from palpate.studies.accuracy_page import render, write_page
from palpate.studies.summary import Group, Runs

LAB = Group("desk <b>", "lab")
MASS, COM = Parameter("mug", "mass"), Parameter("mug", "com")
SEEDS = 60


def drawn(parameter: Parameter, component: int, seed: int, share: float) -> ScoredEstimate:
    """An estimate that states 1 g or 1 mm, and is off by `share` of that, at random."""
    random = np.random.default_rng([seed, component, len(parameter.quantity)])
    value = 0.2 + 1e-3 * share * float(random.standard_normal())
    unit = "kg" if parameter == MASS else "m"
    ends = (value - 1.96e-3, value + 1.96e-3)
    return ScoredEstimate(parameter, component, seed, value, 1e-3, *ends, 0.2, None, unit)


@pytest.fixture(scope="module")
def runs() -> Runs:
    """Honest masses, a bold centre of mass, one seed that finds nothing and one that crashes."""
    result: list[SeedRun] = []
    for seed in range(SEEDS):
        coms = tuple(drawn(COM, i, seed, 3.0) for i in range(3))
        result.append(SeedRun(seed, "complete", 12, 20.0, (drawn(MASS, 0, seed, 1.0), *coms)))
    nothing = MissingComponent(MASS, 0, SEEDS, 0.2, "kg", "The mug was never lifted.")
    result.append(SeedRun(SEEDS, "failed", 12, 20.0, (), (), (nothing,)))
    crash = "Traceback\nValueError: the arm is <nowhere>"
    result.append(SeedRun(SEEDS + 1, "crashed", 0, 0.0, (), crash=crash))
    return {LAB: result}


@pytest.fixture(scope="module")
def page(runs: Runs) -> str:
    return render(runs)


def marked_row(page: str, name: str) -> list[tuple[str, str]]:
    """Mark and text of the cells of the last row of that name."""
    pattern = rf'<tr><td class="name">{re.escape(name)}</td>(.*?)</tr>'
    result = re.findall(pattern, page, re.DOTALL)[-1]
    cells = re.findall(r'<td(?: class="(\w+)")?>(.*?)</td>', result, re.DOTALL)
    return [(mark, re.sub(r"<[^>]+>", " ", text).strip()) for mark, text in cells]


def row(page: str, name: str) -> list[str]:
    """The cells' text."""
    return [text for _, text in marked_row(page, name)]


def test_a_row_says_how_far_off_and_how_honestly(page: str) -> None:
    measured, bias, sd, _, stated, ratio, in95, _, worst = row(page, "mug.mass")
    assert measured.startswith(f"{SEEDS}/{SEEDS + 2}")
    assert "1 not identified" in measured
    assert bias.startswith(("+", "-"))
    assert "g" in sd
    assert stated == "1 g"
    assert float(ratio.split()[0]) == pytest.approx(1.0, abs=0.2)
    assert float(in95.split()[0]) > 90
    assert float(worst) < 4


def test_intervals_that_are_too_narrow_are_marked(page: str) -> None:
    for axis in "xyz":
        *_, stated, in95, in50, _ = marked_row(page, f"mug.com {axis}")
        assert [stated[0], in95[0], in50[0]] == ["bad"] * 3
    *_, stated, in95, in50, _ = marked_row(page, "mug.mass")
    assert [stated[0], in95[0], in50[0]] == ["", "", ""]


def test_every_figure_is_drawn_and_is_one_that_plotly_knows(page: str) -> None:
    figures: dict[str, Any] = {
        name: json.loads(text)
        for name, text in re.findall(
            r'<script type="application/json" id="(.+?)">(.+?)</script>', page
        )
    }
    places = re.findall(r'data-figure="(.+?)"', page)
    assert sorted(places) == sorted(figures)
    assert len(figures) == 4 + 2 * 4  # two of all, two of the scenario, two of each component
    for figure in figures.values():
        go.Figure(figure)


def test_names_and_reasons_from_elsewhere_are_text(page: str) -> None:
    assert "desk &lt;b&gt;" in page
    assert "desk <b>" not in page
    assert "ValueError: the arm is &lt;nowhere&gt;" in page
    assert "mug.mass: The mug was never lifted." in page


def test_the_page_loads_nothing_from_the_network(page: str) -> None:
    assert "default-src &#39;none&#39;" in page
    own = page.replace("http://www.w3.org/", "")
    assert not re.search(r'(?:src|href)="(?!#|data:)', own)


def test_a_study_without_a_folder_writes_no_page(tmp_path: Path) -> None:
    assert write_page(tmp_path) is None
    assert list(tmp_path.iterdir()) == []


def test_seeds_that_identify_nothing_make_a_page_all_the_same() -> None:
    nothing = MissingComponent(MASS, 0, 0, 0.2, "kg", "The mug was never lifted.")
    page = render({LAB: [SeedRun(0, "failed", 12, 20.0, (), (), (nothing,))]})
    assert row(page, "mug.mass")[0].startswith("0/1")


def test_a_single_seed_makes_a_page() -> None:
    item = SeedRun(0, "complete", 12, 20.0, (drawn(MASS, 0, 0, 1.0),))
    assert row(render({LAB: [item]}), "mug.mass")[0] == "1/1"
