"""Phrases at the prompt: their definition, and the words after `strikes` that play one."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from ergon.notation.tables import notes
from ergon.notation.tables.shapes import MAX_NAME, NAME
from ergon.notation.text.errors import TextError, quote
from ergon.repl.language import amounts
from ergon.repl.language import values as v
from ergon.repl.language.commands import BlockCommand, When
from ergon.repl.language.forms import Slot, Words, form
from ergon.repl.language.scope import Scope, playable
from ergon.repl.language.striking import NAMED, check_options, strikes
from ergon.repl.language.transforming import split_at_do, transform_offers
from ergon.repl.language.values import Completion, CompletionContext, Value
from ergon.scores.pattern.words import parse_strikes
from ergon.scores.reading.melody import MAX_CHORD, PHRASE_ENTRY
from ergon.scores.reading.phrase_do import split_do
from ergon.scores.reading.strike_tables import STRIKES


@dataclass(frozen=True, slots=True)
class DefinePhrase(BlockCommand):
    """`phrase tune 0 C4 1mNs, 1/2 E4 to bell`: define a phrase, which `strikes` play.

    Its entries have `at`, `what` and `impulse` as texts.
    """

    name: str
    entries: tuple[Mapping[str, str], ...]
    to: str | None = None


_OPTIONS = {"every": "2bar", "times": "4", "until": "C", "transpose": "3st"}
_IMPULSE = re.compile(r"[-+.0-9]")  # what begins so is none of a note or a module
_ENTRIES_MAX = 1_000  # entries of a line

Entry = Mapping[str, str]  # `at`, `what` and `impulse`, as texts


def _entries(text: str, *_: Any) -> tuple[Entry, ...]:
    """Entries separated by commas: the time after the beginning, what is struck, and the
    impulse.
    """
    entries: list[Entry] = []
    start = 0
    for part in text.split(","):
        words = [(w.group(), start + w.start()) for w in re.finditer(r"\S+", part)]
        if not words:
            message = "an entry is missing: write for instance 0 C4 1mNs, 1/2 E4"
            raise TextError(message, offset=start)
        entries.append(_entry(words))
        start += len(part) + 1
    if len(entries) > _ENTRIES_MAX:
        raise TextError(
            f"a line has at most {_ENTRIES_MAX:,} entries of a phrase", length=len(text)
        )
    return tuple(entries)


def _entry(words: list[tuple[str, int]]) -> Entry:
    (when, begin), *rest = words
    fields = {"at": when}
    if len(rest) > 1 and _IMPULSE.match(rest[-1][0]):
        fields["impulse"] = rest[-1][0]
        v.check_word(PHRASE_ENTRY, "impulse", *rest.pop())
    v.check_word(PHRASE_ENTRY, "at", when, begin)
    if not 1 <= len(rest) <= MAX_CHORD:
        message = "what is struck is missing: write for instance 1/2 E4 G4 1mNs"
        raise TextError(message, offset=begin, length=len(when))
    for word, offset in rest:
        if notes.word_of(word) is None and not re.fullmatch(r"[^\W\d][\w.#-]*", word):
            message = f"{quote(word)} is neither a note nor a module, such as C4 or bell.m"
            raise TextError(message, offset=offset, length=len(word))
    return {**fields, "what": " ".join(word for word, _ in rest)}


def _name(text: str, scope: Scope, _: Mapping[str, Any]) -> str:
    v.check_new_name(text)
    for what in ("gesture", "take", "player", "instrument", "key"):
        if text in getattr(scope, f"{what}s"):
            message = f"{quote(text)} is the name of a {what}: give the phrase another name"
            raise TextError(message, length=len(text))
    return text


def _read_played(text: str, scope: Scope, _: Mapping[str, Any]) -> Mapping[str, str]:
    """The fields of strikes that play a phrase, as texts."""
    first = text.split()[0]
    if first not in scope.phrases:  # what is wrong with modules is told by the form before
        raise TextError(f"{quote(first)} is not a phrase", length=len(first))
    before, do = split_at_do(text)
    words, options = parse_strikes(before, _OPTIONS)
    if len(words) > 1:
        message = f"{quote(words[1].text)} does not belong here: one phrase is played at a time"
        raise TextError(message, offset=words[1].offset, length=len(words[1].text))
    check_options(options, scope)
    fields = {"play": words[0].text, **{name: word.text for name, word in options.items()}}
    if do is not None:
        if not text[do:].strip():
            message = "'do' needs a transformation: do scale 0.5, from 2"
            raise TextError(message, offset=len(before), length=max(1, len(text) - len(before)))
        try:
            split_do(text[do:])
        except TextError as error:
            error.offset += do
            raise
        fields["do"] = " ".join(text[do:].split())
    return fields


def _offers(context: CompletionContext) -> Iterator[Completion]:
    last = context.before[-1] if context.before else ""
    if not context.before:
        yield from v.name_completions(context.scope.phrases)
    elif context.before[0] not in context.scope.phrases:
        return
    elif "do" in context.before:
        yield from v.transform_completions(context)
        yield from transform_offers(context.before[context.before.index("do") + 1 :])
    elif last in _OPTIONS:
        yield Completion(_OPTIONS[last], STRIKES.by_name[last].doc)
    else:
        for name in (*_OPTIONS, "do"):
            if name not in context.before:
                yield Completion(name, STRIKES.by_name[name].doc)


def _entry_offers(context: CompletionContext) -> Iterator[Completion]:
    """What an entry strikes, behind its time; the time of the first entry."""
    begun: list[str] = []
    for word in context.before:
        begun = [] if word.endswith(",") else [*begun, word]
    if not context.before:
        yield Completion("0", "when, what, how strongly")
    elif len(begun) == 1 or (begun and not _IMPULSE.match(begun[-1])):
        yield from v.struck_completions(context)


def _read_struck(text: str, scope: Scope, _: Mapping[str, Any]) -> str:
    if not NAME.fullmatch(text.split(".")[0]) or len(text) > 4 * MAX_NAME:
        raise TextError(f"{quote(text)} is not an instrument", length=len(text))
    if text.split(".")[0] not in playable(scope):
        raise v.unknown_instrument(text, "an instrument", playable(scope), scope)
    return text


NEW_PHRASE = Value(
    "a name for the phrase", _name, lambda context: v.name_completions(context.scope.phrases)
)
ENTRIES = Value(
    "entries, such as 0 C4 1mNs, 1/2 E4 G4",
    _entries,
    _entry_offers,
)
TO = Value(
    "an instrument whose notes are struck",
    _read_struck,
    lambda context: v.name_completions(playable(context.scope)),
)
PLAYED = Value("a phrase, and how it is repeated", _read_played, _offers)


def define_phrase(
    name: str,
    entries: tuple[Entry, ...],
    to: str | None,
    length: Any,
    *,
    when: When,
    words: Words,
) -> DefinePhrase:
    """Define a phrase."""
    return DefinePhrase(name, entries, to, when=when, words=words)


# fmt: off
PHRASE_STRIKES_FORM = form("strikes", "str", "plays a phrase on what it strikes",
    "hook strikes tune transpose 3st", strikes,
    Slot("name", "NAME", NAMED),
    Slot("fields", "PHRASE [every LENGTH] [times N] [transpose Nst] [do …]",
    PLAYED, many=True), subject=True)
PHRASE_FORM = form("phrase", "ph", "defines or redefines a phrase: when, what, how strongly",
    "phrase tune 0 C4, 1/2 E4 to bell", define_phrase,
    Slot("name", "NAME", NEW_PHRASE),
    Slot("entries", "TIME NOTE … [IMPULSE], …", ENTRIES, many=True),
    Slot("to", "INSTRUMENT", TO, "to", optional=True),
    Slot("length", "LENGTH", amounts.LENGTH, "length", optional=True))
# fmt: on
