"""The picture of maps: colours are outcomes, marks say whether they are accurate, lines are
predictions.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np

from ergon.workshop.lab.map_table import Surveyed
from ergon.workshop.lab.maps import Map, Spot
from ergon.workshop.lab.metrics import Floats

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_STABLE_COLOUR, _UNSTABLE_COLOUR, _REFUSED_COLOUR = "#cfe6f5", "#eda06f", "#d9d9d9"
_COLOUR_BY_OUTCOME = {True: _STABLE_COLOUR, False: _UNSTABLE_COLOUR, None: _REFUSED_COLOUR}
_BORDER_POINTS = 160  # points a side on which a formula's border is drawn
_COLUMNS_MAX = 2
_PANEL_WIDTH = 4.6  # width of a panel [in]
_TITLE_DENSITY, _PANEL_TITLE_DENSITY = 9, 12  # letters of titles that an inch takes, at least
_WIDE_FIGURE = 1.5 * _PANEL_WIDTH  # width from which the legend has four columns
_UNCHANGED_MARKER: dict[str, Any] = {
    "marker": "D", "linestyle": "", "markersize": 9, "markerfacecolor": "none",
    "markeredgecolor": "#b3261e", "markeredgewidth": 1.6,
}  # fmt: skip


def draw(surveyed: Surveyed, title: str) -> Figure:
    """A figure with a panel for each map."""
    from matplotlib.figure import Figure

    n_columns = min(_COLUMNS_MAX, len(surveyed))
    n_rows = -(-len(surveyed) // n_columns)
    # The keys of the legend take more rows below a single panel.
    legend_height = 1.0 if n_columns > 1 else 1.5
    figure = Figure(
        figsize=(_PANEL_WIDTH * n_columns, 3.4 * n_rows + legend_height), layout="constrained"
    )
    figure.suptitle(fill(title, int(_TITLE_DENSITY * _PANEL_WIDTH * n_columns)), fontweight="bold")
    grid = figure.subplots(n_rows, n_columns, squeeze=False).ravel()
    for ax, (surveyed_map, spots) in zip(grid, surveyed.values(), strict=False):
        _draw_panel(ax, surveyed_map, spots)
    for ax in grid[len(surveyed) :]:
        ax.set_axis_off()
    has_written = any(surveyed_map.as_written is not None for surveyed_map, _ in surveyed.values())
    _legend(figure, grid[len(surveyed)] if len(grid) > len(surveyed) else None, has_written)
    return figure


def _draw_panel(ax: Axes, surveyed_map: Map, spots: Sequence[Spot]) -> None:
    ax.set_title(
        fill(surveyed_map.title, int(_PANEL_TITLE_DENSITY * (_PANEL_WIDTH - 1.0))), fontsize=9
    )
    ax.set_xlabel(surveyed_map.x_label)
    ax.set_ylabel(surveyed_map.y_label)
    ax.set_xscale("log" if surveyed_map.log_x else "linear")
    ax.set_yscale("log" if surveyed_map.log_y else "linear")
    for axis, axis_values in ((ax.xaxis, surveyed_map.xs), (ax.yaxis, surveyed_map.ys)):
        axis.set_major_formatter("{x:g}")
        axis.set_minor_formatter("")
        if len(axis_values) <= 5:
            axis.set_ticks(axis_values)
    _draw_outcomes(ax, surveyed_map, spots)
    _draw_accuracy(ax, spots)
    _draw_borders(ax, surveyed_map, spots)
    if surveyed_map.as_written is not None:
        ax.plot(*surveyed_map.as_written, **_UNCHANGED_MARKER, zorder=3)


def _draw_outcomes(ax: Axes, surveyed_map: Map, spots: Sequence[Spot]) -> None:
    """Draw a rectangle for each run of spots in a row with the same outcome."""
    from matplotlib.patches import Rectangle

    x, y = _edges(surveyed_map.xs, surveyed_map.log_x), _edges(surveyed_map.ys, surveyed_map.log_y)
    n_columns = len(surveyed_map.xs)
    for row in range(len(surveyed_map.ys)):
        runs = groupby(
            enumerate(s.stable for s in spots[row * n_columns : (row + 1) * n_columns]),
            _second,
        )
        for stable, run in runs:
            columns = [column for column, _ in run]
            left, right = x[columns[0]], x[columns[-1] + 1]
            size = float(right - left), float(y[row + 1] - y[row])
            colour = _COLOUR_BY_OUTCOME[stable]
            ax.add_patch(Rectangle((float(left), float(y[row])), *size, color=colour, zorder=0))
    ax.set_xlim(x[0], x[-1])
    ax.set_ylim(y[0], y[-1])


def _second(pair: tuple[int, bool | None]) -> bool | None:
    return pair[1]


def _draw_accuracy(ax: Axes, spots: Sequence[Spot]) -> None:
    for accurate, marker, marker_size in ((True, "o", 2.6), (False, "x", 3.0)):
        x = [s.x for s in spots if s.accurate is accurate]
        y = [s.y for s in spots if s.accurate is accurate]
        ax.plot(
            x, y, marker, color="#1f3b57", markersize=marker_size, markeredgewidth=0.7, zorder=2
        )


def _draw_borders(ax: Axes, surveyed_map: Map, spots: Sequence[Spot]) -> None:
    """Draw the border of the formula as a solid line, and that of the certificate as a dashed line
    between spots.
    """
    if surveyed_map.load is not None:
        x, y = (
            _fine_grid(v, log)
            for v, log in (
                (surveyed_map.xs, surveyed_map.log_x),
                (surveyed_map.ys, surveyed_map.log_y),
            )
        )
        log_load = np.array([[np.log(max(surveyed_map.load(a, b), 1e-300)) for a in x] for b in y])
        if log_load.min() < 0.0 < log_load.max():
            ax.contour(x, y, log_load, levels=[0.0], colors="black", linewidths=1.4)
    is_allowed = np.array([s.certified is not False for s in spots]).reshape(
        len(surveyed_map.ys), -1
    )
    x, y = _edges(surveyed_map.xs, surveyed_map.log_x), _edges(surveyed_map.ys, surveyed_map.log_y)
    for row_index, column_index in np.argwhere(is_allowed[:, 1:] != is_allowed[:, :-1]):
        _draw_border_segment(ax, [x[column_index + 1]] * 2, y[row_index : row_index + 2])
    for row_index, column_index in np.argwhere(is_allowed[1:] != is_allowed[:-1]):
        _draw_border_segment(ax, x[column_index : column_index + 2], [y[row_index + 1]] * 2)


def _draw_border_segment(
    ax: Axes, x: Sequence[float] | Floats, y: Sequence[float] | Floats
) -> None:
    ax.plot(x, y, "--", color="black", linewidth=1.6, zorder=1)


def _edges(values: Sequence[float], is_log: bool) -> Floats:
    """The boundaries of cells centred on some values."""
    positions = np.log(values) if is_log else np.array(values)
    if len(positions) == 1:
        edges = np.array([positions[0] - 0.5, positions[0] + 0.5])
    else:
        middle = 0.5 * (positions[1:] + positions[:-1])
        first_edge, last_edge = 2 * positions[0] - middle[0], 2 * positions[-1] - middle[-1]
        edges = np.concatenate([[first_edge], middle, [last_edge]])
    return np.exp(edges) if is_log else edges


def _fine_grid(values: Sequence[float], is_log: bool) -> Floats:
    edges = _edges(values, is_log)
    low, high = max(edges[0], 0.0), edges[-1]
    return (
        np.geomspace(low, high, _BORDER_POINTS)
        if is_log
        else np.linspace(low, high, _BORDER_POINTS)
    )


def _legend(figure: Figure, ax: Axes | None, has_written: bool) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    ink = "#1f3b57"
    handles: list[Line2D | Patch] = [
        Patch(color=_STABLE_COLOUR, label="stays finite"),
        Patch(color=_UNSTABLE_COLOUR, label="runs away"),
        Patch(color=_REFUSED_COLOUR, label="refused, and not run"),
        Line2D([], [], marker="o", linestyle="", color=ink, markersize=4, label="and is right"),
        Line2D([], [], marker="x", linestyle="", color=ink, markersize=5, label="but is wrong"),
        Line2D([], [], color="black", linewidth=1.4, label="border by a formula"),
        Line2D([], [], color="black", linestyle="--", label="border by the certificate"),
    ]
    if has_written:
        handles.append(Line2D([], [], label="the score as it is written", **_UNCHANGED_MARKER))
    if ax is not None:
        ax.legend(handles=handles, loc="center", frameon=False)
    else:
        columns = 2 if figure.get_figwidth() < _WIDE_FIGURE else 4
        figure.legend(handles=handles, loc="outside lower center", ncols=columns, frameon=False)
