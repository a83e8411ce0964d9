"""`do:` — what happens to a gesture before it is played: scale, stretch, mirror, reverse, …

Transformations act left to right on points whose times count from the gesture's start. Where beats
and seconds have to be compared (jitter, quantise, from) a beat lasts as long as it does at the
start of the occurrence.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import floor
from typing import NamedTuple, Protocol

from ergon.notation.text.errors import TextError
from ergon.notation.text.numbers import NUMBER, UNIT
from ergon.notation.text.spelling import nearest
from ergon.notation.text.values import Point, Time
from ergon.scores.gesture.points import parse_metres, parse_time

NO_TIME = Time()
NO_OTHER_VERBS: Mapping[str, str] = {}
FACTOR_MAX = 1e4  # of a scale or stretch
# A jittered point keeps a tenth of the way to its neighbour free, so that order survives a rubato.
JITTER_RATIO_MAX = 0.45
SAME_INSTANT_TOLERANCE = 1e-9  # [s]: tolerance for rounding of instants

_TIME_PATTERN = re.compile(rf"({NUMBER})(?:/({NUMBER}))?({UNIT})")
_POSITION_PATTERN = re.compile(rf"({NUMBER})({UNIT})")
_RATIO_PATTERN = re.compile(rf"([+-]?)({NUMBER})(?:/({NUMBER}))?")


class Chance(Protocol):
    """The source of random draws: `ergon._core.Chance`."""

    def uniform(self, low: float, high: float) -> float:
        """Draw a number between `low` and `high`."""


class MidpointChance:
    """Draws the middle of each range: for lengths, which must not depend on chance."""

    def uniform(self, low: float, high: float) -> float:
        """The middle."""
        return (low + high) / 2


@dataclass(frozen=True, slots=True)
class Transform:
    """One transformation; which of `amount`, `time` and `x` [m] it uses depends on its word."""

    word: str
    amount: float = 1.0
    time: Time = NO_TIME
    x: float = 0.0
    offset: int = 0
    length: int = 1

    @property
    def time_factor(self) -> float:
        """How many times as long a gesture becomes."""
        if self.word == "fast":
            return 1.0 / self.amount
        return self.amount if self.word in ("stretch", "slow") else 1.0

    @property
    def period_factor(self) -> float:
        """How many times as long the time between repetitions becomes."""
        return self.time_factor if self.word in ("fast", "slow") else 1.0


@dataclass(frozen=True, slots=True)
class TakeTransform:
    """The sum of transformations of a take: x·scale at t·stretch, moved by `shift`.

    `front_cut` and `back_cut` [s] of the take, as it was captured, are left out.
    """

    scale: float = 1.0
    stretch: float = 1.0
    reverse: bool = False
    shift: Time = NO_TIME
    front_cut: float = 0.0
    back_cut: float = 0.0


class _TransformedPoints(NamedTuple):
    points: tuple[Point, ...]
    note: str | None = None


def parse_transform(
    written_text: str, text_start: int = 0, other_verbs: Mapping[str, str] = NO_OTHER_VERBS
) -> Transform:
    """Read one transformation, such as `scale 0.5` or `jitter 4ms 0.2mm`.

    `other_verbs` are words that the caller reads, for messages. Raises TextError with offsets into
    the text plus `text_start`.
    """
    placed_words = [(w.group(), text_start + w.start()) for w in re.finditer(r"\S+", written_text)]
    verb_names = (*_VERBS, *other_verbs)
    if not placed_words:
        raise TextError(f"a transformation is one of {', '.join(verb_names)}", offset=text_start)
    (verb_word, verb_offset), verb_arguments = placed_words[0], placed_words[1:]
    verb = _VERBS.get(verb_word)
    if verb_word in _RHYTHM_VERBS:
        message = (
            f"'{verb_word}' is of rhythms and phrases; a hand moves: {_RHYTHM_VERBS[verb_word]}"
        )
    elif verb_word in _ROUND_WORDS:
        message = (
            f"'{verb_word}' needs rounds, and a gesture by itself has none; write it in `do` of "
        )
        message += "what plays the gesture"
    else:
        message = ""
    if message:
        raise TextError(message, offset=verb_offset, length=len(verb_word))
    if verb is None:
        raise TextError(
            f"unknown transformation '{verb_word[:40]}'; known are {', '.join(verb_names)}",
            offset=verb_offset,
            length=len(verb_word),
            suggestion=nearest(verb_word, verb_names),
        )
    if len(verb_arguments) != len(verb.arguments):
        extra_argument = (
            verb_arguments[len(verb.arguments)]
            if len(verb_arguments) > len(verb.arguments)
            else None
        )
        error_offset, error_length = (
            (extra_argument[1], len(extra_argument[0]))
            if extra_argument
            else (verb_offset, len(verb_word))
        )
        raise TextError(
            f"'{verb_word}' has another number of values; write for instance {verb.example}",
            offset=error_offset,
            length=error_length,
        )
    fields: dict[str, float | Time] = {}
    for (argument, word_offset), (name, read_argument) in zip(
        verb_arguments, verb.arguments, strict=True
    ):
        fields[name] = read_argument(argument, word_offset, verb.example)
    end_offset = placed_words[-1][1] + len(placed_words[-1][0])
    return Transform(verb_word, offset=verb_offset, length=end_offset - verb_offset, **fields)  # type: ignore[arg-type]


def parse_chain(written_text: str) -> tuple[Transform, ...]:
    """Read transformations separated by commas: `scale 0.5, mirror`. Raises TextError."""
    transforms = []
    chain_start = 0
    for part in written_text.split(","):
        transforms.append(parse_transform(part, chain_start))
        chain_start += len(part) + 1
    return tuple(transforms)


def apply(
    points: Sequence[Point], transforms: Sequence[Transform], chance: Chance, beat: float = 1.0
) -> tuple[tuple[Point, ...], tuple[str, ...]]:
    """Transform `points` left to right; also return a sentence for each loss of points.

    `beat` is the duration [s] of a beat at the start of the occurrence.
    """
    transformed = tuple(points)
    notes: list[str] = []
    for transform in transforms:
        transformed, note = _VERBS[transform.word].apply(transformed, transform, chance, beat)
        if note is not None:
            notes.append(note)
    return transformed, tuple(notes)


def apply_to_take(transforms: Sequence[Transform], beat: float = 1.0) -> TakeTransform:
    """Combine transformations of a take. Raises TextError for those that need written points.

    `beat` is the duration [s] of a beat at the start of the occurrence.
    """
    scale, stretch, reverse, shift = 1.0, 1.0, False, Time()
    cuts = [0.0, 0.0]  # in front and at the back
    for transform in transforms:
        if transform.word in ("jitter", "quantise"):
            raise TextError(
                f"'{transform.word}' moves written points; a take has none",
                offset=transform.offset,
                length=transform.length,
            )
        amount, transform_time = transform.amount, transform.time
        scale *= {"scale": amount, "mirror": -1.0}.get(transform.word, 1.0)
        time_factor = transform.time_factor
        stretch *= time_factor
        shift = Time(shift.beats * time_factor, shift.seconds * time_factor)
        reverse ^= transform.word in ("reverse", "rev")
        if transform.word == "from":
            cut_duration = (
                (transform_time.beats - shift.beats) * beat + transform_time.seconds - shift.seconds
            )
            cuts[reverse] += max(0.0, cut_duration) / stretch
            shift = Time(0.0, max(0.0, -cut_duration))
            continue
        shift = Time(shift.beats + transform_time.beats, shift.seconds + transform_time.seconds)
    return TakeTransform(scale, stretch, reverse, shift, *cuts)


def _scale(
    points: tuple[Point, ...], transform: Transform, _: Chance, __: float
) -> _TransformedPoints:
    return _TransformedPoints(tuple(_moved_point(p, p.at, p.x * transform.amount) for p in points))


def _mirror(points: tuple[Point, ...], _: Transform, __: Chance, ___: float) -> _TransformedPoints:
    return _TransformedPoints(tuple(_moved_point(p, p.at, 0.0 - p.x) for p in points))


def _stretch(
    points: tuple[Point, ...], transform: Transform, _: Chance, __: float
) -> _TransformedPoints:
    factor = transform.time_factor
    return _TransformedPoints(
        tuple(
            _moved_point(p, Time(p.at.beats * factor, p.at.seconds * factor), p.x) for p in points
        )
    )


def _shift(
    points: tuple[Point, ...], transform: Transform, _: Chance, __: float
) -> _TransformedPoints:
    return _TransformedPoints(
        tuple(
            _moved_point(
                p,
                Time(p.at.beats + transform.time.beats, p.at.seconds + transform.time.seconds),
                p.x,
            )
            for p in points
        )
    )


def _start_from(
    points: tuple[Point, ...], transform: Transform, _: Chance, beat_duration: float
) -> _TransformedPoints:
    """Leave out the points before an instant, which becomes the start; the last point stays.

    The first point that is left gets the curve of the gesture's first point.
    """
    start_seconds = transform.time.beats * beat_duration + transform.time.seconds
    later_indices = (
        i
        for i, p in enumerate(points)
        if p.at.beats * beat_duration + p.at.seconds >= start_seconds - SAME_INSTANT_TOLERANCE
    )
    first_index = next(later_indices, None)
    if first_index is None:
        last_point = _moved_point(points[-1], NO_TIME, points[-1].x)
        return _TransformedPoints(
            (last_point,),
            "from: the start lies after the last point, so only the last position remains",
        )
    times = [
        Time(p.at.beats - transform.time.beats, p.at.seconds - transform.time.seconds)
        for p in points[first_index:]
    ]
    moved_points = [
        _moved_point(p, new_time, p.x)
        for p, new_time in zip(points[first_index:], times, strict=True)
    ]
    return _TransformedPoints((replace(moved_points[0], curve=points[0].curve), *moved_points[1:]))


def _reverse(points: tuple[Point, ...], _: Transform, __: Chance, ___: float) -> _TransformedPoints:
    """Play the points backward, between the first and the last point's instants.

    The curve that led into point i now leads into point i-1.
    """
    first_time, last_time = points[0].at, points[-1].at
    beats, seconds = (first_time.beats + last_time.beats, first_time.seconds + last_time.seconds)
    curves = [points[0].curve, *(p.curve for p in reversed(points[1:]))]
    return _TransformedPoints(
        tuple(
            Point(Time(beats - p.at.beats, seconds - p.at.seconds), p.x, curve, p.offset, p.length)
            for p, curve in zip(reversed(points), curves, strict=True)
        )
    )


def _jitter(
    points: tuple[Point, ...], transform: Transform, chance: Chance, beat_duration: float
) -> _TransformedPoints:
    """Move every point but the first by a draw in time, then one in position.

    A point moves at most JITTER_RATIO_MAX of the way to a neighbour, so that a tenth of the way
    stays between them. A hold keeps the moved position of the point before it.
    """
    time_max = transform.time.beats * beat_duration + transform.time.seconds
    instants = [p.at.beats * beat_duration + p.at.seconds for p in points]
    moved_points = list(points[:1])
    for i in range(1, len(points)):
        point = points[i]
        dt, dx = chance.uniform(-1.0, 1.0) * time_max, chance.uniform(-1.0, 1.0) * transform.x
        dt_min = -JITTER_RATIO_MAX * (instants[i] - instants[i - 1])
        dt = max(dt, dt_min)
        if i + 1 < len(points):
            dt = min(dt, JITTER_RATIO_MAX * (instants[i + 1] - instants[i]))
        x = moved_points[-1].x if point.curve == "hold" else point.x + dx
        moved_points.append(_moved_point(point, Time(point.at.beats, point.at.seconds + dt), x))
    return _TransformedPoints(tuple(moved_points))


def _quantise(
    points: tuple[Point, ...], transform: Transform, _: Chance, beat_duration: float
) -> _TransformedPoints:
    """Move points to the nearest multiple of q beats, halves later; merge those that meet.

    The merged point has the position of the last; its curve is the last that is not a hold.
    """
    grid_beats = transform.amount
    merged_points: list[Point] = []
    for point in points:
        rounded_time = Time(
            floor((point.at.beats + point.at.seconds / beat_duration) / grid_beats + 0.5)
            * grid_beats,
            0.0,
        )
        curve = point.curve
        if merged_points and rounded_time.beats <= merged_points[-1].at.beats:
            last_point = merged_points.pop()
            rounded_time, curve = last_point.at, last_point.curve if curve == "hold" else curve
        merged_points.append(Point(rounded_time, point.x, curve, point.offset, point.length))
    n_lost = len(points) - len(merged_points)
    if not n_lost:
        return _TransformedPoints(tuple(merged_points))
    count_text = "points fall" if n_lost > 1 else "point falls"
    return _TransformedPoints(
        tuple(merged_points),
        f"quantise {grid_beats:g}: {n_lost} {count_text} on the time of the next point",
    )


def _moved_point(point: Point, time: Time, x: float) -> Point:
    return Point(time, x, point.curve, point.offset, point.length)


def _read_ratio(word: str, offset: int, example: str) -> float:
    ratio_match = _RATIO_PATTERN.fullmatch(word)
    if ratio_match is None:
        raise _misread_error(word, offset, "a number", example)
    divisor = 1.0 if ratio_match[3] is None else float(ratio_match[3])
    value = float(ratio_match[2]) / divisor if divisor else FACTOR_MAX * 2
    if not value <= FACTOR_MAX:
        raise TextError(f"'{word[:40]}' is too large", offset=offset, length=len(word))
    return -value if ratio_match[1] == "-" else value


def _read_positive_time(word: str, offset: int, example: str) -> float:
    value = _read_ratio(word, offset, example)
    if value <= 0.0:
        raise TextError("this must be above 0", offset=offset, length=len(word))
    return value


def _read_span(word: str, offset: int, example: str) -> Time:
    match = _TIME_PATTERN.fullmatch(word)
    if match is None:
        raise _misread_error(word, offset, "a time", example)
    return Time(*parse_time(match[1], match[2], match[3], offset))


def _read_signed_span(word: str, offset: int, example: str) -> Time:
    sign = word[:1] if word[:1] in ("+", "-") else ""
    time = _read_span(word[len(sign) :], offset + len(sign), example)
    return Time(-time.beats, -time.seconds) if sign == "-" else time


def _read_distance(word: str, offset: int, example: str) -> float:
    match = _POSITION_PATTERN.fullmatch(word)
    if match is None:
        raise _misread_error(word, offset, "a distance", example)
    return parse_metres(match[1], match[2], offset)


def _misread_error(read_word: str, word_offset: int, kind: str, example: str) -> TextError:
    return TextError(
        f"'{read_word[:40]}' is not {kind}; write for instance {example}",
        offset=word_offset,
        length=max(1, len(read_word)),
    )


_ApplyTransform = Callable[[tuple[Point, ...], Transform, Chance, float], _TransformedPoints]
_ReadArgument = Callable[[str, int, str], float | Time]


class _Verb(NamedTuple):
    """How a transformation is written, and the function that applies it."""

    example: str
    arguments: tuple[tuple[str, _ReadArgument], ...]
    apply: _ApplyTransform


_VERBS = {
    "scale": _Verb("scale 0.5", (("amount", _read_ratio),), _scale),
    "from": _Verb("from 4", (("time", _read_span),), _start_from),
    "stretch": _Verb("stretch 2", (("amount", _read_positive_time),), _stretch),
    "mirror": _Verb("mirror", (), _mirror),
    "reverse": _Verb("reverse", (), _reverse),
    "jitter": _Verb("jitter 4ms 0.2mm", (("time", _read_span), ("x", _read_distance)), _jitter),
    "shift": _Verb("shift 1/8", (("time", _read_signed_span),), _shift),
    "quantise": _Verb("quantise 1/8", (("amount", _read_positive_time),), _quantise),
    "rev": _Verb("rev", (), _reverse),
    "fast": _Verb("fast 2", (("amount", _read_positive_time),), _stretch),
    "slow": _Verb("slow 2", (("amount", _read_positive_time),), _stretch),
}
# Those that rhythms have too: without `do` before it, such a word may be the name of a gesture.
_RHYTHM_WORDS = ("rev", "fast", "slow")
_SINGLE_HAND_REASON = (
    "it is in one place at a time, and a path is played once; let another player play it"
)
_NO_STROKES_REASON = "it has no strokes; write its points"
# Words that rhythms and phrases have, and what a gesture or a take has for them.
_RHYTHM_VERBS = {
    "late": "write shift 1/8, in beats",
    "early": "write shift -1/8, in beats",
    "swing": "write swing 2/3 beside `every`",
    "euclid": "write euclid 3 8 beside the names of gestures",
    "struct": "write euclid 3 8, or rests between names: knock ~ knock",
    "mask": "write rests between names: knock ~ knock knock",
    "cat": "write the names one after another: knock lean",
    "transpose": "it has no pitch; transpose the instrument",
    **dict.fromkeys(("off", "superimpose", "echo", "ply", "stack", "jux"), _SINGLE_HAND_REASON),
    **dict.fromkeys(
        ("legato", "tremolo", "roll", "grace", "arp", "rolled", "strum"), _NO_STROKES_REASON
    ),
}
# Words that change some of the rounds that a player plays.
_ROUND_WORDS = (
    "palindrome",
    "iter",
    "every",
    "whenmod",
    "chunk",
    "sometimes",
    "often",
    "rarely",
    "degrade",
)
ARGUMENT_COUNTS = {word: len(verb.arguments) for word, verb in _VERBS.items()}
GESTURE_ARGUMENT_COUNTS = {
    word: count for word, count in ARGUMENT_COUNTS.items() if word not in _RHYTHM_WORDS
}
EXAMPLES = {word: verb.example for word, verb in _VERBS.items()}
MEANINGS = {word: f"a transformation, such as {example}" for word, example in EXAMPLES.items()}
