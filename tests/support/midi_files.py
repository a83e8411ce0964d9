"""MIDI files that tests write with mido, and what mido says of them."""

import random
from pathlib import Path

import mido

TICKS = 480  # in a quarter note
METERS = ((4, 4), (3, 4), (6, 8), (7, 8), (12, 8), (2, 2), (3, 2), (5, 16))


def save(path: Path, *tracks: list[tuple[int, mido.Message | mido.MetaMessage]]) -> Path:
    """Write tracks of (tick, message) in any order."""
    file = mido.MidiFile(type=1, ticks_per_beat=TICKS)
    for events in tracks:
        track, before = mido.MidiTrack(), 0
        for tick, message in sorted(events, key=lambda event: event[0]):
            track.append(message.copy(time=tick - before))
            before = tick
        file.tracks.append(track)
    file.save(path)
    return path


def tempo(tick: int, micros: int) -> tuple[int, mido.MetaMessage]:
    return tick, mido.MetaMessage("set_tempo", tempo=micros)


def meter(tick: int, count: int, unit: int) -> tuple[int, mido.MetaMessage]:
    return tick, mido.MetaMessage("time_signature", numerator=count, denominator=unit)


def note(tick: int, number: int = 60, long: int = 60, hard: int = 90, channel: int = 0):
    """The two events of a note."""
    fields = {"note": number, "velocity": hard, "channel": channel}
    return [
        (tick, mido.Message("note_on", **fields)),
        (tick + long, mido.Message("note_off", **fields)),
    ]


def random_file(path: Path, seed: int, *, grid: int = 1) -> Path:
    """Notes on a grid of ticks, tempos anywhere, and meters on bar lines: x/4, x/8, x/16, x/2."""
    draw = random.Random(seed)
    tick, head = 0, []
    for number in range(draw.randrange(2, 6)):
        count, unit = draw.choice(METERS)
        if number or draw.random() < 0.7:  # without any, a file is in 4/4
            head.append(meter(tick, count, unit))
        else:
            count, unit = 4, 4
        tick += draw.randrange(1, 5) * count * 4 * TICKS // unit
    head += [tempo(draw.randrange(tick), draw.randrange(150_000, 3_000_000)) for _ in range(9)]
    if draw.random() < 0.5:
        head.append(tempo(0, draw.randrange(150_000, 3_000_000)))
    notes = [event for _ in range(40) for event in note(draw.randrange(0, tick + 2000, grid))]
    return save(path, head, notes)


def instants(path: Path) -> list[float]:
    """The instants [s] at which notes begin, as mido plays the file."""
    now, result = 0.0, []
    for message in mido.MidiFile(path):
        now += message.time
        if message.type == "note_on" and message.velocity:
            result.append(now)
    return sorted(result)
