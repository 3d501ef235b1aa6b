"""The documentation: every page is in the site's contents, and what a page links to is there."""

import re
import runpy
from pathlib import Path

import pytest
import yaml

from palpate.estimation.quantities.catalogue import PURPOSES, catalogue
from palpate.planning.check.check import RULES
from palpate.primitives.registry import vocabulary

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
def test_what_a_page_links_to_is_there(page: Path) -> None:
    for target in LINK.findall(page.read_text(encoding="utf-8")):
        if "://" in target or target in {*GENERATED, SCHEMA}:
            continue
        assert (page.parent / target).exists(), target


def test_the_vocabulary_page_has_every_primitive_quantity_purpose_and_rule() -> None:
    text = runpy.run_path(str(DOCS / "vocabulary_page.py"))["page"](vocabulary())
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
