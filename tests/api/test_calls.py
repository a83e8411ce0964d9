"""What commands do, as functions: play, plot, page, export, import, chart; a text as a score."""

from __future__ import annotations

import re
from html import unescape
from pathlib import Path

import numpy as np
import pytest
from one_bell import SCORE

import ergon
from ergon.cli import app


@pytest.fixture(autouse=True)
def folder(work_folder: Path) -> Path:
    Path("bell.yaml").write_text(SCORE)
    return work_folder


def command(*words: str) -> None:
    with pytest.raises(SystemExit) as ended:
        app.main(list(words))
    assert ended.value.code == 0


def test_render_of_a_text():
    sound = ergon.render(text=SCORE)
    assert np.array_equal(sound.frames, ergon.render("bell.yaml").frames)
    assert np.array_equal(sound.frames, ergon.render("elsewhere.yaml", text=SCORE).frames)
    with pytest.raises(ergon.OptionError, match="name a score, or give its text"):
        ergon.render()
    with pytest.raises(ergon.ScoreError, match=r"^piece.yaml:2:"):
        ergon.render(text="ergon: 1\nkeys: {finger: {M: 60h}}\n")


def test_play_until_end_of_piece():
    played = ergon.play("bell.yaml", ergon.PlayOptions(audio="null", until="0.3s"))
    assert played.seconds == pytest.approx(0.3, abs=0.05)
    assert 0 <= played.late <= played.ticks
    with pytest.raises(ergon.DeviceError, match="no such output"):
        ergon.play("bell.yaml", ergon.PlayOptions(audio="nul"))


@pytest.mark.parametrize("name", ["knock", "ada"])
def test_plot_equals_command_svg(name: str):
    command("plot", "bell.yaml", name, "--svg", "drawn.svg")
    assert ergon.plot("bell.yaml", name)._repr_svg_() == Path("drawn.svg").read_text()
    with pytest.raises(ergon.ErgonError, match="did you mean 'knock'"):
        ergon.plot("bell.yaml", "knokc")


def test_plot_of_notes():
    strikes = "\nstrikes: {s: {to: bell.m, at: 1|1, impulse: 1mNs}}\n"
    text = SCORE.replace("\nmix:", f"{strikes}mix:")
    picture = ergon.plot("bell.yaml", "notes", ergon.ReadOptions(text=text))
    assert ">bell" in picture.svg
    with pytest.raises(ergon.ErgonError, match="no instrument is struck"):
        ergon.plot("bell.yaml", "notes")


def test_page_equals_share_command_file():
    page = ergon.page("bell.yaml")
    command("share", "bell.yaml", "-o", "shared.html")
    assert page.html == Path("shared.html").read_text()
    frame = page._repr_html_()
    assert unescape(re.search(r'srcdoc="([^"]*)"', frame)[1]) == page.html
    page.write("page.html")
    assert Path("page.html").read_text() == page.html


@pytest.mark.parametrize("kind", ["modal", "faust", "mdl", "csound"])
def test_export_equals_command_text(kind: str):
    exported = ergon.export("bell.yaml", kind)
    command("export", "bell.yaml", "--to", kind, "-o", "out")
    written = {path.stem: path.read_text() for path in Path("out").iterdir()}
    assert {part.part: part.text for part in exported} == written
    with pytest.raises(ergon.OptionError, match="there is no format 'fuast'; there are modal,"):
        ergon.export("bell.yaml", "fuast")


def test_import_of_exported_mdl():
    Path("bell.mdl").write_text(ergon.export("bell.yaml", "mdl")[0].text)
    model = ergon.import_("bell.mdl")
    command("import", "bell.mdl", "-o", "back.yaml")
    assert Path("back.yaml").read_text() == model.text
    assert ergon.check("back.yaml").is_playable
    with pytest.raises(ergon.ErgonError):
        ergon.import_("bell.yaml")


def test_chart_of_a_score():
    options = ergon.ChartOptions(seconds=0.1, methods=["ca", "bm4"], upto=2)
    chart = ergon.chart("bell.yaml", options)
    assert {point.setting.method for point in chart.points} == {"ca", "bm4", None}
    assert all(point.cost > 0.0 for point in chart.points if point.status == "ok")
    assert len(str(chart).splitlines()) > len(chart.points)
    assert chart._repr_svg_().startswith("<?xml")
    with pytest.raises(ergon.OptionError, match="there is no 'bm5'; did you mean 'bm4'"):
        ergon.chart("bell.yaml", ergon.ChartOptions(methods=["bm5"]))


def test_repr_of_plan_row():
    [row] = ergon.plan("bell.yaml").rows
    error = f"{row.error_db:.1f} dB"
    words = f"<PlanRow {' + '.join(row.parts)}: {row.what}, {row.n_mat} MATs, {row.n_lia} LIAs"
    assert repr(row).startswith(f"{words}, {error}, cost ")
    assert float(repr(row).rpartition(" ")[2].rstrip(">")) == pytest.approx(row.cost, rel=0.01)
