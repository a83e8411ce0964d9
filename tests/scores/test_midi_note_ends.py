"""Notes of a sequencer's file on shipped instruments: they begin and end where mido says."""

from __future__ import annotations

import random
from collections.abc import Iterator
from pathlib import Path

import mido
import pytest
from sweep import crossed

from ergon.api import score
from ergon.scores.staging.struck_notes import struck_notes

SCORE = """\
ergon: 1
rates: {{audio: {rate}}}
tempo: {{from: tune.mid}}
meter: {{from: tune.mid}}
instruments: {{one: {{from: {matter}, notes: [C4, E4, G4]}}}}
takes: {{tune: {{file: tune.mid}}}}
strikes: {{tune: {{play: tune, at: 1|1, to: one}}}}
mix: {{route: [{{from: one, to: 1}}]}}
"""
RATE = 44100.0
KEYS = {60: "one.C4", 64: "one.E4", 67: "one.G4"}
TICKS = 480


def _sequence(path: Path, numerator: int, denominator: int) -> None:
    """Three bars with tempos in their middle, notes that meet, and the pedal."""
    draws = random.Random(f"{numerator}/{denominator}")
    bar = 4 * TICKS * numerator // denominator
    meter = mido.MetaMessage("time_signature", numerator=numerator, denominator=denominator)
    times = mido.MidiTrack([meter])
    for number in range(3):
        tempo = draws.randrange(300_000, 900_000)
        times.append(mido.MetaMessage("set_tempo", tempo=tempo, time=bar // 2 if number else 0))
    events = [(bar, mido.Message("control_change", control=64, value=127))]
    events.append((2 * bar - bar // 3, mido.Message("control_change", control=64, value=0)))
    for key in KEYS:
        tick = draws.randrange(bar // 4)
        while tick < 3 * bar:
            end = tick + draws.randrange(bar // 8, bar // 2)
            velocity = draws.randrange(20, 127)
            events.append((tick, mido.Message("note_on", note=key, velocity=velocity)))
            events.append((end, mido.Message("note_off", note=key)))
            tick = end + draws.randrange(1, bar // 4)
    track, before = mido.MidiTrack(), 0
    for tick, message in sorted(events, key=lambda event: (event[0], event[1].type)):
        track.append(message.copy(time=tick - before))
        before = tick
    mido.MidiFile(ticks_per_beat=TICKS, tracks=[times, track]).save(path)


def _mido_notes(path: Path) -> Iterator[tuple[str, float, float]]:
    """The notes by mido: member, beginning and end [s], where the key or the pedal comes up, or
    the key is struck again.
    """
    seconds, is_down = 0.0, False
    sounding: dict[int, float] = {}
    released: set[int] = set()

    def ended(keys: list[int]) -> Iterator[tuple[str, float, float]]:
        for key in keys:
            yield KEYS[key], sounding.pop(key), seconds
            released.discard(key)

    for message in mido.MidiFile(path):  # its times are in seconds
        seconds += message.time
        if message.type == "control_change":
            is_down = message.value >= 64
            yield from ended([] if is_down else [*released])
        elif message.type == "note_on":
            yield from ended([message.note] if message.note in sounding else [])
            sounding[message.note] = seconds
        elif message.type == "note_off" and is_down:
            released.add(message.note)
        elif message.type == "note_off":
            yield from ended([message.note])


@pytest.mark.parametrize(
    ("meter", "matter"), crossed([(4, 4), (7, 8), (3, 2)], ["strings/piano", "friction/viol"])
)
def test_midi_notes_begin_and_end_as_in_mido(tmp_path: Path, matter: str, meter: tuple[int, int]):
    _sequence(tmp_path / "tune.mid", *meter)
    text = SCORE.format(rate="44.1kHz", matter=matter)
    (tmp_path / "s.yaml").write_text(text, encoding="utf-8")
    staged = score.stage_piece(score.read(tmp_path / "s.yaml"), None).stage
    notes = [(n.member, n.begin, n.end) for n in struck_notes(staged)]
    exact = sorted(_mido_notes(tmp_path / "tune.mid"), key=lambda note: (note[1], note[0]))
    assert [member for member, *_ in notes] == [member for member, *_ in exact]
    for (_, begin, end), (_, exact_begin, exact_end) in zip(notes, exact, strict=True):
        assert begin == pytest.approx(exact_begin, abs=1 / RATE)
        assert end == pytest.approx(exact_end, abs=1 / RATE)
