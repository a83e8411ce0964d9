"""The picture of a chart: error over cost, both logarithmic; failures are on the upper edge."""

from __future__ import annotations

from math import floor as rounded_down
from math import isfinite
from textwrap import fill
from typing import TYPE_CHECKING

from ergon.workshop.lab.chart import Chart, Point, likely_cost
from ergon.workshop.lab.energy import ROUNDING_DB
from ergon.workshop.lab.names import METHODS, METRICS
from ergon.workshop.lab.pictures import COLOURS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_IN_DB = ("waveform", "energy")
_ERROR_MIN = 1e-6  # cents, or dB of spectra: smaller is nothing, and a logarithm needs an end
_ERROR_DB_MIN = -320.0
_TITLE_WIDTH = 60  # letters of a title that fit beside one another
_ROW_HEIGHT = 0.045  # of the height of the axes: a row of failures
_ZERO_ENERGY_OFFSET_DB = (
    10.0  # below the lowest figure of energy: where points stand that made none
)


def draw(chart: Chart, title: str, machine: str) -> Figure:
    """A figure of the chart."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import LogLocator

    figure = Figure(figsize=(7.5, 6.0), layout="constrained")
    ax = figure.subplots()
    heading = fill(f"{title}: the first {chart.seconds:g} s", _TITLE_WIDTH)
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
    measured = [p for p in chart.points if p.status == "ok" and p.error(chart.metric) is not None]
    _draw_front(ax, chart, measured)
    label_by_method: dict[str, str] = {method: method for method in METHODS}
    for group in chart.identical_methods:
        label_by_method.update(
            {method: "" for method in group[1:]}, **{group[0]: " = ".join(group)}
        )
    for method in METHODS:
        if label_by_method[method]:
            points_of_method = [p for p in measured if p.setting.method == method]
            _draw_method(ax, chart, points_of_method, method, label_by_method[method])
    for point in measured:
        if point.setting.method is None:
            _draw_planner(ax, chart, point)
    if chart.metric == "energy":
        _draw_energy_notes(ax, chart, measured)
    _set_limits(ax, chart, measured)
    _draw_failures(ax, chart)
    if ax.get_legend_handles_labels()[0]:
        # Below the axes it lies on no data.
        spacing = 0.9 if chart.metric == "energy" else 0.5  # rings are large
        figure.legend(loc="outside lower center", ncols=2, frameon=False, labelspacing=spacing)
    return figure


def _plotted_error(chart: Chart, point: Point) -> float:
    """The height of a point; points below the floor are drawn on it, and those that made no energy
    below all that did: at the floor they would press the others into a corner.
    """
    error = point.error(chart.metric)
    assert error is not None
    if chart.metric == "energy" and point.is_bounded:
        energy_errors = (p.error("energy") for p in chart.points if not p.is_bounded)
        lowest = min((db for db in energy_errors if db is not None), default=0.0)
        return _ZERO_ENERGY_OFFSET_DB * rounded_down(lowest / _ZERO_ENERGY_OFFSET_DB - 1.0)
    error_min = _ERROR_DB_MIN if chart.metric in _IN_DB else _ERROR_MIN
    return max(error, error_min if chart.floor is None else chart.floor, error_min)


def _cost(point: Point) -> float:
    assert point.cost is not None
    return point.cost


def _draw_method(ax: Axes, chart: Chart, points: list[Point], method: str, name: str) -> None:
    colour = COLOURS[METHODS.index(method)]
    for precision, marker, line in (("f64", "o", "-"), ("f32", "s", ":")):
        points_of_precision = [p for p in points if p.setting.precision == precision]
        points_of_precision.sort(key=lambda p: p.setting.oversampling)
        if points_of_precision:
            label = name if precision == "f64" else f"{name}, single precision"
            x, y = (
                [_cost(p) for p in points_of_precision],
                [_plotted_error(chart, p) for p in points_of_precision],
            )
            ax.plot(x, y, line, color=colour, marker=marker, markersize=5, label=label, zorder=3)
        for point in points_of_precision:
            position = _cost(point), _plotted_error(chart, point)
            _label_point(ax, f"×{point.setting.oversampling}", position, colour)


def _draw_planner(ax: Axes, chart: Chart, point: Point) -> None:
    """A full star is the planner's choice by ear, an empty one its choice for an error."""
    position, budget = (_cost(point), _plotted_error(chart, point)), point.setting.budget_db
    fill_colour, label = "black", "the planner's choice"
    if budget is not None:
        fill_colour, label = "white", f"the planner's choice for {budget:g} dB"
        if chart.metric == "waveform":
            ax.axhline(budget, color="black", linewidth=0.8, linestyle=":", zorder=0,
                       label=f"{budget:g} dB, as asked for")  # fmt: skip
    ax.plot(
        *position,
        "*",
        color="black",
        markerfacecolor=fill_colour,
        markersize=14,
        label=label,
        zorder=4,
    )
    _label_point(ax, point.reason, position, "black", below=True)


