"""Values of a bar that bring its partials to those of a glockenspiel: 1 : 2.76 : 5.4."""

import sys
from pathlib import Path

import ergon

SCORE = """\
ergon: 1
instruments:
  bar:
    modules:
      a: {CEL: {M: 2g, f: 500Hz, t60: 1s}}
      b: {CEL: {M: 2g, f: 900Hz, t60: 1s}}
      c: {CEL: {M: 2g, f: 2kHz, t60: 1s}}
      ab: {REF: {between: [a, b], K: 5kN/m}}
      bc: {REF: {between: [b, c], K: 5kN/m}}
    out: {SOX: [a, b, c]}
"""


def main(folder: Path) -> Path:
    """Tune the bar to A4; where the tuned score is."""
    path = folder / "bar.yaml"
    path.write_text(SCORE, encoding="utf-8")
    options = ergon.TuneOptions(base="A4")
    tuned = ergon.tune(path, "bar", "1:2.76:5.4", options)
    for mode, before, after in zip(tuned.modes, tuned.before, tuned.frequencies, strict=True):
        print(f"mode {mode}: {before:.1f} Hz -> {after:.1f} Hz")
    for value in tuned.values:
        print(f"{value.name}: {value.text}")
    if tuned.edited is None:
        raise SystemExit(tuned.trouble)
    target = folder / "tuned.yaml"
    target.write_text(tuned.edited, encoding="utf-8")
    return target


if __name__ == "__main__":
    print(main(Path(*sys.argv[1:])))
