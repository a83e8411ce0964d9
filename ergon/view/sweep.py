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


def picture(title: str, target_names: Sequence[str], sweep_points: Sequence[Point]) -> str:
    """The sweep as a whole SVG document.

    Variants that differ only in the first value are joined by a line; lines get darker from the
    first to the last of the other values.
    """
    horizontal = _across(sweep_points)
    points_by_other_values: dict[tuple[str, ...], list[Point]] = {}
    for point in sweep_points:
        points_by_other_values.setdefault(point.values[1:], []).append(point)
    if all(len(curve_points) == 1 for curve_points in points_by_other_values.values()):  # pairs
        points_by_other_values = {(): list(sweep_points)}
    figure_names = [
        name for name in _PANELS if any(name in point.figures for point in sweep_points)
    ]
    svg_parts = [
        text(_LEFT_MARGIN, 20, short(title), weight="bold"),
        _key(list(points_by_other_values), target_names[1:]),
    ]
    for panel_number, figure_name in enumerate(figure_names):
        row, column = divmod(panel_number, 2)
        left_edge, top_edge = (
            column * _PANEL_WIDTH,
            _TOP_MARGIN + row * (_PANEL_HEIGHT + _PANEL_GAP),
        )
        figures = [
            point.figures[figure_name] for point in sweep_points if figure_name in point.figures
        ]
        plot_frame = Frame(
            left_edge + _LEFT_MARGIN,
            top_edge,
            left_edge + _PANEL_WIDTH - _RIGHT_MARGIN,
            top_edge + _PANEL_HEIGHT,
            horizontal.axis,
            axis(figures, 5),
        )
        svg_parts += [
            axes(plot_frame, target_names[0] + horizontal.unit, ""),
            text(left_edge + _LEFT_MARGIN, top_edge - 8, _PANELS[figure_name]),
        ]
        for index, curve_points in enumerate(points_by_other_values.values()):
            colour = _colour(index, len(points_by_other_values))
            line_points = [
                (
                    plot_frame.across(horizontal.place_of(p.values[0])),
                    plot_frame.down(p.figures[figure_name]),
                )
                for p in curve_points
                if figure_name in p.figures
            ]
            svg_parts.append(_curve(line_points, colour))
    rows = (len(figure_names) + 1) // 2
    return document(
        2 * _PANEL_WIDTH,
        _TOP_MARGIN + rows * (_PANEL_HEIGHT + _PANEL_GAP),
        f"sweep of {title}",
        svg_parts,
    )


@dataclass(frozen=True, slots=True)
class _Across:
    """The horizontal positions of the values of the first target."""

    axis: Axis
    unit: str
    places: Mapping[str, float]

    def place_of(self, value: str) -> float:
        return self.places[value]


def _across(sweep_points: Sequence[Point]) -> _Across:
    """Numbers in their own unit, on a logarithmic axis if they are spaced evenly on one; other
    values at equal distances.
    """
    first_values = list(dict.fromkeys(point.values[0] for point in sweep_points))
    matches = [_NUMBER_PATTERN.match(value) for value in first_values]
    units = {
        value[match.end() :].strip()
        for value, match in zip(first_values, matches, strict=True)
        if match
    }
    if all(matches) and len(units) == 1:
        axis_numbers = [float(match[0]) for match in matches if match]
        (unit,) = units
        unit_text = f" [{unit}]" if unit else ""
        if _is_geometric(axis_numbers):
            positions = [math.log10(x) for x in axis_numbers]
            ticks = tuple(sorted(_few(positions)))
            tick_names = tuple(f"{10.0**tick:.3g}" for tick in ticks)
            return _Across(
                _room(positions, ticks, tick_names),
                unit_text,
                dict(zip(first_values, positions, strict=True)),
            )
        return _Across(
            axis(axis_numbers, 6), unit_text, dict(zip(first_values, axis_numbers, strict=True))
        )
    positions = [float(i) for i in range(len(first_values))]
    ticks = _few(positions)
    tick_names = tuple(first_values[int(tick)] for tick in ticks)
    return _Across(
        _room(positions, ticks, tick_names), "", dict(zip(first_values, positions, strict=True))
    )


def _room(positions: Sequence[float], ticks: tuple[float, ...], names: tuple[str, ...]) -> Axis:
    margin = 0.04 * (max(positions) - min(positions)) or 0.5
    return Axis(min(positions) - margin, max(positions) + margin, ticks, 0, names)


def _few(positions: Sequence[float], count_max: int = 6) -> tuple[float, ...]:
    stride = math.ceil(len(positions) / count_max)
    return tuple(positions[::stride])


def _is_geometric(axis_numbers: Sequence[float]) -> bool:
    if len(axis_numbers) < 3 or min(axis_numbers) <= 0.0:
        return False
    ratios = [b / a for a, b in itertools.pairwise(axis_numbers)]
    differences = [b - a for a, b in itertools.pairwise(axis_numbers)]
    is_arithmetic = max(differences) - min(differences) <= 1e-6 * max(map(abs, differences))
    return not is_arithmetic and max(ratios) <= (1.0 + 1e-6) * min(ratios)


def _colour(index: int, count: int) -> str:
    share = index / max(1, count - 1)
    channels = (
        round(a + share * (b - a)) for a, b in zip(_FIRST_COLOUR, _LAST_COLOUR, strict=True)
    )
    return "#" + "".join(f"{channel:02x}" for channel in channels)


def _curve(line_points: Sequence[tuple[float, float]], colour: str) -> str:
    if not line_points:
        return ""
    line = "L".join(f"{x:.1f} {y:.1f}" for x, y in line_points)
    dots = "".join(f"<circle cx='{x:.1f}' cy='{y:.1f}' r='2.2'/>" for x, y in line_points)
    path = f"<path d='M{line}' fill='none' stroke='{colour}' stroke-width='1.2'/>"
    return f"{path}\n<g fill='{colour}'>{dots}</g>"


def _key(other_values: Sequence[tuple[str, ...]], targets: Sequence[str]) -> str:
    """The legend of all lines if they are few, else of the first and the last."""
    if len(other_values) < 2:
        return ""
    labelled_values = (
        other_values
        if len(other_values) <= _LEGEND_CURVES_MAX
        else (other_values[0], other_values[-1])
    )
    labels = [
        ", ".join(map("=".join, zip(targets, values, strict=True))) for values in labelled_values
    ]
    svg_parts, left_edge = [], float(_LEFT_MARGIN)
    for values, label in zip(labelled_values, labels, strict=True):
        colour = _colour(other_values.index(values), len(other_values))
        svg_parts.append(
            f"<line x1='{left_edge:g}' y1='32' x2='{left_edge + 20:g}' y2='32' stroke='{colour}' "
            "stroke-width='3'/>"
        )
        svg_parts.append(text(left_edge + 25, 36, label))
        left_edge += 45 + 7 * len(label)
    return "\n".join(svg_parts)
