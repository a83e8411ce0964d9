"""Values of lines that place instruments in space: pan, rooms, fades."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from ergon.notation.clock.positions import Length
from ergon.notation.tables import value_kinds
from ergon.notation.tables.shapes import Text
from ergon.notation.text.errors import TextError, quote
from ergon.repl.language import amounts, structure, values
from ergon.repl.language.commands import BlockCommand, Command, When
from ergon.repl.language.forms import Slot, Words, form
from ergon.repl.language.scope import Scope
from ergon.repl.language.structure import check_value, field_pairs
from ergon.repl.language.values import Completion, CompletionContext, Value
from ergon.scores.reading.mix_tables import ROOM_RECORD


@dataclass(frozen=True, slots=True)
class Route(BlockCommand):
    """Set the channels, gain, pan and room of an instrument.

    None leaves a setting as it was. `send` is a room and a level.
    """

    name: str
    channels: tuple[str, ...] | None
    gain: float | None = None
    pan: float | None = None
    send: tuple[str, str] | None = None


@dataclass(frozen=True, slots=True)
class MovePan(Command):
    """Move an instrument to a place between its two channels, over a length."""

    name: str
    pan: float
    over: Length


@dataclass(frozen=True, slots=True)
class Filter(BlockCommand):
    """Set a filter or the delay of an instrument: the fields of its routes and their texts.

    An empty mapping removes it.
    """

    name: str
    kind: str
    fields: Mapping[str, str]


@dataclass(frozen=True, slots=True)
class Room(Command):
    """Add a room, or change fields of one, as written."""

    name: str
    fields: Mapping[str, str]


@dataclass(frozen=True, slots=True)
class Fade(Command):
    """Fade in or out, over a length: an instrument, or everything if the name is None."""

    name: str | None
    is_in: bool
    over: Length


_ROOM_FIELD_BY_NAME = {field.name: field for field in ROOM_RECORD.fields if field.name != "to"}
_MASTER_NAME = "master"
_SEND_EXAMPLE = "send hall -12dB"


def route(
    name: str,
    channels: tuple[str, ...] | None = None,
    gain: float | None = None,
    pan: float | None = None,
    send: tuple[str, str] | None = None,
    *,
    when: When,
    words: Words,
) -> Route:
    """Set where an instrument sounds; what is None stays as it was."""
    return Route(name, channels, gain, pan, send, when=when, words=words)


def set_filter(
    name: str, kind: str, fields: Mapping[str, str], *, when: When, words: Words
) -> Filter:
    """Set a filter or the delay of an instrument, or remove it."""
    return Filter(name, kind, fields, when=when, words=words)


def fade(name: str, way: str, over: Length, *, when: When, words: Words) -> Fade:
    """Fade an instrument, or everything, in or out."""
    return Fade(None if name == _MASTER_NAME else name, way == "in", over, when=when, words=words)


def _read_send(slot_text: str, scope: Scope, _: Mapping[str, Any]) -> tuple[str, str]:
    room_name, *level_words = slot_text.split()
    if room_name not in scope.rooms:
        raise values.unknown_name_error(
            room_name, "a room; `room hall t60=2s` adds one", scope.rooms
        )
    if len(level_words) != 1:
        raise TextError(f"a send needs a room and a level: {_SEND_EXAMPLE}", offset=len(slot_text))
    try:
        value_kinds.GAIN.parse(level_words[0])
    except TextError as error:
        error.offset += slot_text.index(level_words[0], len(room_name))
        raise
    return room_name, level_words[0]


def _send_completions(context: CompletionContext) -> Iterator[Completion]:
    if not context.earlier_words:
        return values.name_completions(context.scope.rooms)
    return iter((Completion("-12dB", "a level"),) if len(context.earlier_words) == 1 else ())


def _read_filter_kind(text: str, *_: Any) -> str:
    if text not in _FILTER_SHAPES:
        raise values.unknown_name_error(text, "a filter of a route", tuple(_FILTER_SHAPES))
    return text


def _read_filter_fields(
    slot_text: str, _: Scope, earlier_values: Mapping[str, Any]
) -> dict[str, str]:
    if slot_text == "off":
        return {}
    field_shapes = _FILTER_SHAPES[earlier_values["kind"]]
    word_matches = list(re.finditer(r"\S+", slot_text))
    if len(word_matches) > len(field_shapes):
        kind = earlier_values["kind"]
        message = f"{kind} takes no more than {len(field_shapes)}, such as {_FILTER_EXAMPLES[kind]}"
        raise TextError(
            message,
            offset=word_matches[len(field_shapes)].start(),
            length=len(word_matches[-1].group()),
        )
    filter_fields: dict[str, str] = {}
    for word_match, (name, shape) in zip(word_matches, field_shapes.items(), strict=False):
        check_value(shape, word_match.group(), word_match.start())
        filter_fields[name] = word_match.group()
    if "gain" in field_shapes and "gain" not in filter_fields:
        message = f"a level is missing, such as {_FILTER_EXAMPLES[earlier_values['kind']]}"
        raise TextError(message, offset=len(slot_text))
    return filter_fields


def _filter_completions(context: CompletionContext) -> Iterator[Completion]:
    if not context.earlier_words:
        yield Completion("off", "without it")


def _read_room_name(text: str, scope: Scope, _: Mapping[str, Any]) -> str:
    return text if text in scope.rooms else values.check_new_name(text)


def _read_room_fields(text: str, *_: Any) -> dict[str, str]:
    room_fields: dict[str, str] = {}
    for field_name, field_text, field_offset in field_pairs(text):
        if field_name not in _ROOM_FIELD_BY_NAME:
            message = (
                f"a room has no field {quote(field_name)}; it has {', '.join(_ROOM_FIELD_BY_NAME)}"
            )
            raise TextError(message, offset=field_offset, length=len(field_name))
        if field_name in room_fields:
            raise TextError(
                f"{quote(field_name)} is written twice", offset=field_offset, length=len(field_name)
            )
        shape = (
            value_kinds.DURATION if field_name == "t60" else _ROOM_FIELD_BY_NAME[field_name].shape
        )
        if isinstance(shape, Text):
            check_value(shape, field_text, field_offset + len(field_name) + 1)
        room_fields[field_name] = field_text
    return room_fields


def _room_completions(_: CompletionContext) -> Iterator[Completion]:
    return (Completion(f"{name}=", field.doc) for name, field in _ROOM_FIELD_BY_NAME.items())


def _read_faded_name(faded_name: str, scope: Scope, _: Mapping[str, Any]) -> str:
    if faded_name != _MASTER_NAME and faded_name not in scope.instruments:
        raise values.unknown_instrument_error(
            faded_name, "an instrument or master", (*scope.instruments, _MASTER_NAME), scope
        )
    return faded_name


def _faded_completions(context: CompletionContext) -> Iterator[Completion]:
    return values.name_completions({**context.scope.instruments, _MASTER_NAME: "everything"})


def _read_fade_direction(text: str, *_: Any) -> str:
    if not re.fullmatch("in|out", text):
        raise TextError(f"{quote(text)} is neither in nor out", length=len(text))
    return text


_SHELF_SHAPES: Mapping[str, Text] = {"f": value_kinds.HERTZ, "gain": value_kinds.GAIN}
# What is written after a filter, in order.
_FILTER_SHAPES: Mapping[str, Mapping[str, Text]] = {
    "lowpass": {"": value_kinds.HERTZ},
    "highpass": {"": value_kinds.HERTZ},
    "lowshelf": _SHELF_SHAPES,
    "highshelf": _SHELF_SHAPES,
    "delay": {"time": value_kinds.DURATION, "feedback": value_kinds.GAIN},
}
_FILTER_EXAMPLES = {
    "lowpass": "2kHz",
    "highpass": "80Hz",
    "lowshelf": "200Hz -3dB",
    "highshelf": "4kHz -6dB",
    "delay": "250ms -6dB",
}
FILTER_KIND = Value(
    f"a filter of a route: {', '.join(_FILTER_SHAPES)}",
    _read_filter_kind,
    lambda _: (Completion(kind, example) for kind, example in _FILTER_EXAMPLES.items()),
)
FILTER_FIELDS = Value(
    "a frequency, a shelf such as 200Hz -3dB, a time such as 250ms, or off",
    _read_filter_fields,
    _filter_completions,
)
PAN_VALUE = amounts.quantity_value(
    value_kinds.PAN, "-0.3", (), "a place from -1 (first channel) to 1 (second)"
)
SEND_VALUE = Value(f"a room and a level, such as {_SEND_EXAMPLE}", _read_send, _send_completions)
ROOM_NAME = Value(
    "a name of a room",
    _read_room_name,
    lambda context: values.name_completions(context.scope.rooms),
)
ROOM_FIELDS = Value("fields, such as t60=2s size=12m", _read_room_fields, _room_completions)
FADED_VALUE = Value("an instrument or master", _read_faded_name, _faded_completions)
FADE_DIRECTION = Value(
    "in or out",
    _read_fade_direction,
    lambda _: (Completion("out", "to silence"), Completion("in", "from silence")),
)


# fmt: off
ROUTE_FORM = form("route", "ro", "an instrument sounds from these channels, and no others",
    "route bell 3 4 gain -6dB pan -0.3", route,
    Slot("name", "INSTRUMENT", structure.INSTRUMENT_VALUE),
    Slot("channels", "CHANNEL …|nearest", structure.CHANNELS_VALUE, takes_many=True),
    Slot("gain", "LEVEL", amounts.LEVEL_VALUE, "gain", optional=True),
    Slot("pan", "PLACE", PAN_VALUE, "pan", optional=True))
ROUTE_GAIN_FORM = form("route", "ro", "an instrument has this level where it sounds",
    "route bell gain -6dB", route, Slot("name", "INSTRUMENT", structure.INSTRUMENT_VALUE),
    Slot("gain", "LEVEL", amounts.LEVEL_VALUE, "gain"))
ROUTE_PAN_FORM = form("route", "ro", "an instrument sounds from here between its two channels",
    "route bell pan -0.3", route, Slot("name", "INSTRUMENT", structure.INSTRUMENT_VALUE),
    Slot("pan", "PLACE", PAN_VALUE, "pan"))
PAN_FORM = form("pan", "pan", "an instrument sounds from here between its two channels",
    "pan bell -0.3", route, Slot("name", "INSTRUMENT", structure.INSTRUMENT_VALUE),
    Slot("pan", "PLACE", PAN_VALUE))
MOVE_PAN_FORM = form("pan", "pan", "an instrument moves to here between its two channels",
    "pan bell 0.8 over 4bar", MovePan, Slot("name", "INSTRUMENT", structure.INSTRUMENT_VALUE),
    Slot("pan", "PLACE", PAN_VALUE), Slot("over", "LENGTH", amounts.LENGTH_VALUE, "over"))
FILTER_FORM = form("filter", "fil", "a filter or a delay on what is heard; off: without",
    "filter bell lowpass 2kHz", set_filter,
    Slot("name", "INSTRUMENT", structure.INSTRUMENT_VALUE),
    Slot("kind", "lowpass|highpass|lowshelf|highshelf|delay", FILTER_KIND),
    Slot("fields", "VALUE [LEVEL]|off", FILTER_FIELDS, takes_many=True))
SEND_FORM = form("route", "ro", "an instrument sounds in a room too",
    "route bell send hall -12dB", route, Slot("name", "INSTRUMENT", structure.INSTRUMENT_VALUE),
    Slot("send", "ROOM LEVEL", SEND_VALUE, "send", takes_many=True))
ROOM_FORM = form("room", "roo", "adds a room that routes send to, or changes one",
    "room hall t60=2s size=12m", Room,
    Slot("name", "NAME", ROOM_NAME),
    Slot("fields", "FIELD=VALUE …", ROOM_FIELDS, takes_many=True))
FADE_FORM = form("fade", "fa", "fades an instrument or everything in or out",
    "fade bell out over 8bar", fade,
    Slot("name", "INSTRUMENT|master", FADED_VALUE),
    Slot("way", "in|out", FADE_DIRECTION),
    Slot("over", "LENGTH", amounts.LENGTH_VALUE, "over"))
# fmt: on
