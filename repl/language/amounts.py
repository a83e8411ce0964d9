"""Amounts in a line: quantities, times and levels, and the parameters that take them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any

from ergon.instruments.transpose import CENTS_SHAPE
from ergon.notation.clock.positions import Length, Position, parse_length, parse_position
from ergon.notation.tables import quantities, value_kinds
from ergon.notation.tables.shapes import Text
from ergon.notation.text.errors import TextError, quote
from ergon.repl.language.commands import NOW, Now, Sync
from ergon.repl.language.scope import Scope
from ergon.repl.language.values import (
    ANY_NAME,
    NUMBER_PATTERN,
    Completion,
    CompletionContext,
    Value,
    check_new_name,
    name_completions,
    name_value,
    unknown_name_error,
)
from ergon.scores.reading.automatable import amount_reader

# --- quantities ----------------------------------------------------------------------------------


def unit_completions(
    example: str, unit_names: Iterable[str], quantity_name: str
) -> Callable[[CompletionContext], Iterator[Completion]]:
    """Completions of a quantity: an example, or what is typed with each unit."""
    unit_words = [unit for unit in unit_names if unit.isascii()]

    def complete_units(context: CompletionContext) -> Iterator[Completion]:
        number_match = NUMBER_PATTERN.match(context.typed_text)
        if number_match is None:
            yield Completion(example, quantity_name)
        else:
            yield from (
                Completion(number_match.group() + unit, quantity_name) for unit in unit_words
            )

    return complete_units


def quantity_value(
    shape: Text, example_text: str, units: Iterable[str], description: str = ""
) -> Value:
    """A value that is read as a score reads it."""
    description = description or shape.what
    return Value(
        description,
        lambda text, *_: shape.parse(text),
        unit_completions(example_text, units, description),
    )


DIMENSIONS = {
    value_kinds.MASS: quantities.MASS,
    value_kinds.MASS_OR_NUMBER: quantities.MASS_OR_NUMBER,
    value_kinds.STIFFNESS: quantities.STIFFNESS,
    value_kinds.DAMPING: quantities.DAMPING,
    value_kinds.POSITION: quantities.POSITION,
    value_kinds.HARDENING: quantities.HARDENING,
    value_kinds.PITCH: quantities.FREQUENCY,
    value_kinds.DURATION: quantities.DURATION,
    value_kinds.FORCE: quantities.FORCE,
    value_kinds.PAUSE: quantities.INSTANT,
    value_kinds.CONSTANT: quantities.CONSTANT,
    CENTS_SHAPE: quantities.Dimension("interval", {"cents": 0, "st": 2}, "2st"),
}


def dimension_value(shape: Text) -> Value:
    """A quantity with the units of its dimension."""
    dimension = DIMENSIONS.get(shape, quantities.NUMBER)
    return quantity_value(shape, dimension.example, dimension.units)


def _read_level(slot_text: str, scope: Scope, _: Mapping[str, Any]) -> Any:
    if slot_text in scope.instruments or slot_text in scope.players or slot_text in scope.strikes:
        message = f"a level is missing: gain {slot_text} -6dB"
        raise TextError(message, offset=len(slot_text))
    return value_kinds.GAIN.parse(slot_text)


def _read_gain(slot_text: str, scope: Scope, earlier_values: Mapping[str, Any]) -> float:
    gain_ratio: float = _read_level(slot_text, scope, earlier_values)
    if gain_ratio > GAIN_MAX:
        message = f"{slot_text.strip()} is above the highest level, {quantities.LOUDEST_DB:g}dB"
        raise TextError(message, length=len(slot_text))
    return gain_ratio


_LENGTH_UNITS = ("bar", "beats", "s", "ms")
GAIN_MAX = 10.0 ** (quantities.LOUDEST_DB / 20.0) * (1.0 + 1e-9)  # 24dB itself is taken


def _read_length(slot_text: str, *_: Any) -> Length:
    parsed_length = parse_length(slot_text)
    if not (parsed_length.bars or parsed_length.beats or parsed_length.seconds):
        raise TextError(
            f"the length {quote(slot_text)} is zero: write one such as 1bar", length=len(slot_text)
        )
    return parsed_length


def _read_signed_length(slot_text: str, *_: Any) -> Length:
    sign = slot_text[:1] if slot_text[:1] in ("+", "-") else ""
    try:
        return parse_length(slot_text[len(sign) :]).times(-1.0 if sign == "-" else 1.0)
    except TextError as error:
        error.offset += len(sign)
        raise


_GRID_BY_WORD: dict[str, Now | Length] = {
    "now": NOW,
    "beat": Length(beats=1.0),
    "bar": Length(bars=1.0),
}


def _read_grid(grid_text: str, *_: Any) -> Now | Length:
    if grid_text in _GRID_BY_WORD:
        return _GRID_BY_WORD[grid_text]
    if grid_text[:1].isalpha():
        raise unknown_name_error(grid_text, "a boundary", (*_GRID_BY_WORD, "2bar"))
    grid_length = _read_length(grid_text)
    if grid_length.seconds:
        message = "a boundary lies on beats or bars, not on seconds: write one such as 2bar"
        raise TextError(message, length=len(grid_text), suggestion="bar")
    return grid_length


def read_position(text: str, scope: Scope, _: Mapping[str, Any] | None = None) -> Position:
    """Read a position whose mark must exist. Raises TextError."""
    parsed_position = parse_position(text)
    if (
        parsed_position.mark is not None
        and parsed_position.text not in scope.marks
        and parsed_position.mark not in scope.marks
    ):
        raise unknown_name_error(parsed_position.mark, "a mark", scope.marks)
    return parsed_position


def position_completions(context: CompletionContext) -> Iterator[Completion]:
    """Marks, and an example of a bar."""
    yield from name_completions(context.scope.marks)
    yield Completion("9|1", "bar 9, beat 1")


LENGTH_VALUE = Value(
    "a length, such as 2bar, 1/2 (beats) or 250ms",
    _read_length,
    unit_completions("2bar", _LENGTH_UNITS, "a length"),
)
SHIFT_VALUE = Value(
    "a time, such as 10ms or -10ms",
    _read_signed_length,
    unit_completions("10ms", _LENGTH_UNITS, "time"),
)
POSITION_VALUE = Value(
    "a position, such as 9|1, a mark or 12.5s", read_position, position_completions
)
_VOICE_VALUE = name_value("the name of strikes, or a player", "strikes", "players")
# That the voice exists is checked when the line is typed, not when it is replayed: the voice may be
# gone then, and the beat is known.
SYNC_VALUE = Value(
    _VOICE_VALUE.description, lambda text, *_: Sync(check_new_name(text)), _VOICE_VALUE.completions
)
GRID_VALUE = Value(
    "a boundary: now, beat, bar or a length such as 2bar",
    _read_grid,
    lambda context: name_completions(dict.fromkeys((*_GRID_BY_WORD, "2bar"), "a boundary")),
)
_BPM_OFFERS = {0: (Completion("72", "bpm"),), 1: (Completion("->", "to another tempo"),)}
BPM_VALUE = Value(
    "a tempo, such as 72 or 60 -> 84",
    lambda text, *_: value_kinds.BPM.parse(text),
    lambda context: _BPM_OFFERS.get(len(context.earlier_words), ()),
)
STIFFNESS_VALUE = dimension_value(value_kinds.STIFFNESS)
DAMPING_VALUE = dimension_value(value_kinds.DAMPING)
DURATION_VALUE = quantity_value(value_kinds.DURATION, "3s", quantities.DURATION.units)
_LEVEL_OFFERS = unit_completions("-6dB", ("dB",), "a level")
LEVEL_VALUE = Value("a level, such as -6dB or x0.5", _read_level, _LEVEL_OFFERS)
GAIN_VALUE = Value("a level, such as -6dB or x0.5", _read_gain, _LEVEL_OFFERS)
METER_VALUE = quantity_value(value_kinds.METER, "3/4", ())
TIMES_VALUE = quantity_value(value_kinds.TIMES, "8", ())
COUNT_VALUE = quantity_value(value_kinds.integer(1, 10_000, "3"), "3", (), "how many, such as 3")
SEED_VALUE = quantity_value(value_kinds.integer(0, 2**64 - 1, "7"), "7", (), "a whole number")


# --- parameters --------------------------------------------------------------------------------


def _near_targets(path_text: str, scope: Scope) -> list[str]:
    """The parameters of the module, or else the part, that a wrong path names; or all."""
    path_head = path_text.rpartition(".")[0]
    while path_head:
        near_targets = [target for target in scope.targets if target.startswith(f"{path_head}.")]
        if near_targets:
            return near_targets
        path_head = path_head.rpartition(".")[0]
    return list(scope.targets)


def _read_target(path_text: str, scope: Scope, _: Mapping[str, Any]) -> str:
    if path_text not in scope.targets:
        raise unknown_name_error(path_text, "a parameter", _near_targets(path_text, scope))
    return path_text


def _read_change(
    change_text: str, scope: Scope, earlier_values: Mapping[str, Any]
) -> tuple[float | None, float | None]:
    target_path = earlier_values["target"]
    shape = scope.targets[target_path]
    if shape is CENTS_SHAPE:
        return shape.parse(change_text), None
    amount = amount_reader(shape.parse, target_path.rpartition(".")[2])(change_text)
    return (None, amount.value) if amount.is_factor else (amount.value, None)


def _change_completions(context: CompletionContext) -> Iterator[Completion]:
    if not context.typed_text.startswith("x"):
        yield from dimension_value(context.scope.targets[context.fields["target"]]).completions(
            context
        )
    yield Completion("x1.5", "so many times what it is")


def _target_completions(context: CompletionContext) -> Iterator[Completion]:
    """The completions up to the next dot: a part, then its modules, then their parameters."""
    typed_text = context.typed_text
    for target_path, shape in context.scope.targets.items():
        if target_path.startswith(typed_text):
            dot_index = target_path.find(".", len(typed_text))
            if dot_index < 0:
                yield Completion(target_path, shape.what)
            else:
                yield Completion(target_path[: dot_index + 1], "its parameters")


TARGET_VALUE = Value("a parameter, such as bell.m.K", _read_target, _target_completions)
TUNING = "tuning"  # what `show` may be followed by, as by a name of the score


def _read_shown_name(name_text: str, scope: Scope, earlier_values: Mapping[str, Any]) -> str:
    shown_name: str = (
        name_text
        if name_text == TUNING or name_text in scope.targets
        else ANY_NAME.read(name_text, scope, earlier_values)
    )
    return shown_name


def _shown_completions(context: CompletionContext) -> Iterator[Completion]:
    yield from ANY_NAME.completions(context)
    yield Completion(TUNING, "which frequencies notes have")
    yield from _target_completions(context)


NAME_OR_PARAMETER = Value("a name of this score", _read_shown_name, _shown_completions)
CHANGE_VALUE = Value(
    "a value with its unit, or a factor such as x1.5", _read_change, _change_completions
)
