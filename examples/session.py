"""A session whose verbs are methods; its sound goes nowhere, and its score is saved."""

import sys
from pathlib import Path

import ergon

SCORE = """\
ergon: 1
keys: {k1: {M: 400g, K: 60N/m, Z: 1.2Ns/m}}
instruments:
  bell:
    modules:
      m: {CEL: {M: 2g, f: 440Hz, t60: 1s}}
      b: {BUT: {between: [k1, m], K: 900N/m, gap: 1mm}}
    out: {SOX: m}
gestures: {knock: 0mm@0 smooth 6mm@60ms 0mm@120ms}
players: {ada: {key: k1}}
parts: {ada: []}
"""


def main(folder: Path) -> Path:
    """Play, change what is played, save; where the new score is."""
    path = folder / "session.yaml"
    path.write_text(SCORE, encoding="utf-8")
    options = ergon.SessionOptions(audio="null", journal=folder / "session.jsonl")
    with ergon.open_session(path, options) as session:
        session.play()
        session.plays("ada", "knock", every=1, times=8)
        session.set("bell.m.f", "330Hz", now=True)
        try:
            session.plays("ada", "kock")
        except ergon.NotTaken as refused:
            print(refused)
        session.save(str(folder / "saved"))
    return folder / "saved.yaml"


if __name__ == "__main__":
    print(main(Path(*sys.argv[1:])))
