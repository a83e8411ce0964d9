"""Error against cost of each method of computing a score, for programs and notebooks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ergon.api import score as scores
from ergon.api.errors import OptionError
from ergon.api.options import ReadOptions
from ergon.api.pictures import Picture
from ergon.common.report import Report
from ergon.notation.text.spelling import nearest
from ergon.workshop.lab import chart_table
from ergon.workshop.lab.chart import (
    Chart,
    Point,
    SilentPieceError,
    measure,
    n_frames_to_compute,
    planner_settings,
    settings,
)
from ergon.workshop.lab.machine import machine
from ergon.workshop.lab.names import METHODS, METRICS, PRECISIONS, Metric
from ergon.workshop.lab.scene import Score


@dataclass(frozen=True, slots=True, kw_only=True)
class ChartOptions(ReadOptions):
    """The length computed [s], the measure of error, the methods (by default all), the largest
    oversampling, and an error [dB] for which the planner's choice is added.
    """

    seconds: float = 2.0
    metric: Metric = "waveform"
    methods: Sequence[str] = ()
    upto: int = 8
    error: float | None = None


@dataclass(frozen=True, slots=True)
class ErrorChart:
    """What was measured: a point for each method, oversampling and precision; `str` is the table
    that `ergon chart` prints.
    """

    title: str
    chart: Chart

    @property
    def points(self) -> Sequence[Point]:
        """The points: their settings, costs and errors."""
        return self.chart.points

    def plot(self) -> Picture:
        """Error over cost. It needs matplotlib (the extra `lab`)."""
        from ergon.workshop.lab.draw_chart import draw
        from ergon.workshop.lab.pictures import pictures

        stem = Path("chart")
        files_by_path = pictures(lambda: draw(self.chart, self.title, machine()), stem, png=False)
        return Picture(files_by_path[stem.with_suffix(".svg")].decode())

    def __str__(self) -> str:
        """One line a point: its cost and its errors; * is best for its cost."""
        return chart_table.lines(self.chart)

    def _repr_svg_(self) -> str:
        return self.plot().svg


def chart(
    score: str | Path, options: ChartOptions | None = None, *, report: Report | None = None
) -> ErrorChart:
    """Compute the beginning of a score by every method, and compare each with the best.

    Raises ScoreError, and OptionError also where the piece is silent for so long.
    """
    options, report = options or ChartOptions(), report or Report()
    methods = tuple(options.methods) or tuple(METHODS)
    for option, chosen_names, allowed_names in (
        ("methods", methods, METHODS),
        ("metric", (options.metric,), METRICS),
    ):
        for method_name in chosen_names:
            if method_name not in allowed_names:
                suggestion = nearest(method_name, allowed_names)
                advice = (
                    f"; did you mean '{suggestion}'?"
                    if suggestion
                    else f"; there is {', '.join(allowed_names)}"
                )
                raise OptionError(option, f"there is no '{method_name}'{advice}")
    loaded = scores.read(score, options, report)
    piece = scores.piece_of(loaded)
    chart_settings = [
        *settings(methods, PRECISIONS, options.upto),
        *planner_settings(options.error),
    ]
    n_frames = n_frames_to_compute(chart_settings, round(options.seconds * piece.rate))
    try:
        with report.progress(f"charting {score}", n_frames, piece.rate) as progress:
            measured = measure(
                Score(piece), chart_settings, options.seconds, options.metric, progress.update
            )
    except SilentPieceError as silence:
        raise OptionError("seconds", f"{silence}; a larger number computes more") from None
    for doubt in measured.doubts:
        report.warn(doubt)
    return ErrorChart(piece.title or Path(score).stem, measured)
