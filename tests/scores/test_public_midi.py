"""Notes of public MIDI files beside those that mido reads, in seconds, and when their keys go up.

The files are those that music21 brings, and those of the folder that $ERGON_PUBLIC_MIDI names, such
as a clone of https://github.com/Natooz/MidiTok (its folder `tests`); none is kept here.
"""

import bisect
import importlib.util
import os
from collections import defaultdict
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from ergon.notation.text.errors import TextError
from ergon.scores.gesture.midi_file import read_notes
from ergon.scores.gesture.midi_survey import tempos_of

pytestmark = pytest.mark.slow

_SUSTAIN, _DOWN = 64, 64


def _public_files() -> list[Path]:
    paths = []
    music21 = importlib.util.find_spec("music21")
    if music21 is not None and music21.origin is not None:
        paths += (Path(music21.origin).parent / "midi").rglob("*.mid")
    if folder := os.environ.get("ERGON_PUBLIC_MIDI"):
        paths += Path(folder).rglob("*.mid")
    return sorted(paths)


def _first(ticks: list[int], tick: int) -> float:
    """The first of `ticks` after `tick`; infinite if there is none."""
    index = bisect.bisect_right(ticks, tick)
    return ticks[index] if index < len(ticks) else float("inf")


def _is_down(pedal: list[tuple[int, bool]], tick: int) -> bool:
    """Whether the pedal is down before what it does at `tick`."""
    return next((down for then, down in reversed(pedal) if then < tick), False)


def _mido_notes(path: Path) -> list[tuple[float, int, int, float | None]]:
    """Beginning [s], number, velocity and length [s] of each note: a note ends where its key goes
    up, is struck again, or where the pedal that held it comes up, at the latest with the file.
    """
    mido = pytest.importorskip("mido")
    file = mido.MidiFile(path)
    tick, instants, tempos = 0, {}, [(0, 500_000)]
    struck, released, pedals = defaultdict(list), defaultdict(list), defaultdict(list)
    for message in mido.merge_tracks(file.tracks):
        tick += message.time
        if message.type == "set_tempo":
            tempos.append((tick, message.tempo))
        elif message.type == "note_on" and message.velocity:
            struck[message.channel, message.note].append((tick, message.velocity))
        elif message.type in ("note_on", "note_off"):
            released[message.channel, message.note].append(tick)
        elif message.type == "control_change" and message.control == _SUSTAIN:
            pedals[message.channel].append((tick, message.value >= _DOWN))

    def seconds(instant: float) -> float:
        if instant not in instants:
            total = 0.0
            for (begin, tempo), (end, _) in zip(tempos, [*tempos[1:], (instant, 0)], strict=True):
                ticks = max(min(end, instant) - begin, 0)
                total += mido.tick2second(ticks, file.ticks_per_beat, tempo)
            instants[instant] = total
        return instants[instant]

    notes = []
    for (channel, number), beginnings in struck.items():
        begins = [begin for begin, _ in beginnings]
        ups = [then for then, down in pedals[channel] if not down]
        for index, (begin, velocity) in enumerate(beginnings):
            again = begins[index + 1] if index + 1 < len(begins) else float("inf")
            end = _first(released[channel, number], begin)
            if end < again and _is_down(pedals[channel], int(end)):
                end = min(_first(ups, int(end) - 1), tick)
            end = min(end, again)
            lasting = None if end == float("inf") else seconds(end) - seconds(begin)
            notes.append((seconds(begin), number, velocity, lasting))
    return notes


def _ergon_notes(path: Path) -> list[tuple[float, int, int, float | None]]:
    tempos = tempos_of(path)

    def seconds(quarter: float) -> float:
        total = 0.0
        for (begin, bpm), (end, _) in zip(tempos, [*tempos[1:], (quarter, 0.0)], strict=True):
            total += max(min(end, quarter) - begin, 0.0) * 60.0 / bpm
        return total

    return [
        (
            seconds(note.at),
            note.number,
            note.velocity,
            None if note.length is None else seconds(note.at + note.length) - seconds(note.at),
        )
        for note in read_notes(path).notes
    ]


def _columns(notes: list[tuple[float, int, int, float | None]]) -> NDArray[np.float64]:
    """Numbers, velocities, beginnings and lengths of notes in order; -1 where nothing ends one."""
    rows = [
        (number, velocity, instant, -1.0 if lasting is None else lasting)
        for instant, number, velocity, lasting in notes
    ]
    return np.array(sorted(rows, key=lambda row: (*row[:2], round(row[2], 7), row[3])))


@pytest.mark.parametrize("path", _public_files(), ids=lambda path: path.name)
def test_notes_of_public_midi_files(path: Path) -> None:
    mido = pytest.importorskip("mido")
    try:
        wanted = _mido_notes(path)
    except (OSError, EOFError, ValueError, mido.midifiles.meta.KeySignatureError) as error:
        with pytest.raises(TextError):  # nor does ergon read it
            read_notes(path)
        pytest.skip(f"mido does not read it: {error}")
    if not wanted:
        with pytest.raises(TextError, match="no notes"):
            read_notes(path)
        return
    notes = _ergon_notes(path)
    assert len(notes) == len(wanted)
    assert np.abs(_columns(notes) - _columns(wanted)).max() < 1e-6
