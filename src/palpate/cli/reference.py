"""The vocabulary as a page of the documentation, written by `make docs`."""

from __future__ import annotations

from collections.abc import Iterator

from palpate.estimation.quantities.catalogue import PURPOSES, catalogue
from palpate.planning.check.check import RULES
from palpate.primitives.base import Primitive
from palpate.primitives.registry import Vocabulary, acquisition, vocabulary

HEAD = """# The vocabulary

Generated from the declarations by `make docs`. A plan is made of these primitives and composites, and of nothing else.
"""


def page(words: Vocabulary) -> str:
    """Write the page's Markdown."""
    return "\n".join(_parts(words)) + "\n"


def _parts(words: Vocabulary) -> Iterator[str]:
    yield HEAD
    yield "## Primitives\n"
    for name, primitive in words.primitives.items():
        yield from _primitive(name, primitive)
    yield "## Composites\n"
    for composite in words.composites.values():
        yield f"### {composite.name} `{composite.symbol}`\n\n{composite.summary}\n"
    yield "## Quantities\n"
    yield "| id | unit | what | how it is acquired |\n|---|---|---|---|"
    for quantity in catalogue().values():
        how = acquisition(quantity)
        yield f"| `{quantity.id}` | {quantity.unit} | {quantity.label} | {how} |"
    yield "\n## Purposes\n"
    yield "Quantities that a simulation needs, by its purpose. Requests and prompts are read with this table.\n"
    yield "| to | needs | because of |\n|---|---|---|"
    for purpose in PURPOSES:
        needed = ", ".join(f"`{id}`" for id in purpose.quantities)
        yield f"| {', '.join(purpose.verbs)} | {needed} | {purpose.reason} |"
    yield "\n## Rules of the check\n"
    yield "| rule | what it finds |\n|---|---|"
    for rule, text in RULES.items():
        yield f"| `{rule}` | {text} |"


def _primitive(name: str, cls: type[Primitive]) -> Iterator[str]:
    yield f"### {name}\n"
    yield f"{cls.summary()}\n"
    for field, info in cls.model_fields.items():
        yield f"- `{field}`: {info.description}"
    if cls.claims:
        yield f"- claims the {' and the '.join(sorted(cls.claims))}"
    if cls.reads:
        yield f"- reads `{cls.reads}`"
    if cls.writes:
        yield f"- writes `{cls.writes}`"
    if cls.measures:
        yield f"- yields {cls.measures.label} in {cls.measures.unit}"
    yield ""


if __name__ == "__main__":
    print(page(vocabulary()), end="")
