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
# Dash pattern of each curve: of `period` dot columns the first `drawn` are drawn.
_PATTERNS = ((1, 1), (4, 2), (6, 1))
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
    return _drawn([(x_label, curves)], width, [height], t_label, 2)


def panels(
    labelled_curves: Sequence[tuple[str, Sequence[Curve]]],
    *,
    width: int = 78,
    heights: Sequence[int],
    t_label: str = "time [s]",
) -> str:
    """Draw several plots one above the other, with a common time axis: the label and the curves of
    each.

    `heights` are their numbers of lines; the lines of the time axis belong to the last plot.
    """
    return _drawn(labelled_curves, width, [*heights[:-1], heights[-1] + 2], t_label, 4)


def _drawn(
    plots: Sequence[tuple[str, Sequence[Curve]]],
    line_width: int,
    heights: Sequence[int],
    t_label: str,
    n_ticks: int,
) -> str:
    line_width = max(line_width, WIDTH_MIN)
    row_counts = [max(height, HEIGHT_MIN) - 1 for height in heights]  # below a legend
    row_counts[-1] -= 2  # two lines of axis
    x_axes = [
        axis([value for curve in curves for value in curve.x], max(n_ticks, row_count // 4))
        for (_, curves), row_count in zip(plots, row_counts, strict=True)
    ]
    margin = max(
        len(x_axis_drawn.text(tick)) for x_axis_drawn in x_axes for tick in x_axis_drawn.ticks
    )
    column_count = line_width - margin - 2
    instants = [t for _, curves in plots for curve in curves for t in curve.t]
    t_axis = axis(instants, max(2, column_count // 14), tight=True)
    canvas_lines: list[str] = []
    for (x_label, curves), x_axis, row_count in zip(plots, x_axes, row_counts, strict=True):
        canvas_lines.append(_legend(curves, x_label, margin))
        canvas_lines += _canvas(curves, t_axis, x_axis, row_count, margin, column_count)
    canvas_lines.extend(_time(t_axis, column_count, margin, t_label))
    return "\n".join(line.rstrip() for line in canvas_lines) + "\n"


def _canvas(
    curves: Sequence[Curve],
    t_axis: Axis,
    x_axis: Axis,
    row_count: int,
    margin: int,
    column_count: int,
) -> list[str]:
    """The lines of a plot, with the labels of its axis before them."""
    tick_labels = {_row(x_axis, tick, row_count): x_axis.text(tick) for tick in x_axis.ticks}
    canvas_rows = [[_BLANK] * column_count for _ in range(row_count)]
    for curve, (period, drawn_columns) in zip(curves, _PATTERNS, strict=False):
        for column_index, top_dot, bottom_dot in _columns(
            curve, t_axis, x_axis, column_count, row_count
        ):
            if column_index % period < drawn_columns:
                for dot_row in range(top_dot, bottom_dot + 1):
                    canvas_rows[dot_row // 4][column_index // 2] |= _DOTS[column_index % 2][
                        dot_row % 4
                    ]
    canvas_lines = []
    for index, cells in enumerate(canvas_rows):
        axis_sign = "┤" if index in tick_labels else "│"
        canvas_lines.append(
            f"{tick_labels.get(index, ''):>{margin}} {axis_sign}{''.join(map(chr, cells))}"
        )
    return canvas_lines


def _row(x_axis: Axis, value: float, row_count: int) -> int:
    return round((1 - x_axis.part(value)) * (4 * row_count - 1)) // 4


def _columns(
    curve: Curve, t_axis: Axis, x_axis: Axis, column_count: int, row_count: int
) -> Iterator[tuple[int, int, int]]:
    """Each dot column that the curve covers, with the first and the last dot row that it covers
    there, counted from the top.
    """
    dot_columns = _parts(t_axis, curve.t) * (2 * column_count - 1)
    dot_rows = (1 - _parts(x_axis, curve.x)) * (4 * row_count - 1)
    is_finite = np.isfinite(dot_columns) & np.isfinite(dot_rows)
    # A curve is drawn in one stroke until it has a gap or goes back in time.
    begins_stroke = ~is_finite[1:] | ~is_finite[:-1] | (np.diff(dot_columns) < 0)
    for stroke in np.split(np.arange(len(dot_columns)), np.flatnonzero(begins_stroke) + 1):
        if not is_finite[stroke[:1]].any():
            continue
        first_column, top, bottom = _stroke(dot_columns[stroke], dot_rows[stroke])
        for column_index, (low_row, high_row) in enumerate(
            zip(top.tolist(), bottom.tolist(), strict=True), first_column
        ):
            yield column_index, low_row, high_row


def _parts(axis: Axis, values: Sequence[float]) -> NDArray[np.float64]:
    """`Axis.part` of each value."""
    return (np.asarray(values, np.float64) - axis.low) / (axis.high - axis.low)


def _stroke(
    dot_columns: NDArray[np.float64], dot_rows: NDArray[np.float64]
) -> tuple[int, NDArray[np.int64], NDArray[np.int64]]:
    """The first column of a stroke, and the lowest and the highest row in each of its columns."""
    rounded_columns = np.rint(dot_columns).astype(np.int64)
    first_column, column_count = (
        int(rounded_columns[0]),
        int(rounded_columns[-1] - rounded_columns[0]) + 1,
    )
    columns = np.arange(first_column, first_column + column_count)
    # A stroke enters and leaves a column at its edges, or begins and ends within it.
    row_at_left_edge = np.interp(np.maximum(columns - 0.5, dot_columns[0]), dot_columns, dot_rows)
    row_at_right_edge = np.interp(np.minimum(columns + 0.5, dot_columns[-1]), dot_columns, dot_rows)
    top, bottom = (
        np.minimum(row_at_left_edge, row_at_right_edge),
        np.maximum(row_at_left_edge, row_at_right_edge),
    )
    np.minimum.at(top, rounded_columns - first_column, dot_rows)
    np.maximum.at(bottom, rounded_columns - first_column, dot_rows)
    return first_column, np.rint(top).astype(np.int64), np.rint(bottom).astype(np.int64)


def _legend(curves: Sequence[Curve], x_label: str, margin: int) -> str:
    legend_entries = []
    for curve, (period, drawn_columns) in zip(curves, _PATTERNS, strict=False):
        cells = [_BLANK] * 4
        for column in range(8):
            if column % period < drawn_columns:
                cells[column // 2] |= _DOTS[column % 2][1]
        legend_entries.append("".join(map(chr, cells)) + " " + curve.name)
    return f"{x_label:<{margin + 2}}" + "   " + "   ".join(legend_entries)


def _time(t_axis: Axis, column_count: int, margin: int, axis_label: str) -> list[str]:
    axis_line, label_row = ["─"] * column_count, [" "] * column_count
    label_begin = column_count - len(axis_label) - 1
    for tick in t_axis.ticks:
        tick_column = min(round(t_axis.part(tick) * (column_count - 1)), column_count - 1)
        axis_line[tick_column] = "┴"
        tick_text = t_axis.text(tick)
        label_start = max(0, min(tick_column - len(tick_text) // 2, column_count - len(tick_text)))
        # A number that would touch its neighbour or the label is left out.
        if label_start + len(tick_text) <= label_begin and not any(
            character != " "
            for character in label_row[max(0, label_start - 1) : label_start + len(tick_text) + 1]
        ):
            label_row[label_start : label_start + len(tick_text)] = tick_text
    label_row[column_count - len(axis_label) :] = axis_label
    indent = " " * (margin + 1)
    return [f"{indent}└{''.join(axis_line)}", f"{indent} {''.join(label_row)}"]
