"""`ergon chart`: error against cost of each method of computing a score."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

import click

from ergon.api import score
from ergon.api.options import ReadOptions
from ergon.workshop.lab.names import METHODS, METRICS, PRECISIONS

from . import laboratory, options
from .console import Console
from .outcome import Findings, Refused

if TYPE_CHECKING:
    from ergon.workshop.lab.chart import Chart
    from ergon.workshop.lab.names import Metric


@click.command()
@options.score
@click.option(
    "-o",
    "--output",
    metavar="NAME",
    help="Write NAME.svg, NAME.png and NAME.csv; without this option SCORE-chart here.",
)
@click.option(
    "--seconds",
    type=options.Number(0.05, 60, "DURATION"),
    default=2.0,
    show_default=True,
    help="Seconds of the piece that are computed, from its start.",
)
@click.option(
    "--metric",
    type=click.Choice(tuple(METRICS)),
    default="waveform",
    show_default=True,
    help="Measure of error that is drawn; the table holds all.",
)
@click.option("--methods", metavar="NAMES", help=f"Only these methods, of {','.join(METHODS)}.")
@click.option(
    "--upto",
    type=click.IntRange(2, 64),
    default=8,
    show_default=True,
    help="Largest oversampling factor.",
)
@click.option(
    "--error",
    metavar="DB",
    help="Also draw the plan that the planner makes for this error, such as -60dB.",
)
@options.on
@options.force
@options.trust
@options.with_console
def chart(
    console: Console,
    score_path: str,
    output: str | None,
    seconds: float,
    metric: str,
    methods: str | None,
    upto: int,
    error: str | None,
    on: str | None,
    force: bool,
    trust: bool,
) -> None:
    """Draw the error of every method against its cost, for a score.

    Each method computes the beginning of the piece, 1, 2, 4 … times oversampled, in each
    precision; so does the planner, as it chooses. All are compared with the best method,
    oversampled further. The table (NAME.csv) holds every measure, and why a run failed.
    """
    from ergon.workshop.lab import chart_table
    from ergon.workshop.lab.chart import (
        SilentPieceError,
        measure,
        n_frames_to_compute,
        planner_settings,
        settings,
    )
    from ergon.workshop.lab.draw_chart import draw
    from ergon.workshop.lab.machine import machine
    from ergon.workshop.lab.scene import Score

    chosen_methods = laboratory.parse_choice_list(methods, METHODS, "--methods")
    planned_settings = planner_settings(_error_db_max(error))
    loaded = score.read(score_path, ReadOptions(trust=trust), console)
    output_stem = laboratory.output_stem(output, score_path, "chart", force, loaded.inputs)
    piece = score.piece_of(loaded)
    chosen_settings = [*settings(chosen_methods, PRECISIONS, upto), *planned_settings]
    total_work = n_frames_to_compute(chosen_settings, round(seconds * piece.rate))
    try:
        with (
            laboratory.workers(on, score_path, loaded, trust, console) as workers,
            console.progress(f"charting {score_path}", total_work, piece.rate) as progress,
        ):
            scene, chart_metric = Score(piece), cast("Metric", metric)
            measured_chart = measure(
                scene, chosen_settings, seconds, chart_metric, progress.update, workers
            )
    except SilentPieceError as silence:
        raise Refused(f"{silence}; a larger --seconds computes more of the piece") from None
    chart_title, machine_text = piece.title or output_stem.name, machine()
    if on is not None:
        machine_text += (
            f", points by workers ({on}), costs scaled by a reference computation on both machines"
        )
    _report(console, measured_chart)
    table = chart_table.csv(measured_chart, chart_title, machine_text)
    laboratory.write_table_and_pictures(
        console, output_stem, table, lambda: draw(measured_chart, chart_title, machine_text), force
    )
    if measured_chart.reference is None:
        raise Findings("no method ran at two rates, so nothing can be compared; the table says why")


def _error_db_max(error_text: str | None) -> float | None:
    """The largest error that the planner may make [dB]."""
    from ergon.notation.tables.quantities import LEVEL, quantity
    from ergon.notation.text.errors import TextError

    if error_text is None:
        return None
    try:
        error_db = quantity(error_text, LEVEL)
    except TextError as error:
        raise Refused(f"--error: {error}") from None
    if error_db >= 0.0:
        raise Refused(f"--error: {error_text} is not below 0 dB; write a level such as -60dB")
    return error_db


def _report(console: Console, measured_chart: Chart) -> None:
    from ergon.workshop.lab import chart_table

    for doubt in measured_chart.doubts:
        console.warn(doubt)
    if console.json:
        for point in measured_chart.points:
            console.record("point", **chart_table.point_fields(point))
        console.record(
            "reference", metric=measured_chart.metric, **chart_table.reference(measured_chart)
        )
    else:
        console.data(chart_table.lines(measured_chart))
