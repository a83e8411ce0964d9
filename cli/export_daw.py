"""`ergon export` for a workstation: tempo map, marks, sound, and a project that lines them up."""

from __future__ import annotations

from collections.abc import Callable
from itertools import cycle
from math import log2
from pathlib import Path
from typing import TYPE_CHECKING

from ergon.api import score

from .console import Console
from .summary import print_finer_steps, print_rendered

if TYPE_CHECKING:
    from ergon.api.options import FileOptions
    from ergon.api.render import Completed
    from ergon.exchange.midi import Marker, Meter, NoteTrack
    from ergon.scores.reading.piece import Piece
    from ergon.scores.staging.stage import Stage

_DRUM_CHANNEL, _FIRST_DRUM_KEY = 9, 36  # channel from 0, and key of the first one
_PITCHED_CHANNELS = [channel for channel in range(16) if channel != _DRUM_CHANNEL]
_SOUND_CHANNELS_MAX = 1024
_TEMPO_AFTER_END_MAX = 3600.0  # [s] of the tempo map that are written beyond the end of a piece


def export_daw(
    console: Console,
    score_path: str,
    output_folder: Path,
    file_options: FileOptions,
    *,
    is_rendered: bool,
) -> None:
    """Write `tempo.mid`, `marks.csv` and, if it `is_rendered`, `mix.wav`, `stems/` and
    `project.rpp`.
    """
    from ergon.api.render import prepare, write
    from ergon.exchange.markers import markers_csv
    from ergon.exchange.midi import tempo_file
    from ergon.exchange.safe import check_target, file_group

    loaded = score.read(score_path, file_options, console)
    prepared = (
        prepare(loaded, str(output_folder / "mix.wav"), file_options, console)
        if is_rendered
        else None
    )
    stage = (prepared or score.stage_piece(loaded, None, console)).stage
    piece, end_seconds = stage.piece, stage.n_analysed_frames / stage.rate
    tempo_path, marks_path = output_folder / "tempo.mid", output_folder / "marks.csv"
    project_path = output_folder / "project.rpp"
    paths = [tempo_path, marks_path, *([project_path] if is_rendered else [])]
    for path in paths:
        check_target(path, force=file_options.force, inputs=loaded.inputs)
    marks = [
        (name, score.where(piece, instant), instant) for name, instant in score.mark_instants(piece)
    ]
    clock = _clock(piece, end_seconds)
    bytes_by_path = {marks_path: markers_csv(marks).encode()}
    try:
        midi_bytes = tempo_file(*clock, piece.title, _note_tracks(stage))
        bytes_by_path = {tempo_path: midi_bytes, **bytes_by_path}
    except ValueError as error:
        left_out = " and ".join(str(path) for path in paths if path != marks_path)
        verb = "are" if is_rendered else "is"
        console.warn(f"{error}; {left_out} {verb} left out, and the other files are written")
    completed = None
    # The small files are written before the sound and renamed after it, so that either all files or
    # none appear.
    with file_group(force=file_options.force, inputs=loaded.inputs) as small_files:
        for path, file_bytes in bytes_by_path.items():
            small_files.write(path, file_bytes)
        project_file = None
        if prepared is not None and tempo_path in bytes_by_path:
            # The project needs the stems and the length, which are known only after the sound. Its
            # disk space is reserved before.
            project_file = small_files.open(project_path, binary=True)
            project_file.write(b" " * _project_bytes_max(clock, stage))
            project_file.flush()
        if prepared is not None:
            completed = write(prepared, console)
        if project_file is not None and completed is not None:
            bytes_by_path[project_path] = _project_bytes(
                clock, piece.title, completed, output_folder
            )
            project_file.seek(0)
            project_file.write(bytes_by_path[project_path])
            project_file.truncate()
    for path in bytes_by_path:
        console.wrote(path)
    if completed is not None:
        print_rendered(console, completed)
        print_finer_steps(console, completed.reports)