def _draw_energy_notes(ax: Axes, chart: Chart, measured: list[Point]) -> None:
    """Draw an arrow below points that made no energy, and a ring round those counted in part."""
    below_rounding = [(_cost(p), _plotted_error(chart, p)) for p in measured if p.is_bounded]
    counted_in_part = [
        (_cost(p), _plotted_error(chart, p)) for p in measured if p.energy_of == "links"
    ]
    if below_rounding:
        x, y = zip(
            *((cost, height - 0.3 * _ZERO_ENERGY_OFFSET_DB) for cost, height in below_rounding),
            strict=True,
        )
        label = f"made none above rounding ({ROUNDING_DB:g} dB)"
        ax.plot(x, y, linestyle="", marker=r"$\downarrow$", markersize=10, color="#666666",
                label=label, zorder=4)  # fmt: skip
        scale_min = max(height for _, height in below_rounding) + 0.5 * _ZERO_ENERGY_OFFSET_DB
        ax.axhline(scale_min, color="#999999", linewidth=0.8, linestyle="--", zorder=0)
        # Below this line is no scale.
        ax.yaxis.set_major_formatter(
            lambda db, _: f"{db:g}".replace("-", "−") if db > scale_min else ""
        )
    if counted_in_part:
        x, y = zip(*counted_in_part, strict=True)
        ax.plot(x, y, "o", color="#666666", markerfacecolor="none", markersize=17,
                label="only what contacts and laws made is counted", zorder=2)  # fmt: skip


def _draw_front(ax: Axes, chart: Chart, measured: list[Point]) -> None:
    """No fixed setting is both cheaper and better than the points on this line; stars may be."""
    front = sorted((_cost(p), _plotted_error(chart, p)) for p in measured if p.on_front)
    if front:
        x, y = zip(*front, strict=True)
        label = "best fixed setting for its cost"
        ax.step(x, y, where="post", color="#bbbbbb", linewidth=5, label=label,
                solid_capstyle="round", zorder=1)  # fmt: skip


def _set_limits(ax: Axes, chart: Chart, measured: list[Point]) -> None:
    floor = chart.floor
    heights = [_plotted_error(chart, p) for p in measured] or [0.0]
    if chart.metric not in _IN_DB:
        ax.set_ylim(top=2.5 * max(*heights, 1e-3))
    else:
        shown_floor = None if chart.metric == "energy" else floor
        heights_and_floor = (
            heights if shown_floor is None else [*heights, max(shown_floor, _ERROR_DB_MIN)]
        )
        lowest, highest = min(heights_and_floor), max(heights)
        margin = max(6.0, 0.08 * (highest - lowest))
        n_failed_rows = len(_failed_methods(chart))
        ax.set_ylim(
            lowest - margin,
            highest + 2 * margin + n_failed_rows * _ROW_HEIGHT * (highest - lowest + 3 * margin),
        )
    costs = [cost for p in chart.points if (cost := likely_cost(chart, p))] or [0.3]
    ax.set_xlim(min(costs) / 1.5, max(costs) * 2.0)
    if ax.get_xlim()[0] < 1.0 < ax.get_xlim()[1]:
        ax.axvline(1.0, color="#999999", linewidth=0.8, linestyle="--", zorder=0)
        ax.text(1.0, 0.01, " real time", transform=ax.get_xaxis_transform(), fontsize=8)
    if floor is None or not isfinite(floor) or chart.reference is None:
        return
    if chart.metric == "energy":
        return  # arrows say what is below rounding
    floor = max(floor, _ERROR_DB_MIN if chart.metric in _IN_DB else _ERROR_MIN)
    bottom = ax.get_ylim()[0]
    if chart.metric not in _IN_DB:
        bottom = min(bottom, floor / 3.0)
        ax.set_ylim(bottom=bottom)
    ax.axhspan(bottom, floor, facecolor="#eeeeee", edgecolor="#cccccc", hatch="///", zorder=0)
    note = f"the reference ({chart.reference.setting}) is itself no surer than this"
    box = {"facecolor": "white", "edgecolor": "none", "pad": 1.5}
    # At the lower edge, where no point is: the floor is the lowest height of a point.
    ax.annotate(note, (0.0, 0.0), xycoords="axes fraction", xytext=(6, 4),
                textcoords="offset points", fontsize=8, va="bottom", bbox=box)  # fmt: skip


def _draw_failures(ax: Axes, chart: Chart) -> None:
    """Draw failures at the upper edge, a row for each method, at the cost that each would have; the
    legend says what happened.
    """
    left_limit = ax.get_xlim()[0]
    for row, method in enumerate(_failed_methods(chart)):
        failed = [p for p in chart.points if p.status != "ok" and p.setting.method == method]
        height = 1.0 - _ROW_HEIGHT * row
        colour = COLOURS[METHODS.index(method)] if method else "black"
        costs = [likely_cost(chart, point) or left_limit for point in failed]
        label = f"{method or 'the planner'}: {_failure_text(failed)}"
        ax.plot(costs, [height] * len(costs), "X", color=colour, markersize=8, label=label,
                transform=ax.get_xaxis_transform(), clip_on=False, zorder=5)  # fmt: skip


def _failed_methods(chart: Chart) -> list[str | None]:
    """Methods of which a run failed; None is the planner."""
    failed = (point.setting.method for point in chart.points if point.status != "ok")
    return list(dict.fromkeys(failed))


def _failure_text(failed: list[Point]) -> str:
    """`×1, ×2 refused, ×4 diverged`."""
    status_texts = []
    for status in dict.fromkeys(point.status for point in failed):
        settings = (point.setting for point in failed if point.status == status)
        names = [str(setting).split(" ", 1)[1] if setting.method else "" for setting in settings]
        status_texts.append(f"{', '.join(filter(None, names))} {status}".strip())
    return ", ".join(status_texts)


def _label_point(
    ax: Axes, word: str, position: tuple[float, float], colour: str, *, below: bool = False
) -> None:
    """A word beside a point: above it, or below it where other words are above."""
    offset = (8, -12) if below else (5, 4)
    box = {"facecolor": "white", "edgecolor": "none", "pad": 0.5, "alpha": 0.8}
    ax.annotate(word, position, xytext=offset, textcoords="offset points", fontsize=8, color=colour,
                bbox=box if below else None, zorder=6)  # fmt: skip
