"""A heavy instrument computed once, and read while the others are played in a session."""

import sys
from pathlib import Path

import ergon

SCORE = """\
ergon: 1
instruments:
  gong:
    modules:
      skin: {PLATE: {shape: hex, radius: 6, f: A2, M: 300g, rim: fixed, t60: 1s}}
    out: {SOV: skin.20}
  bell: {modules: {m: {CEL: {M: 2g, f: E5, t60: 1s}}}, out: {SOX: m}}
strikes:
  low: {to: gong.skin.10, at: 1|1, every: 4, times: 2, impulse: 20mNs}
  high: {to: bell.m, at: 1|2, every: 1, times: 7, impulse: 2mNs}
mix: {route: [{from: gong, to: 1}, {from: bell, to: 1, gain: -6dB}]}
"""


def main(folder: Path) -> Path:
    """Freeze the gong, and change the bell in a session beside it; where the frozen part is."""
    path = folder / "gong.yaml"
    path.write_text(SCORE, encoding="utf-8")
    frozen = ergon.freeze(path, ["gong"], folder / "gong.frozen")
    print(f"frozen: {frozen.n_frames} frames of {', '.join(stem.part for stem in frozen.stems)}")
    options = ergon.SessionOptions(
        audio="null", frozen=folder / "gong.frozen", journal=folder / "session.jsonl"
    )
    with ergon.open_session(path, options) as session:
        session.play()
        print(session.set("bell.m.f", "660Hz", now=True).text)
    return folder / "gong.frozen"


if __name__ == "__main__":
    print(main(Path(*sys.argv[1:])))
