"""Pictures and tables: the same bytes every time, ours by their mark, with what failed."""

import csv
import sys
from dataclasses import replace
from math import inf
from pathlib import Path

import pytest
from sweep import few

from ergon.exchange.safe import FileRefusedError, is_ours
from ergon.workshop.lab import chart_table, draw_chart, draw_maps, map_table, maps, table
from ergon.workshop.lab.chart import Chart, Point
from ergon.workshop.lab.energy import ROUNDING_DB
from ergon.workshop.lab.map_catalogue import built_in
from ergon.workshop.lab.pictures import MatplotlibMissingError, save, targets
from ergon.workshop.lab.runs import Setting

POINTS = [
    Point(Setting("ca", 1), "refused", "it would diverge: bell.m", None),
    Point(Setting("ca", 2), "ok", "", 0.01, waveform_db=-20.0, cents=3.0, on_front=True),
    Point(Setting("ca", 4), "diverged", "the motion of bell.m diverged", None),
    Point(Setting("ca", 8), "ok", "", 0.04, waveform_db=-40.0, cents=0.2),
    Point(Setting("bm4", 1, "f32"), "ok", "", 0.02, waveform_db=-90.0, cents=0.0, on_front=True),
    Point(Setting(None), "ok", "bell modal ×1", 0.005, waveform_db=-80.0, cents=0.0),
    Point(Setting(None, budget_db=-60.0), "ok", "bell", 0.004, waveform_db=-70.0, cents=0.1),
]


def example(metric: str) -> Chart:
    return Chart(POINTS, None, -85.0 if metric == "waveform" else 0.01, metric, 2.0, 44100.0)  # type: ignore[arg-type]


@pytest.mark.parametrize("metric", few(["waveform", "cents"], 1))
def test_chart_picture_same_bytes(tmp_path: Path, metric: str):
    chart = example(metric)
    files = [
        save(lambda: draw_chart.draw(chart, "Bell", "a machine"), tmp_path / name)
        for name in ("one", "two")
    ]
    for item, two in zip(*files, strict=True):
        assert item.read_bytes() == two.read_bytes()
        assert is_ours(item)
    text = files[0][0].read_text(encoding="utf-8")
    assert "ca: ×1 refused, ×4 diverged" in text
    assert "the planner's choice" in text
    assert "the planner's choice for -60 dB" in text
    assert ("-60 dB, as asked for" in text) == (metric == "waveform")
    assert "bell modal ×1" in text
    assert "best fixed setting for its cost" in text
    assert "<dc:date>" not in text
    assert files[0][1].read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"


def test_chart_picture_of_energy_below_rounding(tmp_path: Path):
    some_energy = Point(Setting("ca", 1), "ok", "", 0.01, energy_db=-47.0, energy_of="all")
    no_energy = Point(Setting(None), "ok", "bell", 0.02, energy_db=-inf, energy_of="links",
                      is_bounded=True)  # fmt: skip
    chart = Chart([some_energy, no_energy], None, ROUNDING_DB, "energy", 2.0, 44100.0)
    svg, _ = save(lambda: draw_chart.draw(chart, "Bell", "a machine"), tmp_path / "one")
    text = svg.read_text(encoding="utf-8")
    assert "made none above rounding (-150 dB)" in text
    assert "only what contacts and laws made is counted" in text
    assert "300" not in text.split("energy that the scheme made")[0]  # no scale down to nothing
    lines = chart_table.lines(chart)
    assert "<-150+" in lines
    assert "only ca keeps a ledger" in lines
    assert "nan" not in lines


def test_chart_picture_merges_equal_methods(tmp_path: Path):
    chart = replace(example("waveform"), identical_methods=(("ca", "bm4"),))
    svg, _ = save(lambda: draw_chart.draw(chart, "Bell", "a machine"), tmp_path / "one")
    assert "ca = bm4" in svg.read_text(encoding="utf-8")
    assert "the same samples here: ca, bm4" in chart_table.lines(chart)


def test_map_picture_marks_score_as_written(tmp_path: Path):
    first = replace(built_in("ca")["cell"], as_written=(1.0, 1.0))
    spots = [maps.Spot(x, y, None, True, True) for y in first.ys for x in first.xs]
    svg, _ = save(lambda: draw_maps.draw({"cell": (first, spots)}, "A map"), tmp_path / "map")
    assert "the score as it is written" in svg.read_text(encoding="utf-8")


