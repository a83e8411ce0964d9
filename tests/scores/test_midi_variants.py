"""MIDI files as other programs write them, read by ours and by mido."""

from __future__ import annotations

import io
import random
from pathlib import Path

import mido
import pytest

from ergon.scores.gesture.midi_bytes import NOTE_OFF, NOTE_ON, MidiBytes


def _variable(value: int) -> bytes:
    parts = [value & 0x7F]
    while value := value >> 7:
        parts.append(value & 0x7F | 0x80)
    return bytes(parts[::-1])


def _track(chance: random.Random) -> bytes:
    """Events with all that files have between notes; a status is left out where it may be."""
    out, status = b"", 0

    def event(first: int, *content: int) -> bytes:
        nonlocal status
        is_running, status = first == status and chance.random() < 0.8, first
        return bytes(content) if is_running else bytes([first, *content])

    for _ in range(chance.randrange(2, 40)):
        out += _variable(chance.choice([0, 0, 1, 96, 127, 128, 480, 20_000, 2_097_152]))
        channel = chance.randrange(3)
        match chance.randrange(11):
            case 0 | 1 | 2:
                out += event(0x90 | channel, chance.randrange(128), chance.randrange(128))
            case 3 | 4:
                out += event(0x80 | channel, chance.randrange(128), 64)
            case 5:
                out += event(0xB0 | channel, chance.choice([1, 7, 64]), chance.randrange(128))
            case 6:
                out += event(0xE0 | channel, chance.randrange(128), chance.randrange(128))
            case 7:
                out += event(0xC0 | channel, 5)
            case 8:  # a status goes on over it; mido loses the times of kinds that it does not know
                text = "Grün".encode("latin-1")[: chance.randrange(5)]
                out += b"\xff" + bytes([chance.choice([1, 3, 5, 6, 0x7F])])
                out += _variable(len(text)) + text
            case 9:
                out += b"\xff\x51\x03" + chance.randrange(200_000, 900_000).to_bytes(3, "big")
            case 10:
                content = bytes(chance.randrange(128) for _ in range(chance.randrange(150)))
                out += b"\xf0" + _variable(len(content) + 1) + content + b"\xf7"
                status = 0
    return out + _variable(chance.choice([0, 1000])) + b"\xff\x2f\0"


def _chunk(name: bytes, content: bytes) -> bytes:
    return name + len(content).to_bytes(4, "big") + content


def _variant(seed: int) -> tuple[bytes, bytes]:
    """A file, and one for mido: without what stands between or behind the tracks."""
    chance = random.Random(seed)
    kind = seed % 2
    tracks = [_chunk(b"MTrk", _track(chance)) for _ in range(1 + kind * chance.randrange(4))]
    head = b"".join(
        number.to_bytes(2, "big")
        for number in (kind, len(tracks), chance.choice([1, 24, 96, 480, 960, 15_360]))
    )
    plain = _chunk(b"MThd", head) + b"".join(tracks)
    more = [_chunk(b"XFIH", bytes(7)) if chance.random() < 0.3 else b"" for _ in tracks]
    behind = chance.choice([b"", b"", b"\0", bytes(130), b"TAG" + bytes(125)])
    longer = head + bytes(2) if chance.random() < 0.2 else head
    rest = b"".join(part for pair in zip(more, tracks, strict=True) for part in pair)
    return _chunk(b"MThd", longer) + rest + behind, plain


@pytest.mark.parametrize("seed", range(60))
def test_midi_files_of_other_programs(seed: int) -> None:
    data, plain = _variant(seed)
    file = MidiBytes(Path("x.mid"), data)
    header = file.read_header()
    theirs = mido.MidiFile(file=io.BytesIO(plain), clip=True)
    assert (header.format, header.ticks_per_quarter) == (theirs.type, theirs.ticks_per_beat)
    assert len(header.track_spans) == len(theirs.tracks)
    for span, track in zip(header.track_spans, theirs.tracks, strict=True):
        ours = [
            (event.tick, event.kind, event.channel - 1, *event.content)
            for event in file.track_events(span)
            if event.kind in (NOTE_ON, NOTE_OFF)
        ]
        tick, expected = 0, []
        for message in track:
            tick += message.time
            if message.type in ("note_on", "note_off"):
                kind = NOTE_ON if message.type == "note_on" else NOTE_OFF
                expected.append((tick, kind, message.channel, message.note, message.velocity))
        assert ours == expected


NOTE = b"\0\x90\x3c\x64\x60\x3c\0\0\xff\x2f\0"


def _file(track: bytes, n_tracks: int = 1) -> bytes:
    head = b"MThd\0\0\0\6\0\1" + n_tracks.to_bytes(2, "big") + b"\0\x60"
    return head + b"MTrk" + len(track).to_bytes(4, "big") + track


def _notes(data: bytes) -> list[tuple[int, int]]:
    file = MidiBytes(Path("x.mid"), data)
    (span,) = file.read_header().track_spans
    return [(e.tick, e.content[0]) for e in file.track_events(span) if e.kind == NOTE_ON]


def test_running_status_over_system_exclusive_message() -> None:
    track = b"\0\x90\x3c\x64\x60\xf0\x03\x7e\x7f\xf7\0\x3e\x5a\0\xff\x2f\0"
    assert _notes(_file(track)) == [(0, 60), (96, 62)]


def test_midi_file_within_riff() -> None:
    """RMID, with a chunk of odd size before."""
    inner = _file(NOTE)
    chunks = b"DISP\3\0\0\0abc\0data" + len(inner).to_bytes(4, "little") + inner
    data = b"RIFF" + (4 + len(chunks)).to_bytes(4, "little") + b"RMID" + chunks
    assert _notes(data) == _notes(inner) == [(0, 60), (96, 60)]


def test_midi_tracks_missing_from_file_are_counted() -> None:
    header = MidiBytes(Path("x.mid"), _file(NOTE, n_tracks=3)).read_header()
    assert (len(header.track_spans), header.n_missing) == (1, 2)
    assert MidiBytes(Path("x.mid"), _file(NOTE)).read_header().n_missing == 0
