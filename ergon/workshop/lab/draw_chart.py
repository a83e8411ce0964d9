"""The picture of a chart: error over cost, both logarithmic; failures are on the upper edge."""

from __future__ import annotations

from math import isfinite
from textwrap import fill
from typing import TYPE_CHECKING

from ergon.workshop.lab.chart import Chart, Point, likely_cost
from ergon.workshop.lab.names import METHODS, METRICS
from ergon.workshop.lab.pictures import COLOURS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_IN_DB = ("waveform", "energy")
_LEAST = 1e-6  # cents, or dB of spectra: smaller is nothing, and a logarithm needs an end
_LEAST_DB = -320.0
_TITLE = 60  # letters of a title that fit beside one another
_ROW = 0.045  # height of a row of failures over that of the axes


def draw(chart: Chart, title: str, machine: str) -> Figure:
    """A figure of the chart."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import LogLocator

    figure = Figure(figsize=(7.5, 6.0), layout="constrained")
    ax = figure.subplots()
    heading = fill(f"{title}: the first {chart.seconds:g} s", _TITLE)
    ax.set_title(heading, loc="left", fontweight="bold", pad=14)
    ax.set_xscale("log")
    ax.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    ax.xaxis.set_major_formatter("{x:g}")
    ax.xaxis.set_minor_formatter("")
    ax.grid(True)
    ax.set_xlabel(f"cost: seconds of one core per second of sound ({machine})", fontsize=8)
    ax.set_ylabel(METRICS[chart.metric])
    if chart.metric not in _IN_DB:
        ax.set_yscale("log")
    measured_points = [
        p for p in chart.points if p.status == "ok" and p.error(chart.metric) is not None
    ]
    _front(ax, chart, measured_points)
    names_by_method: dict[str, str] = {method: method for method in METHODS}
    for group in chart.alike:
        names_by_method.update(
            {method: "" for method in group[1:]}, **{group[0]: " = ".join(group)}
        )
    for method in METHODS:
        if names_by_method[method]:
            row = [p for p in measured_points if p.setting.method == method]
            _method(ax, chart, row, method, names_by_method[method])
    for point in measured_points:
        if point.setting.method is None:
            _planner(ax, chart, point)
    _limits(ax, chart, measured_points)
    _failures(ax, chart)
    if ax.get_legend_handles_labels()[0]:
        # Below the axes it lies on no data.
        figure.legend(loc="outside lower center", ncols=2, frameon=False)
    return figure


def _height(chart: Chart, point: Point) -> float:
    """The height of a point; points below the floor are drawn on it."""
    error = point.error(chart.metric)
    assert error is not None
    least = _LEAST_DB if chart.metric in _IN_DB else _LEAST
    return max(error, least if chart.floor is None else chart.floor, least)


def _cost(point: Point) -> float:
    assert point.cost is not None
    return point.cost


def _method(
    ax: Axes, chart: Chart, chart_points: list[Point], method: str, method_label: str
) -> None:
    colour = COLOURS[METHODS.index(method)]
    for precision, marker, line_style in (("f64", "o", "-"), ("f32", "s", ":")):
        chart_row = [p for p in chart_points if p.setting.precision == precision]
        chart_row.sort(key=lambda p: p.setting.oversampling)
        if chart_row:
            label = method_label if precision == "f64" else f"{method_label}, single precision"
            x, y = [_cost(p) for p in chart_row], [_height(chart, p) for p in chart_row]
            ax.plot(
                x, y, line_style, color=colour, marker=marker, markersize=5, label=label, zorder=3
            )
        for point in chart_row:
            position = _cost(point), _height(chart, point)
            _word(ax, f"×{point.setting.oversampling}", position, colour)


def _planner(ax: Axes, chart: Chart, chart_point: Point) -> None:
    """A full star is the planner's choice by ear, an empty one its choice for an error."""
    star_position, budget = (
        (_cost(chart_point), _height(chart, chart_point)),
        chart_point.setting.budget_db,
    )
    inside, star_label = "black", "the planner's choice"
    if budget is not None:
        inside, star_label = "white", f"the planner's choice for {budget:g} dB"
        if chart.metric == "waveform":
            ax.axhline(budget, color="black", linewidth=0.8, linestyle=":", zorder=0,
                       label=f"{budget:g} dB, as asked for")  # fmt: skip
    ax.plot(
        *star_position,
        "*",
        color="black",
        markerfacecolor=inside,
        markersize=14,
        label=star_label,
        zorder=4,
    )
    _word(ax, chart_point.reason, star_position, "black", below=True)


