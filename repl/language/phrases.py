"""Phrases at the prompt: their definition, and the words after `strikes` that play one."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from ergon.notation.tables import notes
from ergon.notation.tables.shapes import MAX_NAME, NAME
from ergon.notation.text.errors import TextError, quote
from ergon.repl.language import amounts, values
from ergon.repl.language.commands import BlockCommand, When
from ergon.repl.language.forms import Slot, Words, form
from ergon.repl.language.scope import Scope, playable_instruments
from ergon.repl.language.striking import NAMED_VALUE, check_options, strikes
from ergon.repl.language.transforming import split_at_transforms, transform_completions
from ergon.repl.language.values import Completion, CompletionContext, Value
from ergon.scores.pattern.words import parse_strikes
from ergon.scores.reading.melody import MAX_CHORD, PHRASE_ENTRY_RECORD
from ergon.scores.reading.phrase_do import split_transforms
from ergon.scores.reading.strike_tables import STRIKES_RECORD


@dataclass(frozen=True, slots=True)
class DefinePhrase(BlockCommand):
    """`phrase tune 0 C4 1mNs, 1/2 E4 to bell`: define a phrase, which `strikes` play.

    Its entries have `at`, `what` and `impulse` as texts.
    """

    name: str
    entries: tuple[Mapping[str, str], ...]
    to: str | None = None


_OPTION_EXAMPLES = {"every": "2bar", "times": "4", "until": "C", "transpose": "3st"}
_IMPULSE_PATTERN = re.compile(r"[-+.0-9]")  # no note and no module begins with these
_ENTRIES_MAX = 1_000  # entries of a line

Entry = Mapping[str, str]  # `at`, `what` and `impulse`, as texts


def _parse_entries(entries_text: str, *_: Any) -> tuple[Entry, ...]:
    """Entries separated by commas: the time after the beginning, what is struck, and the
    impulse.
    """
    phrase_entries: list[Entry] = []
    entry_start = 0
    for entry_text in entries_text.split(","):
        slot_words = [
            (word_match.group(), entry_start + word_match.start())
            for word_match in re.finditer(r"\S+", entry_text)
        ]
        if not slot_words:
            message = "an entry is missing: write for instance 0 C4 1mNs, 1/2 E4"
            raise TextError(message, offset=entry_start)
        phrase_entries.append(_parse_entry(slot_words))
        entry_start += len(entry_text) + 1
    if len(phrase_entries) > _ENTRIES_MAX:
        raise TextError(
            f"a line has at most {_ENTRIES_MAX:,} entries of a phrase", length=len(entries_text)
        )
    return tuple(phrase_entries)


def _parse_entry(words: list[tuple[str, int]]) -> Entry:
    (time_text, time_offset), *struck_words = words
    entry_fields = {"at": time_text}
    if len(struck_words) > 1 and _IMPULSE_PATTERN.match(struck_words[-1][0]):
        entry_fields["impulse"] = struck_words[-1][0]
        values.check_word(PHRASE_ENTRY_RECORD, "impulse", *struck_words.pop())
    values.check_word(PHRASE_ENTRY_RECORD, "at", time_text, time_offset)
    if not 1 <= len(struck_words) <= MAX_CHORD:
        message = "what is struck is missing: write for instance 1/2 E4 G4 1mNs"
        raise TextError(message, offset=time_offset, length=len(time_text))
    for entry_word, word_offset in struck_words:
        if notes.word_of(entry_word) is None and not re.fullmatch(r"[^\W\d][\w.#-]*", entry_word):
            message = f"{quote(entry_word)} is neither a note nor a module, such as C4 or bell.m"
            raise TextError(message, offset=word_offset, length=len(entry_word))
    return {**entry_fields, "what": " ".join(word for word, _ in struck_words)}


def _read_phrase_name(phrase_name: str, scope: Scope, _: Mapping[str, Any]) -> str:
    values.check_new_name(phrase_name)
    for name_kind in ("gesture", "take", "player", "instrument", "key"):
        if phrase_name in getattr(scope, f"{name_kind}s"):
            message = (
                f"{quote(phrase_name)} is the name of a {name_kind}: give the phrase another name"
            )
            raise TextError(message, length=len(phrase_name))
    return phrase_name


def _read_played_phrase(slot_text: str, scope: Scope, _: Mapping[str, Any]) -> Mapping[str, str]:
    """The fields of strikes that play a phrase, as texts."""
    phrase_name = slot_text.split()[0]
    if phrase_name not in scope.phrases:  # the previous form reports mistakes in modules
        raise TextError(f"{quote(phrase_name)} is not a phrase", length=len(phrase_name))
    options_text, transforms_start = split_at_transforms(slot_text)
    placed_words, placed_options = parse_strikes(options_text, _OPTION_EXAMPLES)
    if len(placed_words) > 1:
        message = (
            f"{quote(placed_words[1].text)} does not belong here: one phrase is played at a time"
        )
        raise TextError(message, offset=placed_words[1].offset, length=len(placed_words[1].text))
    check_options(placed_options, scope)
    strike_fields = {
        "play": placed_words[0].text,
        **{name: word.text for name, word in placed_options.items()},
    }
    if transforms_start is not None:
        if not slot_text[transforms_start:].strip():
            message = "'do' needs a transformation: do scale 0.5, from 2"
            raise TextError(
                message, offset=len(options_text), length=max(1, len(slot_text) - len(options_text))
            )
        try:
            split_transforms(slot_text[transforms_start:])
        except TextError as error:
            error.offset += transforms_start
            raise
        strike_fields["do"] = " ".join(slot_text[transforms_start:].split())
    return strike_fields


def _completions(context: CompletionContext) -> Iterator[Completion]:
    last_word = context.earlier_words[-1] if context.earlier_words else ""
    if not context.earlier_words:
        yield from values.name_completions(context.scope.phrases)
    elif context.earlier_words[0] not in context.scope.phrases:
        return
    elif "do" in context.earlier_words:
        yield from values.transform_completions(context)
        yield from transform_completions(
            context.earlier_words[context.earlier_words.index("do") + 1 :]
        )
    elif last_word in _OPTION_EXAMPLES:
        yield Completion(_OPTION_EXAMPLES[last_word], STRIKES_RECORD.by_name[last_word].doc)
    else:
        for name in (*_OPTION_EXAMPLES, "do"):
            if name not in context.earlier_words:
                yield Completion(name, STRIKES_RECORD.by_name[name].doc)


def _entry_completions(context: CompletionContext) -> Iterator[Completion]:
    """What an entry strikes, behind its time; the time of the first entry."""
    entry_words: list[str] = []
    for word in context.earlier_words:
        entry_words = [] if word.endswith(",") else [*entry_words, word]
    if not context.earlier_words:
        yield Completion("0", "when, what, how strongly")
    elif len(entry_words) == 1 or (entry_words and not _IMPULSE_PATTERN.match(entry_words[-1])):
        yield from values.struck_completions(context)


def _read_struck(struck_path: str, scope: Scope, _: Mapping[str, Any]) -> str:
    if not NAME.fullmatch(struck_path.split(".")[0]) or len(struck_path) > 4 * MAX_NAME:
        raise TextError(f"{quote(struck_path)} is not an instrument", length=len(struck_path))
    if struck_path.split(".")[0] not in playable_instruments(scope):
        raise values.unknown_instrument_error(
            struck_path, "an instrument", playable_instruments(scope), scope
        )
    return struck_path


NEW_PHRASE = Value(
    "a name for the phrase",
    _read_phrase_name,
    lambda context: values.name_completions(context.scope.phrases),
)
ENTRIES_VALUE = Value(
    "entries, such as 0 C4 1mNs, 1/2 E4 G4",
    _parse_entries,
    _entry_completions,
)
TO_VALUE = Value(
    "an instrument whose notes are struck",
    _read_struck,
    lambda context: values.name_completions(playable_instruments(context.scope)),
)
PLAYED_VALUE = Value("a phrase, and how it is repeated", _read_played_phrase, _completions)


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
    Slot("name", "NAME", NAMED_VALUE),
    Slot("fields", "PHRASE [every LENGTH] [times N] [transpose Nst] [do …]",
    PLAYED_VALUE, takes_many=True), begins_with_subject=True)
PHRASE_FORM = form("phrase", "ph", "defines or redefines a phrase: when, what, how strongly",
    "phrase tune 0 C4, 1/2 E4 to bell", define_phrase,
    Slot("name", "NAME", NEW_PHRASE),
    Slot("entries", "TIME NOTE … [IMPULSE], …", ENTRIES_VALUE, takes_many=True),
    Slot("to", "INSTRUMENT", TO_VALUE, "to", optional=True),
    Slot("length", "LENGTH", amounts.LENGTH_VALUE, "length", optional=True))
# fmt: on
