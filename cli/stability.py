"""`ergon stability`: where a method fails, predicted and measured, and where it is also right."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, cast

import click

from ergon.api import score
from ergon.api.options import ReadOptions
from ergon.workshop.lab.names import ENERGY_MAPS, MAPS, METHODS, PLAN, SLOW, SLOW_MAPS

from . import laboratory, options
from .bundled import ScorePath
from .console import Console
from .outcome import Refused

if TYPE_CHECKING:
    from ergon.scores.reading.load import Loaded
    from ergon.workshop.lab.maps import Map
    from ergon.workshop.lab.names import MapMetric


_METHOD_HELP = (
    f"Method that is mapped; {SLOW} is a part computed slower than the rest, {PLAN} what the "
    "planner chooses by ear."
)
_MAPS_HELP = (
    f"Only these maps, of {','.join(MAPS)}; with --method {SLOW} of {','.join(SLOW_MAPS)}, with "
    f"--metric energy of {','.join(ENERGY_MAPS)}."
)


@click.command()
@click.argument("score_path", metavar="[SCORE]", required=False, type=ScorePath())
@click.option(
    "-o",
    "--output",
    metavar="NAME",
    help="Write NAME.svg, NAME.png and NAME.csv; without this option SCORE-stability, or "
    "METHOD-stability without SCORE, here.",
)
@click.option(
    "--method",
    type=click.Choice((*METHODS, SLOW, PLAN)),
    default="ca",
    show_default=True,
    help=_METHOD_HELP,
)
@click.option(
    "--metric",
    type=click.Choice(("waveform", "energy")),
    default="waveform",
    show_default=True,
    help="What has to be right: the sound, or the energy, of which steps make at most a hundredth.",
)
@click.option("--maps", "map_names", metavar="NAMES", help=_MAPS_HELP)
@click.option(
    "--seconds",
    type=options.Number(0.05, 60, "DURATION"),
    default=0.5,
    show_default=True,
    help="Seconds of SCORE that are computed, from its start.",
)
@click.option(
    "--accurate",
    type=options.Number(-200, 0),
    help="Largest error that counts as right [dB]. Default: -20 in the first 0.1 s of sound; with "
    "--method e4, in a second of sound, -75 up to 10 frames between pulls and -70 beyond.",
)
@options.on
@options.force
@options.trust
@options.with_console
def stability(
    console: Console,
    score_path: str | None,
    output: str | None,
    method: str,
    metric: str,
    map_names: str | None,
    seconds: float,
    accurate: float | None,
    on: str | None,
    force: bool,
    trust: bool,
) -> None:
    """Draw where a method fails, as predicted and as measured.

    Without SCORE the maps show small scenes of ergon's own: a cell, a contact, a hard stroke, the
    rate of a string, a coupling; with --method e4 a slow key that pulls a string. With SCORE the
    map multiplies its springs and its rate. Every point of a map is computed, also where ergon
    would refuse the score.
    """
    from ergon.workshop.lab import map_table
    from ergon.workshop.lab.draw_maps import draw
    from ergon.workshop.lab.maps import survey_all

    if score_path is not None and method == SLOW:
        raise Refused(f"--method {SLOW} maps scenes of ergon's own, and takes no SCORE")
    metric_name = cast("MapMetric", metric)
    if metric_name == "energy" and method == SLOW:
        raise Refused(
            f"--metric energy has no map of --method {SLOW}; use {PLAN} or another method"
        )
    if metric_name != "energy" and method == PLAN:
        raise Refused(f"--method {PLAN} has maps of its energy alone; add --metric energy")
    loaded = (
        None if score_path is None else score.read(score_path, ReadOptions(trust=trust), console)
    )
    inputs = () if loaded is None else loaded.inputs
    stem = laboratory.output_stem(output, score_path or method, "stability", force, inputs)
    survey_settings = (method, seconds, accurate, metric_name)
    maps, plot_title = _maps(loaded, Path(score_path or "").stem, map_names, survey_settings)
    total_spots = sum(drawn_map.n_spots for drawn_map in maps.values())
    with laboratory.workers(on, score_path, loaded, trust, console) as workers:
        surveyors = None if workers is None else workers.surveyors(*survey_settings)
        with console.progress("mapping", total_spots, 0.0) as progress:
            surveys = survey_all(maps, progress.update, surveyors)
    if console.json:
        for record in map_table.records(surveys):
            console.record("spot", **record)
    else:
        console.data(map_table.lines(surveys))
    table = map_table.csv(surveys, f"{method}, {plot_title}")
    laboratory.write_table_and_pictures(
        console, stem, table, lambda: draw(surveys, plot_title), force
    )


def _maps(
    loaded: Loaded | None,
    score_name: str,
    map_names: str | None,
    survey_settings: tuple[str, float, float | None, MapMetric],
) -> tuple[dict[str, Map], str]:
    from ergon.workshop.lab import map_catalogue

    piece = None if loaded is None else score.piece_of(loaded)
    method_names, seconds, accurate, metric = survey_settings
    available_maps = map_catalogue.maps(method_names, piece, seconds, accurate, metric)
    chosen_maps = laboratory.parse_choice_list(map_names, tuple(available_maps), "--maps")
    condition = "it makes no energy" if metric == "energy" else "its sound is right"
    picture_title = f"where {method_names} is stable, and where {condition}"
    if piece is not None:
        picture_title = f"{piece.title or score_name}: {picture_title}"
    return {name: available_maps[name] for name in chosen_maps}, picture_title
