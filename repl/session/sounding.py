"""What sounds in a session, by where it is written: an editor lights these places."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ergon.notation.clock.meter import SAME
from ergon.repl.session.played_versions import PlayedVersions
from ergon.repl.session_protocol import Sounding, SoundingPlace
from ergon.scores.pattern.search import n_before

if TYPE_CHECKING:
    from ergon.notation.text.values import Place
    from ergon.repl.session.running import RunningVersion
    from ergon.repl.session.schedule import Schedule
    from ergon.scores.edits.texts import Texts
    from ergon.scores.reading.piece import Piece, Strikes

_WINDOW_SECONDS = 4.0  # [s] for which places are computed together
_PLACES_MAX = 1000  # places in one answer; those beyond are left out


@dataclass(frozen=True, slots=True)
class _BegunSound:
    """A gesture or strike that has begun [s of the engine]: its start, its end, its place in the
    score, and its name.
    """

    start: float
    end: float
    place: Place
    name: str


class SoundingPlaces:
    """The places of what begins in a session, from now on, for one who looks again and again."""

    def __init__(self, schedule: Schedule) -> None:
        """Begin at the present frame."""
        self._schedule = schedule
        self._played_versions = PlayedVersions(schedule)
        list(self._played_versions.pop_before(schedule.engine.frame))
        self._running: RunningVersion | None = None
        self._window_start = self._window_end = 0.0
        self._window_sounds: list[_BegunSound] = []

    def __call__(self) -> Sounding:
        """What has begun since the last call, in order of time."""
        engine_frame, sounding_places = self._schedule.engine.frame, []
        for running, first_frame, stop_frame in self._played_versions.pop_before(engine_frame):
            rate, texts = running.stage.rate, running.version.texts
            for begun_sound in self._begun_between(running, first_frame / rate, stop_frame / rate):
                sounding_places.append(_shown_place(begun_sound, texts))
        return Sounding(engine_frame / self._schedule.rate, tuple(sounding_places[:_PLACES_MAX]))

    def _begun_between(
        self, running: RunningVersion, since_instant: float, before_instant: float
    ) -> Iterator[_BegunSound]:
        """What begins in a version between two instants [s]."""
        if running.clock.begin_instant is None:
            return
        if (
            running is not self._running
            or not self._window_start <= since_instant <= before_instant <= self._window_end
        ):
            self._running, self._window_start = running, since_instant
            self._window_end = max(before_instant, since_instant + _WINDOW_SECONDS)
            self._window_sounds = sorted(
                _begun_sounds(running, since_instant, self._window_end),
                key=lambda begun_sound: begun_sound.start,
            )
        yield from (
            begun_sound
            for begun_sound in self._window_sounds
            if since_instant <= begun_sound.start < before_instant
        )


def _shown_place(begun_sound: _BegunSound, score_texts: Texts) -> SoundingPlace:
    """A place with the characters that stand there in the session's text, which may differ from
    the file.
    """
    place = begun_sound.place
    shown_text = (
        score_texts.text
        if place.file == score_texts.path
        else score_texts.overlay.get(place.file, "")
    )
    lines = shown_text.splitlines()
    line = lines[place.line - 1] if place.line <= len(lines) else ""
    marked_text = line[place.column - 1 : place.column - 1 + place.length]
    file = str(Path(place.file).absolute())
    return SoundingPlace(
        file,
        place.line,
        place.column,
        marked_text,
        begun_sound.start,
        begun_sound.end,
        begun_sound.name,
    )


def _begun_sounds(
    running: RunningVersion, since_instant: float, before_instant: float
) -> Iterator[_BegunSound]:
    for gesture in running.stage.gestures:
        if since_instant <= gesture.written_start < before_instant:
            yield _BegunSound(gesture.written_start, gesture.stop, gesture.place, gesture.name)
    piece = running.stage.piece
    first_beat, last_beat = (
        piece.tempo_map.beats(instant) for instant in (since_instant, before_instant)
    )
    for strikes in piece.strikes:
        yield from _strikes_between(piece, strikes, first_beat - SAME, last_beat + SAME)


def _strikes_between(
    piece: Piece, strikes: Strikes, first_beat: float, last_beat: float
) -> Iterator[_BegunSound]:
    """What strikes begin between two beats."""
    tempo_map = piece.tempo_map

    def begun_stroke(
        beat: float, end_beat: float, sound_name: str, place: Place = strikes.place
    ) -> _BegunSound:
        return _BegunSound(
            tempo_map.seconds(beat), tempo_map.seconds(max(beat, end_beat)), place, sound_name
        )

    if strikes.is_melody:
        for stroke_beat, _, hit in strikes.played_hits(piece, first_beat, last_beat):
            if first_beat <= stroke_beat < last_beat:
                stroke_end = (
                    stroke_beat
                    if hit.duration is None
                    else tempo_map.after(stroke_beat, hit.duration)
                )
                yield begun_stroke(stroke_beat, stroke_end, hit.struck_text, hit.place)
    elif strikes.passing is not None:
        assert strikes.length is not None
        for stroke_beat in strikes.rounds(tempo_map):
            if first_beat <= stroke_beat < last_beat:
                yield begun_stroke(
                    stroke_beat, tempo_map.after(stroke_beat, strikes.length), strikes.name
                )
    elif strikes.pattern is not None:
        pattern_steps = strikes.place_beats(piece)
        for step_index in range(
            n_before(pattern_steps, first_beat), n_before(pattern_steps, last_beat)
        ):
            note_word = pattern_steps.places.name_in_place(step_index)
            if note_word is not None:
                stroke_end = (
                    pattern_steps[step_index + 1]
                    if step_index + 1 < len(pattern_steps)
                    else pattern_steps[step_index]
                )
                yield begun_stroke(
                    pattern_steps[step_index],
                    stroke_end,
                    note_word if strikes.voices else strikes.name,
                )
    elif strikes.rate is not None:
        stroke_beat, stop_beat = tempo_map.resolve(strikes.at), strikes.stop_beat(tempo_map)
        if first_beat <= stroke_beat < last_beat:
            yield begun_stroke(
                stroke_beat, stroke_beat if stop_beat is None else stop_beat, strikes.name
            )
    else:
        beats = strikes.beats(tempo_map)
        for step_index in range(n_before(beats, first_beat), n_before(beats, last_beat)):
            yield begun_stroke(beats[step_index], -math.inf, strikes.name)
