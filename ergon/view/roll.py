"""Notes of a piece as SVG: a bar for each, as high as its pitch and as dark as it is strong."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import ceil, floor
from xml.sax.saxutils import escape

from .curve import Axis, axis
from .svg import Frame, axes, document, short, text

# Safe for the colour-blind (Okabe & Ito, 2008).
_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#222222")
_WIDTH, _HEIGHT = 960, 480  # pixels
_NAMES = {0: "C", 4: "E", 7: "G"}  # of the keys that have a line, by their places in an octave
_ALL_NAMES = 24  # keys, up to which E and G have lines too


@dataclass(frozen=True, slots=True)
class Bar:
    """A note: who plays it, its instants [s], its height in keys of MIDI, its strength (0 to 1)."""

    name: str
    begin: float
    end: float
    key: float
    strength: float


def picture(bars: Sequence[Bar], *, title: str = "") -> str:
    """A whole SVG document; `bars` has at least one."""
    t_axis = axis([0.0, *(bar.end for bar in bars)], 10, tight=True)
    frame = Frame(64, 40, _WIDTH - 16, _HEIGHT - 64, t_axis, _key_axis(bars))
    names = dict.fromkeys(bar.name for bar in bars)
    colours = {name: _COLOURS[i % len(_COLOURS)] for i, name in enumerate(names)}
    parts = [axes(frame, "time [s]", "")]
    parts += [_rectangle(bar, frame, colours[bar.name]) for bar in bars]
    parts += [*_legend(colours, frame), text(frame.left, 20, short(title), weight="bold")]
    return document(_WIDTH, _HEIGHT, title, parts)


def _key_axis(bars: Sequence[Bar]) -> Axis:
    """An axis of keys with the names of notes."""
    low = floor(min(bar.key for bar in bars)) - 1
    high = ceil(max(bar.key for bar in bars)) + 1
    steps = _NAMES if high - low < _ALL_NAMES else (0,)
    keys = [key for key in range(low, high + 1) if key % 12 in steps]
    names = tuple(f"{_NAMES[key % 12]}{key // 12 - 1}" for key in keys)
    return Axis(low, high, tuple(map(float, keys)), 0, names)


def _rectangle(bar: Bar, frame: Frame, colour: str) -> str:
    begin, end = frame.across(bar.begin), frame.across(bar.end)
    a_key = abs(frame.down(1.0) - frame.down(0.0))
    thick = max(2.0, min(12.0, 0.8 * a_key))
    return (
        f"<rect x='{begin:.2f}' y='{frame.down(bar.key) - thick / 2:.2f}' "
        f"width='{max(1.5, end - begin):.2f}' height='{thick:.2f}' "
        f"fill='{colour}' fill-opacity='{0.35 + 0.65 * bar.strength:.2f}'>"
        f"<title>{escape(bar.name)}</title></rect>"
    )


def _legend(colours: dict[str, str], frame: Frame) -> Iterator[str]:
    x, y = frame.left, frame.bottom + 54
    for name, colour in colours.items():
        yield f"<rect x='{x:g}' y='{y - 10:g}' width='12' height='12' fill='{colour}'/>"
        yield text(x + 18, y, short(name))
        x += 36 + 7.5 * len(short(name))
