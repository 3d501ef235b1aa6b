"""The documentation: every page is in the site's contents, and what a page links to is there."""

import re
import runpy
from pathlib import Path

import pytest
import yaml
from typer.testing import CliRunner

from palpate.cli.app import app
from palpate.estimation.quantities.catalogue import PURPOSES, catalogue
from palpate.planning.check.check import RULES
from palpate.primitives.registry import vocabulary
from palpate.robots.robot_config import read_config
from palpate.robots.simulated.noise.models import noise_models
from palpate.scene.poses import parse_poses

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
GENERATED = {"commands.md", "vocabulary.md", "keys.md", "results.md"}
"""Pages that `docs/hooks.py` adds when the site is built."""
SCHEMA = "poses.schema.json"
LINK = re.compile(r"\]\(([^)#\s]+)(?:#[^)]*)?\)")
NUMBER = re.compile(r"\d+\.\d+")
PAGES = sorted([*DOCS.glob("*.md"), ROOT / "README.md", ROOT / "CONTRIBUTING.md"])


def contents(entry: object) -> list[str]:
    """The pages of the site's navigation."""
    if isinstance(entry, str):
        return [entry]
    inner = entry.values() if isinstance(entry, dict) else entry
    return [page for one in inner for page in contents(one)]


def test_every_page_is_in_the_contents_once() -> None:
    settings = yaml.safe_load((ROOT / "mkdocs.yml").read_text(encoding="utf-8"))
    listed = contents(settings["nav"])
    pages = {page.name for page in DOCS.glob("*.md")} | GENERATED
    assert sorted(listed) == sorted(pages)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_of_a_page_have_targets(page: Path) -> None:
    for target in LINK.findall(page.read_text(encoding="utf-8")):
        if "://" in target or target in {*GENERATED, SCHEMA}:
            continue
        assert (page.parent / target).exists(), target


def test_the_vocabulary_page_has_every_primitive_quantity_purpose_and_rule() -> None:
    text = runpy.run_path(str(DOCS / "vocabulary_page.py"))["page"](vocabulary())
    assert r"NAME (± [factor \*] OFFSET)\*" in text, "asterisks outside code are no emphasis"
    names = {*vocabulary().primitives, *vocabulary().composites}
    assert names <= set(re.findall(r"^### (\w+)", text, re.MULTILINE))
    assert {*catalogue(), *RULES} <= set(re.findall(r"^\| `([\w-]+)`", text, re.MULTILINE))
    assert all(f"| {', '.join(purpose.verbs)} |" in text for purpose in PURPOSES)


def test_the_page_of_keys_has_a_meaning_for_each() -> None:
    text = runpy.run_path(str(DOCS / "keys_page.py"))["page"]()
    rows = re.findall(r"^\| \**`([\w.]+)`\** \| (.*) \|$", text, re.MULTILINE)
    keys = {key for key, _ in rows}
    assert {"torque_gain.covariance", "hand.pads.half", "torque.ripple.resonance.damping"} <= keys
    assert [key for key, meaning in rows if not meaning] == []


def blocks(page: str, language: str) -> list[str]:
    """The code blocks of a page in a language."""
    text = (DOCS / page).read_text(encoding="utf-8")
    return re.findall(rf"^```{language}\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)


def test_the_plan_of_the_page_passes_the_check(tmp_path: Path) -> None:
    plan = tmp_path / "plan.json"
    plan.write_text(blocks("plan.md", "json")[0], encoding="utf-8")
    scene = str(ROOT / "examples" / "desk.xml")
    done = CliRunner().invoke(app, ["check", str(plan), "--scene", scene])
    assert done.exit_code == 0, done.output


@pytest.mark.parametrize("page", ["calibration.md", "franka.md"])
def test_the_robot_yaml_of_a_page_is_read(tmp_path: Path, page: str) -> None:
    (text,) = [block for block in blocks(page, "yaml") if block.startswith("palpate_robot")]
    file = tmp_path / "robot.yaml"
    file.write_text(text, encoding="utf-8")
    assert read_config(file).gravity is not None


def test_the_noise_model_of_the_page_is_read(tmp_path: Path) -> None:
    file = tmp_path / "worn.yaml"
    file.write_text(blocks("noise.md", "yaml")[0], encoding="utf-8")
    assert noise_models().load(str(file)).name == "worn pads"


def test_the_poses_of_the_page_are_read() -> None:
    covariance = str([[1e-6 * (row == column) for column in range(6)] for row in range(6)])
    text = blocks("poses.md", "yaml")[0].replace("[[…], …]", covariance)
    assert set(parse_poses(text, "poses.md").objects) == {"bottle", "box", "tin"}


def test_the_readmes_three_lines_print_what_it_says(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    program = text.partition("```python\n")[2].partition("```")[0]
    monkeypatch.chdir(ROOT)
    exec(program, {})
    printed, said = capsys.readouterr().out, program.partition("# ")[2]
    assert NUMBER.sub("", printed) == NUMBER.sub("", said)
    found, shown = (float(NUMBER.findall(text)[0]) for text in (printed, said))
    assert found == pytest.approx(shown, abs=float(NUMBER.findall(said)[1]))
