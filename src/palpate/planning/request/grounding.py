"""What a sentence asks for: from the words of a request to the parameters of a scene.

Deterministic and shallow on purpose: it pairs quantities with the objects they are said of, and
where it cannot, it says what it understood instead of guessing. Every word is either understood,
or known to say nothing of what is asked (`words/en.yaml`), or it is named in a refusal.

First the words: those of other languages become English ones where they stand (`languages`),
misspelt ones those that they come near (`spelling`), turns of phrase marks (`lexicon`). Then what
they stand for (`mentions`), and which of several things stands where it is said to (`whereabouts`):
"the box beside the red one". Then the grammar, from the outside in:

    request   = clause { turn clause }
    turn      = "." | ";" | "?" | "we know" | "is known" | "except" | "do not measure" | "but" | …
    clause    = { group | filler }           wanted, or, after "we know" and "except", not wanted
    group     = mention { list mention }     of quantities or of objects, never of both
    list      = "," | "and" | "or" | "plus", with articles beside it
    mention   = quantity | unmeasurable property | object | unknown object | pronoun | "everything"
    object    = { colour | shape | word of its name } noun

An object that fits several bodies is ambiguous, unless it is a plural ("the bottles") or stands
after "all", "both", "every".

A clause ends where a turn of phrase says that something else begins. "We know the height but not
the mass": what is known is taken out, and the "not" turns back to what is wanted. "All but the
bottle", "do not touch the box": taken out.

Which objects a group of quantities is said of, the first that applies:

1. those after it: a linking word stands between ("the mass *of* the bottle and the mug", "how
   heavy *is* the box"), or nothing but articles ("weigh the mug"), unless an object stands right
   before ("bottle mass");
2. those spoken of last that can have the quantity: "the bottle's mass and friction", "bottle
   mass", "the bottle is new, I need its mass". A pronoun names nothing, so it means the same;
3. none were spoken of: all that miss the quantity, or, where none does, all that can have it.

Two lists that only look like one are divided. A compound name belongs to the quantity after it:
in "the mass of the bottle and mug friction" the mug is the friction's. A quantity right after its
object is that object's: in "what does the cup weigh and how high is the table" the weight is the
cup's.

What is compared is asked of all that it is compared of: "is the mug heavier than the bottle" is two
masses, "which box is the lightest" one of every box.

Without any quantity, a deed that is to be simulated asks for what it depends on ("simulate throwing
it": mass, centre of mass, inertia). Other objects, where something is said to be missing, mean all
that the scene misses of them, "everything" and a goal ("build a simulation") all that it misses;
either reading is remarked on. A deed that is asked for is no measurement, and refused. "Where" asks for a
position only where it opens a question, and not in "tell me where its balance point is".
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from palpate.errors import InputError, PlanRejected
from palpate.parameter import Parameter
from palpate.planning.planner import MAX_REQUEST
from palpate.planning.request.clauses import clauses
from palpate.planning.request.item import Item
from palpate.planning.request.languages import in_english
from palpate.planning.request.mentions import Words
from palpate.planning.request.reading import Reading
from palpate.planning.request.resolver import Resolver
from palpate.planning.request.standing import understood
from palpate.planning.request.tokens import tokens
from palpate.planning.request.whereabouts import located
from palpate.planning.request.wording import english
from palpate.scene.scene import Scene


@dataclass(frozen=True, slots=True)
class Grounded:
    """What a request asks for.

    Attributes:
        asked: the parameters it names, whether or not the scene states them.
        cannot: one sentence for each thing asked that no plan can measure.
        remarks: how something unsaid was read.
    """

    asked: tuple[Parameter, ...]
    cannot: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()


def ground(request: str, scene: Scene) -> Grounded:
    """What `request` asks for in `scene`.

    Raises:
        InputError: empty or too long, or it names an object that the scene does not have (the
            message lists those it has). PlanRejected: ambiguous, or nothing in it is understood;
            the message says what to say instead.
    """
    if not request.strip():
        raise InputError("the request is empty; say what is unknown, e.g. 'the mass of the bottle'")
    if len(request) > MAX_REQUEST:
        raise InputError(
            f"the request has {len(request)} characters; say it in at most {MAX_REQUEST}"
        )
    words = Words(scene)
    said = tokens(in_english(words.nouns.apart(request), words.nouns.names))
    slips = words.slips(said)
    found = located(words.items([slips.get(word, word) for word in said]), scene)
    remarks = [f"'{word}' is read as '{meant}'." for word, meant in slips.items()]
    remarks += [item.remark for item in found if item.remark]
    items, unread = understood(found)
    reading = Reading(Resolver(scene))
    for clause in clauses(items):
        reading.read(clause)
    if not reading.pairs:
        unread += [item.text for item in found if item.kind == "aside"]
    return _answer(request, reading, remarks, unread)


def _answer(
    request: str, reading: Reading, remarks: Sequence[str], unread: Sequence[str]
) -> Grounded:
    """The parameters of what was understood, less what was excluded."""
    resolver = reading.resolver
    excluded: set[Parameter] = set()
    for quantity, objects in reading.excluded:
        excluded.update(resolver.exclusions(quantity, objects))
    read = list(remarks)
    asked: list[Parameter] = []
    for quantity, objects in reading.pairs or reading.aims():
        asked += resolver.parameters(quantity, objects)
    if not (reading.pairs or asked or resolver.cannot):
        asked, remark = _unsaid(request, reading, unread)
        read += [remark] if remark else []
    elif any(item.kind == "everything" for item in reading.alone) and reading.pairs:
        found, remark = resolver.everything()
        asked += found
        read.append(remark)
    unknown = [item.text for item in reading.set_aside() if _is_unknown(item)]
    if unread or unknown:
        resolver.not_understood([*unread, *unknown])
    for deed in reading.undone():
        resolver.cannot.append(resolver.no_deed(deed))
    if not (asked or resolver.cannot or read):
        resolver.reject(request)
    return Grounded(
        asked=tuple(_less(resolver.ordered(asked), excluded)),
        cannot=tuple(dict.fromkeys(resolver.cannot)),
        remarks=tuple(dict.fromkeys(read)),
    )


def _unsaid(request: str, reading: Reading, unread: Sequence[str]) -> tuple[list[Parameter], str]:
    """What a request without a quantity means, and how it was read.

    Raises:
        InputError: it names only objects that the scene does not have. PlanRejected: it wishes for
            no measurement.
    """
    resolver = reading.resolver
    if reading.commands:
        raise PlanRejected(resolver.no_deed(reading.commands[0]))
    quantities = {item.names[0] for item, _ in reading.excluded if item is not None}
    if unread:
        resolver.not_understood(unread)
    named = reading.fragment and bool(reading.alone)
    # "The red box has 200 g, what about the blue one?", but not "the mug weighs 300 g".
    others = bool(quantities) and bool(reading.alone)
    wished = reading.wished or named or others
    found, remark = resolver.without_quantity(reading.alone, wished, reading.at_large)
    if quantities and found and not reading.wished:
        # What is said of the boxes is said of all.
        found = [parameter for parameter in found if parameter.quantity in quantities]
    if not (found or remark or resolver.cannot):
        unknown = [item.text for item in reading.alone if _is_unknown(item)]
        if unknown:
            resolver.not_understood(unknown)
        resolver.reject(request)
    return found, remark


def _is_unknown(item: Item) -> bool:
    """Whether nobody knows the word: neither a thing nor a property."""
    if item.kind == "unmeasurable":
        return item.text == item.names[0] and item.text not in english().states
    return item.kind == "unknown"


def _less(parameters: Sequence[Parameter], excluded: set[Parameter]) -> list[Parameter]:
    return [parameter for parameter in parameters if parameter not in excluded]
