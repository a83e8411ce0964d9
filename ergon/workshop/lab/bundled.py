"""Charts of scores that ship, and the maps of a method: `python -m ergon.workshop.lab.bundled
docs/charts`.

The page beside the pictures says on which machine they were made.
"""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

from ergon.common.module_arguments import module_arguments
from ergon.exchange.safe import write_text
from ergon.scores.reading.load import load
from ergon.workshop.lab import chart_table, draw_chart, draw_maps, map_catalogue, map_table
from ergon.workshop.lab.chart import measure, planner_settings, settings
from ergon.workshop.lab.machine import machine
from ergon.workshop.lab.maps import survey_all
from ergon.workshop.lab.names import METHODS, PRECISIONS, SLOW
from ergon.workshop.lab.pictures import save, targets
from ergon.workshop.lab.scene import Score

SCORES = ("one-gesture", "tempo", "hand", "two-keys")
_DURATION, _OVERSAMPLING_MAX = 2.0, 8
_MAPPED_METHODS = ("ca", "ca2p", "bm4", SLOW)
_PAGE_HEADER = """\
# Charts of what ships

Made by `python -m ergon.workshop.lab.bundled` on {machine}; do not edit.
[How to read them](../charts.md).
Errors are the same on every machine, costs are not.
"""


def main(folder: Path) -> None:
    """Write all pictures, their tables, and the page."""
    page = [_PAGE_HEADER.format(machine=machine())]
    for name in SCORES:
        page.append(_chart_section(folder, name))
    page.append("## Stability\n")
    page.extend(_maps_section(folder, method) for method in _MAPPED_METHODS)
    write_text(folder / "README.md", "\n".join(page), force=True)


def _chart_section(folder: Path, score_name: str) -> str:
    path = Path(str(files("ergon"))) / "scores" / "library" / f"{score_name}.yaml"
    piece = load(path).piece
    assert piece is not None, f"{score_name} has mistakes"
    chart_settings = [*settings(METHODS, PRECISIONS, _OVERSAMPLING_MAX), *planner_settings()]
    chart = measure(Score(piece), chart_settings, _DURATION, "waveform", lambda done: None)
    title, machine_text = piece.title, machine()
    stem = folder / score_name
    write_text(targets(stem)[0], chart_table.csv(chart, title, machine_text), force=True)
    save(lambda: draw_chart.draw(chart, title, machine_text), stem, force=True, png=False)
    print(f"{score_name}\n{chart_table.lines(chart)}", flush=True)
    return (
        f"## {title}\n\n![Error over cost of {title}]({score_name}.svg)\n\n"
        f"In numbers: [{score_name}.csv]({score_name}.csv).\n"
    )


def _maps_section(folder: Path, method_name: str) -> str:
    surveys = survey_all(map_catalogue.built_in(method_name), lambda done: None)
    maps_title = f"where {method_name} is stable, and where its sound is right"
    map_name = "stability" if method_name == "ca" else f"stability-{method_name}"
    stem = folder / map_name
    write_text(targets(stem)[0], map_table.csv(surveys, maps_title), force=True)
    save(lambda: draw_maps.draw(surveys, maps_title), stem, force=True, png=False)
    print(map_table.lines(surveys), flush=True)
    return (
        f"![Maps: where {method_name} is stable, and where its sound is right]({map_name}.svg)\n\n"
        f"In numbers: [{map_name}.csv]({map_name}.csv).\n"
    )


if __name__ == "__main__":
    main(Path(module_arguments("FOLDER")[0]))
