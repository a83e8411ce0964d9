"""`ergon admittance` as it is typed."""

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


def test_admittance_command_peaks_table(capsys: Capture):
    typed = ["admittance", "wires.yaml", "wire.s.3", "--high", "1kHz", "--peaks"]
    assert app.run(typed) == 0
    head, columns, *rows = capsys.readouterr().out.splitlines()
    assert head == (
        "velocity of wire.s.3 for a force at wire.s.3: peaks from 20 to 1000 Hz, 1,003 frequencies"
    )
    assert columns.split() == ["note", "cents", "frequency", "level", "phase"]
    assert [row.split()[1] for row in rows] == ["D4", "D5", "A5"]
    assert app.run(["admittance", "wires.yaml", "pad.m"]) == 0
    out, err = capsys.readouterr()
    assert "no peak from 20 to 5000 Hz, 1,000 frequencies" in out
    assert "pad: the law of 1 link was linearised at rest" in err
    assert "pad: 1 contact counted as open" in err
    assert app.run(["admittance", "wires.yaml", "k1", "wire.s.3"]) == 0
    assert "no force from there reaches this point, so it does not move" in capsys.readouterr().out


def test_admittance_command_csv_npz_svg_and_records(capsys: Capture):
    typed = ["admittance", "wires.yaml", "wire.s.3", "wire.s.17", "k1", "--count", "7"]
    assert app.run([*typed, "--csv", "y.csv", "--npz", "y.npz", "--svg", "y.svg"]) == 0
    rows = list(csv.DictReader(Path("y.csv").read_text().splitlines()))
    arrays = np.load("y.npz")
    assert arrays["admittance"].shape == (2, 7)
    assert [float(row["wire.s.17 real"]) for row in rows] == arrays["admittance"][0].real.tolist()
    assert [float(row["frequency_hz"]) for row in rows] == arrays["frequency_hz"].tolist()
    assert arrays["heard"].tolist() == ["wire.s.17", "k1"]
    assert "velocity of wire.s.17" in Path("y.svg").read_text()
    assert capsys.readouterr().err.splitlines()[-3:] == [
        "wrote y.csv",
        "wrote y.npz",
        "wrote y.svg",
    ]
    assert app.run([*typed, "--json"]) == 0
    first, second = records(capsys)
    assert (first["event"], first["heard"], len(first["level_db"])) == (
        "admittance",
        "wire.s.17",
        7,
    )
    assert second["heard"] == "k1"


@pytest.mark.parametrize(
    ("typed", "message"),
    [
        (["wirr"], "FROM: nothing is called 'wirr'; did you mean 'wire'?"),
        (["k1", "wire.s.77"], "TO: wire.s has members 0 to 23"),
        (["k1", "--high", "10Hz"], "--high: is 10 Hz; it must be above low, 20 Hz"),
        (["k1", "k1", "k1", "k1", "k1", "--svg", "y.svg"], "--svg: draws at most 3 points"),
    ],
)
def test_admittance_command_refuses_wrong_points(typed: list[str], message: str, capsys: Capture):
    assert app.run(["admittance", "wires.yaml", *typed]) == 2
    assert message in capsys.readouterr().err
