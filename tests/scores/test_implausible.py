"""Warnings of what a score can hardly mean, where the examples of the pages do not go."""

from pathlib import Path

import pytest
from checked import check

import ergon
from ergon.scores.reading.load import load
from ergon.scores.staging.implausible import warn_implausible

ROOT = Path(__file__).parents[2]
SCORE = """\
ergon: 1
keys: {k1: {M: 400g, K: 60N/m, travel: -15mm..10mm}}
instruments:
  bell:
    modules:
      m: {CEL: {M: 2g, f: A3}}
      b: {BUT: {between: [k1, m], K: 900N/m, gap: 1mm}}
    out: {SOX: m}
"""


def codes(text: str) -> list[str]:
    piece = check(text).piece
    assert piece is not None
    return [found.code for found in warn_implausible(piece)]


@pytest.mark.parametrize(
    ("before", "after", "wanted"),
    [
        ("gap: 1mm", "gap: 10mm", ["W329"]),
        ("gap: 1mm", "gap: 9.9mm", []),
        ("gap: 1mm", "gap: 14mm, side: above", []),
        ("gap: 1mm", "gap: 15mm, side: above", ["W329"]),
        ("10mm}", "10mm, reach: 2}", []),
        ("10mm}}", "10mm, reach: 0.1}}", ["W329"]),
        ("between: [k1, m], K: 900N/m, gap: 1mm", "between: [m, k1], K: 1N/m, gap: 14mm", []),
        (
            "between: [k1, m], K: 900N/m, gap: 1mm",
            "between: [m, k1], K: 1N/m, gap: 15mm",
            ["W329"],
        ),
        ("gap: 1mm", "gap: -1mm, side: above", ["W327"]),
        ("f: A3}", "f: A3, X0: -1mm}", []),
        ("K: 900N/m, gap: 1mm", "gap: 1mm, contact: magic, restitution: 0.5", []),
        ("K: 900N/m", "K: 900000kN/m, exponent: 1.5", []),
        ("K: 900N/m", "K: 900000kN/m", ["W328"]),
        (
            "BUT: {between: [k1, m], K: 900N/m, gap: 1mm}",
            "RES: {between: [k1, m], K: 1e9}",
            ["W328"],
        ),
        ("  bell:\n", "  bell:\n    units: ca\n    at: 44100Hz\n", []),
    ],
)
def test_implausible_values_and_near_misses(before, after, wanted):
    if "units" in after:
        text = "ergon: 1\ninstruments:\n  bell:\n    units: ca\n    at: 44100Hz\n    modules: "
        text += "{m: {CEL: {M: 1, K: 3}}, w: {SOL: {}}, b: {BUT: {between: [w, m], K: 9, gap: -1}}}"
        assert codes(text + "\n    out: {SOX: m}\n") == wanted
        return
    text = SCORE.replace(before, after)
    assert text != SCORE
    assert codes(text) == wanted


@pytest.mark.parametrize("path", sorted(ROOT.glob("scores/library/*.yaml")), ids=lambda p: p.stem)
def test_bundled_scores_have_no_implausible_warnings(path):
    piece = load(path).piece
    assert piece is not None
    assert warn_implausible(piece) == []


def test_soft_output_warning_by_bits_and_master(tmp_path):
    """A file of floats without a master is in metres: nothing is said of its level."""
    listened = []

    class Listener(ergon.Report):
        def diagnostics(self, found, files, left_out):
            listened.extend(one.code for one in found)

    path = tmp_path / "bell.yaml"
    bell = "{modules: {m: {CEL: {M: 2g, f: A4, X0: 1um}}}, out: {SOX: m}}"
    text = f"ergon: 1\ninstruments: {{bell: {bell}}}\n"
    for bits, master, wanted in (
        ("float", "", []),
        ("float", "mix: {route: {from: bell, to: 1}, master: {gain: 0dB}}\n", ["W325"]),
        ("24", "", ["W325"]),
        ("24", "mix: {route: {from: bell, to: 1}, master: {normalise: -1dB}}\n", []),
    ):
        path.write_text(text + master + f"render: {{tail: 100ms, bits: {bits}}}\n")
        listened.clear()
        options = ergon.FileOptions(force=True)
        ergon.render_to_file(path, tmp_path / "bell.wav", options, report=Listener())
        assert listened == wanted, (bits, master)
