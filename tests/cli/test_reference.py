from pathlib import Path

from palpate.cli.reference import page
from palpate.primitives.registry import vocabulary

DOCS = Path(__file__).parents[2] / "docs"


def test_the_page_in_the_docs_is_what_the_declarations_say() -> None:
    assert (DOCS / "vocabulary.md").read_text(encoding="utf-8") == page(vocabulary()), (
        "run `make docs`"
    )
