"""A plucked string at three pitches with two decays: six renders and their table."""

import sys
from pathlib import Path

import ergon

SCORE = """\
ergon: 1
instruments:
  string:
    modules:
      body: {STRING: {masses: 24, f: D3, M: 4g, ends: fixed, t60: 2s}}
    out: {SOX: body.4}
strikes: {pluck: {to: string.body.3, at: 1|1, impulse: 2mNs}}
mix: {route: [{from: string, to: 1}], master: {normalise: -3dB}}
render: {tail: 1s}
"""


def main(folder: Path) -> Path:
    """Render all variants; where their table is."""
    path = folder / "pluck.yaml"
    path.write_text(SCORE, encoding="utf-8")
    options = ergon.SweepOptions(
        vary=("string.body.f=A2,D3,A3", "string.body.t60=1s,3s"), out=folder / "plucks"
    )
    sweep = ergon.sweep(path, options)
    for row in sweep.rows:
        values = ", ".join(
            f"{target} {value}" for target, value in zip(sweep.targets, row.values, strict=True)
        )
        print(f"{values}: {row.reason or row.file}")
    return sweep.table


if __name__ == "__main__":
    print(main(Path(*sys.argv[1:])))
