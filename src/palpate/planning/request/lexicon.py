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
"""Properties people ask for that no touch of this arm can tell, by the words they use."""

ADJECTIVES = word_set(
    "heavy high tall slippery hot warm cold stiff soft hard elastic bouncy viscous full empty rough "
    "wide long thick big large wet expensive old strong transparent sharp"
)
"""Words that ask for a quantity only after "how"."""

COLOURS = word_set(
    "red green blue yellow orange purple violet pink brown black white grey gray cyan magenta "
    "turquoise teal beige golden gold silver light dark"
)

# Small words that say which, how many and whose.

DETERMINERS = word_set("the a an this that these those my our your his her their its some any")
EVERY = word_set("all both each every two three four five six")

PASSIVE = word_set("is are was were be been being get gets")
"""Words before a deed that is done to what stands before them."""

# Nouns that fit any object, any surface, the hand itself.

OBJECT_NOUNS = word_set("object thing item body")
SURFACE_NOUNS = word_set("surface")
GRIPPER_NOUNS = word_set("gripper hand arm robot")

# What stands for something said elsewhere.

POSSESSIVES = word_set("its their his her")
PRONOUNS = word_set("it them they") | POSSESSIVES
EVERYTHING = word_set("everything anything whatever")

# What ties words together, and what keeps them apart.

LIST = frozenset((",", "and", "or", "plus"))
"""What stands between the parts of a list."""
LINKS = word_set("of for between is are was were does do did has have")
"""Words that tie a quantity to the object after it."""
WEAK = word_set("place where level grip location")
"""Synonyms that are quantities only before "of", or, for "where", with nothing stronger in the
clause."""
TURNS = word_set("need want measure determine find estimate tell but")
"""Words that end a remark about what is known already."""
BEFORE_WHERE = word_set("me out determine measure and , find see")
"""Words after which "where" asks for a position."""

STOP = word_set(
    "of for is are was were be been do does did what whats which how much many and or but not to "
    "in on at with about we i you he she they me us please can could would should will shall may "
    "might must need want like know find out tell give get determine measure estimate identify "
    "compute figure calculate learn see check test acquire obtain just only also too then than "
    "first second next finally here there now today soon again back so as if when while because "
    "since from into onto over under by between against through during before after both either "
    "have has had there s t re ve ll d let lets make build create set up simulate our simulation "
    "simulator scene model twin digital world file description mujoco mjcf xml request value "
    "values number parameter parameters property properties coefficient coefficients constant "
    "quantity quantities data measurement measurements exactly approximately accurately "
    "really actually missing unknown everything anything whatever all each every one ones "
    "something that this these those it its their them where who whose yet already still very "
    "same new however whether together respectively regarding "
    "concerning physical real true correct right sure thanks thank hello hi help no"
)
"""Words that are never the name of an object that is not there."""

UNITS = (
    r"kg|kilos?|kilograms?|g|grams?|mg|milligrams?|lbs?|pounds?|oz|ounces?|mm|cm|m|km|millimet(?:re|er)s?|"
    r"centimet(?:re|er)s?|met(?:re|er)s?|inch(?:es)?|n|newtons?|n/m|n/mm|kn/m|%|percent|degrees?"
)

# Each pattern is replaced in the order given, before the words are told apart.

MARKS: tuple[tuple[str, str], ...] = (
    (r"[&+]", " and "),
    (
        r"\bhow many (?:kilos|kilograms|grams|pounds|ounces) (?:is|are|has|have)\b",
        " how heavy is ",
    ),
    (r"\b(?:put|place|set) ([^,.;:?!]{1,40}?) on (?:the|your|some|a) weight\b", r" weigh \1 "),
    (
        r"\bhow much (?:is|are) ([^,.;:?!]{1,40}?) in (?:kilos|kilograms|grams|kg|g|pounds|ounces)\b",
        r" weigh \1 ",
    ),
    (r"\b(what|who|where|there|here)'s\b", r"\1 is"),
    (r"\bnothing (?:but|except|other than)\b", " only "),
    (
        r"([^,.;:?!]*?)\b(?:(?:must|should|may|shall|can|is|are) not (?:to )?be \w+|(?:is|are) (?:off limits|taboo)|"
        r"(?:has|have) to stay(?: put| there| where (?:it|they) (?:is|are))?|stays? (?:put|there|where (?:it|they) "
        r"(?:is|are)))",
        r" §neg \1 §want ",
    ),
    (
        r"\b(?:do|does|did|can|could) (?:you|anyone|anybody|somebody|someone|the robot) know\b|"
        r"\b(?:must|should|shall) (?:i|we|one) (?:get to )?know\b|"
        r"\b(?:so|that|until|when) (?:i|we) (?:can )?know\b",
        " §want ",
    ),
    (r"\b(?:have|got|has) ([^,.;:?!]{1,40}?) already\b", r" §know \1 §want "),
    (
        r"\b(?:have|has|had) already been (?:weigh|measured?|determined?|tested|probed)\b",
        " §was_known ",
    ),
    (r"\b(?:have|has|had) already (?:weigh|measured?|determined?|tested|probed)\b", " §know "),
    (
        r"\bleav(?:e|ing) ((?:\w+ ){1,6}?)(?:alone|in peace|be|out|where it is|as it is)\b",
        r" §neg \1 §want ",
    ),
    (
        r"\b(?:keep (?:your|the) (?:hands?|fingers?|gripper) off|hands off|(?:stay|keep) away from|avoid|spare|"
        r"do not disturb)\b",
        " §neg ",
    ),
    (
        r"\bwhere (?:[\w' ]{0,30}?)\b(?:does|do|will|would|can|could) (.+?) balances?\b",
        r" where is the balance point of \1 ",
    ),
    (
        r"\bpoint (?:where|(?:at|on|in) which) ((?:the|my|our|this|that) [\w ]+?) balances?\b",
        r" balance point of \1 ",
    ),
    (r"\b(\d+(?:[.,]\d+)?) *(?:" + UNITS + r")(?!\w)", " §amount "),
    (
        r"\b(?:half )?(?:a|an) (?:kilo|kilogram|gram|pound|ounce|newton|met(?:re|er)|inch)\b",
        " §amount ",
    ),
    (r"\b(?:do|does|did) not (?:need|want|wish)(?: to)?(?: know| measure)?", " §neg "),
    (
        r"\b(?:with no|without) know\w*|\bnot (?:yet )?kn(?:ow\w*|ew)|\b(?:can|could)\s?not\b",
        " §want ",
    ),
    (r"\bunknowns?\b", " missing §want "),
    (r"\b(?:to|us|me) know\b|\bno idea(?: of| about)?", " §want "),
    (r"\b(?:is|are|was|were) (?:already |well )?(?:known|given)\b", " §was_known "),
    (r"\b(?:already |well )?kn(?:ow|ows|own|ew)\b|\balready have\b", " §know "),
    (
        r"\b(?:except(?:ing)?(?: for)?|(?:with|at) the exception of|"
        r"save(?: for)?(?= the)|excluding|apart from|other than|besides|never mind|leav(?:e|ing) out|"
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
"""Turns of phrase that say what is wanted, known or not wanted, with the mark that stands for
each."""
