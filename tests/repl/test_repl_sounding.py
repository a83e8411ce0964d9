"""What sounds in a session, by the places of its text: for editors that mark it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from sessions import Stepped

from ergon.repl.session.sounding import SoundingPlaces
from ergon.repl.session_protocol import SoundingPlace
from ergon.repl.wire.protocol import encode, encode_sounding

# At 120 bpm a beat lasts half a second.
SCORE = """\
ergon: 1
tempo: [{at: 1|1, bpm: 120}]
keys: {k1: {M: 400g, K: 60N/m, Z: 1.2Ns/m, travel: -15mm..15mm}}
instruments:
  bell: {CEL: {M: 2g, f: 440Hz, t60: 0.4s}}
gestures: {knock: 0mm@0 smooth 6mm@25ms 0mm@50ms}
players: {ada: {key: k1}}
parts:
  ada: [{at: 1|1, play: knock}, {at: 1|3, play: knock, every: 1/4, times: 3}]
strikes:
  d1: {to: bell, at: 1|1, rhythm: "x x [~ x] x", times: 2, impulse: 1mNs}
  tune: |
    1|1   bell 1mNs
    1|2.5 bell 2mNs
  feet: {to: bell, at: 1|2, euclid: 3 8, every: 1/2, until: 3|1, impulse: 1mNs}
  last: {to: bell, at: 2|1, every: 1, times: 2, impulse: 1mNs}
  rain: {to: bell, rate: 3Hz, at: 1|2, until: 2|1, impulse: 1uNs..2uNs}
"""
# (line, marked text, beat from 0, length in beats): by the rules of docs/language.md, by hand.
GESTURE = 0.05 / 0.5
WRITTEN = [
    *((9, "knock", beat, GESTURE) for beat in (0, 2, 2.25, 2.5)),
    *((11, "d1", 4 * bar + beat, long) for bar in (0, 1) for beat, long in [(0, 1), (1, 1)]),
    *((11, "d1", 4 * bar + beat, long) for bar in (0, 1) for beat, long in [(2.5, 0.5), (3, 1)]),
    (13, "1|1", 0, 0),
    (14, "1|2.5", 1.5, 0),
    *((15, "feet", beat, long) for beat, long in [(1, 1.5), (2.5, 1.5), (4, 1), (5, 1.5)]),
    (15, "feet", 6.5, 0),  # nothing follows that would end it
    (16, "last", 4, 0),
    (16, "last", 5, 0),
    (17, "rain", 1, 3),
]


def followed(session: Stepped, seconds: float, step: float) -> list[SoundingPlace]:
    """What began in this time, looked at after every step [s]."""
    look = SoundingPlaces(session.session.schedule)
    began: list[SoundingPlace] = []
    for _ in range(round(seconds / step)):
        session.run(step)
        sounding = look()
        assert all(place.start < sounding.now for place in sounding.began)
        began += sounding.began
    return began


@pytest.mark.parametrize("step", [0.05, 0.7, 4.9])
def test_sounding_places_begin_once_at_written_beats(tmp_path: Path, step: float):
    """However often one looks: each begins once, at its beat, where it is written."""
    session = Stepped(SCORE, tmp_path)
    session.ok("play")
    began = followed(session, 4.9, step)
    zero = min(place.start for place in began)
    result = sorted(
        (place.line, place.text, place.start - zero, place.end - place.start) for place in began
    )
    wanted = sorted((line, text, beat / 2, long / 2) for line, text, beat, long in WRITTEN)
    wanted = [row for row in wanted if zero + row[2] < 4.9]
    assert [row[:2] for row in result] == [row[:2] for row in wanted]
    for seen, written in zip(result, wanted, strict=True):
        assert seen[2:] == pytest.approx(written[2:], abs=1e-9), seen
    lines = SCORE.split("\n")
    for place in began:
        assert lines[place.line - 1][place.column - 1 :].startswith(place.text)
        assert place.file == str(tmp_path / "score.yaml")
    session.close()


def test_place_after_a_typed_line_names_its_text(tmp_path: Path):
    """Lines that are typed move others: the text of a place says whether a file still has it."""
    session = Stepped(SCORE, tmp_path)
    session.ok("shake = 0@0 smooth 3@20ms 0@40ms")
    session.ok("ada plays shake every 1")
    session.ok("play")
    began = followed(session, 1.2, 0.1)
    text = session.session.schedule.head.texts.text.split("\n")
    shakes = [place for place in began if place.what == "shake"]
    assert shakes
    for place in shakes:
        assert text[place.line - 1][place.column - 1 :].startswith(place.text)
        assert "shake" in text[place.line - 1]
    session.close()


def test_sounding_of_a_stopped_piece_is_empty(tmp_path: Path):
    session = Stepped(SCORE, tmp_path)
    assert followed(session, 0.5, 0.1) == []
    session.close()


def test_sounding_places_over_protocol(tmp_path: Path):
    session = Stepped(SCORE, tmp_path)
    look = SoundingPlaces(session.session.schedule)
    session.ok("play")
    session.run(0.2)
    fields = json.loads(encode(**encode_sounding(look())))
    assert fields["now"] == pytest.approx(session.session.schedule.engine.frame / session.rate)
    [first] = [place for place in fields["began"] if place["what"] == "knock"]
    assert set(first) == {"file", "line", "column", "text", "start", "end", "what"}
    assert (first["line"], first["column"], first["text"]) == (9, 25, "knock")
    session.close()
