"""Curves as braille text: eight dots a character, the same text for the same curves."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from .curve import CURVES_MAX, Axis, Curve, axis

if TYPE_CHECKING:
    from numpy.typing import NDArray

# Bits of U+2800 by dot column (0, 1) and dot row (0 at the top); ISO/TR 11548-1.
_DOTS = ((0x01, 0x02, 0x04, 0x40), (0x08, 0x10, 0x20, 0x80))
_BLANK = 0x2800
# Dash pattern of each curve: of how many dot columns how many are drawn.
_DASHES = ((1, 1), (4, 2), (6, 1))
WIDTH_MIN, HEIGHT_MIN = 24, 5


def plot(
    curves: Sequence[Curve],
    *,
    width: int = 78,
    height: int = 20,
    t_label: str = "time [s]",
    x_label: str = "",
) -> str:
    """Draw up to three curves over one pair of axes, `width` by `height` characters in all."""
    if not 1 <= len(curves) <= CURVES_MAX:
        raise ValueError(f"a plot has 1 to {CURVES_MAX} curves, not {len(curves)}")
    return _draw([(x_label, curves)], width, [height], t_label, 2)


def panels(
    labelled_plots: Sequence[tuple[str, Sequence[Curve]]],
    *,
    width: int = 78,
    heights: Sequence[int],
    t_label: str = "time [s]",
) -> str:
    """Draw several plots one above the other, with a common time axis: the label and the curves of
    each.

    `heights` are their numbers of lines; the lines of the time axis belong to the last plot.
    """
    return _draw(labelled_plots, width, [*heights[:-1], heights[-1] + 2], t_label, 4)


def _draw(
    plots: Sequence[tuple[str, Sequence[Curve]]],
    width: int,
    heights: Sequence[int],
    t_label: str,
    n_ticks: int,
) -> str:
    width = max(width, WIDTH_MIN)
    rows_per_plot = [max(height, HEIGHT_MIN) - 1 for height in heights]  # below a legend
    rows_per_plot[-1] -= 2  # two lines of axis
    x_axes = [
        axis([value for curve in curves for value in curve.x], max(n_ticks, n_rows // 4))
        for (_, curves), n_rows in zip(plots, rows_per_plot, strict=True)
    ]
    margin = max(len(x_axis.text(tick)) for x_axis in x_axes for tick in x_axis.ticks)
    n_columns = width - margin - 2
    times = [t for _, curves in plots for curve in curves for t in curve.t]
    t_axis = axis(times, max(2, n_columns // 14), tight=True)
    lines: list[str] = []
    for (x_label, curves), x_axis, n_rows in zip(plots, x_axes, rows_per_plot, strict=True):
        lines.append(_legend(curves, x_label, margin))
        lines += _canvas_lines(curves, t_axis, x_axis, n_rows, margin, n_columns)
    lines.extend(_time_axis_lines(t_axis, n_columns, margin, t_label))
    return "\n".join(line.rstrip() for line in lines) + "\n"


def _canvas_lines(
    curves: Sequence[Curve],
    t_axis: Axis,
    x_axis: Axis,
    n_rows: int,
    margin: int,
    n_columns: int,
) -> list[str]:
    """The lines of a plot, with the labels of its axis before them."""
    tick_labels = {_text_row(x_axis, tick, n_rows): x_axis.text(tick) for tick in x_axis.ticks}
    cell_rows = [[_BLANK] * n_columns for _ in range(n_rows)]
    for curve, (period, dash_length) in zip(curves, _DASHES, strict=False):
        for dot_column, top_dot, bottom_dot in _columns(curve, t_axis, x_axis, n_columns, n_rows):
            if dot_column % period < dash_length:
                for dot_row in range(top_dot, bottom_dot + 1):
                    cell_rows[dot_row // 4][dot_column // 2] |= _DOTS[dot_column % 2][dot_row % 4]
    lines = []
    for index, cells in enumerate(cell_rows):
        border = "┤" if index in tick_labels else "│"
        lines.append(f"{tick_labels.get(index, ''):>{margin}} {border}{''.join(map(chr, cells))}")
    return lines


def _text_row(x_axis: Axis, value: float, n_rows: int) -> int:
    return round((1 - x_axis.fraction(value)) * (4 * n_rows - 1)) // 4


def _columns(
    curve: Curve, t_axis: Axis, x_axis: Axis, n_columns: int, n_rows: int
) -> Iterator[tuple[int, int, int]]:
    """Each dot column that the curve covers, with the first and the last dot row that it covers
    there, counted from the top.
    """
    dot_columns = _fractions(t_axis, curve.t) * (2 * n_columns - 1)
    dot_rows = (1 - _fractions(x_axis, curve.x)) * (4 * n_rows - 1)
    is_finite = np.isfinite(dot_columns) & np.isfinite(dot_rows)
    # A curve is drawn in one stroke until it has a gap or goes back in time.
    begins_stroke = ~is_finite[1:] | ~is_finite[:-1] | (np.diff(dot_columns) < 0)
    for stroke_indices in np.split(np.arange(len(dot_columns)), np.flatnonzero(begins_stroke) + 1):
        if not is_finite[stroke_indices[:1]].any():
            continue
        first_column, top_rows, bottom_rows = _stroke(
            dot_columns[stroke_indices], dot_rows[stroke_indices]
        )
        for dot_column, (top_row, bottom_row) in enumerate(
            zip(top_rows.tolist(), bottom_rows.tolist(), strict=True), first_column
        ):
            yield dot_column, top_row, bottom_row


def _fractions(axis: Axis, values: Sequence[float]) -> NDArray[np.float64]:
    """`Axis.fraction` of each value."""
    return (np.asarray(values, np.float64) - axis.low) / (axis.high - axis.low)


def _stroke(
    dot_columns: NDArray[np.float64], dot_rows: NDArray[np.float64]
) -> tuple[int, NDArray[np.int64], NDArray[np.int64]]:
    """The first column of a stroke, and the lowest and the highest row in each of its columns."""
    rounded_columns = np.rint(dot_columns).astype(np.int64)
    first_column, n_columns = (
        int(rounded_columns[0]),
        int(rounded_columns[-1] - rounded_columns[0]) + 1,
    )
    columns = np.arange(first_column, first_column + n_columns)
    # A stroke enters and leaves a column at its edges, or begins and ends within it.
    left_edge_rows = np.interp(np.maximum(columns - 0.5, dot_columns[0]), dot_columns, dot_rows)
    right_edge_rows = np.interp(np.minimum(columns + 0.5, dot_columns[-1]), dot_columns, dot_rows)
    top_rows, bottom_rows = (
        np.minimum(left_edge_rows, right_edge_rows),
        np.maximum(left_edge_rows, right_edge_rows),
    )
    np.minimum.at(top_rows, rounded_columns - first_column, dot_rows)
    np.maximum.at(bottom_rows, rounded_columns - first_column, dot_rows)
    return first_column, np.rint(top_rows).astype(np.int64), np.rint(bottom_rows).astype(np.int64)


def _legend(curves: Sequence[Curve], x_label: str, margin: int) -> str:
    entries = []
    for curve, (period, dash_length) in zip(curves, _DASHES, strict=False):
        cells = [_BLANK] * 4
        for column in range(8):
            if column % period < dash_length:
                cells[column // 2] |= _DOTS[column % 2][1]
        entries.append("".join(map(chr, cells)) + " " + curve.name)
    return f"{x_label:<{margin + 2}}" + "   " + "   ".join(entries)


def _time_axis_lines(t_axis: Axis, n_columns: int, margin: int, axis_label: str) -> list[str]:
    axis_line, label_line = ["─"] * n_columns, [" "] * n_columns
    axis_label_begin = n_columns - len(axis_label) - 1
    for tick in t_axis.ticks:
        tick_column = min(round(t_axis.fraction(tick) * (n_columns - 1)), n_columns - 1)
        axis_line[tick_column] = "┴"
        tick_label = t_axis.text(tick)
        tick_label_begin = max(
            0, min(tick_column - len(tick_label) // 2, n_columns - len(tick_label))
        )
        # A number that would touch its neighbour or the label is left out.
        if tick_label_begin + len(tick_label) <= axis_label_begin and not any(
            character != " "
            for character in label_line[
                max(0, tick_label_begin - 1) : tick_label_begin + len(tick_label) + 1
            ]
        ):
            label_line[tick_label_begin : tick_label_begin + len(tick_label)] = tick_label
    label_line[n_columns - len(axis_label) :] = axis_label
    indent = " " * (margin + 1)
    return [f"{indent}└{''.join(axis_line)}", f"{indent} {''.join(label_line)}"]
