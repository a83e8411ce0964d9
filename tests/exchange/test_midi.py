"""The tempo map as MIDI, read back by mido and integrated independently."""

import io
import math

import mido
import pytest

from ergon.exchange.midi import TICKS_PER_QUARTER, Marker, Meter, tempo_file


def ramp(bpm_1: float, bpm_2: float, start: float, beats: float):
    """Closed form of a tempo that is linear in BPM over beats: t = 60 db ln(b1/b0)/(b1-b0)."""

    def seconds(beat: float) -> float:
        t = 60 * min(beat, start) / bpm_1
        inside = min(max(beat - start, 0), beats)
        slope = (bpm_2 - bpm_1) / beats
        t += 60 / slope * math.log1p(slope * inside / bpm_1)
        return t + 60 * max(beat - start - beats, 0) / bpm_2

    return seconds


def read(data: bytes) -> mido.MidiFile:
    return mido.MidiFile(file=io.BytesIO(data))


def seconds_by_tick(file: mido.MidiFile) -> dict[int, float]:
    tick, now, tempo, result = 0, 0.0, 500_000, {}
    for message in file.tracks[0]:
        tick += message.time
        now += message.time / TICKS_PER_QUARTER * tempo * 1e-6
        result[tick] = now
        if message.type == "set_tempo":
            tempo = message.tempo
    return result


@pytest.mark.parametrize("bpms", [(60, 96), (132.5, 47), (71, 73)])
def test_tempo_file_times_by_closed_form(bpms: tuple[float, float]) -> None:
    seconds = ramp(*bpms, start=32, beats=16)
    data = tempo_file(seconds, 200, [Meter(0, 4, 4)], [Marker("C", 32), Marker("end", 200)], "t")
    file = read(data)
    assert file.type == 1
    assert file.ticks_per_beat == TICKS_PER_QUARTER
    for tick, now in seconds_by_tick(file).items():
        assert now == pytest.approx(seconds(tick / TICKS_PER_QUARTER), abs=4e-6)


def test_steady_tempo_is_one_event() -> None:
    file = read(tempo_file(lambda beat: beat, 400, [], [], "t"))
    assert [m.tempo for m in file.tracks[0] if m.type == "set_tempo"] == [1_000_000]


def test_rounded_midi_tempo_does_not_drift() -> None:
    seconds = lambda beat: beat * 60 / 70  # noqa: E731
    file = read(tempo_file(seconds, 4000, [], [Marker("far", 4000)], "t"))
    assert seconds_by_tick(file)[4000 * TICKS_PER_QUARTER] == pytest.approx(seconds(4000), abs=4e-6)
    assert sum(m.type == "set_tempo" for m in file.tracks[0]) < 500


def test_tempo_file_meters_and_markers() -> None:
    meters = [Meter(0, 4, 4), Meter(8, 7, 8), Meter(22, 3, 2)]
    marks = [Marker("A", 0), Marker("Überraschung", 8), Marker("C", 25)]
    file = read(tempo_file(lambda beat: beat / 2, 30, meters, marks, "Duet"))
    tick, result = 0, []
    for message in file.tracks[0]:
        tick += message.time
        if message.type == "time_signature":
            result.append((tick, message.numerator, message.denominator))
        elif message.type == "marker":
            # mido decodes text as latin-1
            result.append((tick, message.text.encode("latin-1").decode()))
    assert result == [
        (0, 4, 4),
        (0, "A"),
        (8 * TICKS_PER_QUARTER, 7, 8),
        (8 * TICKS_PER_QUARTER, "Überraschung"),
        (15 * TICKS_PER_QUARTER, 3, 2),  # 14 eighths are 7 quarters
        (21 * TICKS_PER_QUARTER, "C"),  # and three halves more are 6
    ]
    assert file.tracks[0].name == "Duet"


def test_unsupported_meter_and_tempo_are_refused() -> None:
    with pytest.raises(ValueError, match="meter 4/5"):
        tempo_file(lambda beat: beat, 4, [Meter(0, 4, 5)], [], "t")
    with pytest.raises(ValueError, match="tempo at beat 0: a quarter note lasts 60 s"):
        tempo_file(lambda beat: beat * 60, 4, [], [], "t")


def test_tempo_file_bytes_are_reproducible() -> None:
    seconds = ramp(60, 96, 4, 8)
    item, two = (tempo_file(seconds, 40, [], [Marker("A", 3)], "t") for _ in range(2))
    assert item == two
    assert b"made by ergon" in item[:1024]
