"""Parts as orchestras of Csound: what Csound plays is what the engine plays by modes."""

from pathlib import Path

import numpy as np
import pytest
from csound_played import needs_csound, rendered
from planned_sound import off_db, played

from ergon.cli import app
from ergon.workshop.api.export import ExportOptions
from ergon.workshop.api.export_csound import csound_orchestras

pytestmark = pytest.mark.usefixtures("work_folder")
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
    out: {a: {SOX: m}, b: {SOX: [m, n]}, c: {SOA: n}}
  bell:
    modules:
      b: {MODES: {M: 30g, f: [440Hz, 921Hz, 1500Hz], t60: [3s, 2s, 1s],
          places: {rim: [1, 0.4, 0.7], crown: [-0.4, 1, 0.2]}}}
    out: {SOV: b.crown}
  sky: {modules: {c: {BANK: {count: 40, M: 2g, f: 200Hz..4kHz, t60: 1s}}}, out: {SOX: c.all}}
strikes:
  a: {to: [wire.s.3, wire.s.9], at: 10ms, impulse: 1mNs}
  b: {to: [mesh.n], at: 0s, impulse: 1mNs}
  c: {to: [bell.b.rim], at: 50ms, every: 50ms, times: 2, impulse: 2mNs, lasts: 0s}
  d: {to: [sky.c.all], at: 20ms, impulse: 1mNs}
render: {tail: 0.2s}
"""
DEAF = "  deaf: {modules: {m: {CEL: {M: 1g, f: 9Hz}}}}\nstrikes:"  # is not written


@needs_csound
def test_csound_export_renders_as_modal_engine() -> None:
    Path("s.yaml").write_text(SCORE)
    exact = played(SCORE, method="modal")
    Path("s.yaml").write_text(SCORE.replace("strikes:", DEAF))
    built = csound_orchestras("s.yaml")
    assert [item.part for item in built] == ["s"]
    Path("s.csd").write_text(built[0].text)
    assert off_db(rendered(Path("s.csd")), exact) < -140
    parts = csound_orchestras("s.yaml", ExportOptions(parts=["wire", "sky"]))
    assert [item.part for item in parts] == ["wire", "sky"]
    for item, channels in zip(parts, (exact[:, :1], exact[:, -1:]), strict=True):
        Path("part.csd").write_text(item.text)
        assert off_db(rendered(Path("part.csd")), channels) < -140


@needs_csound
def test_csound_orchestra_with_many_strikes_on_modes() -> None:
    """A hundred and twenty struck points of one bank leave the numbers of its modes free."""
    score = SCORE.replace("count: 40", "count: 120")
    exact = played(score, method="modal")
    Path("s.yaml").write_text(score)
    (built,) = csound_orchestras("s.yaml", ExportOptions(parts=["sky"]))
    Path("sky.csd").write_text(built.text)
    assert off_db(rendered(Path("sky.csd")), exact[:, -1:]) < -140


def test_csound_export_comments_with_units(capsys: pytest.CaptureFixture[str]) -> None:
    Path("s.yaml").write_text(SCORE)
    assert app.run(["export", "s.yaml", "bell", "--to", "csound", "-o", "d", "--upto", "1kHz"]) == 0
    text = Path("d/bell.csd").read_text()
    for line in (
        "gaPush1 init 0  ; [N s] on bell.b.0 in this sample",
        "gaOut1 init 0  ; [m] out",
        "giFull1 = 10.0  ; [m/s] of it is full scale",
        "  iDecay = p5      ; [1/s]; T60 = 6.9078/p5 s",
        "i 1 0.05 2.2675736961451248e-05 0.002",
    ):
        assert line in text.splitlines()
    rows = [line.split()[4:] for line in text.splitlines() if line.startswith("i 100 ")]
    assert [float(row[0]) for row in rows] == pytest.approx([440.0, 921.0])
    # 1 N·s on 30 g; levels 1 at the rim and -0.4 at the crown.
    assert float(rows[0][2]) == pytest.approx(0.4 / (0.03 * 2 * np.pi * 440.0), rel=1e-9)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("out: {SOV: b.crown}", "", "bell has no output of motion"),
        ("count: 40", "count: 201", "sky is struck at 201 points; a bank can have at most 200"),
    ],
)
def test_csound_export_refuses_unsupported_scores(
    old: str, new: str, says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("s.yaml").write_text(SCORE.replace(old, new))
    code = app.run(["export", "s.yaml", "bell", "sky", "--to", "csound", "-o", "d"])
    assert (code, Path("d").exists()) == (2, False)
    assert says in capsys.readouterr().err
