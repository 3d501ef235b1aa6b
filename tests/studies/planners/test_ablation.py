import json
import threading
from collections.abc import Callable
from itertools import count
from pathlib import Path

import pytest
from loopback import Fails, Loopback, Reply, Request, Says

from palpate.common.errors import InputError, Unavailable
from palpate.planning.model import session as session_module
from palpate.planning.model.settings import Budget, ModelSettings
from palpate.runs import pipeline
from palpate.runs.run import Run
from palpate.studies.ablation import (
    ABLATION,
    CONFIGURATIONS,
    KINDS,
    ablation,
    chosen,
    modules_left_out,
    repeatability,
)
from palpate.studies.attempt import Conditions
from palpate.studies.efficiency import Rate
from palpate.studies.scenarios.catalogue import scenario
from palpate.studies.trials import by_scenario, read_records, table

pytestmark = pytest.mark.long

pytest.importorskip("pydantic_ai")

NAME = "one_missing_mass"
GOOD = (scenario(NAME).folder / "plans" / "paper.json").read_text()


@pytest.fixture(autouse=True)
def _environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OPENAI_API_KEY", "sk-secret-0123456789")
    monkeypatch.setattr(session_module, "BACKOFF", (0.01,))


@pytest.fixture(scope="module")
def executions() -> dict[object, Run]:
    """Runs by what they follow from."""
    return {}


@pytest.fixture(autouse=True)
def _executed_once(monkeypatch: pytest.MonkeyPatch, executions: dict[object, Run]) -> None:
    """The same plan with the same seed and noise gives the same trace: it is executed once."""
    measure = pipeline.measure

    def measured(made: Run) -> Run:
        key = repr(made.plan.tree), made.settings.scene, made.settings.noise, made.settings.seed
        if key not in executions:
            executions[key] = measure(made)
        return executions[key]

    monkeypatch.setattr(pipeline, "measure", measured)


def settings(server: Loopback, rounds: int = 0, **changes) -> Conditions:
    model_settings = ModelSettings(
        base_url=server.url("openai"), budget=Budget(seconds=20), rounds=rounds
    )
    return Conditions(**{"noise": "none", "model_settings": model_settings} | changes)


def model(request: Request) -> Reply:
    """Depends on the prompt as the paper's models did: no form without examples, no right action
    without a library."""
    if "# Output" not in request.system:
        return Says("First lift the green bottle, then weigh it.")
    if "# Action library" not in request.system:
        return Says(GOOD.replace("Force2Mass", "WeighObject"))
    if "# Behavior tree rules" not in request.system:
        document = json.loads(GOOD)
        document["tree"]["children"] = document["tree"]["children"][:-3]
        return Says(json.dumps(document))
    return Says(GOOD)


def together(number: int, answer: Callable[[Request], Reply]) -> Callable[[Request], Reply]:
    """`answer`, which is given to nobody before `number` have asked."""
    asked, met = count(1), threading.Event()

    def reply(request: Request) -> Reply:
        if next(asked) >= number:
            met.set()
        met.wait(15)
        return answer(request)

    return reply


def test_the_papers_table_is_made_over_http(tmp_path: Path) -> None:
    with Loopback(answer=together(4, model)) as server:
        records = ablation(
            [NAME], ["openai:gpt-x"], tmp_path / "r.jsonl", settings(server), trials=2, in_flight=4
        )
        requests = list(server.requests)
    assert server.most_in_flight == 4
    assert len(requests) == len(records) == 2 * len(CONFIGURATIONS)
    rows = {row.configuration: row for row in table(records)}
    assert list(rows) == list(CONFIGURATIONS) == list(ABLATION)
    syntax = {name: row.syntax.hits for name, row in rows.items()}
    assert syntax == dict.fromkeys(CONFIGURATIONS, 2) | {
        "no actions": 0,
        "no output": 0,
        "no system prompt": 0,
    }
    success = {name: row.success.hits if row.success else None for name, row in rows.items()}
    assert success == dict.fromkeys(CONFIGURATIONS, 2) | {
        "no text": None,
        "no actions": 0,
        "no output": 0,
        "no system prompt": 0,
        "no rules": 0,
    }
    assert rows["full"].tokens == 3500
    assert all(bool(request.images) == ("Attached" in request.user) for request in requests)
    assert all("<!--" not in request.user for request in requests), "notes give answers away"
    weighed = [record.found["green_bottle.mass"] for record in records if record.success]
    assert len(weighed) == 8
    assert all(abs(w.value[0] - w.truth[0]) < 4 * w.std[0] for w in weighed)


def several(request: Request) -> Reply:
    """Right about both tasks, unless nobody told it that some things cannot be measured."""
    if "temperature" not in request.user:
        return Says(GOOD)
    if "# Reasoning rules" in request.system:
        return Says('{"parameters": [], "explanation": "Nothing senses heat.", "tree": null}')
    return Says(GOOD)


