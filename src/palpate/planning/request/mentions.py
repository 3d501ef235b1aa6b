"""What the words of a request stand for: quantities, objects, deeds, and what marks their roles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from palpate.planning.request import lexicon, spelling
from palpate.planning.request.item import EDGE, Item
from palpate.planning.request.lexicon import COLOURS, DETERMINERS, EVERY, STOP, word_set
from palpate.planning.request.nouns import Nouns
from palpate.planning.request.tokens import singulars
from palpate.planning.request.wording import english, longest
from palpate.quantities.catalogue import catalogue
from palpate.scene.scene import Scene

LONGEST_PHRASE = 7
"""Words of the longest synonym of a quantity: "centre of mass in all three axes"."""


class Words:
    """The words that name things in one scene.

    Attributes:
        nouns: of its bodies.
    """

    def __init__(self, scene: Scene) -> None:
        self.nouns = Nouns(scene)
        several = [own for own in self.nouns.named if len(own) > 1]
        self._long_names = sorted(several, key=len, reverse=True)
        self._phrases = _phrases()
        self._relations = longest(english().relations)

    def slips(self, tokens: Sequence[str]) -> dict[str, str]:
        """What those tokens that mean nothing are a slip of."""
        known = self.nouns.names | {word for phrase in self._phrases for word in phrase}
        known = {word for word in known - lexicon.WEAK if len(word) >= spelling.SHORTEST}
        found: dict[str, str] = {}
        for token in tokens:
            if known.isdisjoint(singulars(token)) and not self._means_something(token):
                meant = spelling.meant(token, known)
                if meant is not None:
                    found[token] = meant
        return found

    def _means_something(self, token: str) -> bool:
        if token in _SMALL or not token.isalpha() or self.nouns.known(token):
            return True
        forms = {*singulars(token), *_infinitives(token)}
        return not _READ.isdisjoint(forms)

    def items(self, tokens: Sequence[str]) -> list[Item]:
        """The request as items, in order."""
        found: list[Item] = []
        at = 0
        while at < len(tokens):
            item = self._item(tokens, at, found)
            found.append(_again(item, found, (*tokens, "", "")[at + 1]))
            at += len(item.words)
        return _joined(_compared(found))

    def _item(self, tokens: Sequence[str], at: int, before: Sequence[Item]) -> Item:
        word = tokens[at]
        if word == "§amount":
            return Item("amount", (word,))
        if word.startswith("§"):
            return Item("mark", (word,))
        if word in ".;:?!":
            return Item("break", (word,))
        if word in lexicon.LIST:
            return Item("list", (word,))
        return (
            self._whole_name(tokens, at)
            or self._relation(tokens, at)
            or self._comparison(word)
            or self._quantity(tokens, at)
            or self._unmeasurable(tokens, at)
            or self._mention(tokens, at, before)
            or self._plain(tokens, at, before)
        )

    def _whole_name(self, tokens: Sequence[str], at: int) -> Item | None:
        """A body's name of several words, the longest first, together or apart: "redbox", "red
        box"; or one of a single word that was said in two, "note book".

        A name of one word is a noun like others, for its article tells it from a look-alike: "the
        can", "can you".
        """
        for own in self._long_names:
            names = (self.nouns.named[own][0],)
            joined = "".join(own)
            if tokens[at] == joined and joined not in STOP:
                return Item("object", (joined,), names, fitting=names)
            if tuple(tokens[at : at + len(own)]) == own:
                return Item("object", own, names, fitting=names)
        two = tuple(tokens[at : at + 2])
        called = self.nouns.named.get(("".join(two),), ()) if len(two) == 2 else ()
        return Item("object", two, (called[0],), fitting=(called[0],)) if called else None

    def _relation(self, tokens: Sequence[str], at: int) -> Item | None:
        """How one thing stands to another: "on top of", "beside"."""
        for length in range(min(self._relations, len(tokens) - at), 0, -1):
            phrase = tuple(tokens[at : at + length])
            if phrase in english().relations:
                return Item("stop", phrase, (english().relations[phrase],))
        return None

    def _comparison(self, word: str) -> Item | None:
        """A word that compares: "heavier"."""
        id = english().compared.get(word)
        if id is None or id not in catalogue():
            return None
        return Item("quantity", (word,), (id,), compared=True)

    def _quantity(self, tokens: Sequence[str], at: int) -> Item | None:
        """The longest synonym of a quantity at this place, in the singular or the plural."""
        most = min(LONGEST_PHRASE, len(tokens) - at)
        for length in range(most, 0, -1):
            phrase = tuple(tokens[at : at + length])
            for last in singulars(phrase[-1]):
                id = self._quantity_called(phrase, last)
                if id and (length > 1 or _counts(last, tokens, at)):
                    return Item("quantity", phrase, (id,), plural=last != phrase[-1])
        return None

    def _quantity_called(self, phrase: tuple[str, ...], last: str) -> str | None:
        """The quantity that `phrase` is a synonym of, with its `last` or its first word in the
        singular: "balance points", "moments of inertia"."""
        first = singulars(phrase[0])[-1]
        found = self._phrases.get((*phrase[:-1], last))
        return found or self._phrases.get((first, *phrase[1:]))

    def _unmeasurable(self, tokens: Sequence[str], at: int) -> Item | None:
        """A property that nothing here can measure: "temperature", "how hot", "is it clean"."""
        word = tokens[at]
        if self.nouns.known(word):
            return None
        for form in singulars(word):
            label = lexicon.UNMEASURABLE.get(form)
            if label is not None and (form not in lexicon.ADJECTIVES or _after_how(tokens, at)):
                return Item("unmeasurable", (word,), (label,))
        if word in english().states and self._is_said_of_something(tokens, at):
            return Item("unmeasurable", (word,), (word,))
        return None

    def _is_said_of_something(self, tokens: Sequence[str], at: int) -> bool:
        """Whether an adjective is what a question is about, "is it full?", and not a part of a
        name, "the full bottle"."""
        before = tokens[:at]
        for i in range(at - 1, -1, -1):
            if tokens[i] in ".;:?!":
                before = tokens[i + 1 : at]
                break
        following = tokens[at + 1 : at + 2]
        attribute = bool(following) and self.nouns.known(following[0])
        return not attribute and not _SAYING.isdisjoint(before)

    def _mention(self, tokens: Sequence[str], at: int, before: Sequence[Item]) -> Item | None:
        """The longest run of words that together fit some body; adjectives never stand apart from
        their noun."""
        if tokens[at] in STOP and not self._is_noun(tokens, at, before):
            return None
        run = self._run(tokens[at:])
        if not run:
            return None
        several = self._is_every(before) or not self.nouns.singular(run[-1])
        collective = run[-1] in english().collective
        plural = (several or collective) and not _is_one_of(before)
        names = self.nouns.matching(run, several)
        fitting = self.nouns.fitting(run)
        remark = ""
        if names and not fitting and names[0] in self.nouns.own:
            remark = f"'{' '.join(run)}' is taken for {_quoted(names)}."
        elif plural and self.nouns.is_kind(run[-1]):
            remark = f"'{' '.join(run)}' are taken to be {_quoted(names)}."
        kind = "object" if names else "unknown"
        return Item(kind, run, names, plural, fitting or names, remark=remark)

    def _is_noun(self, tokens: Sequence[str], at: int, before: Sequence[Item]) -> bool:
        """Whether a small word names a thing: "the can", "tool and can", "which can is", but not "can
        you"."""
        told_apart = bool(before) and before[-1].kind == "selector"
        asked = at > 0 and tokens[at - 1] in ("which", "what")
        if told_apart or _is_determined(before) or (asked and (*tokens, "")[at + 1] in _SAID_OF):
            return True
        return self._owns(tokens, at) or _is_listed(before, tokens, at)

    def _is_every(self, before: Sequence[Item]) -> bool:
        """Whether the words just before say "all of them": "every tool", "every tool and can"."""
        if _is_list_of_things(before):
            first = before[-2]
            return first.plural and self.nouns.singular(first.words[-1])
        for item in reversed(before):
            if item.text in EVERY:
                return True
            if item.kind != "stop" or item.text not in DETERMINERS | {"of"}:
                return False
        return False

    def _owns(self, tokens: Sequence[str], at: int) -> bool:
        """Whether a property comes right after: "shelf height and can mass"."""
        following = (*tokens, "")[at + 1]
        return (following,) in self._phrases and following not in lexicon.ADJECTIVES

    def _run(self, tokens: Sequence[str]) -> tuple[str, ...]:
        run: tuple[str, ...] = ()
        for word in tokens:
            if not self.nouns.known(word):
                break
            longer = (*run, word)
            # "light" alone may fit nothing; what counts is whether "light blue box" does.
            if run and not COLOURS.issuperset(run) and not self.nouns.matching(longer, False):
                break
            run = longer
        return run

    def _plain(self, tokens: Sequence[str], at: int, before: Sequence[Item]) -> Item:
        """A word that names nothing by itself."""
        word, said = tokens[at], english()
        if word in lexicon.EVERYTHING or self._is_all(tokens, at):
            return Item("everything", (word,))
        if word in lexicon.PRONOUNS:
            return Item("pronoun", (word,))
        deed = next((form for form in _infinitives(word) if form in _DEEDS), None)
        if word in said.tying:
            return Item("stop", (word,))
        if deed is not None and _is_noun_here(word, deed, before, (*tokens, ".")[at + 1]):
            return Item("word", (word,))
        if deed is not None:
            return Item("deed", (word,), (deed,))
        if word in said.selecting and self.nouns.known((*tokens, "")[at + 1]):
            return Item("selector", (word,), (said.selecting[word],))
        if word in said.aside:
            return Item("aside", (word,))
        if word in said.nouns:
            return Item("filler", (word,))
        if not _FILLERS.isdisjoint(_infinitives(word)):
            return Item("stop", (word,))
        return Item("word", (word,))

    def _is_all(self, tokens: Sequence[str], at: int) -> bool:
        """Whether "all", "every" … has no object's noun after it: "all masses", "all that is
        missing"."""
        if tokens[at] not in ("all", "every", "each"):
            return False
        for word in tokens[at + 1 : at + 4]:
            if word not in DETERMINERS and word not in ("of", "missing", "unknown"):
                return not self.nouns.known(word)
        return True


