"""The words that a request may use, as lists: what they are, not what is made of them."""

from __future__ import annotations

from collections.abc import Mapping


def word_set(text: str) -> frozenset[str]:
    """The words of `text`."""
    return frozenset(text.split())


def by_word(labelled: Mapping[str, str]) -> dict[str, str]:
    """Each word to the label that it stands under."""
    labels: dict[str, str] = {}
    for label, words in labelled.items():
        labels.update(dict.fromkeys(words.split(), label))
    return labels


_NOT_FELT = {
    "temperature": "temperature hot warm cold",
    "volume": "volume capacity",
    "density": "density",
    "hardness": "hardness hard",
    "elasticity": "elasticity elastic",
    "restitution": "restitution bounciness bouncy",
    "damping": "damping",
    "viscosity": "viscosity viscous",
    "fill level": "full empty",
    "colour": "colour color",
    "texture": "texture",
    "roughness": "roughness rough",
    "material": "material",
    "pressure": "pressure",
    "humidity": "humidity moisture wet",
    "charge": "charge",
    "conductivity": "conductivity",
    "price": "price cost expensive",
    "age": "age old",
    "smell": "smell taste",
    "strength": "strength strong",
    "transparency": "transparency transparent",
    "sharpness": "sharp sharpness",
}
UNMEASURABLE = by_word(_NOT_FELT)
"""Properties that no touch measures, by the words of requests."""

ADJECTIVES = word_set(
    "heavy high tall slippery hot warm cold stiff soft hard elastic bouncy viscous full empty rough "
    "wide long thick big large wet expensive old strong transparent sharp tilted "
    "inclined slanted horizontal level sloping uneven"
)
"""Words that ask for a quantity only after "how"."""

COLOURS = word_set(
    "red green blue yellow orange purple violet pink brown black white grey gray cyan magenta "
    "turquoise teal beige golden gold silver light dark"
)

NO_NOUNS = word_set("place where level weigh lean")
"""Synonyms of quantities that sentences use for other things, too; `words/grammar.txt` has them."""

# Nouns that fit any object, any surface, the hand itself.

OBJECT_NOUNS = word_set("object thing item body")
SURFACE_NOUNS = word_set("surface")
GRIPPER_NOUNS = word_set("gripper hand arm robot")

MASSES = (
    r"kg|kilos?|kilograms?|kilogrammes?|g|grams?|grammes?|mg|milligrams?|lbs?|pounds?|oz|ounces?"
)
UNITS = (
    r"mm|cm|m|km|millimet(?:re|er)s?|"
    r"centimet(?:re|er)s?|met(?:re|er)s?|inch(?:es)?|n|newtons?|n/m|n/mm|kn/m|%|percent|degrees?"
)

_NUMBER = r"\b\d+(?:[.,]\d+)? *"
_WORD = r"\b(?:(?:half )?an?|one|two|three|five|ten) "
AMOUNTS = (
    (_NUMBER + rf"(?:{MASSES})(?!\w)", "§mass"),
    (_NUMBER + rf"(?:{UNITS})(?!\w)", "§amount"),
    (_WORD + rf"(?=\w{{4}})(?:{MASSES})(?!\w)", "§mass"),
    (_WORD + rf"(?=\w{{4}})(?:{UNITS})(?!\w)", "§amount"),
)
"""Words of an amount with its unit."""
