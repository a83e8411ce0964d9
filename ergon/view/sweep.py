"""A sweep as a picture: a frame for each figure, over the first parameter that varies."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from .curve import Axis, axis
from .svg import Frame, axes, document, shorten, text

_PANEL_TITLES: Mapping[str, str] = {
    "loudness_lufs": "loudness [LUFS]",
    "centroid_hz": "centroid [Hz]",
    "pitch_hz": "pitch [Hz]",
    "partial_hz": "strongest partial [Hz]",
    "t60_s": "T60 [s]",
    "cpu_s": "work [CPU s]",
    "error_db": "error [dB]",
    "error_cents": "error [cents]",
}
_PANEL_WIDTH, _PANEL_HEIGHT, _PANEL_GAP, _TOP_MARGIN = 460, 170, 62, 60
_LEFT_MARGIN, _RIGHT_MARGIN = 70, 16
_FIRST_COLOUR, _LAST_COLOUR = (86, 180, 233), (0, 30, 90)  # colours of the first and the last curve
_NUMBER_PATTERN = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")
_LEGEND_CURVES_MAX = 6


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
    x_axis = _make_x_axis(points)
    point_groups: dict[tuple[str, ...], list[Point]] = {}
    for point in points:
        point_groups.setdefault(point.values[1:], []).append(point)
    if all(len(curve_points) == 1 for curve_points in point_groups.values()):  # pairs
        point_groups = {(): list(points)}
    figure_names = [
        name for name in _PANEL_TITLES if any(name in point.figures for point in points)
    ]
    elements = [
        text(_LEFT_MARGIN, 20, shorten(title), weight="bold"),
        _legend(list(point_groups), targets[1:]),
    ]
    for panel_index, figure_name in enumerate(figure_names):
        row, column = divmod(panel_index, 2)
        left, top = (
            column * _PANEL_WIDTH,
            _TOP_MARGIN + row * (_PANEL_HEIGHT + _PANEL_GAP),
        )
        values = [point.figures[figure_name] for point in points if figure_name in point.figures]
        frame = Frame(
            left + _LEFT_MARGIN,
            top,
            left + _PANEL_WIDTH - _RIGHT_MARGIN,
            top + _PANEL_HEIGHT,
            x_axis.axis,
            axis(values, 5),
        )
        elements += [
            axes(frame, targets[0] + x_axis.unit, ""),
            text(left + _LEFT_MARGIN, top - 8, _PANEL_TITLES[figure_name]),
        ]
        for index, curve_points in enumerate(point_groups.values()):
            colour = _colour(index, len(point_groups))
            pixels = [
                (
                    frame.x_pixel(x_axis.position(p.values[0])),
                    frame.y_pixel(p.figures[figure_name]),
                )
                for p in curve_points
                if figure_name in p.figures
            ]
            elements.append(_curve_elements(pixels, colour))
    n_rows = (len(figure_names) + 1) // 2
    return document(
        2 * _PANEL_WIDTH,
        _TOP_MARGIN + n_rows * (_PANEL_HEIGHT + _PANEL_GAP),
        f"sweep of {title}",
        elements,
    )


@dataclass(frozen=True, slots=True)
class _XAxis:
    """The horizontal positions of the values of the first target."""

    axis: Axis
    unit: str
    positions: Mapping[str, float]

    def position(self, value: str) -> float:
        return self.positions[value]


def _make_x_axis(points: Sequence[Point]) -> _XAxis:
    """Numbers in their own unit, on a logarithmic axis if they are spaced evenly on one; other
    values at equal distances.
    """
    first_values = list(dict.fromkeys(point.values[0] for point in points))
    matches = [_NUMBER_PATTERN.match(value) for value in first_values]
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
            positions = [math.log10(x) for x in numbers]
            ticks = tuple(sorted(_decimate(positions)))
            tick_labels = tuple(f"{10.0**tick:.3g}" for tick in ticks)
            return _XAxis(
                _axis_with_margin(positions, ticks, tick_labels),
                unit_text,
                dict(zip(first_values, positions, strict=True)),
            )
        return _XAxis(axis(numbers, 6), unit_text, dict(zip(first_values, numbers, strict=True)))
    positions = [float(i) for i in range(len(first_values))]
    ticks = _decimate(positions)
    tick_labels = tuple(first_values[int(tick)] for tick in ticks)
    return _XAxis(
        _axis_with_margin(positions, ticks, tick_labels),
        "",
        dict(zip(first_values, positions, strict=True)),
    )


def _axis_with_margin(
    positions: Sequence[float], ticks: tuple[float, ...], tick_labels: tuple[str, ...]
) -> Axis:
    margin = 0.04 * (max(positions) - min(positions)) or 0.5
    return Axis(min(positions) - margin, max(positions) + margin, ticks, 0, tick_labels)


def _decimate(positions: Sequence[float], n_max: int = 6) -> tuple[float, ...]:
    stride = math.ceil(len(positions) / n_max)
    return tuple(positions[::stride])


def _is_geometric(numbers: Sequence[float]) -> bool:
    if len(numbers) < 3 or min(numbers) <= 0.0:
        return False
    ratios = [b / a for a, b in itertools.pairwise(numbers)]
    differences = [b - a for a, b in itertools.pairwise(numbers)]
    is_arithmetic = max(differences) - min(differences) <= 1e-6 * max(map(abs, differences))
    return not is_arithmetic and max(ratios) <= (1.0 + 1e-6) * min(ratios)


def _colour(curve_index: int, n_curves: int) -> str:
    fraction = curve_index / max(1, n_curves - 1)
    channels = (
        round(a + fraction * (b - a)) for a, b in zip(_FIRST_COLOUR, _LAST_COLOUR, strict=True)
    )
    return "#" + "".join(f"{channel:02x}" for channel in channels)


def _curve_elements(pixels: Sequence[tuple[float, float]], colour: str) -> str:
    if not pixels:
        return ""
    line = "L".join(f"{x:.1f} {y:.1f}" for x, y in pixels)
    dots = "".join(f"<circle cx='{x:.1f}' cy='{y:.1f}' r='2.2'/>" for x, y in pixels)
    path = f"<path d='M{line}' fill='none' stroke='{colour}' stroke-width='1.2'/>"
    return f"{path}\n<g fill='{colour}'>{dots}</g>"


def _legend(values_by_curve: Sequence[tuple[str, ...]], targets: Sequence[str]) -> str:
    """The legend of all lines if they are few, else of the first and the last."""
    if len(values_by_curve) < 2:
        return ""
    shown_values = (
        values_by_curve
        if len(values_by_curve) <= _LEGEND_CURVES_MAX
        else (values_by_curve[0], values_by_curve[-1])
    )
    labels = [
        ", ".join(map("=".join, zip(targets, values, strict=True))) for values in shown_values
    ]
    elements, left = [], float(_LEFT_MARGIN)
    for values, label in zip(shown_values, labels, strict=True):
        colour = _colour(values_by_curve.index(values), len(values_by_curve))
        elements.append(
            f"<line x1='{left:g}' y1='32' x2='{left + 20:g}' y2='32' stroke='{colour}' "
            "stroke-width='3'/>"
        )
        elements.append(text(left + 25, 36, label))
        left += 45 + 7 * len(label)
    return "\n".join(elements)