_FILLERS = (
    STOP
    | DETERMINERS
    | EVERY
    | english().harmless
    | english().degrees
    | english().than
    | english().tying
    | {"'s"}
)
_SMALL = (
    english().nouns | english().aside | lexicon.PRONOUNS | lexicon.EVERYTHING | english().degrees
)
_MEANT = (
    english().deeds
    | english().handling
    | english().states
    | lexicon.UNMEASURABLE.keys()
    | english().compared.keys()
    | english().selecting.keys()
    | COLOURS
)
_DEEDS = english().deeds | english().handling
_READ = _MEANT | _FILLERS
_SAID_OF = word_set("is are was were weighs weigh has")
"""Words after a thing that something is asked of."""
_SAYING = lexicon.PASSIVE | word_set("how if whether has have had")
"""Words before an adjective that says something of a thing."""


def _is_noun_here(word: str, deed: str, before: Sequence[Item], following: str) -> bool:
    """Whether a word that may be a deed stands where a thing is named: "the mug's handle", "the
    nails", "the wrench set", but not "a throw of the hammer", "simulate the mug fall"."""
    if not before:
        return False
    if before[-1].text == "'s" or (_is_determined(before) and following != "of"):
        return True
    simulated = any(item.text.startswith("simulat") for item in before)
    is_head = word == deed and before[-1].kind == "object" and following in ".?!"
    return is_head and not simulated


