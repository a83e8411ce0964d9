"""Reads the words of a line as a command; for a line that is still being typed, finds completions.

The same pass over the places of a form does both, so that exactly what would be accepted is
offered.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

from ergon.notation.tables.shapes import NAME
from ergon.notation.text.errors import TextError, quote
from ergon.notation.text.spelling import nearest
from ergon.repl.language import amounts, values, verbs
from ergon.repl.language.commands import NOW, Command, When, Word
from ergon.repl.language.forms import Form, Slot
from ergon.repl.language.line_verb import split_verb
from ergon.repl.language.lines import Line, split_words
from ergon.repl.language.scope import Scope

_TIME_KEYWORDS = {
    "at": amounts.POSITION_VALUE,
    "in": amounts.LENGTH_VALUE,
    "sync": amounts.SYNC_VALUE,
}  # words before the time at which a line acts
# A verb, the word that it does not take, and the line that does it.
_OTHER_VERBS = (("undo", re.compile(r"\d+"), "back {}"), ("stop", NAME, "mute {0}, or remove {0}"))
_UNIT_BY_WORD = {
    **{name: "bar" for name in ("bar", "bars")},
    **{name: "" for name in ("beat", "beats")},
    **{name: "s" for name in ("s", "sec", "second", "seconds")},
    **{name: name for name in ("ms", "dB", "st", "Hz", "kHz", "mNs", "cents")},
}
_NUMBER_PATTERN = re.compile(r"[+-]?\d+(\.\d+)?(/\d+)?")
_TIME_COMPLETIONS = (
    values.Completion("now", "at the next tick"),
    values.Completion("at", "at a position or a mark"),
    values.Completion("in", "so much later"),
    values.Completion("sync", "where another voice begins again"),
)


@dataclass(slots=True)
class Hints:
    """Completions for the word of which `typed` is the beginning."""

    typed: str
    completions: list[values.Completion] = field(default_factory=list)


def read_command(typed_line: Line, scope: Scope, hints: Hints | None = None) -> Command | None:
    """Read a line. Raises TextError, with places in the submitted text.

    With `hints`, the line ends before a word that is being typed: the possible words are added
    to `hints`, and None is returned.
    """
    line_words = _split_joined_words(split_words(typed_line))
    if hints is not None and len(line_words) < 2:
        _add_first_hints(line_words, scope, hints)
    if not line_words:
        return None
    verb, verb_words = split_verb(line_words, scope)
    line_end = line_words[-1].end
    errors = []
    for form in _possible_forms(verb, verb_words):
        form_reader = _FormReader(form, typed_line, list(verb_words), line_end, scope, hints)
        try:
            command = form_reader.read()
        except TextError as error:
            errors.append(error)
        else:
            if command is not None:
                return command
    if hints is not None:
        return None
    # The form that could be read furthest is probably the intended one.
    raise max(errors, key=lambda error: (error.offset, error.suggestion is not None))


def _possible_forms(verb: str, verb_words: list[Word]) -> Iterator[Form]:
    """The forms that a line may have: what is in quotes belongs to one alone."""
    is_quoted = len(verb_words) > 1 and verb_words[1].text.startswith('"')
    for form in verbs.forms_of(verb):
        if len(verb_words) < 2 or verb != "=" or form.needs_quotes == is_quoted:
            yield form


def _split_joined_words(line_words: list[Word]) -> list[Word]:
    """Split `knock=0@0` and `?lean`, which are several words written together."""
    if not line_words:
        return line_words
    first_word, later_words = line_words[0], line_words[1:]
    if first_word.text[0] == "?" and len(first_word.text) > 1:
        return [*_split_word(first_word, 1), *later_words]
    if "=" in first_word.text[1:]:
        name, equals_sign = _split_word(first_word, first_word.text.index("=", 1))
        return [
            name,
            *(_split_word(equals_sign, 1) if len(equals_sign.text) > 1 else (equals_sign,)),
            *later_words,
        ]
    if later_words and later_words[0].text[0] == "=" and len(later_words[0].text) > 1:
        return [first_word, *_split_word(later_words[0], 1), *later_words[1:]]
    return line_words


def _split_word(word: Word, length: int) -> tuple[Word, Word]:
    split_offset = word.start + length
    return Word(word.text[:length], word.start, split_offset), Word(
        word.text[length:], split_offset, word.end
    )


def _add_first_hints(line_words: list[Word], scope: Scope, hints: Hints) -> None:
    if not line_words:
        hints.completions.extend(values.name_completions(scope.players))
        for verb in verbs.LEADING_VERBS:
            hints.completions.append(values.Completion(verb, verbs.forms_of(verb)[0].effect))
        hints.completions.extend(values.name_completions(scope.gestures))
        hints.completions.extend(values.name_completions(scope.blocks))
        return
    first_text = line_words[0].text
    if first_text in scope.players:
        subject_forms = [verbs.forms_of(verb)[0] for verb in verbs.SUBJECT_VERBS]
        verb_effects = (
            (verb_form.verb, verb_form.effect)
            for verb_form in subject_forms
            if verb_form.slots[0].value in (values.PLAYER_VALUE, values.TRANSFORMED_PLAYER)
        )
        hints.completions.extend(
            values.Completion(*verb_and_effect) for verb_and_effect in verb_effects
        )
    elif first_text in scope.blocks:
        hints.completions.append(values.Completion("every", verbs.forms_of("every")[0].effect))
    elif first_text in scope.gestures:
        hints.completions.append(values.Completion("=", "defines it anew"))


# --- its places ----------------------------------------------------------------------------------


class _FormReader:
    """Reads the words of a line by the places of one form."""

    def __init__(
        self,
        verb_form: Form,
        typed_line: Line,
        form_words: list[Word],
        line_end: int,
        scope: Scope,
        hints: Hints | None,
    ) -> None:
        self.form = verb_form
        self.line = typed_line
        self.words = form_words
        self.line_end = line_end  # the position of a missing word
        self.scope = scope
        self.hints = hints
        self.fields: dict[str, Any] = {
            slot.field: None for slot in verb_form.slots if slot.field and slot.optional
        }
        self.written_words: dict[str, Word] = {}
        self.when: When = None
        self.has_time = False  # whether the words include a time; nothing is offered after it

    def read(self) -> Command | None:
        """The command; None where hints are wanted. Raises TextError."""
        self._read_time()
        option_slots = [slot for slot in self.form.slots if slot.keyword and slot.optional]
        fixed_slots = [slot for slot in self.form.slots if slot not in option_slots]
        for number, slot in enumerate(fixed_slots):
            if not self._read_slot(slot, fixed_slots[number + 1 :], option_slots):
                return None
        while (option_slot := self._next_option(option_slots)) is not None:
            option_slots.remove(option_slot)
            self._read_option(option_slot)
        if self.hints is not None:
            self._offer_options(option_slots)
            return None
        self._refuse_extra_words(option_slots)
        return self.form.make_command(**self.fields, when=self.when, words=self.written_words)

    def _read_time(self) -> None:
        """Take the time `now`, `at C` or `in 2` from the end of the words."""
        if not self.form.takes_time or not self.words:
            return
        last_word = self.words[-1]
        keyword = self.words[-2].text if len(self.words) > 1 else ""
        if last_word.text == "now":
            self.when = NOW
            self.has_time, self.written_words["when"] = True, last_word
            del self.words[-1:]
        elif keyword in _TIME_KEYWORDS:
            self.when = self._read_word(_TIME_KEYWORDS[keyword], last_word)
            self.has_time, self.written_words["when"] = True, last_word
            del self.words[-2:]
        elif last_word.text in _TIME_KEYWORDS:
            self._offer_value(_TIME_KEYWORDS[last_word.text])
            description = _TIME_KEYWORDS[last_word.text].description
            raise TextError(
                f"'{last_word.text}' needs {description}",
                offset=last_word.start,
                length=len(last_word.text),
            )

    def _read_slot(
        self, form_slot: Slot, later_slots: list[Slot], option_slots: list[Slot]
    ) -> bool:
        """Read a place that has a fixed order; False if that word is still being typed."""
        n_needed_words = sum(
            (slot.value is not None) + bool(slot.keyword)
            for slot in later_slots
            if not slot.optional
        )
        if form_slot.optional and self.words:
            is_typing = self.hints is not None
            if len(self.words) + is_typing <= n_needed_words:
                return True
        if form_slot.keyword:
            if not self.words:
                self._offer_keyword(form_slot)
                return self._refuse_missing(form_slot)
            word = self.words[0]
            if word.text != form_slot.keyword:
                raise self._unexpected_word_error(word, [form_slot.keyword])
            del self.words[0]
        if form_slot.value is None:
            return True
        if form_slot.takes_many:
            return self._read_many(form_slot, option_slots)
        word_texts = [word.text for word in self.words]
        n_words = form_slot.value.word_count(word_texts)
        if len(word_texts) < n_words:
            self._offer_value(form_slot.value, tuple(word_texts))
            self.words = []
            return form_slot.optional or self._refuse_missing(form_slot)
        words, self.words = self.words[:n_words], self.words[n_words:]
        self._store_value(form_slot, self._joined_words(words))
        return True

    def _joined_words(self, words: list[Word]) -> Word:
        """Successive words as one."""
        start, end = words[0].start, words[-1].end
        text = self.line.text[start - self.line.start : end - self.line.start]
        return Word(text, start, end)

    def _read_many(self, form_slot: Slot, option_slots: list[Slot]) -> bool:
        """Read all words up to the next keyword as one value."""
        keywords = [option.keyword for option in option_slots]
        stop_index = next(
            (
                word_index
                for word_index, line_word in enumerate(self.words)
                if line_word.text in keywords
            ),
            len(self.words),
        )
        slot_words, self.words = self.words[:stop_index], self.words[stop_index:]
        if self.hints is not None and not self.words and form_slot.value is not None:
            self._offer_value(form_slot.value, tuple(word.text for word in slot_words))
        if not slot_words:
            return form_slot.optional or self._refuse_missing(form_slot)
        self._store_value(form_slot, self._joined_words(slot_words))
        self.has_time |= any(word.text in _TIME_KEYWORDS for word in slot_words)
        return True

    def _next_option(self, option_slots: list[Slot]) -> Slot | None:
        """The option whose keyword is the next word; that keyword is removed."""
        if not self.words:
            return None
        next_word = self.words[0]
        for option_slot in option_slots:
            if option_slot.keyword[-1] == "=" and next_word.text.startswith(option_slot.keyword):
                self.words[0] = _split_word(next_word, len(option_slot.keyword))[1]
                return option_slot
            if next_word.text == option_slot.keyword:
                del self.words[0]
                return option_slot
        return None

    def _read_option(self, option_slot: Slot) -> None:
        assert option_slot.value is not None
        if not self.words or not self.words[0].text:
            if not self.words:
                self._offer_value(option_slot.value)
            description = option_slot.value.description
            raise TextError(f"'{option_slot.keyword}' needs {description}", offset=self.line_end)
        self._store_value(option_slot, self.words.pop(0))

    def _store_value(self, slot: Slot, word: Word) -> None:
        assert slot.value is not None
        self.fields[slot.field] = self._read_word(slot.value, word)
        self.written_words[slot.field] = word

    def _read_word(self, slot_value: values.Value, line_word: Word) -> Any:
        try:
            return slot_value.read(line_word.text, self.scope, self.fields)
        except TextError as error:
            error.offset += line_word.start
            raise

    def _refuse_missing(self, missing_slot: Slot) -> bool:
        if self.hints is not None:
            return False
        missing_text = (
            f"'{missing_slot.keyword}'"
            if missing_slot.keyword
            else missing_slot.value.description
            if missing_slot.value
            else ""
        )
        example = self.form.example
        if missing_slot.value is values.PLAYER_OR_ALL and self.scope.players:
            verb = example.split()[0]
            names = [f"{verb} {name}" for name in (*list(self.scope.players)[:4], "all")]
            example = f"{', '.join(names[:-1])} or {names[-1]}"
        error_offset = self.words[0].start if self.words else self.line_end
        raise TextError(f"{missing_text} is missing: {example}", offset=error_offset)

    def _refuse_extra_words(self, option_slots: list[Slot]) -> None:
        if not self.words:
            return
        first_word = self.words[0]
        if not self.form.takes_time and first_word.text == "now" and len(self.words) == 1:
            return  # the verb acts at once anyway
        raise self._unexpected_word_error(first_word, [option.keyword for option in option_slots])

    def _unexpected_word_error(self, unexpected_word: Word, keywords: list[str]) -> TextError:
        time_words = ("now", *_TIME_KEYWORDS) if self.form.takes_time else ()
        message = f"{quote(unexpected_word.text)} does not belong here"
        if (joined_word := self._joined_with_unit(unexpected_word)) is not None:
            message = f"a number and its unit are one word: {joined_word}"
            return TextError(
                message, offset=unexpected_word.start, length=len(unexpected_word.text)
            )
        for verb, pattern, advice in _OTHER_VERBS:
            if verb == self.form.verb and pattern.fullmatch(unexpected_word.text):
                message = f"{message}; write {advice.format(unexpected_word.text)}"
                return TextError(
                    message, offset=unexpected_word.start, length=len(unexpected_word.text)
                )
        nearest_word = nearest(
            unexpected_word.text,
            (*(keyword for keyword in keywords if keyword[-1] != "="), *time_words),
        )
        if nearest_word is None:
            message = f"{message}; write {self.form.usage}"
        if not self.form.takes_time and unexpected_word.text in _TIME_KEYWORDS:
            message = f"'{self.form.verb}' acts at once: leave out '{unexpected_word.text}'"
        return TextError(
            message,
            offset=unexpected_word.start,
            length=len(unexpected_word.text),
            suggestion=nearest_word,
        )

    def _joined_with_unit(self, line_word: Word) -> str | None:
        """A number before a unit that is a word of its own, joined with it; None if it is not."""
        unit_name = _UNIT_BY_WORD.get(line_word.text)
        earlier_words = self.line.text[: line_word.start - self.line.start].split()
        if (
            unit_name is None
            or not earlier_words
            or not _NUMBER_PATTERN.fullmatch(earlier_words[-1])
        ):
            return None
        return earlier_words[-1] + unit_name

    # --- completions ------------------------------------------------------------------------------

    def _offer_value(self, slot_value: values.Value, earlier_words: tuple[str, ...] = ()) -> None:
        if self.hints is not None and not self.has_time:
            context = values.CompletionContext(
                self.hints.typed, earlier_words, self.scope, self.fields
            )
            self.hints.completions.extend(slot_value.completions(context))

    def _offer_keyword(self, slot: Slot) -> None:
        if self.hints is not None and not self.has_time:
            self.hints.completions.append(
                values.Completion(
                    slot.keyword, slot.value.description if slot.value else self.form.effect
                )
            )

    def _offer_options(self, option_slots: list[Slot]) -> None:
        """Offer what may still follow when all required places are filled."""
        if self.hints is None or self.words or self.has_time:
            return
        for option_slot in option_slots:
            self._offer_keyword(option_slot)
            if option_slot.keyword[-1] == "=" and self.hints.typed.startswith(option_slot.keyword):
                self._offer_joined(option_slot)
        if self.form.takes_time:
            self.hints.completions.extend(_TIME_COMPLETIONS)

    def _offer_joined(self, option_slot: Slot) -> None:
        assert self.hints is not None
        assert option_slot.value is not None
        typed_value = self.hints.typed[len(option_slot.keyword) :]
        context = values.CompletionContext(typed_value, (), self.scope, self.fields)
        completions = option_slot.value.completions(context)
        self.hints.completions.extend(
            values.Completion(option_slot.keyword + text, hint) for text, hint in completions
        )
