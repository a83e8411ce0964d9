"""Notes of a piece as SVG: a bar for each, as high as its pitch and as dark as it is strong."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, floor
from xml.sax.saxutils import escape

from .curve import axis
from .svg import short, text

_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#222222")
_NAMES = ("C", "C#", "D", "D#", "E", "F", "F#", "G", "G#", "A", "A#", "B")
_LEFT, _RIGHT, _TOP, _BOTTOM = 64, 16, 40, 64  # pixels
_FONT = "font-family='ui-sans-serif, Helvetica, Arial, sans-serif' font-size='12'"


@dataclass(frozen=True, slots=True)
class Bar:
    """A note: who plays it, its instants [s], its height in keys of MIDI, its strength (0 to 1)."""

    name: str
    begin: float
    end: float
    key: float
    strength: float


def picture(bars: Sequence[Bar], *, title: str = "", width: int = 960, height: int = 480) -> str:
    """A whole SVG document; `bars` has at least one."""
    low = floor(min(bar.key for bar in bars)) - 1
    high = ceil(max(bar.key for bar in bars)) + 1
    t_axis = axis([0.0, *(bar.end for bar in bars)], 10, tight=True)
    room = height - _TOP - _BOTTOM
    thick = max(2.0, min(12.0, 0.8 * room / (high - low)))

    def across(t: float) -> float:
        return _LEFT + t_axis.part(t) * (width - _LEFT - _RIGHT)

    def down(key: float) -> float:
        return height - _BOTTOM - (key - low) / (high - low) * room

    colours = {name: _COLOURS[i % len(_COLOURS)] for i, name in enumerate(_named(bars))}
    parts: list[str] = []
    for key in range(low, high + 1):
        if key % 12 == 0:
            line = f"<line x1='{_LEFT}' x2='{width - _RIGHT}' y1='{down(key):.1f}' "
            parts.append(f"{line}y2='{down(key):.1f}' stroke='#dddddd'/>")
        if key % 12 == 0 or (high - low < 24 and key % 12 in (4, 7)):
            label = f"{_NAMES[key % 12]}{key // 12 - 1}"
            parts.append(text(_LEFT - 8, down(key) + 4, label, anchor="end"))
    for tick in t_axis.ticks:
        line = f"<line x1='{across(tick):.1f}' x2='{across(tick):.1f}' y1='{_TOP}' "
        parts.append(f"{line}y2='{height - _BOTTOM}' stroke='#dddddd'/>")
        parts.append(text(across(tick), height - _BOTTOM + 16, t_axis.text(tick), anchor="middle"))
    parts.append(text(width - _RIGHT, height - _BOTTOM + 32, "time [s]", anchor="end"))
    for bar in bars:
        begin, end = across(bar.begin), across(bar.end)
        parts.append(
            f"<rect x='{begin:.2f}' y='{down(bar.key) - thick / 2:.2f}' "
            f"width='{max(1.5, end - begin):.2f}' height='{thick:.2f}' "
            f"fill='{colours[bar.name]}' fill-opacity='{0.35 + 0.65 * bar.strength:.2f}'>"
            f"<title>{escape(bar.name)}</title></rect>"
        )
    x = float(_LEFT)
    for name, colour in colours.items():
        parts.append(f"<rect x='{x}' y='{height - 22}' width='12' height='12' fill='{colour}'/>")
        parts.append(text(x + 18, height - 12, short(name)))
        x += 36 + 7.5 * len(short(name))
    parts.append(text(_LEFT, 20, short(title), weight="bold"))
    head = f"<svg xmlns='http://www.w3.org/2000/svg' width='{width}' height='{height}' "
    head += f"viewBox='0 0 {width} {height}' {_FONT}>"
    paper = "<rect width='100%' height='100%' fill='#ffffff'/>"
    return "\n".join([head, paper, *parts, "</svg>", ""])


def _named(bars: Sequence[Bar]) -> list[str]:
    return list(dict.fromkeys(bar.name for bar in bars))
