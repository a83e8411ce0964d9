"""Values of a line: how each is read, and its completions."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from ergon.notation.tables import value_kinds
from ergon.notation.tables.fields import Record
from ergon.notation.tables.shapes import MAX_NAME, NAME, Text
from ergon.notation.text.errors import TextError, quote
from ergon.notation.text.spelling import nearest
from ergon.repl.language.scope import Scope, playable_instruments, scores_in, unused_family
from ergon.scores.gesture import notation, space_path
from ergon.scores.gesture.points import CURVES, UNITS_PER_METRE
from ergon.scores.gesture.transforms import ARGUMENT_COUNTS, EXAMPLES, GESTURE_ARGUMENT_COUNTS
from ergon.scores.pattern.turn_chain import TURN_FORMS, parse_chain
from ergon.scores.pattern.words import OPTION_EXAMPLES

MAX_POINTS = 2_000  # of a gesture that is typed: some 7 ms to read, and its ergons before the bar
# Words that may follow a name in a line, so that no gesture or take may be called so.
RESERVED_WORDS = frozenset(
    (
        *OPTION_EXAMPLES,
        *GESTURE_ARGUMENT_COUNTS,
        "do",
        "now",
        "in",
        "sync",
        "over",
        "as",
        "off",
        "all",
    )
)
MAX_COMPARED_NAMES = 2_000  # names that did-you-mean compares with: about 10 ms

NUMBER_PATTERN = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:/\d*)?")


class Completion(NamedTuple):
    """A word that could come next, and a hint."""

    text: str
    hint: str


@dataclass(frozen=True, slots=True)
class CompletionContext:
    """Where a word is completed: its typed beginning, the words before it in the same place, the
    scope.

    `fields` are the values of the line so far.
    """

    typed_text: str
    earlier_words: tuple[str, ...]
    scope: Scope
    fields: Mapping[str, Any]


@dataclass(frozen=True)
class Value:
    """A kind of value. `read` takes the text, the scope and the values so far; it raises
    TextError.
    """

    description: str
    read: Callable[[str, Scope, Mapping[str, Any]], Any]
    completions: Callable[[CompletionContext], Iterable[Completion]]
    # How many of the words that follow it takes; the first words of one that may take several.
    word_count: Callable[[Sequence[str]], int] = lambda _: 1
    first_words: tuple[str, ...] = ()


# --- names ---------------------------------------------------------------------------------------


def name_value(kind_name: str, *sections: str) -> Value:
    """The name of something in one of these sections of the scope."""

    def hinted_names(scope: Scope) -> dict[str, str]:
        return {
            name: hint for section in sections for name, hint in getattr(scope, section).items()
        }

    def read(text: str, scope: Scope, _: Mapping[str, Any]) -> str:
        if text not in (names := hinted_names(scope)):
            raise unknown_instrument_error(text, kind_name, names, scope)
        return text

    return Value(kind_name, read, lambda context: name_completions(hinted_names(context.scope)))


def name_completions(names: Mapping[str, str]) -> Iterator[Completion]:
    """Names with their hints."""
    return (Completion(text, hint) for text, hint in names.items())


def unknown_name_error(unknown_text: str, noun: str, names: Iterable[str]) -> TextError:
    """The error for a word that is not a known name, with the most similar name."""
    known_names = list(names)[:MAX_COMPARED_NAMES]
    nearest_name = nearest(unknown_text, known_names)
    message = f"{quote(unknown_text)} is not {noun}"
    if nearest_name is None:
        name_list = ", ".join(known_names[:8]) + (", …" if len(known_names) > 8 else "")
        message += f"; there are only {name_list}" if known_names else "; the score has none"
    return TextError(message, length=len(unknown_text), suggestion=nearest_name)


def unknown_instrument_error(
    slot_text: str, noun: str, known_names: Iterable[str], scope: Scope
) -> TextError:
    """The same for an instrument or one of its modules; names the family that has to come first."""
    name = slot_text.split(".")[0]
    family = unused_family(name, scope)
    return (
        unknown_name_error(slot_text, noun, known_names)
        if family is None
        else missing_family_error(name, family)
    )


def missing_family_error(instrument_name: str, family: str, advice: str = "") -> TextError:
    """The error for an instrument of a family that is not in use; `advice` is what to type next."""
    message = (
        f"{quote(instrument_name)} is an instrument of {family}, which is not in use: type `use "
        f"{family}`"
    )
    return TextError(
        f"{message}, then `{advice}`" if advice else message, length=len(instrument_name)
    )


def check_word(record: Record, field: str, line_word: str, word_offset: int) -> None:
    """Check a word that a field of a score takes. Raises TextError at `word_offset`."""
    shape = record.by_name[field].shape
    assert isinstance(shape, Text)
    try:
        shape.parse(line_word)
    except TextError as error:
        error.offset += word_offset
        raise


def check_new_name(new_name: str) -> str:
    """Check that a text may be a new name. Raises TextError."""
    if not NAME.fullmatch(new_name) or len(new_name) > MAX_NAME:
        message = f"{quote(new_name)} is not a name: a letter, then letters, digits, '-' and '_'"
        raise TextError(message, length=len(new_name))
    if new_name in RESERVED_WORDS:
        raise TextError(
            f"{quote(new_name)} is a word of the language and cannot be a name",
            length=len(new_name),
        )
    return new_name


def _read_free_name(new_name: str, scope: Scope, _: Mapping[str, Any]) -> str:
    check_new_name(new_name)
    taken_names = {*scope.gestures, *scope.takes, *scope.marks}
    if new_name in taken_names:
        number_match = re.fullmatch(r"(.+)-([0-9]{1,4})", new_name)
        stem, suffix = (
            (number_match[1], int(number_match[2]) + 1) if number_match else (new_name, 2)
        )
        while f"{stem}-{suffix}" in taken_names:
            suffix += 1
        message = f"the name {quote(new_name)} is in use"
        raise TextError(message, length=len(new_name), suggestion=f"{stem}-{suffix}")
    return new_name


def _read_gesture_name(gesture_name: str, scope: Scope, _: Mapping[str, Any]) -> str:
    if gesture_name in scope.gestures:
        return gesture_name
    if gesture_name in scope.takes:
        raise TextError(
            f"{quote(gesture_name)} is a take: give the gesture another name",
            length=len(gesture_name),
        )
    return check_new_name(gesture_name)


def excluding_earlier(compared_value: Value, earlier_field: str) -> Value:
    """A value that must differ from the one in `earlier_field`."""

    def read(slot_text: str, scope: Scope, earlier_values: Mapping[str, Any]) -> Any:
        if slot_text == earlier_values[earlier_field]:
            raise TextError(
                f"{quote(slot_text)} is named twice: name two different ones", length=len(slot_text)
            )
        return compared_value.read(slot_text, scope, earlier_values)

    def complete_others(context: CompletionContext) -> Iterator[Completion]:
        return (
            completion
            for completion in compared_value.completions(context)
            if completion.text != context.fields[earlier_field]
        )

    return Value(compared_value.description, read, complete_others)


def _read_with_level(level_name: str, scope: Scope, _: Mapping[str, Any]) -> str:
    """An instrument or a player; strikes are read by a form of their own."""
    if level_name in scope.instruments or level_name in scope.players:
        return level_name
    names = (*scope.instruments, *scope.players, *scope.strikes)
    raise unknown_instrument_error(
        level_name, "an instrument, a player or the name of strikes", names, scope
    )


def _read_player_or_strikes(section_name: str) -> Callable[[str, Scope, Mapping[str, Any]], str]:
    """Read a player, or the name of strikes: the message for a name that is neither lists both."""

    def read(slot_text: str, scope: Scope, _: Mapping[str, Any]) -> str:
        if slot_text not in getattr(scope, section_name):
            names = (*scope.players, *scope.strikes)
            raise unknown_name_error(slot_text, "a player or the name of strikes", names)
        return slot_text

    return read


def _no_completions(_: CompletionContext) -> tuple[Completion, ...]:
    return ()


PLAYER_VALUE = name_value("a player", "players")
_PLAYER_OR_STRIKES = name_value("a player or strikes", "players", "strikes")
PLAYER_OR_ALL = Value(
    "a player, strikes or all",
    lambda text, scope, earlier_values: (
        None if text == "all" else _PLAYER_OR_STRIKES.read(text, scope, earlier_values)
    ),
    lambda context: (*_PLAYER_OR_STRIKES.completions(context), Completion("all", "every player")),
)
TRANSFORMED_PLAYER = replace(_PLAYER_OR_STRIKES, read=_read_player_or_strikes("players"))
TRANSFORMED_STRIKES = replace(_PLAYER_OR_STRIKES, read=_read_player_or_strikes("strikes"))
PLAYED_VALUE = name_value("a gesture or a take", "gestures", "takes")
KEY_VALUE = name_value("a key", "keys")
OTHER_KEY = excluding_earlier(KEY_VALUE, "a")
OTHER_PLAYER = excluding_earlier(PLAYER_VALUE, "player")
SOUNDING_VALUE = name_value("an instrument or a player", "instruments", "players")
STRIKES_VALUE = name_value("the name of strikes", "strikes")
LEVELLED_VALUE = Value(
    "an instrument, a player or strikes", _read_with_level, SOUNDING_VALUE.completions
)
ANY_NAME = name_value(
    "a name of this score",
    *("gestures", "paths", "phrases", "takes", "players", "keys", "instruments", "marks"),
    *("strikes", "blocks"),
)
PLAYER_KEY_OR_INSTRUMENT = name_value(
    "a player, a key or an instrument", "players", "keys", "instruments"
)
GESTURE_NAME = Value(
    "a name", _read_gesture_name, lambda context: name_completions(context.scope.gestures)
)
NEW_NAME = Value("a new name", _read_free_name, _no_completions)


# --- what is struck -------------------------------------------------------------------------------


def module_names(scope: Scope) -> dict[str, str]:
    """The modules with masses of every instrument that a line may play, each with a hint."""
    return {
        f"{part}.{module}": f"a module of {part}"
        for part, modules in scope.modules.items()
        for module in modules
    }


def act_names(scope: Scope) -> dict[str, str]:
    """The acts with which a line may play an instrument, each with a hint."""
    return {
        f"{part}.{act}": f"a way to play {part}"
        for part, acts in scope.acts.items()
        for act in acts
    }


def complete_to_dot(typed: str, names: Mapping[str, str]) -> Iterator[Completion]:
    """Names, each up to the first dot behind what is typed."""
    for hinted_name, hint in names.items():
        if hinted_name.startswith(typed):
            dot_index = hinted_name.find(".", len(typed))
            yield (
                Completion(hinted_name, hint)
                if dot_index < 0
                else Completion(hinted_name[: dot_index + 1], "its modules")
            )


def struck_completions(context: CompletionContext) -> Iterator[Completion]:
    """Instruments that a line may play; behind a dot, the modules of one."""
    if "." in context.typed_text:
        yield from complete_to_dot(context.typed_text, act_names(context.scope))
        yield from complete_to_dot(context.typed_text, module_names(context.scope))
    else:
        yield from name_completions(playable_instruments(context.scope))


# --- what is played ------------------------------------------------------------------------------


def _point_completions(context: CompletionContext) -> Iterator[Completion]:
    if context.earlier_words and "@" not in context.earlier_words[0]:
        return  # no notation begins so
    number_match = NUMBER_PATTERN.fullmatch(context.typed_text.partition("@")[0])
    if context.typed_text and number_match is None:
        yield from _curve_completions(context)
    elif number_match is not None and "@" not in context.typed_text:
        yield from (
            Completion(f"{number_match.group()}{unit}@", "a position at …") for unit in _METRE_UNITS
        )
    elif not context.typed_text:
        yield Completion(
            "6mm@+1/8" if context.earlier_words else "0mm@0", "a point: position @ time"
        )
        yield from _curve_completions(context)


def _curve_completions(context: CompletionContext) -> Iterator[Completion]:
    if context.earlier_words and context.earlier_words[-1] not in CURVES:
        yield from (Completion(word, "the way into the next points") for word in CURVES)


def transform_completions(context: CompletionContext) -> Iterator[Completion]:
    """The names of transformations of gestures, or after one an example of its first value."""
    yield from _example_completions(
        context, {word: EXAMPLES[word] for word in GESTURE_ARGUMENT_COUNTS}
    )


def play_transform_completions(context: CompletionContext) -> Iterator[Completion]:
    """The names of all transformations that follow `do` of a player, or an example of a value."""
    examples = {**EXAMPLES, **{word: form.example for word, form in TURN_FORMS.items()}}
    yield from _example_completions(context, examples)


def _example_completions(
    context: CompletionContext, examples: Mapping[str, str]
) -> Iterator[Completion]:
    last_word = context.earlier_words[-1] if context.earlier_words else ""
    if ARGUMENT_COUNTS.get(last_word):
        yield Completion(EXAMPLES[last_word].split()[1], f"for instance {EXAMPLES[last_word]}")
    else:
        yield from (Completion(word, f"for instance {text}") for word, text in examples.items())


def _read_notation(slot_text: str) -> notation.Notation:
    """Read a gesture; for a path in space, its first axis."""
    if space_path.axis_count(slot_text) > 1:
        return space_path.parse(slot_text, events_max=MAX_POINTS)[0]
    return notation.parse(slot_text, events_max=MAX_POINTS)


_METRE_UNITS = [unit for unit in UNITS_PER_METRE if unit and unit.isascii()]
NOTATION_VALUE = Value(
    "a gesture, such as 0@0 6@1/8 0@1/4", lambda text, *_: _read_notation(text), _point_completions
)
DO_VALUE = Value(
    "transformations, such as rev, every 4 mirror",
    lambda text, *_: parse_chain(text),
    play_transform_completions,
)


# --- the rest ------------------------------------------------------------------------------------


def _read_file_name(file_text: str, *_: Any) -> str:
    file_word = (
        file_text[1:-1]
        if len(file_text) > 1 and file_text[0] == file_text[-1] == '"'
        else file_text
    )
    if '"' in file_word:
        raise TextError("the quotation mark is not closed", offset=file_text.index('"'))
    return str(value_kinds.PATH.parse(file_word))


def _file_completions(context: CompletionContext, with_suffix: bool = True) -> Iterator[Completion]:
    """The scores in the session's folder."""
    for path in scores_in(context.scope.folder):
        yield Completion(path.name if with_suffix else path.stem, "a score")