def _infinitives(word: str) -> tuple[str, ...]:
    """What a verb may be a form of: "pushing", "pushes", "pushed", "sliding", "tipping"."""
    forms = [word]
    for ending in ("ing", "es", "ed", "s"):
        stem = word.removesuffix(ending)
        if stem == word or len(stem) < 3:
            continue
        forms += [stem, stem + "e"]
        if stem[-1] == stem[-2]:
            forms.append(stem[:-1])
    return tuple(forms)


def _phrases() -> dict[tuple[str, ...], str]:
    """The words of every synonym to the id of its quantity."""
    phrases: dict[tuple[str, ...], str] = {}
    for quantity in catalogue().values():
        for synonym in (*quantity.words.get("en", ()), quantity.id):
            phrases[tuple(synonym.split())] = quantity.id
    return phrases


def _after_how(tokens: Sequence[str], at: int) -> bool:
    return at > 0 and tokens[at - 1] == "how"


def _counts(synonym: str, tokens: Sequence[str], at: int) -> bool:
    """Whether a one-word synonym is a quantity here, and not an attribute ("the heavy box") or a
    verb ("place it")."""
    following = tokens[at + 1 : at + 2]
    if not following or following[0] in ".;:?!":
        # Nothing is left that it could describe or act on; but "is the bench level?" asks how it is.
        return synonym not in lexicon.WEAK or not _asks_how_it_is(tokens[:at])
    if synonym in lexicon.ADJECTIVES:
        degree = at > 0 and tokens[at - 1] in english().degrees
        return degree or _after_how(tokens, at)
    if synonym == "where":
        return True
    return synonym not in lexicon.WEAK or following[0] == "of"


