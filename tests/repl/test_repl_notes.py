"""Instruments with notes, and melodies, while a session plays."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from sessions import Stepped

SCORE = """\
ergon: 1
rates: {audio: 8kHz}
tempo: [{at: 1|1, bpm: 240}]               # a bar is a second
keys: {k1: {M: 400g, K: 60N/m, Z: 1.2Ns/m}}
instruments:
  cell: {CEL: {M: 1g, f: A4, t60: 0.5s}, notes: [C4, E4, G#4], out: {SOX: cell}}
  low: {like: cell, notes: [C2, E2]}
phrases:
  call: {to: cell, impulse: 1mNs, length: 4, entries: [{at: 0, what: C4}, {at: 2, what: E4 Ab4}]}
strikes:
  calls: {play: call, at: 1|1, times: 99}
  tune: |
    1|1   cell.C4   1mNs
    6|1   low.C2    3mNs
mix: {channels: 3, route: [{from: cell, to: [1]}, {from: low.C2, to: [2]}]}
"""


@pytest.fixture
def stepped_session(tmp_path: Path):
    stepped = Stepped(SCORE, tmp_path)
    stepped.ok("play")
    yield stepped
    stepped.close()


def level(stepped_session: Stepped, channel: int, seconds: float) -> float:
    return float(
        np.abs(stepped_session.sound[-int(seconds * stepped_session.rate) :, channel - 1]).max()
    )


def pitches(stepped_session: Stepped) -> dict[str, float]:
    piece = stepped_session.session.schedule.head.piece
    return {name: own.modules[0].fields["f"] for name, own in piece.instruments.items()}


def test_notes_are_set_faded_routed_and_struck(stepped_session: Stepped):
    stepped_session.run(1.2)
    assert level(stepped_session, 1, 1.0) > 0
    stepped_session.ok("set cell.E4.f A4")
    stepped_session.ok("set cell.t60 1s")
    result = pitches(stepped_session)
    assert result["cell.E4"] == 440.0
    assert result["cell.C4"] == pytest.approx(261.6255653)
    assert result["low.E2"] == pytest.approx(82.4068892)  # like `cell`, but for what a note has
    stepped_session.ok("rain strikes low.C2 cell.G#4 every 1 impulse 2mNs")
    stepped_session.run(2.0)
    assert level(stepped_session, 2, 0.5) > 0
    stepped_session.ok("gain cell -300dB")
    stepped_session.ok("route low 3")
    stepped_session.run(3.0)
    assert level(stepped_session, 1, 0.5) < 1e-12
    assert level(stepped_session, 3, 0.5) > 0
    stepped_session.ok("rest rain")
    stepped_session.ok("hush")
    stepped_session.run(1.5)
    by_name = {one.name: one for one in stepped_session.session.schedule.head.piece.strikes}
    assert by_name["calls"].until is not None
    stepped_session.session.close()
    assert np.array_equal(stepped_session.again(), stepped_session.sound)


def test_route_note_of_a_routed_instrument_is_refused(stepped_session: Stepped):
    stepped_session.run(0.2)
    reply = stepped_session.type("route cell.E4 2")
    assert not reply.taken
    assert "routed with all notes of cell" in reply.text


def test_pattern_of_notes_typed_and_saved_by_keep(stepped_session: Stepped):
    stepped_session.ok("cell notes C4 E4 ~ G#4 every 1/2 impulse 2mNs")
    stepped_session.run(2.5)
    result = [
        one.voices for one in stepped_session.session.schedule.head.piece.strikes if one.voices
    ]
    assert [{name: own[0].part for name, own in one.items()} for one in result] == [
        {"C4": "cell.C4", "E4": "cell.E4", "G#4": "cell.G#4"}
    ]
    stepped_session.ok("keep 1bar as kept")
    stepped_session.run(0.5)
    stepped_session.session.close()
    assert np.array_equal(stepped_session.again(), stepped_session.sound)


def test_journal_of_melody_with_pitch_glide(stepped_session: Stepped):
    stepped_session.run(4.0)
    stepped_session.ok("set cell.C4.f x1.5 over 1bar")
    stepped_session.run(3.0)
    stepped_session.session.close()
    assert np.array_equal(stepped_session.again(), stepped_session.sound)
