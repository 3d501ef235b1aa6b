"""The page of a study of planners: the paper's figures, ours beside them, and every failure."""

from dataclasses import asdict
from pathlib import Path

from palpate.studies.planners_page import write_page
from palpate.studies.trials import MeasuredValue, Outcome, PlannerTrial, TrialRecord
from palpate.studies.workers import Lines

MODEL = "openai:<model>"


def record(
    scenario: str, configuration: str, outcome: Outcome, number: int = 0, prompt: str = "full"
) -> TrialRecord:
    values = {
        "bottle.mass": MeasuredValue(
            (0.2551 + 0.001 * number,), (0.0008,), (0.254,), "kg", "identified"
        )
    }
    success = outcome in ("acquired", "refused rightly")
    reason = "" if success else "bottle.mass is off by <7> of its standard deviations"
    trial = PlannerTrial(scenario, MODEL, configuration, number, prompt)
    return TrialRecord(trial, True, success, success, reason, {}, outcome, values, 12, 31.0)


def written(folder: Path, *records: TrialRecord) -> str:
    results = folder / "r.jsonl"
    Lines(results).add(*map(asdict, records))
    page = write_page(results)
    assert page == folder / "r.html"
    return page.read_text()


def test_the_papers_tables_are_shown_next_to_ours(tmp_path: Path) -> None:
    html = written(
        tmp_path,
        *(record("bottle_and_table", "full", "acquired", number) for number in range(3)),
        record("bottle_and_table", "no output", "failed"),
        record("water_temperature", "full", "refused rightly"),
        record("bottle_and_table", "full", "acquired", 0, "lean"),
        record("one_missing_mass", "full", "acquired"),
    )
    for title in ("Success by scenario", "Ablation of the prompt", "Repeatability"):
        assert title in html
    assert "0.257 ± 0.022 kg" in html
    assert "0.2561 ± 0.001 kg" in html
    assert "GPT-4 (paper)" in html
    assert "everything (paper)" in html
    assert "lean prompt" in html
    assert "off by &lt;7&gt;" in html
    assert "<model>" not in html


def test_nothing_was_left_out_and_nothing_failed(tmp_path: Path) -> None:
    html = written(tmp_path, record("water_temperature", "full", "refused rightly"))
    assert "each part of the prompt" not in html
    assert "What was no success" not in html


def test_no_page_is_written_without_trials(tmp_path: Path) -> None:
    assert write_page(tmp_path / "r.jsonl") is None
    assert not (tmp_path / "r.html").exists()
