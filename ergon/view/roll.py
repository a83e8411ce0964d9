"""Notes of a piece as SVG: a bar for each, as high as its pitch and as dark as it is strong."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import ceil, floor
from operator import itemgetter
from xml.sax.saxutils import escape

from .curve import Axis, axis
from .svg import Frame, axes, document, shorten, text

# Safe for the colour-blind (Okabe & Ito, 2008).
_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#222222")
_WIDTH, _HEIGHT = 960, 480  # pixels
_MIDDLE_C = 60.0  # key above the lines where no note has a pitch
_KEY_NAMES = {0: "C", 4: "E", 7: "G"}  # names of the keys with a line, by their number in an octave
_FULL_LABELS_RANGE_MAX = 24  # keys, up to which E and G have lines too
_LANES_PER_PICTURE = 20  # lines of instruments without a pitch that would fill the picture
_CHARACTER_WIDTH = 7.5  # pixels across
_NOTE_GAP = 1.0  # pixels between a note and the next: strokes that follow each other stay apart


@dataclass(frozen=True, slots=True)
class Bar:
    """A note: who plays it, its instants [s], its height in keys of MIDI (None without a pitch),
    its strength (0 to 1).
    """

    name: str
    begin: float
    end: float
    key: float | None
    strength: float


def note_heights_and_lanes(bars: Sequence[Bar]) -> tuple[list[float], dict[str, float]]:
    """The height of each note, in keys of MIDI, and of the line of each instrument without a
    pitch: these lie below all keys, in the order in which they begin.
    """
    pitched_keys = [bar.key for bar in bars if bar.key is not None]
    key_min, key_max = (
        (min(pitched_keys), max(pitched_keys)) if pitched_keys else (_MIDDLE_C, _MIDDLE_C)
    )
    keys_per_lane = max(2, ceil((key_max - key_min) / _LANES_PER_PICTURE))
    unpitched_names = dict.fromkeys(bar.name for bar in bars if bar.key is None)
    lanes = {
        name: float(floor(key_min) - keys_per_lane * n) for n, name in enumerate(unpitched_names, 1)
    }
    return [lanes[bar.name] if bar.key is None else bar.key for bar in bars], lanes


def notes_svg(bars: Sequence[Bar], *, title: str = "") -> str:
    """A whole SVG document; `bars` has at least one."""
    t_axis = axis([0.0, *(bar.end for bar in bars)], 10, tight=True)
    bar_heights, lanes = note_heights_and_lanes(bars)
    left = max(
        64, round(16 + _CHARACTER_WIDTH * max((len(shorten(name)) for name in lanes), default=0))
    )
    frame = Frame(left, 40, _WIDTH - 16, _HEIGHT - 64, t_axis, _key_axis(bar_heights, lanes))
    names = dict.fromkeys(bar.name for bar in bars)
    colour_by_name = {name: _COLOURS[i % len(_COLOURS)] for i, name in enumerate(names)}
    elements = [axes(frame, "time [s]", "")]
    elements += [
        _rectangle(bar, height, frame, colour_by_name[bar.name])
        for bar, height in zip(bars, bar_heights, strict=True)
    ]
    elements += [
        *_legend(colour_by_name, frame),
        text(frame.left, 20, shorten(title), weight="bold"),
    ]
    return document(_WIDTH, _HEIGHT, title, elements)


def _key_axis(keys: Sequence[float], lanes: Mapping[str, float]) -> Axis:
    """An axis of keys with the names of notes, and those of instruments on their lines."""
    key_min, key_max = floor(min(keys)) - 1, ceil(max(keys)) + 1
    labelled_key_min = floor(max(lanes.values(), default=key_min - 1.0)) + 1
    labelled_pitch_classes = _KEY_NAMES if key_max - key_min < _FULL_LABELS_RANGE_MAX else (0,)
    labelled_keys = [
        key for key in range(labelled_key_min, key_max + 1) if key % 12 in labelled_pitch_classes
    ]
    labels = {key: shorten(name) for name, key in sorted(lanes.items(), key=itemgetter(1))}
    labels |= {float(key): f"{_KEY_NAMES[key % 12]}{key // 12 - 1}" for key in labelled_keys}
    return Axis(key_min, key_max, tuple(labels), 0, tuple(labels.values()))


def _rectangle(bar: Bar, height: float, frame: Frame, colour: str) -> str:
    left, right = frame.x_pixel(bar.begin), frame.x_pixel(bar.end)
    pixels_per_key = abs(frame.y_pixel(1.0) - frame.y_pixel(0.0))
    thickness = max(2.0, min(12.0, 0.8 * pixels_per_key))
    return (
        f"<rect x='{left:.2f}' y='{frame.y_pixel(height) - thickness / 2:.2f}' "
        f"width='{max(1.5, right - left - _NOTE_GAP):.2f}' height='{thickness:.2f}' "
        f"fill='{colour}' fill-opacity='{0.35 + 0.65 * bar.strength:.2f}'>"
        f"<title>{escape(bar.name)}</title></rect>"
    )


def _legend(colour_by_name: dict[str, str], frame: Frame) -> Iterator[str]:
    left, text_baseline = frame.left, frame.bottom + 54
    for name, colour in colour_by_name.items():
        yield (
            f"<rect x='{left:g}' y='{text_baseline - 10:g}' width='12' height='12' "
            f"fill='{colour}'/>"
        )
        yield text(left + 18, text_baseline, shorten(name))
        left += 36 + _CHARACTER_WIDTH * len(shorten(name))
