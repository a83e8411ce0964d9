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
    panel_rows: Sequence[tuple[str, Sequence[Curve]]],
    *,
    width: int = 78,
    heights: Sequence[int],
    t_label: str = "time [s]",
) -> str:
    """Draw several plots one above the other, with a common time axis: the label and the curves of
    each.

    `heights` are their numbers of lines; the lines of the time axis belong to the last plot.
    """
    return _drawn(panel_rows, width, [*heights[:-1], heights[-1] + 2], t_label, 4)


def _drawn(
    plots: Sequence[tuple[str, Sequence[Curve]]],
    line_width: int,
    heights: Sequence[int],
    t_label: str,
    n_ticks: int,
) -> str:
    line_width = max(line_width, WIDTH_MIN)
    n_rows = [max(height, HEIGHT_MIN) - 1 for height in heights]  # below a legend
    n_rows[-1] -= 2  # two lines of axis
    x_axes = [
        axis([value for curve in curves for value in curve.x], max(n_ticks, n // 4))
        for (_, curves), n in zip(plots, n_rows, strict=True)
    ]
    margin = max(len(drawn_axis.text(tick)) for drawn_axis in x_axes for tick in drawn_axis.ticks)
    column_count = line_width - margin - 2
    t = [t for _, curves in plots for curve in curves for t in curve.t]
    t_axis = axis(t, max(2, column_count // 14), tight=True)
    canvas_lines: list[str] = []
    for (x_label, curves), x_axis, n in zip(plots, x_axes, n_rows, strict=True):
        canvas_lines.append(_legend(curves, x_label, margin))
        canvas_lines += _canvas(curves, t_axis, x_axis, n, margin, column_count)
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
    canvas = [[_BLANK] * column_count for _ in range(row_count)]
    for curve, (period, drawn) in zip(curves, _PATTERNS, strict=False):
        for column_index, low, high in _columns(curve, t_axis, x_axis, column_count, row_count):
            if column_index % period < drawn:
                for dot in range(low, high + 1):
                    canvas[dot // 4][column_index // 2] |= _DOTS[column_index % 2][dot % 4]
    canvas_lines = []
    for index, row in enumerate(canvas):
        corner = "┤" if index in tick_labels else "│"
        canvas_lines.append(
            f"{tick_labels.get(index, ''):>{margin}} {corner}{''.join(map(chr, row))}"
        )
    return canvas_lines


def _row(x_axis: Axis, value: float, rows: int) -> int:
    return round((1 - x_axis.part(value)) * (4 * rows - 1)) // 4


def _columns(
    curve: Curve, t_axis: Axis, x_axis: Axis, column_count: int, row_count: int
) -> Iterator[tuple[int, int, int]]:
    """A dot column that a stroke of the curve covers, and its first and last row from the top."""
    dots_across = _parts(t_axis, curve.t) * (2 * column_count - 1)
    rows_down = (1 - _parts(x_axis, curve.x)) * (4 * row_count - 1)
    is_finite = np.isfinite(dots_across) & np.isfinite(rows_down)
    # A curve is drawn in one stroke until it has a gap or goes back in time.
    is_new = ~is_finite[1:] | ~is_finite[:-1] | (np.diff(dots_across) < 0)
    for stroke in np.split(np.arange(len(dots_across)), np.flatnonzero(is_new) + 1):
        if not is_finite[stroke[:1]].any():
            continue
        first_column, top, bottom = _stroke(dots_across[stroke], rows_down[stroke])
        for column_index, (low_row, high_row) in enumerate(
            zip(top.tolist(), bottom.tolist(), strict=True), first_column
        ):
            yield column_index, low_row, high_row


def _parts(axis: Axis, values: Sequence[float]) -> NDArray[np.float64]:
    """`Axis.part` of each value."""
    return (np.asarray(values, np.float64) - axis.low) / (axis.high - axis.low)


def _stroke(
    dots_across: NDArray[np.float64], rows_down: NDArray[np.float64]
) -> tuple[int, NDArray[np.int64], NDArray[np.int64]]:
    """The first column of a stroke, and the lowest and the highest row in each of its columns."""
    column_index = np.rint(dots_across).astype(np.int64)
    first_column, n_columns = int(column_index[0]), int(column_index[-1] - column_index[0]) + 1
    middles = np.arange(first_column, first_column + n_columns)
    # A stroke enters and leaves a column at its edges, or begins and ends within it.
    enters = np.interp(np.maximum(middles - 0.5, dots_across[0]), dots_across, rows_down)
    leaves = np.interp(np.minimum(middles + 0.5, dots_across[-1]), dots_across, rows_down)
    top, bottom = np.minimum(enters, leaves), np.maximum(enters, leaves)
    np.minimum.at(top, column_index - first_column, rows_down)
    np.maximum.at(bottom, column_index - first_column, rows_down)
    return first_column, np.rint(top).astype(np.int64), np.rint(bottom).astype(np.int64)


def _legend(curves: Sequence[Curve], x_label: str, margin: int) -> str:
    legend_samples = []
    for curve, (period, drawn) in zip(curves, _PATTERNS, strict=False):
        cells = [_BLANK] * 4
        for column in range(8):
            if column % period < drawn:
                cells[column // 2] |= _DOTS[column % 2][1]
        legend_samples.append("".join(map(chr, cells)) + " " + curve.name)
    return f"{x_label:<{margin + 2}}" + "   " + "   ".join(legend_samples)


def _time(t_axis: Axis, column_count: int, margin: int, axis_label: str) -> list[str]:
    axis_line, tick_words = ["─"] * column_count, [" "] * column_count
    room = column_count - len(axis_label) - 1
    for tick in t_axis.ticks:
        tick_column = min(round(t_axis.part(tick) * (column_count - 1)), column_count - 1)
        axis_line[tick_column] = "┴"
        tick_text = t_axis.text(tick)
        label_start = max(0, min(tick_column - len(tick_text) // 2, column_count - len(tick_text)))
        # A number that would touch its neighbour or the label is left out.
        if label_start + len(tick_text) <= room and not any(
            word != " "
            for word in tick_words[max(0, label_start - 1) : label_start + len(tick_text) + 1]
        ):
            tick_words[label_start : label_start + len(tick_text)] = tick_text
    tick_words[column_count - len(axis_label) :] = axis_label
    space = " " * (margin + 1)
    return [f"{space}└{''.join(axis_line)}", f"{space} {''.join(tick_words)}"]
