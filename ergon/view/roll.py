"""Notes of a piece as SVG: a bar for each, as high as its pitch and as dark as it is strong."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import ceil, floor
from operator import itemgetter
from xml.sax.saxutils import escape

from .curve import Axis, axis
from .svg import Frame, axes, document, short, text

# Safe for the colour-blind (Okabe & Ito, 2008).
_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#222222")
_WIDTH, _HEIGHT = 960, 480  # pixels
_MIDDLE_C = 60.0  # key above the lines where no note has a pitch
_NAMES = {0: "C", 4: "E", 7: "G"}  # names of the keys with a line, by their number in an octave
_ALL_NAMES_RANGE = 24  # keys, up to which E and G have lines too
_LANES_IN_HEIGHT = 20  # lines of instruments without a pitch that would fill the picture
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


def heights(note_bars: Sequence[Bar]) -> tuple[list[float], dict[str, float]]:
    """The height of each note, in keys of MIDI, and of the line of each instrument without a
    pitch: these lie below all keys, in the order in which they begin.
    """
    pitched_keys = [bar.key for bar in note_bars if bar.key is not None]
    lowest, highest = (
        (min(pitched_keys), max(pitched_keys)) if pitched_keys else (_MIDDLE_C, _MIDDLE_C)
    )
    lane_step = max(2, ceil((highest - lowest) / _LANES_IN_HEIGHT))
    unpitched = dict.fromkeys(bar.name for bar in note_bars if bar.key is None)
    lanes = {name: float(floor(lowest) - lane_step * n) for n, name in enumerate(unpitched, 1)}
    return [lanes[bar.name] if bar.key is None else bar.key for bar in note_bars], lanes


def picture(note_bars: Sequence[Bar], *, title: str = "") -> str:
    """A whole SVG document; `note_bars` has at least one."""
    t_axis = axis([0.0, *(bar.end for bar in note_bars)], 10, tight=True)
    bar_keys, lanes = heights(note_bars)
    left = max(
        64, round(16 + _CHARACTER_WIDTH * max((len(short(name)) for name in lanes), default=0))
    )
    plot_frame = Frame(left, 40, _WIDTH - 16, _HEIGHT - 64, t_axis, _key_axis(bar_keys, lanes))
    names = dict.fromkeys(bar.name for bar in note_bars)
    colour_by_name = {name: _COLOURS[i % len(_COLOURS)] for i, name in enumerate(names)}
    svg_parts = [axes(plot_frame, "time [s]", "")]
    svg_parts += [
        _rectangle(bar, key, plot_frame, colour_by_name[bar.name])
        for bar, key in zip(note_bars, bar_keys, strict=True)
    ]
    svg_parts += [
        *_legend(colour_by_name, plot_frame),
        text(plot_frame.left, 20, short(title), weight="bold"),
    ]
    return document(_WIDTH, _HEIGHT, title, svg_parts)


def _key_axis(keys: Sequence[float], lanes: Mapping[str, float]) -> Axis:
    """An axis of keys with the names of notes, and those of instruments on their lines."""
    lowest_key, highest_key = floor(min(keys)) - 1, ceil(max(keys)) + 1
    lowest_labelled_key = floor(max(lanes.values(), default=lowest_key - 1.0)) + 1
    labelled_steps = _NAMES if highest_key - lowest_key < _ALL_NAMES_RANGE else (0,)
    labelled_keys = [
        key for key in range(lowest_labelled_key, highest_key + 1) if key % 12 in labelled_steps
    ]
    labels = {key: short(name) for name, key in sorted(lanes.items(), key=itemgetter(1))}
    labels |= {float(key): f"{_NAMES[key % 12]}{key // 12 - 1}" for key in labelled_keys}
    return Axis(lowest_key, highest_key, tuple(labels), 0, tuple(labels.values()))


def _rectangle(note_bar: Bar, bar_key: float, plot_frame: Frame, colour: str) -> str:
    left_edge, right_edge = plot_frame.across(note_bar.begin), plot_frame.across(note_bar.end)
    pixels_per_key = abs(plot_frame.down(1.0) - plot_frame.down(0.0))
    bar_height = max(2.0, min(12.0, 0.8 * pixels_per_key))
    return (
        f"<rect x='{left_edge:.2f}' y='{plot_frame.down(bar_key) - bar_height / 2:.2f}' "
        f"width='{max(1.5, right_edge - left_edge - _NOTE_GAP):.2f}' height='{bar_height:.2f}' "
        f"fill='{colour}' fill-opacity='{0.35 + 0.65 * note_bar.strength:.2f}'>"
        f"<title>{escape(note_bar.name)}</title></rect>"
    )


def _legend(colour_by_name: dict[str, str], frame: Frame) -> Iterator[str]:
    left_edge, text_baseline = frame.left, frame.bottom + 54
    for instrument_name, colour in colour_by_name.items():
        yield (
            f"<rect x='{left_edge:g}' y='{text_baseline - 10:g}' width='12' height='12' "
            f"fill='{colour}'/>"
        )
        yield text(left_edge + 18, text_baseline, short(instrument_name))
        left_edge += 36 + _CHARACTER_WIDTH * len(short(instrument_name))
