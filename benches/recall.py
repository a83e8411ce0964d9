"""What a render costs after edits that change little of its sound, and that of one bar."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from benches.fresh_process import ergon
from benches.measure import Row
from ergon.exchange.wave import hash_samples

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

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
_DULCIMER = "cimbal: {from: strings/dulcimer, notes: [D4, A4, D5"


class _Edit(NamedTuple):
    """What is changed, the texts before and after, and whether that changes the sound."""

    what: str
    changes: tuple[tuple[str, str], ...]
    is_heard: bool = False


# One after the other, as a piece grows.
_EDITS = (
    _Edit("nothing changed", ()),
    _Edit(
        "unused instrument added", (("  gong:\n", "  spare: {from: bells/handbell}\n  gong:\n"),)
    ),
    _Edit("instrument renamed", (("gong", "tamtam"),)),
    _Edit("two instruments swapped", ((_BARS, ""), (_CIMBAL, _BARS + _CIMBAL))),
    _Edit("unplayed note added to `notes`", ((_DULCIMER, f"{_DULCIMER}, F5"),)),
    _Edit("gain of a route", (("pan: 0.6}", "pan: 0.6, gain: 2dB}"),), is_heard=True),
    _Edit("entry changed at 90 %", (("times: 58", "times: 52"),), is_heard=True),
)
_FROM, _UNTIL = "20|1", "21|1"
_EDGE = 0.01  # [s] in which an excerpt rises and falls


def recall() -> list[Row]:
    """One row for each edit, and one for an excerpt.

    Only the last version is rendered from scratch too: edits that change no sound are compared with
    the version before them.
    """
    with tempfile.TemporaryDirectory() as name:
        folder, text = Path(name), _SCORE
        first, samples = _rendered(folder, text, "on")
        costs = {}
        for what, changes, is_heard in _EDITS:
            for old, new in changes:
                assert old in text, f"{old!r} is in the score"
                text = text.replace(old, new)
            costs[what], after = _rendered(folder, text, "on")
            assert (after != samples) == is_heard, what
            samples = after
        complete = _frames(folder / "a.wav")
        costs["nothing changed, one bar"], _ = _rendered(
            folder, text, "on", "--from", _FROM, "--until", _UNTIL
        )
        assert _is_part_of(_frames(folder / "a.wav"), complete)
        scratch, wanted = _rendered(folder, text, "off")
        assert samples == wanted, "what is recalled has the bytes of a render from scratch"
        # Two edits alike: the second is rendered without --draft.
        old, *gains = "gain: 2dB", "gain: 3dB", "gain: 4dB"
        assert old in text
        for options, gain in zip((("--draft",), ()), gains, strict=True):
            what = f"another gain again{' (--draft)' if options else ''}"
            costs[what], _ = _rendered(folder, text.replace(old, gain), "on", *options)
    return [
        Row(
            f"render of eighty seconds on eight channels, {what}",
            f"{spent:.2f} s of CPU time, start of the program included",
            f"the first render: {first:.2f} s, from scratch without a memory: {scratch:.2f} s",
            spent / scratch,
            "of the time from scratch",
            {"cpu_s": spent, "first_s": first, "scratch_s": scratch},
        )
        for what, spent in costs.items()
    ]


def _frames(path: Path) -> NDArray[np.float64]:
    """The samples of a WAVE file (n_frames, n_channels)."""
    import soundfile

    frames: NDArray[np.float64] = soundfile.read(path, always_2d=True)[0]
    return frames


def _is_part_of(part: NDArray[np.float64], complete: NDArray[np.float64]) -> bool:
    """Whether an excerpt is a part of the piece from `_FROM` on, but for its edges."""
    import numpy as np

    beat = 60 / 96
    rate = round(len(part) / (4 * beat))
    first, edge = round(19 * 4 * beat * rate), round(_EDGE * rate)
    return np.array_equal(part[edge:-edge], complete[first + edge : first + len(part) - edge])


def _rendered(folder: Path, text: str, cache: str, *options: str) -> tuple[float, str]:
    """CPU time of `ergon render` [s], and the hash of the samples."""
    (folder / "a.yaml").write_text(text, encoding="utf-8")
    variables = {"XDG_CACHE_HOME": str(folder / "cache"), "ERGON_CACHE": cache}
    spent, result = ergon(["render", "a.yaml", "-o", "a.wav", "-f", *options], folder, variables)
    result.check_returncode()
    return spent, hash_samples(folder / "a.wav")
