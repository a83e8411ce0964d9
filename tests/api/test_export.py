"""Tables of modes for other programs: their sum is what the engine steps."""

import csv
from pathlib import Path

import numpy as np
import pytest
from planned_sound import off_db, played

from ergon.cli import app
from ergon.workshop.api.export import ExportOptions, mode_tables

RATE = 44_100
SCORE = """\
ergon: 1
title: Modes
instruments:
  wire: {modules: {s: {STRING: {masses: 24, M: 4g, f: D4, t60: 2s}}}, out: {SOX: s.17}}
  mesh:
    units: ca
    at: 44100Hz
    modules:
      m: {CEL: {M: 1, K: 0.01, Z: 0.001}}
      n: {MAS: {M: 2}}
      g: {SOL: {}}
      l: {REF: {between: [m, n], K: 0.1, Z: 0.01}}
      k: {RES: {between: [n, g], K: 0.2}}
    out: {SOX: m}
  bell:
    modules:
      hammer: {CEL: {M: 20g, f: 1Hz, t60: 0.6s}}
      p: {CEL: {M: 1kg, f: 880Hz, t60: 3s}}
      slow: {CEL: {M: 1kg, K: 1N/m, Z: 9Ns/m}}
      hit: {BUT: {between: [hammer, p], K: 1e5N/m, gap: 1mm}}
    out: {SOX: p}
  wall: {modules: {w: {SOL: {}}}}
strikes:
  a: {to: [wire.s.3], at: 0s, impulse: 1mNs, lasts: 0s}
  b: {to: [mesh.n], at: 0s, impulse: 1mNs, lasts: 0s}
render: {tail: 0.2s}
"""


@pytest.fixture(autouse=True)
def folder(work_folder: Path) -> Path:
    Path("s.yaml").write_text(SCORE)
    return work_folder


def test_modal_export_sum_equals_modal_render() -> None:
    exact = played(SCORE, method="modal")
    t = np.arange(len(exact)) / RATE
    for column, built in enumerate(mode_tables("s.yaml", ExportOptions(parts=("wire", "mesh")))):
        head, names, *rows = csv.reader(built.text.splitlines())
        assert head == [f"# modes of {built.part}", " made by ergon"]
        assert names[:4] == ["mode", "frequency [Hz]", "T60 [s]", "decay [1/s]"]
        assert len(names) == 6
        numbers = np.array(rows, dtype=float)
        f, _, d, amplitude, phase = numbers.T[1:, :, None]
        sound = 1e-3 * amplitude * np.exp(-d * t) * np.sin(2 * np.pi * f * t + phase)
        assert off_db(sound.sum(axis=0)[:, None], exact[:, column : column + 1]) < -200


def test_modal_export_hammer_and_skipped_modes(capsys: pytest.CaptureFixture[str]) -> None:
    assert app.run(["export", "s.yaml", "--to", "modal", "-o", "modes", "--upto", "5kHz"]) == 0
    err = capsys.readouterr().err
    assert "bell: its contacts counted as open" in err
    assert "bell: 1 mode that does not oscillate left out" in err
    assert {path.name for path in Path("modes").iterdir()} == {"wire.csv", "mesh.csv", "bell.csv"}
    _, names, hammer, partial = csv.reader(Path("modes/bell.csv").read_text().splitlines())
    assert names[4::2] == [f"amplitude bell.{one} to out [m/Ns]" for one in ("hammer", "p")]
    assert float(hammer[1]) == pytest.approx(1.0)
    # An impulse of 1 Ns on 1 kg is a swing of 1/ω.
    assert float(partial[6]) == pytest.approx(1 / (2 * np.pi * 880), rel=1e-9)
    assert float(Path("modes/wire.csv").read_text().splitlines()[-1].split(",")[1]) < 5000


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--to", "modal", "--bits", "16"], "--bits cannot be used with --to modal"),
        (["--upto", "1kHz"], "--upto cannot be used with --to daw"),
        (["wire"], "PART cannot be used with --to daw"),
        (["--to", "modal", "wir"], "did you mean 'wire'?"),
        (["--to", "modal", "--upto", "1kg"], "--upto"),
        (["--to", "modal", "wall"], "nothing in this score moves"),
    ],
)
def test_export_refuses_wrong_arguments(
    words: list[str], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert app.run(["export", "s.yaml", "-o", "d", *words]) == 2
    assert says in capsys.readouterr().err
    assert not Path("d").exists()


@pytest.mark.parametrize("name", ["bell.dsp", "modes.csv", "mix.wav"])
def test_export_refuses_file_name_as_folder(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["export", "s.yaml", "bell", "--to", "modal", "-o", name]
    assert app.run(words) == 2
    folder = Path(name).stem
    assert f"{name} has the name of a file; name a folder, for example {folder}" in (
        capsys.readouterr().err
    )
    assert not Path(name).exists()
    Path(name).mkdir()
    assert app.run(words) == 0  # a folder that is there already is taken
    assert (Path(name) / "bell.csv").exists()