def _clock(
    piece: Piece, end_seconds: float
) -> tuple[Callable[[float], float], float, list[Meter], list[Marker]]:
    """Tempo, meters and marks of a piece, up to `end_seconds` [s], or up to the last change of
    tempo within an hour after that.
    """
    from ergon.exchange.midi import Marker, Meter

    tempo_map = piece.tempo_map
    ramp_ends = [
        tempo_map.after(beat, entry.over) for beat, entry in tempo_map.entries_by_beat if entry.over
    ]
    last_beat = max(
        [tempo_map.beats(end_seconds), *ramp_ends, *(beat for beat, _ in tempo_map.entries_by_beat)]
    )
    length_beats = min(
        last_beat, tempo_map.beats(end_seconds + _TEMPO_AFTER_END_MAX)
    )  # a ramp may last for years
    meters = [Meter(beat, meter.beats, meter.unit) for beat, _, meter in tempo_map.bars.changes()]
    marks = [Marker(name, beats) for name, beats in score.marks_of(piece)]
    return tempo_map.seconds, length_beats, meters, marks


def _project_bytes(
    clock: tuple[Callable[[float], float], float, list[Meter], list[Marker]],
    piece_title: str,
    completed: Completed,
    output_folder: Path,
) -> bytes:
    """The project of REAPER: a track for each stem, and the mix, which is muted."""
    from ergon.exchange.reaper import SoundFormat, SoundTrack, project_text

    wave_format = completed.job.format
    tracks = [
        SoundTrack(path.stem.partition("_")[2], path.relative_to(output_folder).as_posix())
        for path in (Path(stem.path) for stem in completed.files.stems)
    ]
    mix = SoundTrack("mix", Path(completed.files.mix.path).name, is_muted=bool(tracks))
    sound_format = SoundFormat(
        completed.files.n_frames / wave_format.rate, wave_format.rate, wave_format.n_channels
    )
    return project_text(*clock, piece_title, [*tracks, mix], sound_format).encode()


def _project_bytes_max(
    clock: tuple[Callable[[float], float], float, list[Meter], list[Marker]], stage: Stage
) -> int:
    """Bytes that the project takes at most: two stems of each instrument, and the mix."""
    from ergon.exchange.reaper import SoundFormat, SoundTrack, project_text

    names = [name for part in stage.piece.instruments for name in (f"{part}-dry", f"{part}-wet")]
    tracks = [SoundTrack(name, f"stems/0000_{name}.flac") for name in [*names, "mix"]]
    sound_format = SoundFormat(
        stage.n_analysed_frames / stage.rate, int(stage.rate), _SOUND_CHANNELS_MAX
    )
    return len(project_text(*clock, stage.piece.title, tracks, sound_format).encode())


def _note_tracks(stage: Stage) -> list[NoteTrack]:
    """A track for each instrument that is struck, at the nearest keys; those without a pitch share
    the channel of drums, each at a key of its own.
    """
    from ergon.exchange.midi import Note, NoteTrack
    from ergon.scores.staging.struck_notes import struck_notes

    tempo_map = stage.piece.tempo_map
    notes_by_instrument: dict[str, list[Note]] = {}
    drum_keys: dict[str, int] = {}  # MIDI key of each instrument without a pitch
    for struck_note in struck_notes(stage):
        if struck_note.pitch is None:
            midi_key = drum_keys.setdefault(
                struck_note.instrument, _FIRST_DRUM_KEY + len(drum_keys)
            )
        else:
            midi_key = round(69.0 + 12.0 * log2(struck_note.pitch / 440.0))
        notes_by_instrument.setdefault(struck_note.instrument, []).append(
            Note(
                tempo_map.beats(struck_note.begin),
                tempo_map.beats(struck_note.end),
                min(127, max(0, midi_key)),
                max(1, round(127.0 * struck_note.strength)),
            )
        )
    channels = cycle(_PITCHED_CHANNELS)
    return [
        NoteTrack(name, _DRUM_CHANNEL if name in drum_keys else next(channels), part_notes)
        for name, part_notes in notes_by_instrument.items()
    ]
