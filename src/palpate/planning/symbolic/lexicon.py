"""The words of a request: normalised text, number, and the word lists that grounding relies on."""

from __future__ import annotations

import re


def word_set(text: str) -> frozenset[str]:
    """The words of `text`."""
    return frozenset(text.split())


UNMEASURABLE: dict[str, str] = {
    word: label
    for label, words in {
        "temperature": "temperature hot warm cold",
        "volume": "volume capacity",
        "density": "density",
        "stiffness": "stiffness stiff softness",
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
    }.items()
    for word in words.split()
}
"""Properties people ask for that no touch of this arm can tell, by the words they use."""

ADJECTIVES = word_set(
    "heavy high tall slippery hot warm cold stiff hard elastic bouncy viscous full empty rough wet expensive old "
    "strong transparent sharp"
)
"""Words that ask for a quantity only after "how"."""

COLOURS = word_set(
    "red green blue yellow orange purple violet pink brown black white grey gray cyan magenta turquoise teal beige "
    "golden gold silver light dark"
)

DETERMINERS = word_set("the a an this that these those my our your his her their its some any")
EVERY = word_set("all both each every two three four five six")
OBJECT_NOUNS = word_set("object thing item body")
SURFACE_NOUNS = frozenset(("surface",))
GRIPPER_NOUNS = word_set("gripper hand arm robot")
PRONOUNS = word_set("it its their them they his her these those this")

GOAL = re.compile(
    r"\b(simulat\w+|digital twin|twin|model\w*|scene|world|calibrat\w+|identif\w+|complete|pour\w*|push\w*|grasp\w*|"
    r"pick\w*|lift\w*|stack\w*|throw\w*|slid\w+|manipulat\w+|measur\w+|missing|unknown|parameters?|properties)\b"
)

STOP = word_set(
    "of for is are was were be been do does did what whats which how much many and or but not to in on at with about "
    "we i you he she they me us please can could would should will shall may might must need want like know find out "
    "tell give get determine measure estimate identify compute figure calculate learn see check test acquire obtain "
    "just only also too then than first second next finally here there now today soon again back so as if when while "
    "because since from into onto over under by between against through during before after both either have has had "
    "there s t re ve ll d let lets make build create set up simulate our simulation simulator scene model twin digital "
    "world file description mujoco mjcf xml request value values number parameter parameters property properties "
    "coefficient coefficients constant force quantity quantities data measurement measurements exactly approximately "
    "accurately really actually missing "
    "unknown everything anything whatever all each every one ones something that this these those it its their them "
    "where who whose yet already still very more most less least same other another new however whether together "
    "respectively regarding concerning physical real true correct right sure thanks thank hello hi help no"
)
"""Words that are never the name of an object that is not there."""

_MARKS: tuple[tuple[str, str], ...] = (
    (r"\b(?:do|does|did) not (?:need|want|wish)(?: to)?(?: know| measure)?", " §neg "),
    (
        r"\b(?:with no|without) know\w*|\bnot (?:yet )?kn(?:ow\w*|ew)|\b(?:can|could)\s?not\b",
        " §want ",
    ),
    (r"\b(?:to|us|me) know\b|\bunknown\b|\bno idea(?: of| about)?", " §want "),
    (r"\b(?:is|are|was|were) (?:already |well )?(?:known|given)\b", " §was_known "),
    (r"\b(?:already |well )?kn(?:ow|ows|own|ew)\b|\balready have\b", " §know "),
    (
        r"\b(?:except(?:ing)?(?: for)?|excluding|apart from|other than|besides|never mind|leav(?:e|ing) out|"
        r"ignor(?:e|ing)|skip(?:ping)?|without)\b",
        " §neg ",
    ),
    (
        r"\bdo not (?:measure|touch|care|weigh|move|include|check|bother|probe|test|worry|grasp|lift)"
        r"(?: about| to| with| for| out)*\b",
        " §neg ",
    ),
    (r"\bno need (?:for|of|to \w+)|(?<=everything) but\b(?! not)|(?<=\ball) but\b", " §neg "),
    (r"(?:^|[,.;]|\band|\bbut) *no (?!idea|one)", " §neg "),
    (
        r"(?:\bbut|\band|,|^|\.) *(?:also )?not\b(?! only)|\bnot (?=(?:the|a|an|of|its|their|for)\b)",
        " §neg ",
    ),
)


def tokens(request: str) -> list[str]:
    """Lower-case words, `'s`, punctuation that separates, and the marks §want §know §was_known
    §neg.

    Names written as identifiers (`light_blue_box`, `bottle.mass`) come apart into their words.
    """
    text = request.lower().replace("’", "'").replace("§", " ")
    text = re.sub(r"n't\b", " not", text)
    text = re.sub(r"[_\-/]+", " ", re.sub(r"\s+", " ", text))
    for pattern, mark in _MARKS:
        text = re.sub(pattern, mark, text)
    text = re.sub(r"\.(?=\S)", " ", text)
    return re.findall(r"§\w+|'s\b|\w+|[,;:.?!]", text)


def name_words(name: str) -> tuple[str, ...]:
    """The words of a body's name: `light_blue_box`, `LightBlueBox`, `light-blue box` are the same
    three."""
    return tuple(re.findall(r"[^\W_]+", re.sub(r"(?<=[a-z0-9])(?=[A-Z])", " ", name).lower()))


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
