"""`ergon sweep`: the sounds of `ergon render`, a table of them, and what a second run computes."""

import csv
import os
import signal
import subprocess
from pathlib import Path
from xml.etree import ElementTree

import pytest
from commands import ERGON, forked
from patience import PATIENCE, until

import ergon
from ergon.api import sweep_variant
from ergon.cli import app

BELL = """\
ergon: 1
rates: {audio: 8000Hz}
title: A bell
use: [bells.yaml]
takes: {sway: {file: sway.csv}}
keys: {k1: {M: 400g, K: 60N/m, Z: 1.2Ns/m}}
instruments:
  hum:
    modules:
      m: {CEL: {M: 2g, K: 5kN/m, Z: 0.02Ns/m}}
    out: {x: {SOX: m}}
players: {ada: {key: k1}}
parts: {ada: [{at: 0.1s, play: sway}]}
strikes:
  a: {to: [hum.m, small.n], at: 0.05s, impulse: 1mNs, every: 0.1s, times: 3, chance: 0.6}
mix:
  channels: 1
  route: [{from: hum.x, to: [1], gain: 20dB}, {from: small.x, to: [1]}]
  master: {normalise: -1dB}
render: {tail: 0.4s, bits: 16}
"""
SMALL = """\
instruments:
  small: {modules: {n: {CEL: {M: 1g, f: 300Hz, t60: 0.2s}}}, out: {x: {SOX: n}}}
"""


@pytest.fixture(autouse=True)
def folder(work_folder: Path) -> Path:
    Path("bell.yaml").write_text(BELL)
    Path("bells.yaml").write_text(SMALL)
    rows = "".join(f"{i / 100},{i % 7 / 1000}\n" for i in range(30))
    Path("sway.csv").write_text(f"t [s],x [m]\n{rows}")
    return work_folder


def rows(folder: str = "bell.sweep") -> list[dict[str, str]]:
    text = Path(folder, "sweep.csv").read_text()
    return list(csv.DictReader(line for line in text.splitlines() if line[0] != "#"))


def sweep(*words: str) -> int:
    return app.run(["sweep", "bell.yaml", *words])


def test_sweep_sounds_equal_render(capsys: pytest.CaptureFixture[str]):
    assert sweep("--vary", "hum.m.K=4kN/m..9kN/m:2", "--vary", "seed=7..8") == 0
    assert capsys.readouterr().out.count("\n") == 5
    records_read = rows()
    assert [(row["hum.m.K"], row["seed"]) for row in records_read] == [
        ("4kN/m", "7"),
        ("4kN/m", "8"),
        ("9kN/m", "7"),
        ("9kN/m", "8"),
    ]
    Path("own.yaml").write_text("seed: 8\n" + BELL.replace("5kN/m", "9kN/m"))
    done = ergon.render_to_file("own.yaml", "own.wav")
    assert records_read[3]["file"] == "hum.m.K=9kN_m,seed=8.wav"
    built = Path("bell.sweep", records_read[3]["file"]).read_bytes()
    # What differs is the hash of the score, which says the seed elsewhere.
    assert built[-1000:] == Path("own.wav").read_bytes()[-1000:]
    assert float(records_read[3]["loudness_lufs"]) == pytest.approx(done.mix.loudness)
    assert float(records_read[3]["peak_db"]) == pytest.approx(-1.0, abs=1e-3)
    # f = √(K/M)/2π
    for row, f in ((records_read[0], 225.08), (records_read[3], 337.6)):
        assert float(row["partial_hz"]) == pytest.approx(f, rel=5e-3)
    root = ElementTree.parse("bell.sweep/sweep.svg").getroot()
    assert sum(one.tag.endswith("circle") for one in root.iter()) >= 4 * 4


def test_sweep_of_used_file_field_with_zip():
    assert sweep("--vary", "small.n.f=200Hz,310Hz", "--vary", "seed=1,2", "--zip", "-q") == 0
    assert [(row["small.n.f"], row["seed"]) for row in rows()] == [("200Hz", "1"), ("310Hz", "2")]
    assert Path("bells.yaml").read_text() == SMALL