def test_long_titles_stay_within_pictures():
    """The title of a map of one panel was cut at both sides."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    title = "a piece with a title that says what it is about, and then some words more, at length"
    first = replace(built_in("ca")["cell"], title=title)
    spots = [maps.Spot(x, y, None, True, True) for y in first.ys for x in first.xs]
    map_figure = draw_maps.draw({"cell": (first, spots)}, f"{title}: where ca is stable")
    for figure in (map_figure, draw_chart.draw(example("waveform"), title, "a machine")):
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        for text in (
            figure._suptitle,
            *(side for ax in figure.axes for side in (ax.title, ax._left_title)),
        ):
            if text is not None and text.get_text():
                box = text.get_window_extent(canvas.get_renderer())
                assert 0.0 <= box.x0 <= box.x1 <= figure.bbox.x1, text.get_text()


def test_chart_picture_of_failures_only(tmp_path: Path):
    chart = Chart(POINTS[:1], None, None, "waveform", 2.0, 44100.0)
    svg, _ = save(lambda: draw_chart.draw(chart, "Bell", "a machine"), tmp_path / "one")
    assert "ca: ×1 refused" in svg.read_text(encoding="utf-8")


def test_chart_table_with_reasons():
    text = chart_table.csv(example("cents"), "Bell,\n a bell", "a machine")
    facts = [line for line in text.splitlines() if line.startswith("#")]
    assert facts[0] == "# made by ergon"
    assert facts[1] == "# chart of Bell, a bell, the first 2 s at 44100 Hz"
    rows = list(csv.DictReader(line for line in text.splitlines() if not line.startswith("#")))
    assert [row["status"] for row in rows] == [point.status for point in POINTS]
    assert rows[0]["reason"] == "it would diverge: bell.m"
    assert (rows[0]["cost"], rows[0]["cents"]) == ("", "")
    assert (rows[1]["cost"], rows[1]["waveform_db"], rows[1]["on_front"]) == ("0.01", "-20", "yes")
    assert rows[4]["precision"] == "f32"
    assert [(row["method"], row["budget_db"]) for row in rows[5:]] == [
        ("planner", ""), ("planner", "-60")
    ]  # fmt: skip


def test_table_text_of_value_kinds():
    text = table.csv_text([], ["a"], [[None], [True], [-float("inf")], [1 / 3], [7], ["x, y"]])
    assert text.splitlines()[1:] == ["a", '""', "yes", "-inf", "0.333333", "7", '"x, y"']


@pytest.mark.slow
def test_map_picture_same_bytes(tmp_path: Path):
    single = built_in("ca")["coupling"]
    spots = [maps.Spot(x, y, True, x < 1, None if x > 100 else x < 1, x < 0.1 or None, 0.5)
             for y in single.ys for x in single.xs]  # fmt: skip
    panel = single, spots
    for result in ({"a": panel, "b": panel}, {"a": panel, "b": panel, "c": panel}):
        files = [
            save(lambda f=result: draw_maps.draw(f, "maps"), tmp_path / name, png=False)
            for name in ("x", "y")
        ]
        for first, second in zip(*files, strict=True):
            assert first.read_bytes() == second.read_bytes()
    assert "could not be run" in map_table.lines({"coupling": (single, spots)})


def test_chart_save_refuses_foreign_files(tmp_path: Path):
    (tmp_path / "x.svg").write_text("<svg>mine</svg>")
    with pytest.raises(FileRefusedError, match="no record of writing it"):
        save(lambda: draw_chart.draw(example("cents"), "Bell", ""), tmp_path / "x")
    assert (tmp_path / "x.svg").read_text() == "<svg>mine</svg>"
    assert not (tmp_path / "x.png").exists()


def test_chart_save_without_matplotlib(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(MatplotlibMissingError, match=r"pip install .*\[lab\]"):
        save(lambda: pytest.fail("it drew"), tmp_path / "x")


def test_chart_target_file_names():
    assert [path.name for path in targets(Path("a/b.c"))] == ["b.c.csv", "b.c.svg", "b.c.png"]
