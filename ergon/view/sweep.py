"""A sweep as a picture: a frame for each figure, over the first parameter that varies."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from .curve import Axis, axis
from .svg import Frame, axes, document, short, text

_PANELS: Mapping[str, str] = {
    "loudness_lufs": "loudness [LUFS]",
    "centroid_hz": "centroid [Hz]",
    "pitch_hz": "pitch [Hz]",
    "partial_hz": "strongest partial [Hz]",
    "t60_s": "T60 [s]",
    "cpu_s": "work [CPU s]",
    "error_db": "error [dB]",
    "error_cents": "error [cents]",
}
_WIDTH, _HIGH, _BETWEEN, _TOP = 460, 170, 62, 60
_LEFT, _RIGHT = 70, 16
_LIGHT, _DARK = (86, 180, 233), (0, 30, 90)  # of the first and the last curve
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")
_CURVES_NAMED = 6


@dataclass(frozen=True, slots=True)
class Point:
    """A variant: the texts of its values, and its figures by their names, all finite."""

    values: tuple[str, ...]
    figures: Mapping[str, float]


def picture(title: str, targets: Sequence[str], points: Sequence[Point]) -> str:
    """The sweep as a whole SVG document.

    Variants that differ only in the first value are joined by a line; lines get darker from the
    first to the last of the other values.
    """
    across = _across(points)
    curves: dict[tuple[str, ...], list[Point]] = {}
    for point in points:
        curves.setdefault(point.values[1:], []).append(point)
    if all(len(named_points) == 1 for named_points in curves.values()):  # pairs
        curves = {(): list(points)}
    shown = [name for name in _PANELS if any(name in point.figures for point in points)]
    parts = [text(_LEFT, 20, short(title), weight="bold"), _key(list(curves), targets[1:])]
    for number, name in enumerate(shown):
        row, column = divmod(number, 2)
        left, top = column * _WIDTH, _TOP + row * (_HIGH + _BETWEEN)
        figures = [point.figures[name] for point in points if name in point.figures]
        frame = Frame(
            left + _LEFT, top, left + _WIDTH - _RIGHT, top + _HIGH, across.axis, axis(figures, 5)
        )
        parts += [
            axes(frame, targets[0] + across.unit, ""),
            text(left + _LEFT, top - 8, _PANELS[name]),
        ]
        for index, named_points in enumerate(curves.values()):
            colour = _colour(index, len(curves))
            line_points = [
                (frame.across(across.place_of(p.values[0])), frame.down(p.figures[name]))
                for p in named_points
                if name in p.figures
            ]
            parts.append(_curve(line_points, colour))
    rows = (len(shown) + 1) // 2
    return document(2 * _WIDTH, _TOP + rows * (_HIGH + _BETWEEN), f"sweep of {title}", parts)


@dataclass(frozen=True, slots=True)
class _Across:
    """The horizontal positions of the values of the first target."""

    axis: Axis
    unit: str
    places: Mapping[str, float]

    def place_of(self, value: str) -> float:
        return self.places[value]


def _across(points: Sequence[Point]) -> _Across:
    """Numbers in their own unit, on a logarithmic axis if they are spaced evenly on one; other
    values at equal distances.
    """
    first_values = list(dict.fromkeys(point.values[0] for point in points))
    matches = [_NUMBER.match(value) for value in first_values]
    units = {
        value[match.end() :].strip()
        for value, match in zip(first_values, matches, strict=True)
        if match
    }
    if all(matches) and len(units) == 1:
        numbers = [float(match[0]) for match in matches if match]
        (unit,) = units
        unit_text = f" [{unit}]" if unit else ""
        if _is_geometric(numbers):
            places = [math.log10(x) for x in numbers]
            ticks = tuple(sorted(_few(places)))
            names = tuple(f"{10.0**tick:.3g}" for tick in ticks)
            return _Across(
                _room(places, ticks, names), unit_text, dict(zip(first_values, places, strict=True))
            )
        return _Across(axis(numbers, 6), unit_text, dict(zip(first_values, numbers, strict=True)))
    places = [float(i) for i in range(len(first_values))]
    ticks = _few(places)
    names = tuple(first_values[int(tick)] for tick in ticks)
    return _Across(_room(places, ticks, names), "", dict(zip(first_values, places, strict=True)))


def _room(places: Sequence[float], ticks: tuple[float, ...], names: tuple[str, ...]) -> Axis:
    room = 0.04 * (max(places) - min(places)) or 0.5
    return Axis(min(places) - room, max(places) + room, ticks, 0, names)


def _few(places: Sequence[float], count_max: int = 6) -> tuple[float, ...]:
    step = math.ceil(len(places) / count_max)
    return tuple(places[::step])


def _is_geometric(numbers: Sequence[float]) -> bool:
    if len(numbers) < 3 or min(numbers) <= 0.0:
        return False
    ratios = [b / a for a, b in itertools.pairwise(numbers)]
    differences = [b - a for a, b in itertools.pairwise(numbers)]
    is_even = max(differences) - min(differences) <= 1e-6 * max(map(abs, differences))
    return not is_even and max(ratios) <= (1.0 + 1e-6) * min(ratios)


def _colour(index: int, count: int) -> str:
    part = index / max(1, count - 1)
    mixed = (round(a + part * (b - a)) for a, b in zip(_LIGHT, _DARK, strict=True))
    return "#" + "".join(f"{channel:02x}" for channel in mixed)


def _curve(line_points: Sequence[tuple[float, float]], colour: str) -> str:
    if not line_points:
        return ""
    line = "L".join(f"{x:.1f} {y:.1f}" for x, y in line_points)
    dots = "".join(f"<circle cx='{x:.1f}' cy='{y:.1f}' r='2.2'/>" for x, y in line_points)
    path = f"<path d='M{line}' fill='none' stroke='{colour}' stroke-width='1.2'/>"
    return f"{path}\n<g fill='{colour}'>{dots}</g>"


def _key(others: Sequence[tuple[str, ...]], targets: Sequence[str]) -> str:
    """The legend of all lines if they are few, else of the first and the last."""
    if len(others) < 2:
        return ""
    groups_named = others if len(others) <= _CURVES_NAMED else (others[0], others[-1])
    words = [
        ", ".join(map("=".join, zip(targets, named_values, strict=True)))
        for named_values in groups_named
    ]
    parts, left = [], float(_LEFT)
    for named_values, label in zip(groups_named, words, strict=True):
        colour = _colour(others.index(named_values), len(others))
        parts.append(
            f"<line x1='{left:g}' y1='32' x2='{left + 20:g}' y2='32' stroke='{colour}' "
            "stroke-width='3'/>"
        )
        parts.append(text(left + 25, 36, label))
        left += 45 + 7 * len(label)
    return "\n".join(parts)
