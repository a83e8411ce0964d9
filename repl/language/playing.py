"""The words after `plays`: those of the table of a part."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, cast

from ergon.notation.clock.positions import Length, Position
from ergon.notation.tables.shapes import Text
from ergon.notation.text.errors import TextError
from ergon.repl.language import amounts, values
from ergon.repl.language.commands import BlockCommand, When, Word
from ergon.repl.language.forms import PLAYER_SLOT, Slot, form
from ergon.repl.language.scope import Scope
from ergon.scores.edits.entries import Entry, entry_of_play
from ergon.scores.gesture.notation import Notation
from ergon.scores.gesture.transforms import ARGUMENT_COUNTS, GESTURE_ARGUMENT_COUNTS
from ergon.scores.pattern import words as play_words
from ergon.scores.pattern.turn_chain import Change
from ergon.scores.reading.part import OPTION_SHAPES, PLAY_RECORD
from ergon.scores.reading.playing import PlayingOptions
from ergon.scores.reading.playing_options import OptionValues, playing_options


@dataclass(frozen=True, slots=True)
class Define(BlockCommand):
    """`knock = 0@0 6@1/8 0@1/4`: define a gesture."""

    name: str
    notation: Notation


@dataclass(frozen=True, slots=True)
class Plays(BlockCommand):
    """`ada plays knock every 1`: play this from now on, in place of the rest of the part."""

    player: str
    what: str
    every: Length | None
    times: int | None
    until: Position | None
    do: tuple[Change, ...]
    manner: PlayingOptions
    entry: Entry | None = field(default=None, compare=False, repr=False)  # the entry in a part


@dataclass(frozen=True, slots=True)
class Do(BlockCommand):
    """`ada do mirror`: transform further what the player plays."""

    player: str
    do: tuple[Change, ...]

    @property
    def transform_texts(self) -> tuple[str, ...]:
        """Each transformation as it was written."""
        text = self.words["do"].text
        return tuple(text[change.offset : change.offset + change.length] for change in self.do)


# Options that a line may not set.
_SCORE_ONLY_MESSAGES = {"rate": "'rate' belongs to the score: leave it out here"}


@dataclass(frozen=True, slots=True)
class ParsedPlay:
    """What is played, a name or a pattern, and how.

    `parsed_words` has the place of each word, relative to the first.
    """

    played_text: str
    options: Mapping[str, Any]
    transforms: tuple[Change, ...]
    parsed_words: play_words.PlayWords


def _read_play(slot_text: str, scope: Scope, earlier_values: Mapping[str, Any]) -> ParsedPlay:
    gesture_names: list[play_words.Word] = []

    def collect_name(word: str, offset: int) -> str:
        gesture_names.append(play_words.Word(word, offset))
        return word

    parsed_words = play_words.parse(slot_text, read_name=collect_name)
    for played_name in gesture_names or [parsed_words.played]:
        _read_with_offset(played_name.offset, values.PLAYED_VALUE, played_name.text, scope)
    play_options = {}
    for option_name, option_word in parsed_words.options.items():
        if option_name in _SCORE_ONLY_MESSAGES:
            raise TextError(
                _SCORE_ONLY_MESSAGES[option_name],
                offset=option_word.offset,
                length=len(option_word.text),
            )
        play_options[option_name] = _read_with_offset(
            option_word.offset, _option_value(option_name), option_word.text, scope
        )
    return ParsedPlay(
        " ".join(parsed_words.played.text.split()),
        play_options,
        parsed_words.transforms,
        parsed_words,
    )


def _read_with_offset(word_offset: int, option_value: values.Value, text: str, scope: Scope) -> Any:
    try:
        return option_value.read(text, scope, {})
    except TextError as error:
        error.offset += word_offset
        raise


def _value_by_example(option: str) -> values.Value:
    """A value whose completion is its example."""
    shape, example = OPTION_SHAPES[option], play_words.OPTION_EXAMPLES[option] or ""
    assert isinstance(shape, Text), option
    parse, completion = shape.parse, values.Completion(example, PLAY_RECORD.by_name[option].doc)
    return values.Value(shape.what, lambda text, *_: parse(text), lambda _: (completion,))


# Values that a line checks or completes better than the table of a part: marks and completions.
_OPTION_VALUES = {
    "at": amounts.POSITION_VALUE,
    "until": amounts.POSITION_VALUE,
    "every": amounts.LENGTH_VALUE,
    "times": amounts.TIMES_VALUE,
    **{name: _value_by_example(name) for name in ("chance", "euclid", "swing", "skip")},
}


def _option_value(option: str) -> values.Value:
    if option in _OPTION_VALUES:
        return _OPTION_VALUES[option]
    shape = OPTION_SHAPES[option]
    assert isinstance(shape, Text), option
    return amounts.dimension_value(shape)


def _completions(context: values.CompletionContext) -> Iterator[values.Completion]:
    """Completions: after an option its values, else options and transformations."""
    if not context.earlier_words:
        yield from values.PLAYED_VALUE.completions(context)
        return
    last_word = context.earlier_words[-1]
    if (
        play_words.OPTION_EXAMPLES.get(last_word) is not None
        and last_word not in _SCORE_ONLY_MESSAGES
    ):
        shape = OPTION_SHAPES.get(last_word)
        choices = shape.choices if isinstance(shape, Text) else ()
        if choices:
            yield from (values.Completion(str(word), f"how '{last_word}' is") for word in choices)
        else:
            yield from _option_value(last_word).completions(context)
        return
    if last_word not in ("do", ",") and not GESTURE_ARGUMENT_COUNTS.get(last_word):
        for option, hint in OPTION_HINTS.items():
            if option not in context.earlier_words:
                yield values.Completion(option, hint)
    if not any(
        word in (*play_words.OPTION_EXAMPLES, "do", *GESTURE_ARGUMENT_COUNTS)
        for word in context.earlier_words
    ):
        yield from values.PLAYED_VALUE.completions(context)
    if last_word.endswith(",") or last_word in ("do", *ARGUMENT_COUNTS):
        yield from values.play_transform_completions(context)
    else:
        yield from values.transform_completions(context)


# The options of `plays`, each with a line of help.
_SCORE_FIELDS = (*_SCORE_ONLY_MESSAGES, "at", play_words.NTH_OPTION)
OPTION_HINTS = {
    name: PLAY_RECORD.by_name[name].doc for name in OPTION_SHAPES if name not in _SCORE_FIELDS
}
PLAYING_VALUE = values.Value("a gesture or a take", _read_play, _completions)


def plays(player: str, play: ParsedPlay, when: When, words: Mapping[str, Word]) -> Plays:
    """Make the command. Raises TextError if the line says twice when it begins."""
    play_options = dict(play.options)
    words_by_field = {
        "player": words["player"],
        "what": _option_word(play.parsed_words.played, words["play"]),
    }
    words_by_field |= {
        name: _option_word(word, words["play"]) for name, word in play.parsed_words.options.items()
    }
    if when is not None:
        words_by_field["when"] = words["when"]
    if play.transforms:
        text = words["play"].text
        transforms_text = ", ".join(
            text[transform.offset : transform.offset + transform.length]
            for transform in play.transforms
        )
        words_by_field["do"] = _option_word(
            play_words.Word(transforms_text, play.transforms[0].offset), words["play"]
        )
    written_position: Position | None = play_options.pop("at", None)
    if written_position is not None and when is not None:
        message = "this line says twice when it begins: keep one"
        raise TextError(
            message, offset=words_by_field["at"].start, length=len(words_by_field["at"].text)
        )
    if written_position is not None:
        words_by_field["when"] = words_by_field.pop("at")
    words_by_field["play"] = Word(
        _part_text(words_by_field, play), words["play"].start, words["play"].end
    )
    return Plays(
        player,
        play.played_text,
        play_options.get("every"),
        play_options.get("times"),
        play_options.get("until"),
        play.transforms,
        playing_options(cast("OptionValues", play_options)),
        entry_of_play(play.parsed_words, words["play"].text).with_fields(at=None),
        when=written_position or when,
        words=words_by_field,
    )


def _part_text(words_by_field: Mapping[str, Word], parsed_play: ParsedPlay) -> str:
    """The text of an entry of a part: what is played and how, without the time."""
    option_names = [name for name in parsed_play.parsed_words.options if name != "at"]
    flag_names = [name for name in option_names if play_words.OPTION_EXAMPLES.get(name, "") is None]
    word_by_option = {play_words.NTH_OPTION: "every"}
    option_texts = [
        f"{word_by_option.get(option_name, option_name)} {words_by_field[option_name].text}"
        for option_name in option_names
        if option_name not in flag_names
    ]
    transform_texts = [f"do {words_by_field['do'].text}"] if parsed_play.transforms else []
    return " ".join([parsed_play.played_text, *option_texts, *flag_names, *transform_texts])


def _option_word(word: play_words.Word, play_word: Word) -> Word:
    word_start = play_word.start + word.offset
    return Word(word.text, word_start, word_start + len(word.text))


# fmt: off
_PLAY_FORM = "NAME … [from TIME] [every LENGTH] [times N] [until WHERE] [chance P] [do …] [touch …]"
PLAYS_FORM = form("plays", "p", "the player plays a gesture, take or pattern from here on",
    "ada plays knock every 1 times 8", plays,
    PLAYER_SLOT, Slot("play", _PLAY_FORM, PLAYING_VALUE, takes_many=True), begins_with_subject=True)
DO_FORM = form("do", "d", "transforms further what the player plays",
    "ada do scale 1.2, mirror", Do,
    Slot("player", "PLAYER", values.TRANSFORMED_PLAYER),
    Slot("do", "TRANSFORMATION, …", values.DO_VALUE, takes_many=True), begins_with_subject=True)
DEFINE_FORM = form("=", "=", "defines or redefines a gesture, also while it sounds",
    "knock = 0@0 smooth 7@1/8 smooth 0@1/4", Define,
    Slot("name", "NAME", values.GESTURE_NAME),
    Slot("notation", "NOTATION", values.NOTATION_VALUE, takes_many=True), begins_with_subject=True)
# fmt: on
