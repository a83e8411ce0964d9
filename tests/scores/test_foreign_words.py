"""What composers type who know other programs: each answer has the place and what to write."""

from __future__ import annotations

import pytest

from ergon.notation.text.errors import Diagnostic
from ergon.scores.reading.load import load

SCORE = """\
ergon: 1
tempo: {bpm: 96}
keys:
  k1: {M: 400g, K: 60N/m, Z: 1.2Ns/m, travel: -15mm..15mm}
instruments:
  bell:
    modules:
      hammer: {CEL: {M: 20g, f: 220Hz, t60: 2s}}
      m: {CEL: {M: 20g, f: 220Hz, t60: 2s}}
      b: {BUT: {between: [k1, m], K: 900N/m, gap: 1mm}}
    out: {SOX: m}
  cell: {CEL: {M: 1g, f: A4, t60: 2s}, notes: C3..C5, play: {strike: {impulse: 0.1mNs..2mNs}}, out: {SOX: cell}}
phrases:
  tune: {to: cell, entries: [{at: 0, what: C4}, {at: 1, what: E4}]}
strikes:
  a: {to: cell.C3, at: 1|1, impulse: 1mNs}
  t: {play: tune, at: 2|1}
mix:
  rooms: {hall: {size: 12m, t60: 2s}}
  route: [{from: bell, to: 1, send: {hall: -6dB}}, {from: cell, to: 2}]
render: {tail: 2s}
"""  # noqa: E501
ROUTE, STRIKES, ENTRY = "{from: cell, to: 2", "impulse: 1mNs", "what: C4"

# What is written in place of what; the text that is marked; what is to be read; the suggestion.
CASES = [
    ("tempo: {bpm: 96}", "meter: 3/4", "3/4", "tempo: {bpm: 96, meter: 3/4}", None),
    ("tempo: {bpm: 96}", "bpm: 96", "bpm", "write `tempo: {bpm: 96}`", None),
    ("tempo: {bpm: 96}", "time: 3/4", "time", "tempo: {bpm: 96, meter: 3/4}", None),
    ("tempo: {bpm: 96}", "key: C major", "key", "a score has no key", None),
    ("tempo: {bpm: 96}", "composer: X", "composer", "put it into `title`", None),
    ("tempo: {bpm: 96}", "reverb: 0.3", "reverb", "a reverberation is a room", None),
    (STRIKES, "velocity: 90", "velocity", "unknown field", "impulse"),
    (STRIKES, f"{STRIKES}, loop: true", "loop", "times: 4", None),
    (STRIKES, f"{STRIKES}, duration: 2", "duration", "until it has died away", None),
    (STRIKES, "impulse: forte", "forte", "neither an impulse", "f"),
    (STRIKES, "impulse: mezzopiano", "mezzopiano", "neither an impulse", "mp"),
    (ENTRY, f"{ENTRY}, duration: 1/4", "duration", "until it has died away", None),
    (ENTRY, f"{ENTRY}, velocity: 90", "velocity", "unknown field", "impulse"),
    (ENTRY, "what: r", "r", "each entry stands at its time", None),
    (ENTRY, "what: Cmaj7", "Cmaj7", "write its notes", None),
    (ENTRY, "what: c''", "c''", "counts octaves by ticks", "C5"),
    (ENTRY, "what: cis''", "cis''", "counts octaves by ticks", "C#5"),
    (ENTRY, "what: Ebb", "Ebb", "has no octave", "Ebb4"),
    ("cell.C3", "cell.sol", "cell.sol", "has no octave", "cell.G4"),
    ("cell.C3", "cell.C6", "cell.C6", "the notes of 'cell' are C3 to C5", "cell.C5"),
    (ROUTE, f"{ROUTE}, volume: 0.5", "volume", "unknown field", "gain"),
    (ROUTE, f"{ROUTE}, reverb: 0.3", "reverb", "send: {hall: -6dB}", None),
    (ROUTE, f"{ROUTE}, gain: 50%", "50%", "is a percentage", "x0.5"),
    (ROUTE, "{from: cell, to: right", "right", "channels are numbers from 1", "2"),
    ("{hall: -6dB}", "{hal: -6dB}", "hal", "no room is called 'hal'", "hall"),
    ("out: {SOX: m}", "out: {sox: m}", "sox", "unknown output 'sox'", "SOX"),
    ("out: {SOX: m}", "mute: true", "mute", "stands in its route", None),
    ("out: {SOX: m}", "gain: 0.5", "gain", "stands in its route", None),
    ("out: {SOX: m}", "pedal: down", "pedal", "its `play` may have a `release`", None),
    ("out: {SOX: m}", "use: ball", "use", "by `from: FILE/NAME`", None),
    ("[k1, m]", "k1 m", "k1 m", "expected: a list", "[k1, m]"),
    ("hammer: {CEL: {M: 20g, f: 220Hz", "hammer: {CEL: {M: 20g, f: 220,5Hz", "220,5Hz",
     "a comma ends a value", "220.5Hz"),
    ("tail: 2s", "rate: 48kHz", "rate", "rates: {audio: 48kHz}", None),
    ("tail: 2s", "length: 30s", "length", "--until 30s", None),
    ("tempo: {bpm: 96}", "tempo: {bpm: allegro}", "allegro", "a number of beats a minute", None),
    ("tempo: {bpm: 96}", "include: other.yaml", "other.yaml", "a group", "{file: other.yaml}"),
    ("from: cell", "from: [cell, bell]", "[cell, bell]", "repeat the entry", None),
    ("out: {SOX: m}", "out: m", "m", "expected: {SOX: m}", "{SOX: m}"),
    ("    modules:\n", "  modules:\n", "out", "6 ('b'), 2 ('modules'), 0 ('instruments')", None),
    ("strikes:\n  a: {", "strikes:\n  - {", "t", "lines of a list begin with '- '", None),
    ("  bell:\n", "  bell:\u00a0\n", "\u00a0", "a no-break space (U+00A0)", None),
]  # fmt: skip


def diagnostics(text: str) -> list[Diagnostic]:
    return list(load("s.yaml", text=text).diagnostics)


@pytest.mark.parametrize(
    ("written", "instead", "marked", "words", "suggestion"),
    CASES,
    ids=[f"{instead.strip()[-24:]}-{number}" for number, (_, instead, *_) in enumerate(CASES)],
)
def test_foreign_words_message_place_and_suggestion(written, instead, marked, words, suggestion):
    assert SCORE.count(written) >= 1
    text = SCORE.replace(written, instead, 1)
    first = diagnostics(text)[0]
    assert words in f"{first.message} {first.help or ''}"
    assert first.suggestion == suggestion
    line = text.splitlines()[first.place.line - 1]
    assert line[first.place.column - 1 :].startswith(marked)


@pytest.mark.parametrize("case", [case for case in CASES if not case[0].startswith("out:")])
def test_foreign_words_cause_a_single_message(case):
    written, instead, *_ = case
    assert len(diagnostics(SCORE.replace(written, instead, 1))) == 1


def test_base_score_without_diagnostics():
    assert not diagnostics(SCORE)
