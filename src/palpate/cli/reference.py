"""The vocabulary as a page of the documentation: `python -m palpate.reference >
docs/vocabulary.md`."""

from __future__ import annotations

from collections.abc import Iterator

from palpate.planning.check.check import RULES
from palpate.quantities.catalogue import catalogue
from palpate.vocabulary.base import Primitive
from palpate.vocabulary.registry import Vocabulary, acquisition, vocabulary

HEAD = """# The vocabulary

Generated from the declarations by `make docs`. A plan is made of these primitives and composites, and of nothing else.
"""


def page(words: Vocabulary) -> str:
    """The page's Markdown."""
    parts = [HEAD, "## Primitives\n"]
    parts += ["\n".join(_primitive(name, cls)) for name, cls in words.primitives.items()]
    parts.append("## Composites\n")
    parts += [f"### {c.name} `{c.symbol}`\n\n{c.summary}\n" for c in words.composites.values()]
    parts.append("## Quantities\n\n| id | unit | what | how it is acquired |\n|---|---|---|---|")
    parts.append(
        "\n".join(
            f"| `{q.id}` | {q.unit} | {q.label} | {acquisition(q)} |" for q in catalogue().values()
        )
        + "\n"
    )
    parts.append("## Rules of the check\n\n| rule | what it finds |\n|---|---|")
    parts.append("\n".join(f"| `{rule}` | {text} |" for rule, text in RULES.items()))
    return "\n".join(parts) + "\n"


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
