"""`ergon stats` as it is typed."""

from pathlib import Path

import numpy as np
import pytest
from commands import records
from recordings import Axis, end, header, row, rows

from ergon.cli import app
from tests.api.test_tune import SCORE

Capture = pytest.CaptureFixture[str]


@pytest.fixture(autouse=True)
def folder(work_folder: Path) -> Path:
    Path("bars.yaml").write_text(SCORE)
    return work_folder


def test_stats_command_figures_table(capsys: Capture):
    assert app.run(["stats", "bars.yaml", "bar", "free", "wall"]) == 0
    out = capsys.readouterr().out
    assert "bar: 8 masses of 3 g to 5 g, 31 g in all; 1 fixed point\n" in out
    assert "\nREF    8      9000 N/m to 2e+04 N/m  0.02 N·s/m to 1 N·s/m\n" in out
    assert "8 modes in this range, 58.25 to 719.64 Hz, T60 0.114 s to 2.15 s;" in out
    assert "stable by one step a frame (proved)\n" in out
    assert "5 modes in this range" in out
    assert "and 1 motion that no spring resists" in out
    assert "no bound" in out
    assert "wall: 1 fixed point; nothing in it moves\n" in out


def test_stats_command_json_records(capsys: Capture):
    assert app.run(["stats", "bars.yaml", "--json"]) == 0
    records_read = records(capsys)
    assert [row["part"] for row in records_read] == [
        *("k1", "bar", "free", "wire", "soft", "discrete", "bowl", "wall")
    ]
    assert records_read[1]["links"][0]["count"] == 8
    assert records_read[2]["points"][0]["compliance_m_per_n"] is None
    assert records_read[2]["free_motions"] == 1
    assert records_read[-1]["t60_range_s"] == []


@pytest.mark.parametrize(
    ("typed", "message"),
    [
        (["barr"], "PART: no instrument or key is called 'barr'; did you mean 'bar'?"),
        (["--upto", "h3"], "--upto: 'h3' is neither a frequency"),
    ],
)
def test_stats_command_refuses_wrong_parts(typed: list[str], message: str, capsys: Capture):
    assert app.run(["stats", "bars.yaml", *typed]) == 2
    assert message in capsys.readouterr().err


def test_stats_command_of_take(capsys: Capture):
    every = [
        row(k, Axis(float(5e-3 * np.sin(k / 100)), float(np.cos(k / 100)), 0.0, 1))
        for k in range(3000)
    ]
    data = [rows(*every[i : i + 250]) for i in range(0, 3000, 250)]
    Path("hand.take").write_bytes(b"".join([header(rate=44000.0), *data, end()]))
    assert app.run(["stats", "hand.take"]) == 0
    out = capsys.readouterr().out.splitlines()
    assert out[0] == "remi: 3 s, 3,000 ticks, none lost"
    assert out[1].startswith("  position      -5 mm to 5 mm, rms 3.")
    assert out[2].startswith("  speed         peak 50 mm/s, rms 35")
    assert out[5] == "  reversals     9"
    assert out[6].startswith("  smoothness    -1.")
    assert out[7] == "  force felt    peak 1 N, rms 0.705 N; sent up to 0 N"
    assert out[8].startswith("  energy        given ")
    assert app.run(["stats", "hand.take", "remi", "--cutoff", "8Hz", "--json"]) == 0
    (records_read,) = records(capsys)
    assert (records_read["event"], records_read["lost"], records_read["held"]) == ("hand", 0, 0)
    assert len(records_read["movement"]["reversals"]) == 9
    assert records_read["movement"]["cutoff"] == 8.0


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["hand.take"], "hand.take: No such file"),
        (["bad.take"], "not a recording"),
        (["walk.c3d"], "make a recording of this movement first: ergon take import walk.c3d"),
        (["still.take", "eve"], "PART: there is no hand 'eve'; there are remi"),
        (["still.take", "--cutoff", "1kg"], "--cutoff: "),
    ],
)
def test_stats_command_of_take_refusals(capsys: Capture, words: list[str], message: str):
    Path("bad.take").write_bytes(b"RIFF")
    Path("still.take").write_bytes(header() + rows(row(1, Axis(0.0)), row(2, Axis(0.0))) + end())
    assert app.run(["stats", *words]) == 2
    assert message in capsys.readouterr().err