def test_sweep_second_run_computes_missing_variants(monkeypatch: pytest.MonkeyPatch):
    from ergon.api import sweep as module

    computed: list[str] = []

    def counting(content: object, options: object, name: str) -> object:
        computed.append(name)
        return sweep_variant.compute_variant(content, options, name)  # type: ignore[arg-type]

    monkeypatch.setattr(module, "compute_variant", counting)
    vary = ("--vary", "hum.m.K=4kN/m..6kN/m:3", "-q")
    assert sweep(*vary) == 0
    assert len(computed) == 3
    before = Path("bell.sweep/sweep.csv").read_bytes()
    assert sweep(*vary) == 0
    assert len(computed) == 3
    assert Path("bell.sweep/sweep.csv").read_bytes() == before
    Path("bell.sweep/hum.m.K=5kN_m.wav").write_bytes(b"half a file")
    assert sweep(*vary) == 2  # it was edited
    assert sweep(*vary, "-f") == 0
    assert computed[3:] == ["hum.m.K=5kN_m.wav"]
    assert sweep("--vary", "hum.m.K=4kN/m..8kN/m:5", "-q") == 0  # two of three are known
    assert len(computed) == 6
    Path("sway.csv").write_text(Path("sway.csv").read_text().replace("0.006", "0.005"))
    assert sweep(*vary) == 0  # a take is part of the score
    assert len(computed) == 9
    assert sweep(*vary, "--bits", "24") == 0
    assert len(computed) == 12


def test_sweep_of_score_by_relative_path():
    arguments = ["sweep", "./bell.yaml", "-q", "--vary", "hum.m.M=1g,2g", "--no-sound"]
    assert app.run(arguments) == 0
    assert len(rows()) == 2


def test_sweep_row_of_failed_variant(capsys: pytest.CaptureFixture[str]):
    assert sweep("--method", "ca", "--vary", "hum.m.K=5kN/m,1e9N/m,6kN/m", "--no-sound") == 1
    output = capsys.readouterr()
    assert "1 variant of 3 failed; the first: " in output.err
    assert f"{Path.cwd()}/bell.yaml:10:7: error[E309] hum.m: its frequency is" in output.err
    assert [row["status"] for row in rows()] == ["ok", "refused", "ok"]
    assert sorted(os.listdir("bell.sweep")) == ["sweep.csv", "sweep.svg"]


@pytest.mark.parametrize(
    ("words", "code", "output"),
    [
        (["--vary", "hum.m.K=1kN..2kN:3"], 1, "unit 'kN' does not measure stiffness"),
        (["--vary", "hum.m.M=1g,0g"], 1, "bell.yaml:10:20: error[E202]"),
        (["--vary", "hum.m.Q=1,2"], 2, "--vary: 'hum.m.Q': the field 'Q' does not exist"),
        (["--vary", "seed=1.5,2"], 2, "--vary: seed=1.5: a seed is a whole number"),
        (["--vary", "seed=1,2", "--seed", "3"], 2, "--seed: excludes --vary; the sweep varies it"),
        (["--vary", "seed=1,2", "-o", "bell.yaml"], 2, "bell.yaml"),
        (["--vary", "hum.m.M=1g", "--seed", "-1"], 2, "--seed -1: a seed is a whole number from 0"),
    ],
)
def test_sweep_mistakes_render_nothing(
    words: list[str], code: int, output: str, capsys: pytest.CaptureFixture[str]
):
    before = sorted(os.listdir())
    assert sweep(*words) == code
    assert output in capsys.readouterr().err
    assert sorted(os.listdir()) == before


@pytest.mark.parametrize(
    "number", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.slow)]
)
def test_interrupted_sweep_keeps_complete_files(number: signal.Signals):
    Path("bell.yaml").write_text(BELL.replace("tail: 0.4s", "tail: 20s"))
    words = [*ERGON, "sweep", "bell.yaml", "--vary", "seed=1..60", "--jobs", "2"]
    process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    try:
        until(lambda: len(list(Path().glob("bell.sweep/*.wav"))) > 3, "sounds")
        process.send_signal(number)
        _, output = process.communicate(timeout=PATIENCE)
    finally:
        process.kill()
    assert b"Traceback" not in output
    assert process.returncode == 128 + number
    done = rows()
    assert 2 < len(done) < 60
    row_files = {row["file"] for row in done}
    files = {path.name: path.stat().st_size for path in Path().glob("bell.sweep/*.wav")}
    # A sound of each of the two jobs may not have its row yet.
    assert row_files <= files.keys()
    assert len(files.keys() - row_files) <= 2
    assert len(set(files.values())) == 1, "a file is shorter than the others"


def test_sweep_refuses_foreign_or_edited_table():
    Path("bell.sweep").mkdir()
    Path("bell.sweep/sweep.csv").write_text("mine\n1\n")
    assert sweep("--vary", "seed=1,2", "-q") == 2
    table = "# made by ergon\nseed,status,file,score_sha256\n1,ok,../../x.wav,\n"
    Path("bell.sweep/sweep.csv").write_text(table)
    assert sweep("--vary", "seed=1,2", "-q") == 2
    assert sweep("--vary", "seed=1,2", "-q", "-f") == 0
    done = forked(["sweep", "bell.yaml", "--vary", "seed=1,2", "--json"], Path())
    assert done.returncode == 0
    assert '"event": "variant"' not in done.stdout  # all of it was known