def _asks_how_it_is(before: Sequence[str]) -> bool:
    start = max((i + 1 for i, word in enumerate(before) if word in ".;:?!"), default=0)
    return before[start : start + 1] in (["is"], ["are"], ["was"], ["were"])


def _is_list_of_things(before: Sequence[Item]) -> bool:
    return len(before) > 1 and before[-1].kind == "list" and before[-2].kind == "object"


def _is_listed(before: Sequence[Item], tokens: Sequence[str], at: int) -> bool:
    """Whether a word is the last of a list of things, and nothing follows that it could do."""
    following = (*tokens, ".")[at + 1]
    ends = following in ".,;:?!" or following in lexicon.LIST or following.startswith("§")
    return ends and _is_list_of_things(before)


def _quoted(names: Sequence[str]) -> str:
    return " and ".join(f"'{name}'" for name in names)


def _is_one_of(before: Sequence[Item]) -> bool:
    """Whether the words just before say "one of them", and not which."""
    words = [item.text for item in before[-4:] if item.text not in DETERMINERS | EVERY]
    return words[-2:] in (["one", "of"], ["any", "of"], ["some", "of"]) and words[0] != "which"


def _is_determined(before: Sequence[Item]) -> bool:
    """Whether the word just before makes a noun of the next: "the can", not "can you"."""
    return bool(before) and before[-1].text in DETERMINERS | EVERY


def _again(item: Item, before: Sequence[Item], following: str) -> Item:
    """The quantity before, where "that of the bottle" says it again."""
    if item.text not in ("that", "those") or following != "of":
        return item
    for said in reversed(before):
        if said.of_quantity:
            return replace(said, words=item.words)
    return item


def _compared(items: Sequence[Item]) -> list[Item]:
    """The items; those quantities compare that stand beside "more", "most", "the same"."""
    found: list[Item] = []
    for item in items:
        if found and item.kind == "quantity" and found[-1].compared and not item.compared:
            # "The largest mass" asks for no size.
            item = replace(item, words=(*found.pop().words, *item.words), compared=True)
        found.append(item)
    items = tuple(found)
    for i, item in enumerate(items):
        if item.kind != "quantity":
            continue
        before = items[i - 1].text if i else ""
        after = [following.text for following in items[i + 1 : i + 3]]
        after = [text for text in after if text != "the"]
        degrees = {*english().degrees, "same"} - {"as"}
        alike = after[:2] in (["as", "much"], ["as", "little"])
        if before in english().degrees or alike or not degrees.isdisjoint(after[:1]):
            found[i] = replace(item, compared=True)
    return found


def _joined(items: Sequence[Item]) -> list[Item]:
    """Runs of words that mean nothing here as one unknown item each."""
    joined: list[Item] = []
    for before, item in zip([EDGE, *items], items, strict=False):
        if item.kind != "word":
            joined.append(item)
        elif before.kind == "word":
            joined[-1] = Item("unknown", (*joined[-1].words, *item.words))
        else:
            joined.append(Item("unknown", item.words))
    return joined
