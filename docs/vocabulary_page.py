"""The page of the vocabulary, which `docs/hooks.py` adds to the site."""

from __future__ import annotations

from collections.abc import Iterator

from palpate.estimation.quantities.catalogue import PURPOSES, catalogue
from palpate.planning.check.check import RULES
from palpate.primitives.base import Primitive
from palpate.primitives.registry import Vocabulary, acquisition

HEAD = """# The vocabulary

Look up here the parts of a plan, the quantities and the rules of the check. This page is generated from the code.
`palpate vocabulary` prints the primitives and composites on the terminal.
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


def _escape(text: str) -> str:
    """Escape asterisks outside code, which Markdown reads as emphasis."""
    parts = text.split("`")
    return "`".join(part if n % 2 else part.replace("*", "\\*") for n, part in enumerate(parts))


def _primitive(name: str, cls: type[Primitive]) -> Iterator[str]:
    yield f"### {name}\n"
    yield f"{cls.summary()}\n"
    for field, info in cls.model_fields.items():
        yield f"- `{field}`: {_escape(info.description or '')}"
    if cls.claims:
        yield f"- claims the {' and the '.join(sorted(cls.claims))}"
    if cls.reads:
        yield f"- reads `{cls.reads}`"
    if cls.writes:
        yield f"- writes `{cls.writes}`"
    if cls.measures:
        yield f"- yields {cls.measures.label} in {cls.measures.unit}"
    yield ""
