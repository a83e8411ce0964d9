"""The scalar kinds of the score language: each a parser with its words and its pattern."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from typing import Any

from ergon.notation.clock.meter import parse_meter
from ergon.notation.clock.occurrences import parse_times
from ergon.notation.clock.positions import parse_length, parse_mark, parse_position
from ergon.notation.clock.tempo import parse_bpm
from ergon.notation.tables import quantities as q
from ergon.notation.tables import tuning
from ergon.notation.tables.shapes import Text
from ergon.notation.text.errors import TextError, quote, with_article

_NUMBER = r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?(/[0-9]+)?"
_NOTE = r"[A-G](##|bb|[#b]?)-?[0-9]([+-][0-9.]+cents?)?|-?[0-9]+\\[0-9]+"
_POSITION = r"[0-9]+\|[0-9./]+.*|[^0-9.|+-][^|]*|[0-9./]+ *(ms|s|beats?)?"
_LENGTH = r"[0-9./eE+-]+ *(bars?|beats?|ms|s)?"
MAX_TITLE = 1000  # characters
MAX_CACHED = 4096  # texts of one kind: a score of 10,000 entries repeats a few hundred


def _cached(parse: Callable[[str], Any]) -> Callable[[str], Any]:
    # lru_cache keeps no exceptions: callers shift the offset of a TextError, so each call must
    # raise a new one.
    return lru_cache(MAX_CACHED)(parse)


def _tuned(parse: Callable[[str], Any]) -> Callable[[str], Any]:
    """A parser that remembers values by the tuning too, in which notes are read."""

    @lru_cache(MAX_CACHED)
    def parse_tuned(text: str, tuning_key: tuning.Tuning | None) -> Any:
        return parse(text)

    return lambda text: parse_tuned(text, tuning.written())


def _units(dimension: q.Dimension) -> str:
    return "|".join(re.escape(unit) for unit in dimension.units)


def quantity(dimension: q.Dimension, doc: str = "") -> Text:
    """A number with a unit, as an SI float."""
    doc_words = doc or f"{with_article(dimension.name)}, such as {dimension.example}"
    units = (
        f" *({_units(dimension)}){'?' if dimension.takes_bare_number else ''}"
        if dimension.units
        else ""
    )
    pattern = f"^({_NUMBER}{units}{'' if dimension.takes_bare_number else '|0'})$"
    parse = _cached(lambda text: q.quantity(text, dimension))
    return Text(parse, doc_words, pattern, units=tuple(dimension.units), is_value=True)


def span(dimension: q.Dimension, example: str) -> Text:
    """`low..high` as a pair of SI floats; a lone value is both ends."""

    def read(text: str) -> float:
        return q.frequency(text) if dimension is q.FREQUENCY else q.quantity(text, dimension)

    def parse(span_text: str) -> tuple[float, float]:
        if ".." in span_text:
            return q.span(span_text, read, example)
        span_value = read(span_text)
        return span_value, span_value

    single_pattern = (
        f"({_NUMBER} *({_units(dimension)})?{f'|{_NOTE}' if dimension is q.FREQUENCY else ''})"
    )
    words = f"{with_article(dimension.name)} or a range, such as {example}"
    cached_parse = _tuned(parse) if dimension is q.FREQUENCY else _cached(parse)
    return Text(cached_parse, words, rf"^{single_pattern}(\.\.{single_pattern})?$", is_value=True)


def integer(low_bound: int, high_bound: int, example: str) -> Text:
    """A whole number."""
    words = f"a whole number from {low_bound:,} to {high_bound:,}, such as {example}"
    parse = _cached(lambda text: q.integer(text, low_bound, high_bound))
    return Text(parse, words, f"^{_NUMBER}$", is_value=True)


def integer_or(alternative: str, low: int, high: int, example: str) -> Text:
    """A whole number, or a word."""
    integer_text = integer(low, high, example)

    def parse(text: str) -> int | str:
        word_text = text.strip()
        if word_text[:1].isalpha() and word_text != alternative:
            message = f"{quote(word_text)} is neither a whole number nor {alternative}"
            raise TextError(message, length=len(word_text), suggestion=alternative, code="E201")
        return alternative if word_text == alternative else int(integer_text.parse(text))

    return Text(
        _cached(parse),
        f"{integer_text.what}, or {alternative}",
        f"^({(integer_text.pattern or '')[1:-1]}|{alternative})$",
        is_value=True,
    )


def count_or_size(low_bound: int, high_bound: int, doc_words: str) -> Text:
    """A whole number of masses as an int, or a length with its unit as metres."""

    def parse(text: str) -> int | float:
        if text.strip()[-1:].isalpha():
            return q.quantity(text, q.SIZE)
        return q.integer(text, low_bound, high_bound)

    pattern = f"^{_NUMBER}( *({_units(q.SIZE)}))?$"
    return Text(_cached(parse), doc_words, pattern, units=tuple(q.SIZE.units), is_value=True)


def _title(text: str) -> str:
    if len(text) > MAX_TITLE:
        raise TextError(f"the text has more than {MAX_TITLE} characters", length=1, code="E202")
    return " ".join(text.split())


def _path(text: str) -> str:
    if not text.strip() or len(text) > 1000 or "\x00" in text:
        raise TextError("the name of a file is expected", length=max(1, len(text)), code="E201")
    return text.strip()


def _truth(truth_text: str) -> bool:
    if truth_text in ("true", "false"):
        return truth_text == "true"
    suggestion = {"yes": "true", "on": "true", "no": "false", "off": "false"}.get(
        truth_text.lower()
    )
    message = f"{quote(truth_text)} is neither true nor false"
    raise TextError(message, length=max(1, len(truth_text)), suggestion=suggestion, code="E206")


AXES = ("x", "y", "z")  # coordinates of a point in space

MASS = quantity(q.MASS)
MASS_OR_NUMBER = quantity(q.MASS_OR_NUMBER)
STIFFNESS = quantity(q.STIFFNESS)
DAMPING = quantity(q.DAMPING)
POSITION = quantity(q.POSITION)
SIZE = quantity(q.SIZE)
SPAN = quantity(q.SPAN)
DISC = quantity(q.DISTANCE, "a radius, such as 5cm")
DISTANCE = quantity(q.DISTANCE)
ROOM_SIZE = quantity(q.ROOM_SIZE)
AZIMUTH = quantity(q.AZIMUTH)
ELEVATION = quantity(q.ELEVATION)
PAN = quantity(q.PAN, "a place from -1 (first channel) to 1 (second channel), such as -0.3")
DENSITY = quantity(q.DENSITY)
PRESSURE = quantity(q.PRESSURE)
SURFACE_TENSION = quantity(q.SURFACE_TENSION)
INHARMONICITY = quantity(q.INHARMONICITY)
POISSON = quantity(q.POISSON, "Poisson's ratio, such as 0.33")
SPEED = quantity(q.SPEED)
GRAVITY = quantity(q.GRAVITY)
FORCE = quantity(q.FORCE)
POLES = quantity(q.POLES)
PUSH = quantity(q.PUSH, "a force of either sign, such as -5N")
FULL_SCALE = Text(
    _cached(q.full_scale),
    "a force or a length, such as 2mN or 0.1mm",
    f"^{_NUMBER} *({_units(q.INPUT_FORCE)}|{_units(q.INPUT_LENGTH)})$",
    units=(*q.INPUT_FORCE.units, *q.INPUT_LENGTH.units),
    is_value=True,
)
HARDENING = quantity(q.HARDENING)
HERTZ = quantity(q.FREQUENCY)
RATE = quantity(q.RATE)
TICK_RATE = quantity(q.TICK_RATE)
DURATION = quantity(q.DURATION)
CONTACT_TIME = quantity(q.CONTACT_TIME, "a time from 0s to 50ms, such as 2ms")
PAUSE = quantity(q.INSTANT)  # a duration that may be none
TAIL = Text(
    lambda text: "auto" if text.strip() == "auto" else q.quantity(text, q.INSTANT),
    f"{PAUSE.what}, or auto",
    f"^({(PAUSE.pattern or '')[1:-1]}|auto)$",
    is_value=True,
)
LEVEL = quantity(q.LEVEL)
ERROR = quantity(q.ERROR)
CENTS = quantity(q.CENTS)
SHARE = quantity(q.SHARE)
FRICTION = quantity(q.FRICTION, "a coefficient from 0 to 10, such as 0.4")
CHANCE = quantity(q.CHANCE, "a chance from 0 to 1, such as 0.6 or 60%")
PROPORTION = quantity(q.CHANCE, "a share from 0 to 1, such as 0.3 or 30%")
NUMBER = quantity(q.NUMBER)
RATIO = quantity(q.RATIO)
HOLE = quantity(q.HOLE, "a radius from 0.01 to 1, such as 0.3")
WIDTH = quantity(q.WIDTH, "a width from 0.001 to 4, such as 0.06")
UNIT_RATIO = quantity(q.UNIT_RATIO)
CONSTANT = quantity(q.CONSTANT, "a constant of the law, such as 900N/m")
POSITIVE = quantity(q.FACTOR)
EXPONENT = quantity(q.EXPONENT)
PITCH = Text(
    _tuned(q.frequency),
    "a frequency or a note, such as 220Hz or A3",
    f"^({_NUMBER} *(Hz|kHz)?|{_NOTE})$",
    is_value=True,
)
TRAVEL = span(q.POSITION, "-15mm..15mm")
PITCHES = span(q.FREQUENCY, "20Hz..10kHz")
DURATIONS = span(q.DURATION, "0.5s..8s")
TRIM = span(q.INSTANT, "0.4s..4s")
IMPULSES = span(q.IMPULSE, "1uNs..4uNs")
GAIN = Text(
    _cached(q.gain),
    "a level or a factor, such as -6dB or x0.5",
    f"^({_NUMBER} *dB|x{_NUMBER})$",
    types=("string",),
    is_value=True,
)
REFERENCE = Text(
    lambda text: "SI" if text.strip() == "SI" else q.gain(text),
    f"{GAIN.what}, or SI",
    f"^({_NUMBER} *dB|x{_NUMBER}|SI)$",
    types=("string",),
    is_value=True,
)
WHEN = Text(
    _cached(parse_position),
    "a position in the piece, such as 3|2.5, B+2, 12.5s or beats",
    f"^({_POSITION})$",
    is_position=True,
)
MARK = replace(WHEN, parse=_cached(parse_mark))
LENGTH = Text(
    _cached(parse_length),
    "a length, such as 4bar, 1/2 (beats) or 250ms",
    f"^{_LENGTH}$",
    is_value=True,
)
METER = Text(parse_meter, "a meter, such as 4/4", r"^[0-9]+(\+[0-9]+)*/[0-9]+$", types=("string",))
BPM = Text(
    parse_bpm, "a tempo, such as 60 or 60 -> 96", rf"^{_NUMBER}( *-> *{_NUMBER})?$", is_value=True
)
TITLE = Text(_title, "a text", types=("string", "number", "boolean"))
PATH = Text(_path, "the name of a file", types=("string",))
TIMES = Text(_cached(parse_times), "how often, such as 8", "^[0-9]+$", is_value=True)
BOOLEAN = Text(_truth, "true or false", types=("boolean",))
