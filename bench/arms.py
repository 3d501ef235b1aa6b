"""One table of requests and arms: the tree of each plan, and the values with their deviations."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from hashlib import sha256
from itertools import product
from pathlib import Path

from palpate.runs import pipeline
from palpate.runs.settings import Settings
from palpate.studies.accuracy import run_seed
from palpate.studies.scenarios.catalogue import scenario

REQUESTS = (
    *("bottle_and_table", "friction", "occlusion", "hammer", "clutter", "two_of_three"),
    *("one_missing_mass", "hidden_geometry", "soft_mat", "drawer", "drawer/door"),
    *("vision/contents", "vision/open_box", "vision/lower_one", "synthetic_and_real/rendering"),
)

ARMS = ("fr3", "fr3-ft", "panda", "iiwa14", "ur5e")


@dataclass(frozen=True, slots=True)
class ArmRow:
    """A request on an arm.

    Attributes:
        tree: first characters of the hash of the plan's tree; of the reason without a plan.
        status: of the run; empty where only the plan was made.
        values: (name, value, standard deviation, truth) of each identified component.
    """

    request: str
    arm: str
    seed: int
    tree: str
    status: str = ""
    values: Sequence[tuple[str, float, float, float]] = ()


def settings_of_case(request: str, arm: str, noise: str, seed: int) -> Settings:
    """Return the settings of a bundled scenario on an arm."""
    return scenario(request).settings(arm=arm, noise=noise, seed=seed).check_values()


def plan_row(case: tuple[str, str]) -> ArmRow:
    """Plan a request on an arm."""
    request, arm = case
    settings = settings_of_case(request, arm, "measured", 0)
    plan = pipeline.plan(settings, pipeline.load(settings)).plan
    text = plan.explanation if plan.tree is None else str(plan.tree)
    return ArmRow(request, arm, 0, sha256(text.encode()).hexdigest()[:6])


def run_row(case: tuple[str, str, int], noise: str) -> ArmRow:
    """Run a request on an arm with a seed, and score the values with the truth of the hidden world."""
    request, arm, seed = case
    done = run_seed(settings_of_case(request, arm, noise, seed), seed)
    values = tuple(
        (f"{one.parameter}[{one.component}]", one.value, one.std, one.truth)
        for one in done.estimates
    )
    return ArmRow(request, arm, seed, plan_row((request, arm)).tree, done.status, values)


def compare(
    requests: Sequence[str], arms: Sequence[str], noise: str, seeds: Sequence[int], out: Path | None
) -> Iterator[ArmRow]:
    """Yield a row for each request and arm: the plan alone, or a run for each seed where `out` is given.

    `out` is a file of rows, which is resumed.
    """
    if out is None:
        yield from map(plan_row, product(requests, arms))
        return
    lines = out.read_text(encoding="utf-8").splitlines() if out.is_file() else []
    rows = [ArmRow(**json.loads(line)) for line in lines]
    there = {(row.request, row.arm, row.seed): row for row in rows}
    for case in product(requests, arms, seeds):
        row = there.get(case) or run_row(case, noise)
        if case not in there:
            with out.open("a", encoding="utf-8") as file:
                file.write(json.dumps(asdict(row)) + "\n")
        yield row
