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
def at(tmp_path: Path):
    stepped = Stepped(SCORE, tmp_path)
    stepped.ok("play")
    yield stepped
    stepped.close()


def level(at: Stepped, channel: int, seconds: float) -> float:
    return float(np.abs(at.sound[-int(seconds * at.rate) :, channel - 1]).max())


def pitches(at: Stepped) -> dict[str, float]:
    piece = at.session.schedule.head.piece
    return {name: own.modules[0].fields["f"] for name, own in piece.instruments.items()}


def test_notes_are_set_faded_routed_and_struck(at: Stepped):
    at.run(1.2)
    assert level(at, 1, 1.0) > 0
    at.ok("set cell.E4.f A4")
    at.ok("set cell.t60 1s")
    found = pitches(at)
    assert found["cell.E4"] == 440.0
    assert found["cell.C4"] == pytest.approx(261.6255653)
    assert found["low.E2"] == pytest.approx(82.4068892)  # like `cell`, but for what a note has
    at.ok("rain strikes low.C2 cell.G#4 every 1 impulse 2mNs")
    at.run(2.0)
    assert level(at, 2, 0.5) > 0
    at.ok("gain cell -300dB")
    at.ok("route low 3")
    at.run(3.0)
    assert level(at, 1, 0.5) < 1e-12
    assert level(at, 3, 0.5) > 0
    at.ok("rest rain")
    at.ok("hush")
    at.run(1.5)
    by_name = {one.name: one for one in at.session.schedule.head.piece.strikes}
    assert by_name["calls"].until is not None
    at.session.close()
    assert np.array_equal(at.again(), at.sound)


def test_a_note_of_a_route_as_a_whole_is_not_routed_alone(at: Stepped):
    at.run(0.2)
    reply = at.type("route cell.E4 2")
    assert not reply.taken
    assert "routed with all notes of cell" in reply.text


def test_a_pattern_of_notes_is_typed(at: Stepped):
    at.ok("cell notes C4 E4 ~ G#4 every 1/2 impulse 2mNs")
    at.run(2.5)
    found = [one.voices for one in at.session.schedule.head.piece.strikes if one.voices]
    assert [{name: own[0].part for name, own in one.items()} for one in found] == [
        {"C4": "cell.C4", "E4": "cell.E4", "G#4": "cell.G#4"}
    ]
    at.ok("keep 1bar as kept")
    at.run(0.5)
    at.session.close()
    assert np.array_equal(at.again(), at.sound)


def test_a_melody_is_rendered_as_it_was_played(at: Stepped):
    at.run(4.0)
    at.ok("set cell.C4.f x1.5 over 1bar")
    at.run(3.0)
    at.session.close()
    assert np.array_equal(at.again(), at.sound)