def test_scenarios_of_several_kinds_are_studied_together(tmp_path: Path) -> None:
    names, left_out = [NAME, "water_temperature"], ["full", "no rules"]
    file = tmp_path / "r.jsonl"
    with Loopback(answer=several) as server:
        asked = ["openai:gpt-x"]
        styles = ["full", "lean"]
        records = ablation(names, asked, file, settings(server), 1, left_out, 1, prompts=styles)
        prompts = [len(request.system) for request in server.requests]
    items = [
        (row.scenario, row.asked, row.configuration, row.success) for row in by_scenario(records)
    ]
    lean = "openai:gpt-x, lean prompt"
    assert items == [
        (NAME, "openai:gpt-x", "full", Rate(1, 1)),
        (NAME, "openai:gpt-x", "no rules", Rate(1, 1)),
        (NAME, lean, "full", Rate(1, 1)),
        (NAME, lean, "no rules", Rate(1, 1)),
        ("water_temperature", "openai:gpt-x", "full", Rate(1, 1)),
        ("water_temperature", "openai:gpt-x", "no rules", Rate(0, 1)),
        ("water_temperature", lean, "full", Rate(1, 1)),
        ("water_temperature", lean, "no rules", Rate(0, 1)),
    ]
    assert prompts[2] < prompts[0], "the lean prompt is the shorter one"
    assert [row.scenario for row in table(records)] == [""] * 4
    assert records[4].outcome == "refused rightly"


def test_scenarios_are_named_one_by_one_or_all_together() -> None:
    assert chosen(["friction", "friction"]) == ["friction"]
    assert set(KINDS) == set(chosen(["kinds"])) < set(chosen(["all"]))
    assert "mishaps/unreachable" not in chosen(["all"]), "it is about a recorded plan"


def test_the_image_is_left_out_only_where_it_should_be(tmp_path: Path) -> None:
    from PIL import Image

    picture = tmp_path / "workspace.png"
    Image.new("RGB", (40, 30)).save(picture)
    with Loopback(answer=model) as server:
        shared = settings(server, images=(picture,))
        ablation(
            [NAME],
            ["openai:gpt-x"],
            tmp_path / "r.jsonl",
            shared,
            1,
            ["full", "no image"],
            in_flight=1,
        )
    assert [len(request.images) for request in server.requests] == [1, 0]


def test_syntax_counts_the_first_answer_and_validity_what_feedback_made_of_it(
    tmp_path: Path,
) -> None:
    with Loopback(Says(GOOD[:-50]), Says(GOOD)) as server:
        records = repeatability(
            [NAME], ["openai:gpt-x"], tmp_path / "r.jsonl", settings(server, rounds=1), trials=1
        )
    assert (records[0].syntax, records[0].valid, records[0].success) == (False, True, True)
    assert records[0].figures["rounds"] == 2


def test_models_are_compared_on_the_same_task(tmp_path: Path) -> None:
    with Loopback(answer=model) as server:
        records = repeatability(
            [NAME], ["openai:one", "openai:two"], tmp_path / "r.jsonl", settings(server), trials=2
        )
    assert [
        (row.planner, row.syntax.hits, row.success.hits if row.success else -1)
        for row in table(records)
    ] == [("openai:one", 2, 2), ("openai:two", 2, 2)]
    assert {request.body["model"] for request in server.requests} == {"one", "two"}


def test_any_planner_can_be_studied(tmp_path: Path) -> None:
    plan = scenario(NAME).folder / "plans" / "paper.json"
    planners = ["symbolic", f"replay:{plan}"]
    records = repeatability(
        [NAME], planners, tmp_path / "r.jsonl", Conditions(noise="none"), trials=1
    )
    assert [(r.syntax, r.valid, r.success) for r in records] == [(True, True, True)] * 2


def test_a_plan_that_measures_too_much_is_no_success(tmp_path: Path) -> None:
    records = repeatability(
        ["bottle_and_table"],
        ["exhaustive"],
        tmp_path / "r.jsonl",
        Conditions(noise="none"),
        trials=1,
    )
    assert (records[0].syntax, records[0].success) == (True, False)


def test_an_outage_adds_no_record(tmp_path: Path) -> None:
    file = tmp_path / "r.jsonl"
    with Loopback(Fails(401)) as server, pytest.raises(Unavailable, match="key was refused"):
        repeatability([NAME], ["openai:gpt-x"], file, settings(server), trials=5)
    assert read_records(file) == []


def test_unknown_scenarios_and_configurations_are_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="full"):
        modules_left_out("no soul")
    with pytest.raises(InputError, match=NAME):
        repeatability(["nowhere"], ["symbolic"], tmp_path / "r.jsonl", Conditions(), trials=1)