def _front(ax: Axes, chart: Chart, measured_points: list[Point]) -> None:
    """No fixed setting is both cheaper and better than the points on this line; stars may be."""
    row = sorted((_cost(p), _height(chart, p)) for p in measured_points if p.on_front)
    if row:
        x, y = zip(*row, strict=True)
        label = "best fixed setting for its cost"
        ax.step(x, y, where="post", color="#bbbbbb", linewidth=5, label=label,
                solid_capstyle="round", zorder=1)  # fmt: skip


def _limits(ax: Axes, chart: Chart, measured_points: list[Point]) -> None:
    floor = chart.floor
    heights = [_height(chart, p) for p in measured_points] or [0.0]
    if chart.metric not in _IN_DB:
        ax.set_ylim(top=2.5 * max(*heights, 1e-3))
    else:
        heights_and_floor = heights if floor is None else [*heights, max(floor, _LEAST_DB)]
        lowest_height, highest_height = min(heights_and_floor), max(heights)
        room = max(6.0, 0.08 * (highest_height - lowest_height))
        rows = len(_failed_methods(chart))
        ax.set_ylim(
            lowest_height - room,
            highest_height + 2 * room + rows * _ROW * (highest_height - lowest_height + 3 * room),
        )
    costs = [cost for p in chart.points if (cost := likely_cost(chart, p))] or [0.3]
    ax.set_xlim(min(costs) / 1.5, max(costs) * 2.0)
    if ax.get_xlim()[0] < 1.0 < ax.get_xlim()[1]:
        ax.axvline(1.0, color="#999999", linewidth=0.8, linestyle="--", zorder=0)
        ax.text(1.0, 0.01, " real time", transform=ax.get_xaxis_transform(), fontsize=8)
    if floor is None or not isfinite(floor) or chart.reference is None:
        return
    floor = max(floor, _LEAST_DB if chart.metric in _IN_DB else _LEAST)
    bottom = ax.get_ylim()[0]
    if chart.metric not in _IN_DB:
        bottom = min(bottom, floor / 3.0)
        ax.set_ylim(bottom=bottom)
    ax.axhspan(bottom, floor, facecolor="#eeeeee", edgecolor="#cccccc", hatch="///", zorder=0)
    limit_sentence = f"the reference ({chart.reference.setting}) is itself no surer than this"
    paper = {"facecolor": "white", "edgecolor": "none", "pad": 1.5}
    # At the lower edge, where no point is: the floor is the lowest height of a point.
    ax.annotate(limit_sentence, (0.0, 0.0), xycoords="axes fraction", xytext=(6, 4),
                textcoords="offset points", fontsize=8, va="bottom", bbox=paper)  # fmt: skip


def _failures(ax: Axes, chart: Chart) -> None:
    """Draw failures at the upper edge, a row for each method, at the cost that each would have; the
    legend says what happened.
    """
    left_limit = ax.get_xlim()[0]
    for row, method in enumerate(_failed_methods(chart)):
        failed = [p for p in chart.points if p.status != "ok" and p.setting.method == method]
        row_height = 1.0 - _ROW * row
        colour = COLOURS[METHODS.index(method)] if method else "black"
        costs = [likely_cost(chart, point) or left_limit for point in failed]
        label = f"{method or 'the planner'}: {_what_failed(failed)}"
        ax.plot(costs, [row_height] * len(costs), "X", color=colour, markersize=8, label=label,
                transform=ax.get_xaxis_transform(), clip_on=False, zorder=5)  # fmt: skip


def _failed_methods(chart: Chart) -> list[str | None]:
    """Methods of which a run failed; None is the planner."""
    failed = (point.setting.method for point in chart.points if point.status != "ok")
    return list(dict.fromkeys(failed))


def _what_failed(failed: list[Point]) -> str:
    """`×1, ×2 refused, ×4 diverged`."""
    failure_words = []
    for status in dict.fromkeys(point.status for point in failed):
        settings = (point.setting for point in failed if point.status == status)
        names = [str(setting).split(" ", 1)[1] if setting.method else "" for setting in settings]
        failure_words.append(f"{', '.join(filter(None, names))} {status}".strip())
    return ", ".join(failure_words)


def _word(
    ax: Axes,
    failure_word: str,
    word_position: tuple[float, float],
    colour: str,
    *,
    below: bool = False,
) -> None:
    """A word beside a point: above it, or below it where other words are above."""
    shift = (8, -12) if below else (5, 4)
    paper = {"facecolor": "white", "edgecolor": "none", "pad": 0.5, "alpha": 0.8}
    box = paper if below else None
    ax.annotate(failure_word, word_position, xytext=shift, textcoords="offset points",
                fontsize=8, color=colour, bbox=box, zorder=6)  # fmt: skip
