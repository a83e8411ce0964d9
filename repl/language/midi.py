"""MIDI at the prompt: what moves, what notes strike or play, and what they are mapped to."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from ergon.notation.clock.tempo import parse_bpm
from ergon.notation.tables import quantities, value_kinds
from ergon.notation.tables.strengths import level
from ergon.notation.tables.velocities import LAWS
from ergon.notation.text.errors import TextError, quote
from ergon.repl.language import amounts, values
from ergon.repl.language.commands import When
from ergon.repl.language.forms import OFF_SLOT, PLAYER_SLOT, Slot, Words, form
from ergon.repl.language.mapping import (
    BPM_UNIT,
    EVEN_CURVE,
    LEARN,
    Learn,
    MapControl,
    MapNotes,
    Maps,
    Monitor,
    Unmap,
)
from ergon.repl.language.scope import Scope, playable_instruments
from ergon.repl.language.values import Completion, CompletionContext, Value
from ergon.scores.gesture import midi_source
from ergon.scores.gesture.midi_notes import note_number
from ergon.scores.gesture.midi_source import parse_source

# What a map of a controller may begin with, and what that is.
SOURCES = {**midi_source.SOURCES, LEARN: "the next of these that moves"}


# --- what moves ----------------------------------------------------------------------------------


def _read_source(source_text: str, *_: Any) -> str:
    if source_text == LEARN:
        return source_text
    source_name = source_text.partition(" ")[0]
    source_names = [source for source in SOURCES if " " not in source]
    if source_name not in ("cc", *source_names) or (
        source_name == "bend" and source_name != source_text
    ):
        raise values.unknown_name_error(source_text, "what moves", ("cc 21", *source_names))
    return str(parse_source(source_text))


def is_source(slot_text: str) -> bool:
    """Whether a text names a source of a map."""
    try:
        return slot_text != LEARN and _read_source(slot_text) == slot_text
    except TextError:
        return False


def source_word_count(line_words: Sequence[str]) -> int:
    """How many of these words say what moves."""
    if line_words[:1] == ["cc"]:
        return 2
    if line_words[:1] == ["pressure"] and len(line_words) > 1:
        try:
            note_number(line_words[1])
        except TextError:
            return 1
        return 2
    return 1


def _source_offers(context: CompletionContext) -> Iterator[Completion]:
    if context.earlier_words[-1:] == ("cc",):
        yield Completion("21", "a controller, 0 to 127")
        return
    for source, hint in SOURCES.items():
        yield Completion(source.partition(" ")[0], hint)


SOURCE_VALUE = Value(
    "what moves (cc 21, bend, pressure or learn)",
    _read_source,
    _source_offers,
    word_count=source_word_count,
    first_words=("cc", "bend", "pressure", LEARN),
)


# --- what it leads to ----------------------------------------------------------------------------


def _range_ends(slot_text: str, example: str) -> tuple[str, str]:
    """Both ends of a range; a single value is both."""
    low_end, dots, high_end = slot_text.partition("..")
    if dots and not (low_end and high_end):
        raise TextError(f"a range has two ends, such as {example}", length=max(1, len(slot_text)))
    return low_end, high_end or low_end


def _read_range(
    slot_text: str, scope: Scope, earlier_values: Mapping[str, Any]
) -> tuple[float, float, str]:
    shape = scope.targets[earlier_values["target"]]
    dimension = amounts.DIMENSIONS.get(shape, quantities.NUMBER)
    low_value, high_value = (
        float(shape.parse(end)) for end in _range_ends(slot_text, f"{dimension.example}..…")
    )
    # A constant of a law is in SI units, whatever its dimension.
    return low_value, high_value, "" if shape is value_kinds.CONSTANT else dimension.si


def _range_completions(context: CompletionContext) -> Iterator[Completion]:
    shape = context.scope.targets[context.fields["target"]]
    yield from amounts.dimension_value(shape).completions(context)


def _read_levels(range_text: str, *_: Any) -> tuple[float, float]:
    low_level, high_level = (
        value_kinds.LEVEL.parse(end) for end in _range_ends(range_text, "-40dB..0dB")
    )
    if max(low_level, high_level) > quantities.LOUDEST_DB:
        message = f"{quote(range_text)} goes above the highest level, {quantities.LOUDEST_DB:g}dB"
        allowed_range = "..".join(
            f"{min(end, quantities.LOUDEST_DB):g}dB" for end in (low_level, high_level)
        )
        raise TextError(message, length=len(range_text), suggestion=allowed_range)
    return low_level, high_level


def _read_tempos(slot_text: str, *_: Any) -> tuple[float, float]:
    low_end, high_end = (parse_bpm(end) for end in _range_ends(slot_text, "60..180"))
    if low_end[1] is not None or high_end[1] is not None:
        raise TextError("a range of tempos is two numbers, such as 60..180", length=len(slot_text))
    return low_end[0], high_end[0]


RANGE_VALUE = Value(
    "two values with their units, such as 1kN/m..9kN/m", _read_range, _range_completions
)
LEVELS_VALUE = Value(
    "two levels, such as -40dB..0dB",
    _read_levels,
    amounts.unit_completions("-40dB..0dB", ("dB",), "levels"),
)
TEMPOS_VALUE = Value(
    "two tempos, such as 60..180",
    _read_tempos,
    lambda context: () if context.typed_text else (Completion("60..180", "two tempos"),),
)


def map_control(
    source: str, target: str, range: tuple[float, float, str], *, when: When, words: Words
) -> MapControl | Learn:
    """Map a controller to a parameter."""
    low, high, unit = range
    return _map_or_learn(MapControl(source, target, (low, high), unit, when=when, words=words))


def map_tempo(
    source: str, range: tuple[float, float], *, when: When, words: Words
) -> MapControl | Learn:
    """Map a controller to the tempo."""
    return _map_or_learn(MapControl(source, None, range, BPM_UNIT, when=when, words=words))


def map_gain(
    source: str,
    range: tuple[float, float],
    sounding: str | None = None,
    *,
    when: When,
    words: Words,
) -> MapControl | Learn:
    """Map a controller to a level."""
    return _map_or_learn(MapControl(source, None, range, "dB", sounding, when=when, words=words))


def unmap_control(source: str, *, when: When, words: Words) -> Unmap | Learn:
    """End the map of a controller."""
    if source == LEARN:
        return Learn(None, when=when, words=words)
    return Unmap(source, when=when, words=words)


def _map_or_learn(control_map: MapControl) -> MapControl | Learn:
    return (
        Learn(control_map, when=control_map.when, words=control_map.words)
        if control_map.source == LEARN
        else control_map
    )


# --- notes ---------------------------------------------------------------------------------------


def _read_notes(slot_text: str, *_: Any) -> tuple[int, int]:
    low_end, high_end = (note_number(end) for end in _range_ends(slot_text, "C3..C5"))
    if low_end > high_end:
        raise TextError(f"the range {quote(slot_text)} goes down: write the lower note first")
    return low_end, high_end


def _read_impulses(text: str, *_: Any) -> tuple[float, float]:
    softest, loudest = (_parse_impulse(end) for end in _range_ends(text, "1mNs..20mNs"))
    return softest, loudest


def _parse_impulse(impulse_text: str) -> float:
    """An impulse with its unit; 0 needs none."""
    impulse = level(impulse_text)  # refuses what has no unit
    if impulse.is_strength and impulse.low != 0.0:
        message = (
            f"{quote(impulse_text)} is a strength, and here are impulses: write them with their "
            "unit,"
        )
        raise TextError(f"{message} such as 1mNs..20mNs", length=len(impulse_text))
    return 0.0 if impulse.is_strength else impulse.low


def _read_struck(text: str, *_: Any) -> str:
    if not re.fullmatch(r"[\w.-]{1,200}", text):
        raise TextError(f"{quote(text)} is not a module, such as bell.m", length=len(text))
    return text


def _read_played_instrument(instrument_text: str, scope: Scope, _: Mapping[str, Any]) -> str:
    part_name = instrument_text.split(".")[0]
    if instrument_text in scope.blocks:
        return instrument_text
    if part_name not in playable_instruments(scope):
        raise values.unknown_instrument_error(
            instrument_text,
            "an instrument or a block",
            (*playable_instruments(scope), *scope.blocks),
            scope,
        )
    if part_name not in scope.acts:
        message = (
            f"the impulses are missing: {quote(part_name)} does not say how it is played; write "
        )
        raise TextError(f"{message}them, such as 1mNs..20mNs", length=len(instrument_text))
    return instrument_text


def _read_curve(text: str, *_: Any) -> str:
    if text not in LAWS:
        raise values.unknown_name_error(text, "a curve", LAWS)
    return text


NOTES_VALUE = Value(
    "a note or a range, such as 60, C4 or C3..C5",
    _read_notes,
    lambda _: (Completion("C3..C5", "notes"),),
)
STRUCK_VALUE = Value(
    "a module, such as bell.m",
    _read_struck,
    lambda context: values.complete_to_dot(context.typed_text, values.module_names(context.scope)),
)
PLAYED_BY_NOTES = Value(
    "an instrument that says how it is played, or a block",
    _read_played_instrument,
    lambda context: values.name_completions(
        {**dict.fromkeys(context.scope.acts, "instrument"), **context.scope.blocks}
    ),
)
IMPULSES_VALUE = Value(
    "the impulses of the softest and the loudest note, such as 1mNs..20mNs",
    _read_impulses,
    amounts.unit_completions("1mNs..20mNs", ("Ns", "mNs", "uNs"), "an impulse"),
)
CURVE_VALUE = Value(
    "a curve (square, root or even)",
    _read_curve,
    lambda _: values.name_completions(dict.fromkeys(LAWS, "how strengths follow the velocity")),
)


def map_notes(
    notes: tuple[int, int],
    target: str,
    impulse: tuple[float, float] | None = None,
    curve: str | None = None,
    *,
    when: When,
    words: Words,
) -> MapNotes:
    """Map notes to strikes; without impulses, to an instrument that says how it is played."""
    return MapNotes(*notes, target, impulse, None, curve or EVEN_CURVE, when=when, words=words)


def map_gesture(
    notes: tuple[int, int], player: str, gesture: str, *, when: When, words: Words
) -> MapNotes:
    """Map notes to a gesture of a player."""
    return MapNotes(*notes, player, None, gesture, when=when, words=words)


def learn_note(target: str, *, when: When, words: Words) -> Learn:
    """Map the next note that comes."""
    return Learn(MapNotes(0, 0, target, None), when=when, words=words)


def unmap_notes(notes: tuple[int, int], *, when: When, words: Words) -> Unmap:
    """End the map of a range of notes."""
    return Unmap(MapNotes(*notes, "", None).name, when=when, words=words)


def monitor(is_on: bool = False, *, when: When, words: Words) -> Monitor:
    """Print MIDI messages as they come, or end that."""
    return Monitor(is_on, when=when, words=words)


# fmt: off
_SOURCE_SLOT = Slot("source", "cc N|bend|pressure [NOTE]|learn", SOURCE_VALUE)
_NOTES_SLOT = Slot("notes", "NOTE|NOTE..NOTE", NOTES_VALUE, "note")
_CURVE_SLOT = Slot("curve", "square|root|even", CURVE_VALUE, "curve", optional=True)
MAP_PARAMETER_FORM = form("map", "map", "a MIDI controller moves a parameter",
    "map cc 21 bell.m.K 1kN/m..9kN/m", map_control,
    _SOURCE_SLOT, Slot("target", "PATH", amounts.TARGET_VALUE),
    Slot("range", "VALUE..VALUE", RANGE_VALUE))
MAP_GAIN_FORM = form("map", "map", "a MIDI controller moves a level, in dB",
    "map cc 7 gain bell -40dB..0dB", map_gain,
    _SOURCE_SLOT, Slot("sounding", "NAME", values.SOUNDING_VALUE, "gain"),
    Slot("range", "LEVEL..LEVEL", LEVELS_VALUE))
MAP_MASTER_FORM = form("map", "map", "a MIDI controller moves the level of everything",
    "map cc 8 gain -40dB..0dB", map_gain,
    _SOURCE_SLOT, Slot("", "", None, "gain"),
    Slot("range", "LEVEL..LEVEL", LEVELS_VALUE))
MAP_TEMPO_FORM = form("map", "map", "a MIDI controller sets the tempo",
    "map cc 1 tempo 60..180", map_tempo,
    _SOURCE_SLOT, Slot("range", "BPM..BPM", TEMPOS_VALUE, "tempo"))
MAP_GESTURE_FORM = form("map", "map", "MIDI notes let a player play a gesture",
    "map note D2 ada knock", map_gesture,
    _NOTES_SLOT, PLAYER_SLOT, Slot("gesture", "GESTURE", values.PLAYED_VALUE))
MAP_STRIKES_FORM = form("map", "map", "MIDI notes strike modules, by their velocity",
    "map note C3..C5 bell.m 1mNs..20mNs", map_notes,
    _NOTES_SLOT, Slot("target", "MODULE", STRUCK_VALUE),
    Slot("impulse", "IMPULSE..IMPULSE", IMPULSES_VALUE), _CURVE_SLOT)
MAP_NOTES_FORM = form("map", "map", "MIDI notes play an instrument or run a block",
    "map note C3..C5 gong curve square", map_notes,
    _NOTES_SLOT, Slot("target", "INSTRUMENT|BLOCK", PLAYED_BY_NOTES), _CURVE_SLOT)
MAP_LEARN_FORM = form("map", "map", "the next MIDI note plays an instrument or runs a block",
    "map learn note gong", learn_note, Slot("", "", None, LEARN),
    Slot("target", "INSTRUMENT|BLOCK", PLAYED_BY_NOTES, "note"))
MAPS_FORM = form("maps", "maps", "lists the maps, and what came and has none", "maps", Maps,
    takes_time=False)
UNMAP_FORM = form("unmap", "unma", "ends the map of a controller, or lets none be learnt",
    "unmap cc 21", unmap_control, _SOURCE_SLOT)
UNMAP_NOTES_FORM = form("unmap", "unma", "ends a map of notes", "unmap note C3..C5", unmap_notes,
    _NOTES_SLOT)
MONITOR_FORM = form("monitor", "mon", "prints MIDI messages as they come", "monitor on",
    lambda **more: monitor(True, **more), Slot("", "", None, "on"), takes_time=False)
MONITOR_OFF_FORM = form("monitor", "mon", "ends that", "monitor off", monitor, OFF_SLOT,
    takes_time=False)
# fmt: on
