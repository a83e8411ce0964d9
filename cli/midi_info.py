"""What `ergon info` says of a MIDI file."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ergon.common.terminal import printable

from .console import Console, plural
from .outcome import Refused
from .units import seconds

if TYPE_CHECKING:
    from ergon.scores.gesture.midi_survey import MidiSurvey, MidiTrack

_MINUTE = 60e6  # [us]
_CHANGES_MAX = 12  # tempos or meters in a line
_LINE_MAX = 2_000  # characters


def midi(console: Console, path: Path) -> None:
    """Say what a MIDI file holds, what of it a score can play, and what is passed over."""
    from ergon.scores.gesture.midi_survey import FOLLOWED, passed_over, survey
    from ergon.scores.gesture.take_file import TakeError

    try:
        midi_survey = survey(path)
    except TakeError as error:
        raise Refused(error.message) from None
    duration = midi_survey.seconds(midi_survey.length)
    tempos = [(quarter, _MINUTE / micros) for quarter, micros in midi_survey.tempos if micros]
    meters = [(quarter, f"{count}/{2**power}") for quarter, count, power in midi_survey.meters]
    everything = dict.fromkeys(("has_pedal", "has_tempo", "has_meter", "has_wheel"), True)
    left_out = [*passed_over(midi_survey, **everything, follows=lambda move: move.kind in FOLLOWED)]
    if n_unread_bytes := midi_survey.n_bytes_after + midi_survey.n_bytes_unread:
        left_out.append(plural(n_unread_bytes, "byte") + " after the end of tracks")
    if midi_survey.n_missing:
        left_out.append(
            plural(midi_survey.n_missing, "track") + " that the head states, and that lack"
        )
    played = [*_understood(midi_survey)]
    if console.json:
        console.record(
            "midi",
            file=str(path),
            format=midi_survey.format,
            ticks_per_quarter=midi_survey.ticks,
            duration_s=duration,
            quarters=midi_survey.length,
            tracks=[_fields(track) for track in midi_survey.tracks],
            tempos=[{"quarter": quarter, "bpm": bpm} for quarter, bpm in tempos],
            meters=[{"quarter": quarter, "meter": meter} for quarter, meter in meters],
            understood=played,
            passed_over=left_out,
        )
        return
    info_lines = [
        f"{path}: MIDI file of format {midi_survey.format}, {seconds(duration)} "
        f"({midi_survey.length:g} quarters of {plural(midi_survey.ticks, 'tick')}), "
        f"{plural(len(midi_survey.tracks), 'track')}"
    ]
    for number, track in enumerate(midi_survey.tracks, 1):
        name = f" {track.name}" if track.name else ""
        info_lines.append(f"  track {number}{name}: {_notes(track)}")
    words = [(quarter, f"{bpm:.6g} bpm") for quarter, bpm in tempos]
    info_lines.append(f"  tempo: {changes(words, '120 bpm, for the file says none')}")
    info_lines.append(f"  meter: {changes(meters, '4/4, for the file says none')}")
    info_lines.append(f"  understood: {', '.join(played) or 'nothing'}")
    info_lines.append(f"  passed over: {', '.join(left_out) or 'nothing'}")
    console.data("\n".join(printable(line[:_LINE_MAX]) for line in info_lines) + "\n")


def _fields(track: MidiTrack) -> dict[str, object]:
    channels = [
        {"channel": channel, "notes": notes.count, "low": notes.low, "high": notes.high}
        for channel, notes in sorted(track.notes.items())
    ]
    return {"name": track.name, "channels": channels}


def _notes(track: MidiTrack) -> str:
    from ergon.notation.tables.notes import name

    note_words = [
        f"channel {channel}: {plural(notes.count, 'note')}, "
        + (
            f"{name(notes.low)} to {name(notes.high)}"
            if notes.low < notes.high
            else name(notes.low)
        )
        for channel, notes in sorted(track.notes.items())
    ]
    return "; ".join(note_words) or "no notes"


def _understood(midi_survey: MidiSurvey) -> Iterator[str]:
    """What a score can play of a file, or take over."""
    from ergon.scores.gesture.midi_bytes import CONTROLLER
    from ergon.scores.gesture.midi_file import SUSTAIN
    from ergon.scores.gesture.midi_survey import FOLLOWED, NOUNS

    if event_count := sum(midi_survey.notes.values()):
        yield plural(event_count, "note")
    control_counts: Counter[str] = Counter()
    for move, event_count in midi_survey.moves.items():
        is_pedal = move.kind == CONTROLLER and move.number == SUSTAIN
        control_counts["pedal value" if is_pedal else NOUNS[move.kind][0]] += event_count
    for noun in ("pedal value", *(NOUNS[kind][0] for kind in FOLLOWED)):
        if control_counts[noun]:
            yield plural(control_counts[noun], noun)
    if midi_survey.n_tempos:
        yield plural(midi_survey.n_tempos, "tempo")
    if midi_survey.n_meters:
        yield plural(midi_survey.n_meters, "meter")


def changes(value_changes: Sequence[tuple[float, str]], empty_text: str) -> str:
    """What holds from where on, counted in quarter notes."""
    if not value_changes:
        return empty_text
    if len(value_changes) == 1 and not value_changes[0][0]:
        return value_changes[0][1]
    change_words = [f"{value} at {quarter:g}" for quarter, value in value_changes[:_CHANGES_MAX]]
    if n_unlisted := len(value_changes) - len(change_words):
        change_words.append(f"and {n_unlisted:,} more")
    return f"{', '.join(change_words)} (in quarter notes)"
