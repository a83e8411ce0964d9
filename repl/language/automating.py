"""The words after `set` and `lfo` that make a parameter change by itself."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from ergon.notation.tables import value_kinds
from ergon.notation.tables.shapes import Text
from ergon.notation.text.errors import TextError
from ergon.notation.text.spelling import nearest
from ergon.repl.language import amounts, values
from ergon.repl.language.commands import BlockCommand, When, Word
from ergon.repl.language.forms import OFF_SLOT, Slot, form
from ergon.repl.language.midi import source_word_count
from ergon.repl.language.scope import MIDI_SUFFIXES, Scope, files_in
from ergon.scores.gesture.midi_source import SOURCES, parse_source
from ergon.scores.pattern.order import CHOICE_WORDS
from ergon.scores.pattern.values import ReadAmount, parse_values
from ergon.scores.pattern.words import parse_strikes
from ergon.scores.reading.automatable import ALL_PARAMETERS, amount_reader
from ergon.scores.reading.automation import AUTOMATION_RECORD, parse_range
from ergon.scores.reading.curves import is_curve, parse_curve


@dataclass(frozen=True, slots=True)
class Automate(BlockCommand):
    """`set bell.m.f A3 C4 E4 every 1`, `lfo bell.m.K 0.8..1.2 period 4bar`: automate a parameter.

    `kind` is `set` or `lfo`; the fields are those of `automation:` in a score, as texts.
    """

    target: str
    kind: str
    fields: Mapping[str, str]


@dataclass(frozen=True, slots=True)
class StopLfo(BlockCommand):
    """`lfo bell.m.K off`: the parameter has its own value again."""

    target: str


_SET_OPTIONS = {
    "every": "1",
    "times": "4",
    "until": "C",
    "chance": "0.6",
    "euclid": "3 8",
    "swing": "0.6",
    "skip": "5",
}
_LFO_OPTIONS = {"period": "4bar", "shape": "sine", "until": "C", "phase": "0.25"}


def _read_target(path_text: str, scope: Scope, earlier_values: Mapping[str, Any]) -> str:
    target_path = str(amounts.TARGET_VALUE.read(path_text, scope, earlier_values))
    if target_path.rpartition(".")[2] not in ALL_PARAMETERS:
        known_parameters = ", ".join(ALL_PARAMETERS)
        message = f"only these parameters change by themselves: {known_parameters}"
        raise TextError(message, length=len(path_text))
    return target_path


def _split_options(
    line_text: str, scope: Scope, option_examples: Mapping[str, str]
) -> tuple[str, int, dict[str, str]]:
    """The text before the options, where it ends, and the options, each of them checked."""
    try:
        value_words, placed_options = parse_strikes(line_text, option_examples)
    except TextError as error:
        faulty_word = line_text[error.offset : error.offset + error.length]
        if faulty_word in option_examples:
            error.suggestion = f"{faulty_word} {option_examples[faulty_word]}"
        raise
    for option_name, option_word in placed_options.items():
        field_shape = AUTOMATION_RECORD.by_name[option_name].shape
        try:
            if option_name == "until":
                amounts.POSITION_VALUE.read(option_word.text, scope, {})
            elif isinstance(field_shape, Text):
                field_shape.parse(option_word.text)
        except TextError as error:
            error.offset += option_word.offset
            raise
    values_end = value_words[-1].offset + len(value_words[-1].text) if value_words else 0
    return (
        line_text[:values_end],
        values_end,
        {name: word.text for name, word in placed_options.items()},
    )


def _amount_reader(scope: Scope, earlier_values: Mapping[str, Any]) -> ReadAmount:
    target = earlier_values["target"]
    return amount_reader(scope.targets[target].parse, target.rpartition(".")[2])


def _read_set(slot_text: str, scope: Scope, earlier_values: Mapping[str, Any]) -> Mapping[str, str]:
    """The fields of `set` as texts."""
    values_text, values_end, placed_options = _split_options(slot_text, scope, _SET_OPTIONS)
    read_amount = _amount_reader(scope, earlier_values)
    for word_match in re.finditer(r"[a-z]{2,}(?=\s|$)", values_text):
        if word_match.group() == "over":  # the words before `over` are no values
            read_amount(values_text[: word_match.start()].strip())
        suggestion = nearest(word_match.group(), (*_SET_OPTIONS, "over", *CHOICE_WORDS))
        if suggestion is not None and word_match.group() not in CHOICE_WORDS:
            message = f"unknown word '{word_match.group()}'"
            length = len(word_match.group())
            raise TextError(
                message, offset=word_match.start(), length=length, suggestion=suggestion
            )
    if is_curve(values_text):
        parse_curve(values_text, read_amount)
        if extra_options := placed_options.keys() - {"until"}:
            raise TextError(
                f"a curve has no steps; leave out `{min(extra_options)}`", offset=values_end
            )
        return {"to": " ".join(values_text.split()), **placed_options}
    is_pitch = earlier_values["target"].endswith(".f")
    parse_values(values_text, read_amount, is_pitch=is_pitch)
    if not placed_options.keys() & {"every", "euclid"}:
        message = "several values need the length of a step: every 1"
        raise TextError(message, offset=values_end, length=max(1, len(slot_text) - values_end))
    return {"to": " ".join(values_text.split()), **placed_options}


def _read_lfo(slot_text: str, scope: Scope, earlier_values: Mapping[str, Any]) -> Mapping[str, str]:
    """The fields of `lfo` as texts."""
    range_text, range_end, placed_options = _split_options(slot_text, scope, _LFO_OPTIONS)
    parse_range(range_text, _amount_reader(scope, earlier_values))
    if "period" not in placed_options:
        message = "the length of one swing is missing: period 4bar"
        raise TextError(message, offset=range_end, length=max(1, len(slot_text) - range_end))
    return {"range": range_text, **placed_options}


def _option_completions(option_examples: Mapping[str, str], first_example: str = "") -> Any:
    def complete_options(context: values.CompletionContext) -> Iterator[values.Completion]:
        if not context.earlier_words:
            shape = context.scope.targets[context.fields["target"]]
            value_completions = (
                (values.Completion(first_example, "its ends"),)
                if first_example
                else amounts.dimension_value(shape).completions(context)
            )
            yield from value_completions
            return
        last_word = context.earlier_words[-1]
        if last_word in option_examples:
            yield values.Completion(
                option_examples[last_word].split()[0], AUTOMATION_RECORD.by_name[last_word].doc
            )
            return
        for name in option_examples:
            if name not in context.earlier_words:
                yield values.Completion(name, AUTOMATION_RECORD.by_name[name].doc)

    return complete_options


def _read_source(text: str, *_: object) -> str:
    parse_source(text)
    return " ".join(text.split())


def _source_completions(context: values.CompletionContext) -> Iterator[values.Completion]:
    if context.earlier_words[-1:] == ("cc",):
        yield values.Completion("1/33", "a controller, or two")
        return
    for word, hint in SOURCES.items():
        yield values.Completion(word.partition(" ")[0], hint)


def _read_range_ends(text: str, scope: Scope, earlier_values: Mapping[str, Any]) -> str:
    parse_range(text, _amount_reader(scope, earlier_values))
    return text


def _midi_file_completions(context: values.CompletionContext) -> Iterator[values.Completion]:
    for path in files_in(context.scope.folder, MIDI_SUFFIXES):
        yield values.Completion(path.name, "a MIDI file")


def follow_file(
    target: str,
    file: str,
    source: str,
    ends: str,
    *,
    channel: int | None = None,
    start: str | None = None,
    until: str | None = None,
    when: When,
    words: Mapping[str, Word],
) -> Automate:
    """`set bell.m.K from tune.mid by cc 1 range 1..5`."""
    file_options = {"channel": channel, "start": start, "until": until}
    written_texts = {
        name: words[name].text for name, value in file_options.items() if value is not None
    }
    fields = {"from": file, "by": source, "range": ends, **written_texts}
    return Automate(target, "set", fields, when=when, words=words)


MIDI_FILE = values.Value(
    "the name of a MIDI file, such as tune.mid", values.FILE_VALUE.read, _midi_file_completions
)
FILE_SOURCE = values.Value(
    "what moves in the file, such as cc 1",
    _read_source,
    _source_completions,
    word_count=source_word_count,
    first_words=("cc", "bend", "pressure"),
)
FILE_RANGE = values.Value(
    "two values or factors, such as 1..5",
    _read_range_ends,
    lambda _: [values.Completion("0.8..1.2", "ends")],
)
CHANNEL_VALUE = amounts.quantity_value(
    value_kinds.integer(1, 16, "1"), "1", (), "a channel from 1 to 16"
)
FILE_START = amounts.quantity_value(
    value_kinds.RATIO, "32", (), "quarter notes of the file that are left out"
)
AUTOMATED_TARGET = values.Value(
    "a parameter, such as bell.m.f", _read_target, amounts.TARGET_VALUE.completions
)
AUTOMATION_VALUES = values.Value(
    "values and the length of a step", _read_set, _option_completions(_SET_OPTIONS)
)
LFO_VALUE = values.Value(
    "a range and a period", _read_lfo, _option_completions(_LFO_OPTIONS, "0.8..1.2")
)


def automate(
    target: str, fields: Mapping[str, str], *, when: When, words: Mapping[str, Word]
) -> Automate:
    """`set` with several values or a curve."""
    return Automate(target, "set", fields, when=when, words=words)


def automate_lfo(
    target: str, fields: Mapping[str, str], *, when: When, words: Mapping[str, Word]
) -> Automate:
    """`lfo`."""
    return Automate(target, "lfo", fields, when=when, words=words)


def stop_lfo(target: str, *, when: When, words: Mapping[str, Word]) -> StopLfo:
    """`lfo bell.m.K off`."""
    return StopLfo(target, when=when, words=words)


# fmt: off
SET_PATTERN_FORM = form("set", "set", "a parameter follows a pattern of values, or a curve",
    "set bell.m.f A3 C4 E4 every 1", automate,
    Slot("target", "PATH", AUTOMATED_TARGET),
    Slot("fields", "VALUE … every LENGTH …", AUTOMATION_VALUES, takes_many=True))
SET_FILE_FORM = form("set", "set", "a parameter follows a MIDI file",
    "set bell.m.K from tune.mid by cc 1/33 range 0.5..2", follow_file,
    Slot("target", "PATH", AUTOMATED_TARGET),
    Slot("file", "FILE", MIDI_FILE, "from"),
    Slot("source", "cc N|bend|pressure [NOTE]", FILE_SOURCE, "by"),
    Slot("ends", "LOW..HIGH", FILE_RANGE, "range"),
    Slot("channel", "N", CHANNEL_VALUE, "channel", optional=True),
    Slot("start", "QUARTERS", FILE_START, "start", optional=True),
    Slot("until", "WHERE", amounts.POSITION_VALUE, "until", optional=True))
LFO_FORM = form("lfo", "lf", "a parameter swings between two values",
    "lfo bell.m.K 0.8..1.2 period 4bar", automate_lfo,
    Slot("target", "PATH", AUTOMATED_TARGET),
    Slot("fields", "LOW..HIGH period LENGTH [shape SHAPE] …", LFO_VALUE,
    takes_many=True))
LFO_OFF_FORM = form("lfo", "lf", "a parameter has its own value again",
    "lfo bell.m.K off", stop_lfo,
    Slot("target", "PATH", AUTOMATED_TARGET), OFF_SLOT)
# fmt: on
