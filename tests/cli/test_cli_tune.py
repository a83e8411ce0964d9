"""`ergon tune` as it is typed."""

from pathlib import Path

import pytest
from commands import records

from ergon.cli import app
from tests.api.test_tune import SCORE

Capture = pytest.CaptureFixture[str]


@pytest.fixture(autouse=True)
def folder(work_folder: Path) -> Path:
    Path("bars.yaml").write_text(SCORE)
    return work_folder


def test_tune_command_prints_values(capsys: Capture):
    assert app.run(["tune", "bars.yaml", "wire", "A3"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "wire: 1 mode"
    assert lines[2].split()[1:7:2] == ["293.665", "220.000", "220.000"]
    assert lines[2].endswith("  0 cents")
    assert lines[-1].split()[:3] == ["wire.s.f", "293.665", "0.749154"]
    assert Path("bars.yaml").read_text() == SCORE


def test_tune_command_edits_score_or_new_file(capsys: Capture):
    typed = ["tune", "bars.yaml", "bar", "2=170Hz", "--by", "m3.M"]
    assert app.run([*typed, "-o", "new.yaml"]) == 0
    assert app.run([*typed, "-o", "-"]) == 0
    assert capsys.readouterr().out.endswith(Path("new.yaml").read_text())
    assert app.run([*typed, "--write"]) == 0
    assert Path("bars.yaml").read_text() == Path("new.yaml").read_text() != SCORE
    assert capsys.readouterr().err.endswith("wrote 1 value into bars.yaml\n")
    assert app.run(["tune", "bars.yaml", "bar", "2=170Hz", "--by", "m3.M"]) == 0
    assert "no value changes" in capsys.readouterr().out


def test_tune_command_writes_no_unreachable_targets(capsys: Capture):
    assert app.run(["tune", "bars.yaml", "wire", "1:2.1:3.3", "--write"]) == 2
    assert (
        "the targets cannot be reached together: mode 1 stays 87.35 cents above its target"
        in capsys.readouterr().err
    )
    assert Path("bars.yaml").read_text() == SCORE


def test_tune_command_json_records(capsys: Capture):
    assert app.run(["tune", "bars.yaml", "bar", "1:3", "--by", "springs", "--json"]) == 0
    *values, last = records(capsys)
    assert {row["event"] for row in values} == {"value"}
    assert (last["event"], last["modes"], last["reached"], last["rank"]) == (
        "tuned",
        [1, 2],
        True,
        2,
    )


@pytest.mark.parametrize(
    ("typed", "message"),
    [
        (["barr", "A3"], "PART: no instrument or key is called 'barr'; did you mean 'bar'?"),
        (["bar", "h3"], "TARGET: 'h3' is neither a frequency"),
        (["bar", "1:2", "A3"], "TARGET: give one list of ratios"),
        (["bar", "1=A3", "A4"], "TARGET: 'A4' is not MODE=FREQUENCY, such as 3=A5"),
        (["bar", "1=A3", "1=A4"], "TARGET: mode 1 is given twice"),
        (["bar", "A3", "--base", "A3"], "--base: a base is used with ratios only"),
        (["bar", "A3", "--by", "m9.M"], "--by: bar has no value 'm9.M' above 0"),
        (["bar", "A3", "--write", "-o", "x.yaml"], "--write excludes -o"),
    ],
)
def test_tune_command_refuses_wrong_parts_and_targets(
    typed: list[str], message: str, capsys: Capture
):
    assert app.run(["tune", "bars.yaml", *typed]) == 2
    assert message in capsys.readouterr().err
