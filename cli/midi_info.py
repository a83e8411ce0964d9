"""What `ergon info` says of a MIDI file."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ergon.common.terminal import printable

from .console import Console, plural
from .outcome import Refused
from .units import seconds_text

if TYPE_CHECKING:
    from ergon.scores.gesture.midi_survey import MidiSurvey, MidiTrack

_MICROSECONDS_PER_MINUTE = 60e6  # [us]
_CHANGES_MAX = 12  # tempos or meters in a line
_LINE_MAX = 2_000  # characters


def midi(console: Console, path: Path) -> None:
    """Say what a MIDI file holds, what of it a score can play, and what is passed over."""
    from ergon.scores.gesture.midi_survey import FOLLOWED_KINDS, survey, unused_contents
    from ergon.scores.gesture.take_file import TakeError

    try:
        midi_survey = survey(path)
    except TakeError as error:
        raise Refused(error.message) from None
    duration = midi_survey.seconds(midi_survey.length)
    tempos = [
        (quarter, _MICROSECONDS_PER_MINUTE / micros)
        for quarter, micros in midi_survey.tempos
        if micros
    ]
    meters = [(quarter, f"{count}/{2**power}") for quarter, count, power in midi_survey.meters]
    all_features = dict.fromkeys(("has_pedal", "has_tempo", "has_meter", "has_wheel"), True)
    left_out = [
        *unused_contents(
            midi_survey, **all_features, is_followed=lambda move: move.kind in FOLLOWED_KINDS
        )
    ]
    if n_unread_bytes := midi_survey.n_bytes_after + midi_survey.n_bytes_unread:
        left_out.append(plural(n_unread_bytes, "byte") + " after the end of tracks")
    if midi_survey.n_missing:
        left_out.append(
            plural(midi_survey.n_missing, "track") + " announced in the header but missing"
        )
    left_out += [
        f"{n} × {message_kind}" if n > 1 else message_kind
        for message_kind, n in sorted(midi_survey.odd_counts.items())
    ]
    understood = [*_understood_texts(midi_survey)]
    if console.json:
        console.record(
            "midi",
            file=str(path),
            format=midi_survey.format,
            ticks_per_quarter=midi_survey.ticks_per_quarter,
            duration_s=duration,
            quarters=midi_survey.length,
            tracks=[_track_fields(track) for track in midi_survey.tracks],
            tempos=[{"quarter": quarter, "bpm": bpm} for quarter, bpm in tempos],
            meters=[{"quarter": quarter, "meter": meter} for quarter, meter in meters],
            understood=understood,
            passed_over=left_out,
        )
        return
    lines = [
        f"{path}: MIDI file of format {midi_survey.format}, {seconds_text(duration)} "
        f"({midi_survey.length:g} quarters of {plural(midi_survey.ticks_per_quarter, 'tick')}), "
        f"{plural(len(midi_survey.tracks), 'track')}"
    ]
    for number, track in enumerate(midi_survey.tracks, 1):
        name = f" {track.name}" if track.name else ""
        lines.append(f"  track {number}{name}: {_notes_text(track)}")
    tempo_texts = [(quarter, f"{bpm:.6g} bpm") for quarter, bpm in tempos]
    lines.append(f"  tempo: {changes(tempo_texts, '120 bpm, for the file says none')}")
    lines.append(f"  meter: {changes(meters, '4/4, for the file says none')}")
    lines.append(f"  understood: {', '.join(understood) or 'nothing'}")
    lines.append(f"  passed over: {', '.join(left_out) or 'nothing'}")
    console.data("\n".join(printable(line[:_LINE_MAX]) for line in lines) + "\n")


def _track_fields(track: MidiTrack) -> dict[str, object]:
    channels = [
        {"channel": channel, "notes": notes.count, "low": notes.low, "high": notes.high}
        for channel, notes in sorted(track.counts_by_channel.items())
    ]
    return {"name": track.name, "channels": channels}


def _notes_text(track: MidiTrack) -> str:
    from ergon.notation.tables.notes import name

    channel_texts = [
        f"channel {channel}: {plural(notes.count, 'note')}, "
        + (
            f"{name(notes.low)} to {name(notes.high)}"
            if notes.low < notes.high
            else name(notes.low)
        )
        for channel, notes in sorted(track.counts_by_channel.items())
    ]
    return "; ".join(channel_texts) or "no notes"


def _understood_texts(file: MidiSurvey) -> Iterator[str]:
    """What a score can play of a file, or take over."""
    from ergon.scores.gesture.midi_bytes import CONTROLLER
    from ergon.scores.gesture.midi_file import SUSTAIN
    from ergon.scores.gesture.midi_survey import FOLLOWED_KINDS, NOUNS

    if count := sum(file.notes.values()):
        yield plural(count, "note")
    counts: Counter[str] = Counter()
    for move, count in file.moves.items():
        is_pedal = move.kind == CONTROLLER and move.number == SUSTAIN
        counts["pedal value" if is_pedal else NOUNS[move.kind][0]] += count
    for noun in ("pedal value", *(NOUNS[kind][0] for kind in FOLLOWED_KINDS)):
        if counts[noun]:
            yield plural(counts[noun], noun)
    if file.n_tempos:
        yield plural(file.n_tempos, "tempo")
    if file.n_meters:
        yield plural(file.n_meters, "meter")


def changes(changes: Sequence[tuple[float, str]], empty_text: str) -> str:
    """What holds from where on, counted in quarter notes."""
    if not changes:
        return empty_text
    if len(changes) == 1 and not changes[0][0]:
        return changes[0][1]
    words = [f"{value} at {quarter:g}" for quarter, value in changes[:_CHANGES_MAX]]
    if n_unlisted := len(changes) - len(words):
        words.append(f"and {n_unlisted:,} more")
    return f"{', '.join(words)} (in quarter notes)"
