"""Reads the words of a line as a command; for a line that is still being typed, finds completions.

The same pass over the places of a form does both, so that exactly what would be accepted is
offered.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

from ergon.notation.text.errors import TextError, quote
from ergon.notation.text.spelling import is_misspelt, is_one_slip, nearest
from ergon.repl.language import hearing, verbs
from ergon.repl.language import values as v
from ergon.repl.language.commands import NOW, Command, When, Word
from ergon.repl.language.forms import Form, Slot
from ergon.repl.language.lines import Line, split_words
from ergon.repl.language.scope import Scope, playable
from ergon.scores.pattern.cycle_table import TABLE as TRANSFORMS

_TIME_LEADS = {
    "at": v.POSITION,
    "in": v.LENGTH,
    "sync": v.SYNC,
}  # words before the time at which a line acts
_TIME_COMPLETIONS = (
    v.Completion("now", "at the next tick"),
    v.Completion("at", "at a position or a mark"),
    v.Completion("in", "so much later"),
    v.Completion("sync", "where another voice begins again"),
)


@dataclass(slots=True)
class Hints:
    """Completions for the word of which `typed` is the beginning."""

    typed: str
    completions: list[v.Completion] = field(default_factory=list)


def read_command(line: Line, scope: Scope, hints: Hints | None = None) -> Command | None:
    """Read a line. Raises TextError, with places in the submitted text.

    With `hints`, the line ends before a word that is being typed: the possible words are added
    to `hints`, and None is returned.
    """
    words = _split_joined_words(split_words(line))
    if hints is not None and len(words) < 2:
        _first_hints(words, scope, hints)
    if not words:
        return None
    verb, arguments = _find_verb(words, scope)
    after = words[-1].end
    refusals = []
    for form in _forms(verb, arguments):
        reading = _FormReader(form, line, list(arguments), after, scope, hints)
        try:
            taken = reading.command()
        except TextError as error:
            refusals.append(error)
        else:
            if taken is not None:
                return taken
    if hints is not None:
        return None
    # The form that could be read furthest is probably the intended one.
    raise max(refusals, key=lambda error: (error.offset, error.suggestion is not None))


def _forms(verb: str, arguments: list[Word]) -> Iterator[Form]:
    """The forms that a line may have: what is in quotes belongs to one alone."""
    is_quoted = len(arguments) > 1 and arguments[1].text.startswith('"')
    for form in verbs.forms_of(verb):
        if len(arguments) < 2 or verb != "=" or form.quoted == is_quoted:
            yield form


def _split_joined_words(words: list[Word]) -> list[Word]:
    """Split `knock=0@0` and `?lean`, which are several words written together."""
    if not words:
        return words
    first, rest = words[0], words[1:]
    if first.text[0] == "?" and len(first.text) > 1:
        return [*_split_word(first, 1), *rest]
    if "=" in first.text[1:]:
        name, equals = _split_word(first, first.text.index("=", 1))
        return [name, *(_split_word(equals, 1) if len(equals.text) > 1 else (equals,)), *rest]
    if rest and rest[0].text[0] == "=" and len(rest[0].text) > 1:
        return [first, *_split_word(rest[0], 1), *rest[1:]]
    return words


def _split_word(word: Word, at: int) -> tuple[Word, Word]:
    middle = word.start + at
    return Word(word.text[:at], word.start, middle), Word(word.text[at:], middle, word.end)


# --- the verb ------------------------------------------------------------------------------------


def _find_verb(words: list[Word], scope: Scope) -> tuple[str, list[Word]]:
    """The verb, and the other words."""
    first = words[0].text
    second = words[1].text if len(words) > 1 else ""
    if second == "=":
        return "=", [words[0], *words[2:]]
    if first in scope.blocks and not _is_near_subject_verb(second):
        return "run", words  # what else follows are its values
    about_player = verbs.verbs_matching(second, verbs.SUBJECT_VERBS) if second else ()
    is_player = first in scope.players
    is_instrument = first in playable(scope)
    is_played = first in scope.gestures or first in scope.takes or is_instrument
    is_name = first not in verbs.VERBS or is_instrument  # an instrument may be `pan`
    sure = second in verbs.SUBJECT_VERBS and is_name
    sure = sure and not (second == "every" and is_played)
    if about_player and (is_player or sure):
        return about_player[0], [words[0], *words[2:]]
    if is_name and _is_stroke(words, scope):
        return "hear", words
    some = verbs.verbs_matching(first, verbs.VERBS)
    if len(some) == 1 and not (is_player and first != some[0]):
        return some[0], words[1:]
    raise _unknown_verb(words, some, scope)


def _is_stroke(words: list[Word], scope: Scope) -> bool:
    """Whether a line is an instrument, notes and a level alone: `kick f`, `vib C4 E4 mf`."""
    first, *rest = (word.text for word in words)
    is_instrument = first.partition(".")[0] in playable(scope)
    return is_instrument and bool(rest) and all(hearing.is_stroke_word(text) for text in rest)


def _is_near_subject_verb(word: str) -> bool:
    return any(is_misspelt(word, verb) for verb in verbs.SUBJECT_VERBS)


def _unknown_verb(words: list[Word], some: tuple[str, ...], scope: Scope) -> TextError:
    first, place = words[0].text, words[0].start
    if first in scope.players:
        second = words[1] if len(words) > 1 else None
        example = f"{first} plays {next(iter(scope.gestures), 'knock')}"
        if second is None:
            return TextError(f"what does {first} play? write {example}", offset=words[0].end)
        near = nearest(second.text, verbs.SUBJECT_VERBS)
        message = f"unknown verb {quote(second.text)}"
        return TextError(
            message if near else f"{message}; after a player write plays or do: {example}",
            offset=second.start,
            length=len(second.text),
            suggestion=near,
        )
    if some:
        return verbs.ambiguous(first, some, place)
    played = first in scope.gestures or first in scope.takes
    if played and (player := next(iter(scope.players), None)):
        message = f"{quote(first)} is not a verb; a player plays it"
        suggestion = f"{player} plays {first}"
        return TextError(message, offset=place, length=len(first), suggestion=suggestion)
    if first in TRANSFORMS:
        message = f"{quote(first)} is a transformation, of a rhythm or of strikes"
        voice = next(iter(scope.strikes), "d1")
        what = " ".join(word.text for word in words)
        raise TextError(f"{message}: {voice} do {what}", offset=place, length=len(first))
    for i, word in enumerate(words):
        if word.text in ("at", "in") and _is_stroke(words[:i], scope):
            message = f"one stroke acts at once: leave out '{word.text}', or write a rhythm, such "
            message += f'as {first} = "{first}*4"'
            return TextError(message, offset=word.start, length=len(word.text))
    if first in scope.acts or first in scope.instruments:
        return TextError(_instrument_lines(first, scope), offset=place, length=len(first))
    known = (*verbs.VERBS, *list(scope.players)[: v.MAX_COMPARED])
    near = verbs.MEANT.get(first) or nearest(first, known)
    is_meant = first in verbs.MEANT
    if not is_meant and near in verbs.TAKING_AWAY and not is_one_slip(first, near):
        near = nearest(first, [verb for verb in known if verb not in verbs.TAKING_AWAY])
    message = f"unknown verb {quote(first)}"
    message = message if near else f"{message}; `help` lists them all"
    return TextError(message, offset=place, length=len(first), suggestion=near)


def _instrument_lines(name: str, scope: Scope) -> str:
    """The lines that play an instrument, where its name replaces a verb."""
    message = f"{quote(name)} is an instrument, not a verb; "
    if any(part.startswith(f"{name}.") for part in scope.instruments):
        return message + f'write {name} = "c4 e4*2", {name} notes C4 E4 every 1, or {name} C4 f'
    return message + f'write {name} = "{name}*4", or {name} f for one stroke'


def _first_hints(words: list[Word], scope: Scope, hints: Hints) -> None:
    if not words:
        hints.completions.extend(v.name_completions(scope.players))
        for verb in verbs.VERBS:
            hints.completions.append(v.Completion(verb, verbs.forms_of(verb)[0].effect))
        hints.completions.extend(v.name_completions(scope.gestures))
        hints.completions.extend(v.name_completions(scope.blocks))
        return
    first = words[0].text
    if first in scope.players:
        about = [verbs.forms_of(verb)[0] for verb in verbs.SUBJECT_VERBS]
        effects = (
            (f.verb, f.effect) for f in about if f.slots[0].value in (v.PLAYER, v.DOING_PLAYER)
        )
        hints.completions.extend(v.Completion(*pair) for pair in effects)
    elif first in scope.blocks:
        hints.completions.append(v.Completion("every", verbs.forms_of("every")[0].effect))
    elif first in scope.gestures:
        hints.completions.append(v.Completion("=", "defines it anew"))


# --- its places ----------------------------------------------------------------------------------


class _FormReader:
    """Reads the words of a line by the places of one form."""

    def __init__(
        self,
        form: Form,
        line: Line,
        words: list[Word],
        after: int,
        scope: Scope,
        hints: Hints | None,
    ) -> None:
        self.form = form
        self.line = line
        self.words = words
        self.end_of_line = after  # where a missing word would stand
        self.scope = scope
        self.hints = hints
        self.fields: dict[str, Any] = {
            slot.field: None for slot in form.slots if slot.field and slot.optional
        }
        self.as_written: dict[str, Word] = {}
        self.when: When = None
        self.has_when = False  # whether the words include a time; nothing is offered after it

    def command(self) -> Command | None:
        """The command; None where hints are wanted. Raises TextError."""
        self._read_time()
        options = [slot for slot in self.form.slots if slot.lead and slot.optional]
        places = [slot for slot in self.form.slots if slot not in options]
        for number, slot in enumerate(places):
            if not self._read_slot(slot, places[number + 1 :], options):
                return None
        while (option := self._next_option(options)) is not None:
            options.remove(option)
            self._read_option(option)
        if self.hints is not None:
            self._offer_rest(options)
            return None
        self._check_end(options)
        return self.form.make(**self.fields, when=self.when, words=self.as_written)

    def _read_time(self) -> None:
        """Take the time `now`, `at C` or `in 2` from the end of the words."""
        if not self.form.timed or not self.words:
            return
        last = self.words[-1]
        lead = self.words[-2].text if len(self.words) > 1 else ""
        if last.text == "now":
            self.when = NOW
            self.has_when, self.as_written["when"] = True, last
            del self.words[-1:]
        elif lead in _TIME_LEADS:
            self.when = self._read_value(_TIME_LEADS[lead], last)
            self.has_when, self.as_written["when"] = True, last
            del self.words[-2:]
        elif last.text in _TIME_LEADS:
            self._offer(_TIME_LEADS[last.text])
            what = _TIME_LEADS[last.text].what
            raise TextError(f"'{last.text}' needs {what}", offset=last.start, length=len(last.text))

    def _read_slot(self, slot: Slot, later: list[Slot], options: list[Slot]) -> bool:
        """Read a place that has a fixed order; False if that word is still being typed."""
        needed = sum(
            (slot.value is not None) + bool(slot.lead) for slot in later if not slot.optional
        )
        if slot.optional and self.words:
            typing = self.hints is not None
            if len(self.words) + typing <= needed:
                return True
        if slot.lead:
            if not self.words:
                self._offer_lead(slot)
                return self._refuse_missing(slot)
            word = self.words[0]
            if word.text != slot.lead:
                raise self._unexpected(word, [slot.lead])
            del self.words[0]
        if slot.value is None:
            return True
        if slot.many:
            return self._read_many(slot, options)
        texts = [word.text for word in self.words]
        count = slot.value.count(texts)
        if len(texts) < count:
            self._offer(slot.value, tuple(texts))
            self.words = []
            return slot.optional or self._refuse_missing(slot)
        words, self.words = self.words[:count], self.words[count:]
        self._store(slot, self._joined(words))
        return True

    def _joined(self, words: list[Word]) -> Word:
        """Successive words as one."""
        start, end = words[0].start, words[-1].end
        text = self.line.text[start - self.line.start : end - self.line.start]
        return Word(text, start, end)

    def _read_many(self, slot: Slot, options: list[Slot]) -> bool:
        """Read all words up to the next lead as one value."""
        leads = [option.lead for option in options]
        stop = next((i for i, w in enumerate(self.words) if w.text in leads), len(self.words))
        words, self.words = self.words[:stop], self.words[stop:]
        if self.hints is not None and not self.words and slot.value is not None:
            self._offer(slot.value, tuple(word.text for word in words))
        if not words:
            return slot.optional or self._refuse_missing(slot)
        self._store(slot, self._joined(words))
        self.has_when |= any(word.text in _TIME_LEADS for word in words)
        return True

    def _next_option(self, options: list[Slot]) -> Slot | None:
        """The option whose lead is the next word; that lead is removed."""
        if not self.words:
            return None
        word = self.words[0]
        for option in options:
            if option.lead[-1] == "=" and word.text.startswith(option.lead):
                self.words[0] = _split_word(word, len(option.lead))[1]
                return option
            if word.text == option.lead:
                del self.words[0]
                return option
        return None

    def _read_option(self, option: Slot) -> None:
        assert option.value is not None
        if not self.words or not self.words[0].text:
            if not self.words:
                self._offer(option.value)
            what = option.value.what
            raise TextError(f"'{option.lead}' needs {what}", offset=self.end_of_line)
        self._store(option, self.words.pop(0))

    def _store(self, slot: Slot, word: Word) -> None:
        assert slot.value is not None
        self.fields[slot.field] = self._read_value(slot.value, word)
        self.as_written[slot.field] = word

    def _read_value(self, value: v.Value, word: Word) -> Any:
        try:
            return value.read(word.text, self.scope, self.fields)
        except TextError as error:
            error.offset += word.start
            raise

    def _refuse_missing(self, slot: Slot) -> bool:
        if self.hints is not None:
            return False
        what = f"'{slot.lead}'" if slot.lead else slot.value.what if slot.value else ""
        example = self.form.example
        if slot.value is v.PLAYER_OR_ALL and self.scope.players:
            verb = example.split()[0]
            names = [f"{verb} {name}" for name in (*list(self.scope.players)[:4], "all")]
            example = f"{', '.join(names[:-1])} or {names[-1]}"
        where = self.words[0].start if self.words else self.end_of_line
        raise TextError(f"{what} is missing: {example}", offset=where)

    def _check_end(self, options: list[Slot]) -> None:
        if not self.words:
            return
        word = self.words[0]
        if not self.form.timed and word.text == "now" and len(self.words) == 1:
            return  # the verb acts at once anyway
        raise self._unexpected(word, [option.lead for option in options])

    def _unexpected(self, word: Word, leads: list[str]) -> TextError:
        whens = ("now", *_TIME_LEADS) if self.form.timed else ()
        message = f"{quote(word.text)} does not belong here"
        near = nearest(word.text, (*(lead for lead in leads if lead[-1] != "="), *whens))
        if near is None:
            message = f"{message}; write {self.form.written}"
        if not self.form.timed and word.text in _TIME_LEADS:
            message = f"'{self.form.verb}' acts at once: leave out '{word.text}'"
        return TextError(message, offset=word.start, length=len(word.text), suggestion=near)

    # --- completions ------------------------------------------------------------------------------

    def _offer(self, value: v.Value, before: tuple[str, ...] = ()) -> None:
        if self.hints is not None and not self.has_when:
            context = v.CompletionContext(self.hints.typed, before, self.scope, self.fields)
            self.hints.completions.extend(value.completions(context))

    def _offer_lead(self, slot: Slot) -> None:
        if self.hints is not None and not self.has_when:
            self.hints.completions.append(
                v.Completion(slot.lead, slot.value.what if slot.value else self.form.effect)
            )

    def _offer_rest(self, options: list[Slot]) -> None:
        """Offer what may still follow when all required places are filled."""
        if self.hints is None or self.words or self.has_when:
            return
        for option in options:
            self._offer_lead(option)
            if option.lead[-1] == "=" and self.hints.typed.startswith(option.lead):
                self._offer_joined(option)
        if self.form.timed:
            self.hints.completions.extend(_TIME_COMPLETIONS)

    def _offer_joined(self, option: Slot) -> None:
        assert self.hints is not None
        assert option.value is not None
        typed = self.hints.typed[len(option.lead) :]
        context = v.CompletionContext(typed, (), self.scope, self.fields)
        offers = option.value.completions(context)
        self.hints.completions.extend(
            v.Completion(option.lead + text, hint) for text, hint in offers
        )
