from pathlib import Path

from palpate.reference import page
from palpate.vocabulary.primitive import vocabulary

DOCS = Path(__file__).parents[1] / "docs"


def test_the_page_in_the_docs_is_what_the_declarations_say() -> None:
    assert (DOCS / "vocabulary.md").read_text(encoding="utf-8") == page(vocabulary()), "run `make docs`"
