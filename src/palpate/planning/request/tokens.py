"""From text to words: a request in tokens, a name in words, a plural in singulars."""

from __future__ import annotations

import re

from palpate.planning.request.lexicon import MARKS


def tokens(request: str) -> list[str]:
    """Words, `'s`, punctuation that separates, and the marks §want §know §was_known §neg §amount, of
    a request in lower case.

    Names written as identifiers (`light_blue_box`, `bottle.mass`) come apart into their words.
    """
    text = re.sub(r"n't\b", " not", request)
    text = re.sub(r"[_\-]+", " ", re.sub(r"\s+", " ", text))
    for pattern, mark in MARKS:
        text = re.sub(pattern, mark, text)
    text = re.sub(r"\.(?=\S)|/", " ", text)
    return re.findall(r"§\w+|'s\b|\w+|[,;:.?!]", text)


def name_words(name: str) -> tuple[str, ...]:
    """The words of a body's name: `light_blue_box`, `LightBlueBox`, `light-blue box` are the same
    three."""
    return tuple(re.findall(r"[^\W_]+", re.sub(r"(?<=[a-z0-9])(?=[A-Z])", " ", name).lower()))


_FURTHER = re.compile(r"(?:body|base|top|link|obj|object|geom|mesh|part|main|root|\d)+")
"""What authors of models put behind a noun without saying more by it."""
_BEFORE = re.compile(r"(?=.*[aeiouy])\w{3,}")
"""What may make another noun of the one behind it: `work` of `bench`, but not `sp` of `ring`."""


def is_within(word: str, name: str) -> bool:
    """Whether a noun of at least three letters is the noun of a compound name: a `workbench` is a
    bench, a `hammerbody` a hammer."""
    if len(word) < 3 or word == name:
        return False
    if name.startswith(word) and _FURTHER.fullmatch(name.removeprefix(word)):
        return True
    return name.endswith(word) and bool(_BEFORE.fullmatch(name.removesuffix(word)))


def singulars(word: str) -> tuple[str, ...]:
    """What `word` may be the plural or the gerund of, itself first."""
    forms = [word]
    if word.endswith("ies"):
        forms.append(word[:-3] + "y")
    if word.endswith("ves"):
        forms += [word[:-3] + "f", word[:-3] + "fe"]
    if word.endswith("es"):
        forms.append(word[:-2])
    if word.endswith("s") and not word.endswith("ss"):
        forms.append(word[:-1])
    if word.endswith("ing"):
        forms.append(word[:-3])
    return tuple(forms)
