"""`ergon stats` as it is typed."""

from pathlib import Path

import pytest
from commands import records
from tests.api.test_tune import SCORE

from ergon.cli import app

Capture = pytest.CaptureFixture[str]


@pytest.fixture(autouse=True)
def folder(own_folder: Path) -> Path:
    Path("bars.yaml").write_text(SCORE)
    return own_folder


def test_figures_in_the_terminal(capsys: Capture):
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


def test_as_records(capsys: Capture):
    assert app.run(["stats", "bars.yaml", "--json"]) == 0
    found = records(capsys)
    assert [row["part"] for row in found] == [
        *("k1", "bar", "free", "wire", "soft", "discrete", "wall")
    ]
    assert found[1]["links"][0]["count"] == 8
    assert found[2]["points"][0]["compliance_m_per_n"] is None
    assert found[2]["free_motions"] == 1
    assert found[6]["t60_range_s"] == []


@pytest.mark.parametrize(
    ("typed", "message"),
    [
        (["barr"], "PART: no instrument or key is called 'barr'; did you mean 'bar'?"),
        (["--to", "h3"], "--to: 'h3' is neither a frequency"),
    ],
)
def test_what_cannot_be_asked_for(typed: list[str], message: str, capsys: Capture):
    assert app.run(["stats", "bars.yaml", *typed]) == 2
    assert message in capsys.readouterr().err
