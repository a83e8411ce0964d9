"""`ergon modes` as it is typed."""

import csv
from pathlib import Path

import numpy as np
import pytest
from commands import records

from ergon.cli import app
from tests.api.test_modes import SCORE

Capture = pytest.CaptureFixture[str]


@pytest.fixture(autouse=True)
def folder(work_folder: Path) -> Path:
    Path("wires.yaml").write_text(SCORE)
    return work_folder


def table(name: str) -> list[dict[str, str]]:
    return list(csv.DictReader(Path(name).read_text().splitlines()))


def test_modes_command_table_with_notes_and_levels(capsys: Capture):
    assert app.run(["modes", "wires.yaml", "wire", "--count", "2"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    head, columns, first, second = out.splitlines()
    assert head == "wire: 2 modes of 24 masses"
    assert columns.split() == ["note", "cents", "frequency", "T60", "out", "wire.s.3"]
    assert first.split()[:6] == ["1", "D4", "+0.0", "293.66", "Hz", "2"]
    assert second.split()[:5] == ["2", "D5", "-3.4", "586.17", "Hz"]


def test_modes_command_reports_linearised_laws_and_open_contacts(capsys: Capture):
    assert app.run(["modes", "wires.yaml", "pad", "wall"]) == 0
    out, err = capsys.readouterr()
    assert "pad: the law of 1 link was linearised at rest" in err
    assert "pad: 1 contact counted as open" in err
    assert "wall: no modes: nothing in it moves" in out
    assert app.run(["modes", "wires.yaml", "wire", "--upto", "100Hz"]) == 0
    assert capsys.readouterr().out == "wire: no modes: none of its modes is in this range\n"


def test_modes_command_json_records(capsys: Capture):
    assert app.run(["modes", "wires.yaml", "wire", "--upto", "1kHz", "--json", "--shapes"]) == 0
    *each, last = records(capsys)
    assert [row["note"] for row in each] == ["D4", "D5", "A5"]
    assert len(each[0]["masses"]) == len(each[0]["shape"]) == 24
    assert each[0]["levels_db"].keys() == {"out", "wire.s.3"}
    assert (last["event"], last["modes"], last["certified"]) == ("modes", 3, True)


def test_modes_command_csv_file(capsys: Capture):
    assert app.run(["modes", "wires.yaml", "--count", "3", "--csv", "all.csv"]) == 0
    assert capsys.readouterr().err.splitlines()[-1] == "wrote all.csv"
    rows = table("all.csv")
    assert [row["part"] for row in rows] == ["k1", "wire", "wire", "wire", "pad"]
    assert float(rows[1]["frequency_hz"]) == pytest.approx(293.6647679174076, rel=1e-12)
    assert rows[0]["wire.s.3 [dB]"] == ""
    shapes = ["modes", "wires.yaml", "wire", "--count", "3", "--shapes", "--csv", "shapes.csv"]
    assert app.run(shapes) == 0
    rows = table("shapes.csv")
    assert len(rows) == 3 * 24
    assert sum(float(row["real"]) ** 2 for row in rows[:24]) * 4e-3 / 24 == pytest.approx(1.0)
    assert np.isclose(float(rows[0]["imaginary"]), 0.0)


@pytest.mark.parametrize(
    ("typed", "message"),
    [
        (["wirr"], "PART: no instrument or key is called 'wirr'; did you mean 'wire'?"),
        (["--upto", "h3"], "--upto: 'h3' is neither a frequency such as 220Hz nor a note"),
        (["--upto", "1kHz", "--count", "3"], "--count: excludes --upto; give one of the two"),
        (
            ["--shapes"],
            "--shapes needs --csv, --json or --svg: shapes are many numbers, or pictures",
        ),
    ],
)
def test_modes_command_refuses_wrong_parts_and_options(
    typed: list[str], message: str, capsys: Capture
):
    assert app.run(["modes", "wires.yaml", *typed]) == 2
    assert message in capsys.readouterr().err


def test_modes_command_refuses_foreign_and_input_files(capsys: Capture):
    Path("notes.csv").write_text("mine")
    assert app.run(["modes", "wires.yaml", "--csv", "notes.csv"]) == 2
    assert Path("notes.csv").read_text() == "mine"
    assert "notes.csv" in capsys.readouterr().err
    assert app.run(["modes", "wires.yaml", "--csv", "wires.yaml", "-f"]) == 2
    assert Path("wires.yaml").read_text() == SCORE


def test_modes_command_omits_the_note_below_hearing(capsys: Capture):
    assert app.run(["modes", "wires.yaml", "k1", "--json"]) == 0
    key, _ = records(capsys)
    assert (key["note"], key["cents"]) == (None, None)
    assert key["frequency_hz"] == pytest.approx(1.9346, rel=1e-3)
