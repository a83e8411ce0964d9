"""`ergon chart` and `ergon stability` as they are typed."""

import csv
import sys
from pathlib import Path

import pytest
from commands import records
from one_bell import SCORE
from sweep import few

from ergon.cli import app
from ergon.cli.laboratory import FORMS
from ergon.common.extras import install_command
from ergon.workshop.lab.names import METHODS
from ergon.workshop.lab.pictures import targets

HARD = """\
ergon: 1
title: Too hard
instruments:
  b:
    modules:
      a: {CEL: {M: 1g, f: 100Hz, t60: 1s, X0: 1mm}}
      g: {SOL: {}}
      s: {REF: {between: [a, g], K: 10000kN/m}}
    out: {SOX: a}
render: {tail: 1s}
"""


@pytest.fixture
def here(work_folder: Path) -> Path:
    (work_folder / "bell.yaml").write_text(SCORE)
    (work_folder / "hard.yaml").write_text(HARD)
    return work_folder


def rows(path: Path) -> list[dict[str, str]]:
    lines = [line for line in path.read_text(encoding="utf-8").splitlines() if line[0] != "#"]
    return list(csv.DictReader(lines))


def test_chart_command_of_bell(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert app.run(["chart", "bell.yaml", "--seconds", "0.1", "--upto", "4"]) == 0
    out, err = capsys.readouterr()
    assert "ca ×4" in out
    assert "reference: planner -120 dB ×" in out  # a contact: no fixed method is as sure
    assert err.splitlines() == [f"wrote bell-chart.{form}" for form in FORMS]
    points = rows(here / "bell-chart.csv")
    assert [(p["method"], p["oversampling"]) for p in points] == [
        *((method, times) for method in METHODS for times in ("1", "2", "4")), ("planner", "1")
    ]  # fmt: skip
    assert all(float(p["cost"]) > 0 and float(p["waveform_db"]) < 0 for p in points)
    # Ours may be made again, in any of its names.
    assert (
        app.run(
            ["chart", "bell.yaml", "--seconds", "0.1", "--upto", "2", "-q", "-o", "bell-chart.svg"]
        )
        == 0
    )


def test_chart_command_with_refused_points(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    typed = ["chart", "hard.yaml", "--seconds", "0.1", "-o", "out/x", "--json", "--methods", "ca"]
    assert app.run(typed) == 0
    printed = records(capsys)
    points = [record for record in printed if record["event"] == "point"]
    assert [p["status"] for p in points] == ["refused", "ok", "ok", "ok", "ok"]
    assert "b.a" in points[0]["reason"]
    assert points[0]["cost"] is None
    assert printed[-1]["event"] == "reference"
    assert printed[-1]["setting"] == "ca ×32"
    assert "ca: ×1 refused" in (here / "out" / "x.svg").read_text(encoding="utf-8")


def test_chart_command_with_too_few_runs(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = HARD.replace("10000kN/m", "1e7kN/m")
    (here / "harder.yaml").write_text(text)
    assert (
        app.run(["chart", "harder.yaml", "--seconds", "0.1", "--upto", "2", "--methods", "ca"]) == 1
    )
    assert "the table says why" in capsys.readouterr().err
    records_read = {p["method"]: p["status"] for p in rows(here / "harder-chart.csv")}
    assert records_read == {"ca": "refused", "planner": "ok"}


def test_chart_with_error_adds_a_point_of_the_planner(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    typed = ["chart", "hard.yaml", "--seconds", "0.1", "--methods", "modal", "--upto", "2"]
    assert app.run([*typed, "--error", "-60dB", "--json"]) == 0
    printed = records(capsys)
    points = [record for record in printed if record["event"] == "point"]
    assert [(p["method"], p["budget_db"]) for p in points] == [
        ("modal", None), ("modal", None), ("planner", None), ("planner", -60.0)
    ]  # fmt: skip
    assert [p["reason"] for p in points[2:]] == ["b: modes", "b: modes"]
    assert printed[-1]["setting"] == "modal ×2"  # exact: there is nothing to refine


@pytest.mark.parametrize(
    ("typed", "code", "output"),
    [
        (["chart", "bell.yaml", "--methods", "ca,model"], 2, "did you mean 'modal'?"),
        (["chart", "bell.yaml", "--metric", "beauty"], 2, "waveform"),
        (["chart", "bell.yaml", "--seconds", "0.05", "--upto", "2"], 2, "nothing sounds"),
        (["chart", "bell.yaml", "--error", "60"], 2, "--error"),
        (["chart", "bell.yaml", "--error", "3dB"], 2, "is not below 0 dB"),
        (["chart", "none.yaml"], 1, "none.yaml"),
        (["chart", "wrong.yaml"], 1, "E1"),
        (["chart", "bell.yaml", "-o", "mine"], 2, "no record of writing it"),
        (["stability", "--maps", "cel"], 2, "did you mean 'cell'?"),
        (["stability", "--method", "euler"], 2, "euler"),
        (["stability", "--accurate", "3"], 2, "accurate"),
        (["stability", "--method", "e4", "--maps", "cell"], 2, "soft, quick"),
        (["stability", "bell.yaml", "--method", "e4"], 2, "takes no SCORE"),
        (["stability", "--method", "e4", "--metric", "energy"], 2, "has no map of --method e4"),
        (["stability", "--method", "plan"], 2, "add --metric energy"),
        (["stability", "--metric", "energy", "--maps", "cell"], 2, "rattle"),
        (["stability", "bell.yaml", "--maps", "cell"], 2, "springs, contacts"),
        (["stability", "wrong.yaml"], 1, "E1"),
    ],
)
def test_chart_command_refusals(
    here: Path, capsys: pytest.CaptureFixture[str], typed: list[str], code: int, output: str
) -> None:
    (here / "wrong.yaml").write_text("ergon: 1\nkees: {}\n")
    (here / "mine.csv").write_text("a,b\n")
    text = SCORE.replace("at: A, play", "at: 1|2, play")  # half a second of silence
    (here / "bell.yaml").write_text(text)
    assert app.run(typed) == code
    out, err = capsys.readouterr()
    assert output in err
    assert "Traceback" not in out + err
    assert {path.name for path in here.iterdir()} == {
        "bell.yaml", "hard.yaml", "wrong.yaml", "mine.csv"
    }  # fmt: skip


@pytest.mark.parametrize("typed", few([
    ["chart", "bell.yaml", "--seconds", "0.2", "--upto", "2", "-o", "x"],
    ["stability", "--maps", "rate", "-o", "x"],
], 1))  # fmt: skip
def test_chart_command_without_matplotlib(
    here: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    typed: list[str],
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    assert app.run(typed) == 2
    assert f"{install_command('lab')}; x.csv is written" in capsys.readouterr().err
    assert [path.exists() for path in targets(here / "x")] == [True, False, False]
    assert rows(here / "x.csv")


def test_stability_command_maps_of_method(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert app.run(["stability", "--maps", "cell", "--json"]) == 0
    records_read = records(capsys)  # with a record of progress each second, on a slow machine
    spots = [record for record in records_read if record["event"] != "progress"]
    assert {spot["event"] for spot in spots} == {"spot"}
    for spot in spots:
        assert spot["stable"] == spot["certified"] == (spot["x"] + 2 * spot["y"] < 4)
    table = rows(here / "ca-stability.csv")
    assert [row["stable"] for row in table] == ["yes" if s["stable"] else "no" for s in spots]
    assert (here / "ca-stability.svg").exists()


def test_stability_command_maps_of_score(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert app.run(["stability", "hard.yaml", "--seconds", "0.05"]) == 0
    out, err = capsys.readouterr()
    assert out.startswith("springs: Too hard: all its springs stiffer.")
    assert "contacts" not in out  # it has none
    assert "wrote hard-stability.png" in err
    table = {(row["x"], row["y"]): row for row in rows(here / "hard-stability.csv")}
    assert table["1", "1"]["certified"] == table["1", "1"]["stable"] == "no"
    assert table["1", "2"]["certified"] == table["1", "2"]["stable"] == "yes"
