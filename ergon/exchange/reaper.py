"""A piece as a project of REAPER: its tempo, meters and marks, and sound files on tracks.

A project is text: a line is a word and its values, `<NAME …` begins a block and `>` ends it.
Meaning of the values: Cockos, "ReaScript API" (SetTempoTimeSigMarker, AddProjectMarker2,
GetSetMediaItemInfo), and projects that REAPER saved. The same piece gives the same text.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from .midi import Marker, Meter, Ruler, tempo_steps

_SQUARE_SHAPE = 1  # a tempo that stays up to the next one
_SETS_METER_FLAG = 1  # flag of a point that sets both tempo and meter
_QUOTES = "\"'`"


@dataclass(frozen=True, slots=True)
class SoundTrack:
    """A track with a sound file that begins with the piece; `file` is relative to the project."""

    name: str
    file: str
    is_muted: bool = False


@dataclass(frozen=True, slots=True)
class SoundFormat:
    """What all sound files of a project have: length [s], rate [Hz], channels."""

    length: float
    rate: int
    n_channels: int


def project_text(
    seconds_at: Callable[[float], float],
    length_beats: float,
    meters: Sequence[Meter],
    marks: Sequence[Marker],
    piece_title: str,
    tracks: Sequence[SoundTrack],
    sound_format: SoundFormat,
) -> str:
    """The text of a project.

    `seconds_at(beat)` [s] is the piece's tempo map, written up to beat `length_beats` in the steps
    of a MIDI file. Raises ValueError if a tempo or a meter cannot be written so.
    """
    tempo_points = _tempo_points(seconds_at, length_beats, Ruler(meters))
    _, bpm, (n_beats, beat_unit) = tempo_points[0]
    n_channels = max(
        2, sound_format.n_channels + sound_format.n_channels % 2
    )  # REAPER has them in pairs
    project_lines = [
        '<REAPER_PROJECT 0.1 "6.0" 0',
        "  <NOTES 0 0",
        "    |made by ergon",
        f"    |{_printable_text(piece_title)}",
        "  >",
        f"  SAMPLERATE {sound_format.rate} 1 0",
        f"  TEMPO {bpm:.10f} {n_beats} {beat_unit}",
        f"  MASTER_NCH {n_channels} 2",
        "  <TEMPOENVEX",
        "    ACT 1 -1",
        "    VIS 1 0 1",
        "    ARM 0",
        f"    DEFSHAPE {_SQUARE_SHAPE} -1 -1",
    ]
    meter_before = None
    for seconds, bpm, meter in tempo_points:
        tempo_line = f"    PT {seconds:.12f} {bpm:.10f} {_SQUARE_SHAPE}"
        if meter != meter_before:
            tempo_line += f" {meter[1] << 16 | meter[0]} 0 {_SETS_METER_FLAG}"
        project_lines.append(tempo_line)
        meter_before = meter
    project_lines.append("  >")
    for number, mark in enumerate(marks, 1):
        project_lines.append(
            f"  MARKER {number} {seconds_at(mark.beat):.12f} {_quoted_value(mark.name)} 0"
        )
    for track in tracks:
        project_lines += _track_block(track, sound_format, n_channels)
    return "\n".join([*project_lines, ">", ""])


def _tempo_points(
    seconds_at: Callable[[float], float], length_beats: float, ruler: Ruler
) -> list[tuple[float, float, tuple[int, int]]]:
    """Seconds, quarter notes a minute, and the meter at each change of one of them."""
    tempos = dict(tempo_steps(seconds_at, length_beats, ruler))
    meters = {meter.beat: (meter.n_beats, meter.unit) for meter in ruler.meters}
    tempo_points = []
    micros, meter = tempos[0.0], meters[0.0]
    for beat in sorted({*tempos, *meters}):
        micros, meter = tempos.get(beat, micros), meters.get(beat, meter)
        tempo_points.append((seconds_at(beat), 60e6 / micros, meter))
    return tempo_points


def _track_block(track: SoundTrack, sound_format: SoundFormat, n_channels: int) -> list[str]:
    """The block of a track, whose only item is the whole file."""
    source_kind = "FLAC" if track.file.lower().endswith(".flac") else "WAVE"
    return [
        "  <TRACK",
        f"    NAME {_quoted_value(track.name)}",
        "    VOLPAN 1 0 -1 -1 1",
        f"    MUTESOLO {int(track.is_muted)} 0 0",
        f"    NCHAN {n_channels}",
        "    MAINSEND 1 0",
        "    <ITEM",
        "      POSITION 0",
        f"      LENGTH {sound_format.length:.12f}",
        "      LOOP 0",
        f"      NAME {_quoted_value(track.name)}",
        "      SOFFS 0",
        f"      <SOURCE {source_kind}",
        f"        FILE {_quoted_value(track.file)}",
        "      >",
        "    >",
        "  >",
    ]


def _quoted_value(quoted_text: str) -> str:
    """A text as a value: within the first kind of quote that it does not hold."""
    quoted_text = _printable_text(quoted_text)
    quote = next((candidate for candidate in _QUOTES if candidate not in quoted_text), None)
    if quote is None:
        quote, quoted_text = "`", quoted_text.replace("`", "'")
    return f"{quote}{quoted_text}{quote}"


def _printable_text(text: str) -> str:
    return "".join(c if c.isprintable() else " " for c in text)
