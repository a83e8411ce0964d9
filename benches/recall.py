"""What a render costs after edits that change little of its sound, and that of one bar."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path

from benches.fresh_process import ergon
from benches.measure import Row
from ergon.exchange.wave import hash_samples

# Eighty seconds on eight loudspeakers in a room: struck strings, bars, a gong that hardens, and a
# bank.
_SCORE = """\
ergon: 1
title: Eighty seconds
tempo: [{at: 1|1, bpm: 96, meter: 4/4}]
keys: {k1: {M: 400g, K: 60N/m, Z: 1.2Ns/m}}
instruments:
  cimbal: {from: strings/dulcimer, notes: [D4, A4, D5]}
  gong:
    modules:
      p: {PLATE: {shape: hex, radius: 6, M: 400g, f: 180Hz, t60: 6s, hardening: 1e9N/m3}}
      b: {BUT: {between: [k1, p.centre], K: 4kN/m, Z: 2Ns/m, gap: 2mm}}
    out: {SOX: p.20}
  bars: {from: bars/marimba, notes: [G3, C4]}
  sky:
    BANK: {count: 200, f: 80Hz..10kHz, t60: 0.5s..8s, M: 1g, place: spiral}
    out: {SOX: sky.all}
gestures:
  knock: 0mm@0 smooth 6mm@1/8 smooth 0mm@1/2
players: {ada: {key: k1}}
parts:
  ada: [{at: 1|1, play: knock, every: 2, times: 60}]
strikes:
  plucked: {to: cimbal.hammer, at: 1|1, notes: D4 A4 D5 A4, every: 1/2, times: 60, impulse: 3mNs}
  struck: {to: bars.hammer, at: 1|2, notes: G3 C4, every: 1, times: 58, impulse: 30mNs}
  rain: {to: sky.all, at: 2|1, for: 28bar, rate: 0.05Hz, impulse: 1uNs..9uNs}
mix:
  channels: 8
  rooms: {hall: {t60: {200Hz: 2.2s, 6kHz: 0.9s}, size: 18m}}
  route:
    - {from: cimbal, to: [1, 2], pan: 0.4, send: {hall: -12dB}}
    - {from: gong, to: [3, 4], pan: 0.5, send: {hall: -9dB}}
    - {from: bars, to: [5, 6], pan: 0.2, fade: [{at: 1|1, gain: -12dB}, {at: 20|1, gain: 0dB}]}
    - {from: sky, to: [7, 8], pan: 0.6}
  master: {normalise: -1dB}
render: {tail: 4s}
"""
_BARS = "  bars: {from: bars/marimba, notes: [G3, C4]}\n"
_CIMBAL = "  cimbal: {from: strings/dulcimer, notes: [D4, A4, D5]}\n"
# What is changed: the texts before and after.
_EDITS: Mapping[str, tuple[tuple[str, str], ...]] = {
    "nothing changed": (),
    "an unused instrument added": (("  gong:\n", "  spare: {from: bells/handbell}\n  gong:\n"),),
    "an instrument renamed": (("gong", "tamtam"),),
    "two instruments swapped": ((_BARS, ""), (_CIMBAL, _BARS + _CIMBAL)),
    "a note added to `notes`": (("[D4, A4, D5]", "[D4, F4, A4, D5]"),),
    "an entry changed at 90 %": (("every: 1, times: 58", "every: 1, times: 52"),),
}


def recall() -> list[Row]:
    """One row for each edit, one for an excerpt, and one for a draft."""
    rows = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        first, _ = _rendered(folder, _SCORE, "on")
        for what, changes in _EDITS.items():
            text = _SCORE
            for old, new in changes:
                assert old in text, f"{old!r} is in the score"
                text = text.replace(old, new)
            rows.append(_row(folder, what, text, ()))
        rows.append(
            _row(folder, "nothing changed, one bar", _SCORE, ("--from", "20|1", "--until", "21|1"))
        )
        draft, _ = _rendered(folder, _SCORE, "on", "--draft")
        again, _ = _rendered(folder, _SCORE, "on", "--draft")
    rows.append(
        Row(
            "render of eighty seconds, --draft",
            f"{draft:.2f} s of CPU time; again: {again:.2f} s",
            f"the first render: {first:.2f} s",
            draft / first,
            "of the time of the first render",
            {"cpu_s": draft, "again_s": again, "first_s": first},
        )
    )
    return rows


def _row(folder: Path, what: str, text: str, options: tuple[str, ...]) -> Row:
    saved, samples = _rendered(folder, text, "on", *options)
    complete, scratch = _rendered(folder, text, "off", *options)
    assert samples == scratch, "what is recalled has the bytes of a render from scratch"
    return Row(
        f"render of eighty seconds on eight channels, {what}",
        f"{saved:.2f} s of CPU time, start of the program included",
        f"from scratch: {complete:.2f} s",
        saved / complete,
        "of the time from scratch",
        {"cpu_s": saved, "scratch_s": complete},
    )


def _rendered(folder: Path, text: str, cache: str, *options: str) -> tuple[float, str]:
    """CPU time of `ergon render` [s], and the hash of the samples."""
    (folder / "a.yaml").write_text(text, encoding="utf-8")
    variables = {"XDG_CACHE_HOME": str(folder / "cache"), "ERGON_CACHE": cache}
    spent, result = ergon(["render", "a.yaml", "-o", "a.wav", "-f", *options], folder, variables)
    result.check_returncode()
    return spent, hash_samples(folder / "a.wav")