def _read_scenes(scenes_text: str, *_: Any) -> tuple[str, str | None]:
    placed_names = [(word.strip(), scenes_text.index(word)) for word in scenes_text.split("->")]
    if len(placed_names) > 2:
        raise TextError(
            "a scene goes to one other: scene A -> B over 4bar", length=len(scenes_text)
        )
    for scene_name, word_offset in placed_names:
        if not scene_name:
            raise TextError("a scene needs a name, such as verse-2", offset=len(scenes_text))
        if not NAME.fullmatch(scene_name) or len(scene_name) > MAX_NAME:
            message = f"{quote(scene_name)} is not the name of a scene, such as verse-2"
            raise TextError(message, offset=word_offset, length=max(1, len(scene_name)))
    return placed_names[0][0], placed_names[1][0] if len(placed_names) > 1 else None


def _scene_completions(context: CompletionContext) -> Iterator[Completion]:
    if not context.earlier_words or context.earlier_words[-1] == "->":
        yield from _file_completions(context, with_suffix=False)
    elif len(context.earlier_words) == 1:
        yield Completion("->", "to another scene")


FILE_VALUE = Value("the name of a file", _read_file_name, _file_completions)
SCENES_VALUE = Value("the name of a scene, such as verse-2", _read_scenes, _scene_completions)
EXPRESSION_VALUE = Value("a Python expression", lambda text, *_: text, _no_completions)
