"""Which MIDI files a score uses and what for; what nothing uses is reported, once for each file."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

from ergon.notation.tables.fields import Values
from ergon.notation.text.errors import Collector
from ergon.notation.text.files import Files
from ergon.notation.text.values import Place
from ergon.scores.gesture.midi_course import Course, read_course
from ergon.scores.gesture.midi_file import channel_number
from ergon.scores.gesture.midi_source import MidiSource
from ergon.scores.gesture.midi_survey import MidiMove, MidiSurvey, plural, survey, unused_contents
from ergon.scores.gesture.musicxml_file import read_score
from ergon.scores.gesture.note_files import is_musicxml
from ergon.scores.gesture.take_file import TakeError

_Times = TypeVar("_Times")
_WHEN_UNUSED = (
    "nothing is wrong if the score does without them; `tempo: {from: FILE}`, `meter: {from: "
    "FILE}`, `bend` of the take, automation with `by` and acts called `press` use such events"
)


@dataclass(slots=True)
class _FileUse:
    """A file: where a score names it first, and what it is used for."""

    name: str
    place: Place
    played_channels: set[int | None] = field(
        default_factory=set
    )  # channels that are played; None: all
    has_lengths: bool = False  # the pedal counts
    has_wheel: bool = False
    has_pressure: bool = False
    has_tempo: bool = False
    has_meter: bool = False
    followed_sources: set[tuple[int | None, MidiSource]] = field(
        default_factory=set
    )  # channel, what

    def follows(self, midi_move: MidiMove) -> bool:
        """Whether automation follows an event."""
        return any(
            channel in (None, midi_move.channel)
            and source.kind == midi_move.kind
            and (not source.numbers or midi_move.number in source.numbers)
            for channel, source in self.followed_sources
        )


class MidiUses:
    """The MIDI files of a score and of those that it includes."""

    def __init__(self, files: Files) -> None:
        """Start with none."""
        self._files = files
        self._uses: dict[Path, _FileUse] = {}

    @property
    def paths(self) -> tuple[Path, ...]:
        """Every file that is used."""
        return tuple(self._uses)

    def register_played(self, take: Values, *, has_lengths: bool) -> None:
        """Note that strikes, or a hand (then notes have no lengths), play a take."""
        path = self._files.find(take["file"], take.nodes["file"].document.folder, is_text=False)
        if path is None:
            return
        try:
            channel = None if is_musicxml(path) else channel_number(path, take["channel"])
        except TakeError:  # whoever reads the notes reports it
            return
        use = self._use(path, take["file"], take.place_of("file"))
        use.played_channels.add(channel)
        use.has_lengths |= has_lengths
        use.has_wheel |= has_lengths and take["bend"] is not None

    def register_pressures(self, take: Values) -> None:
        """Note that strikes which play a take play its pressures too."""
        path = self._files.find(take["file"], take.nodes["file"].document.folder, is_text=False)
        if path in self._uses:
            self._uses[path].has_pressure = True

    def read_times(
        self, values: Values, read: Callable[[Path], _Times], *, is_tempo: bool
    ) -> _Times | None:
        """The tempos or the meters of the file that `from` names, as `read` makes them; None if an
        error was reported.
        """
        file_name = values["from"]
        if file_name is None:
            return None
        source_label, folder = (
            f"{values.context.label('from')}: ",
            values.nodes["from"].document.folder,
        )
        path = self._files.locate(
            file_name, folder, values.place_of("from"), source_label, is_text=False
        )
        if path is None:
            return None
        use = self._use(path, file_name, values.place_of("from"))
        use.has_tempo |= is_tempo
        use.has_meter |= not is_tempo
        try:
            return read(path)
        except TakeError as error:
            values.error("E310", f"{source_label}{error.message}", "from")
        return None

    def followed_course(self, values: Values) -> Course:
        """The course of a MIDI source that automation follows; empty if an error was reported."""
        file_name, channel_name, source_text = values["from"], values["channel"], values["by"]
        automation_label, folder = "automation: ", values.nodes["from"].document.folder
        path = self._files.locate(
            file_name, folder, values.place_of("from"), automation_label, is_text=False
        )
        if path is None:
            return ()
        use = self._use(path, file_name, values.place_of("from"))
        use.followed_sources.add((channel_name, source_text))
        try:
            return read_course(path, channel_name, source_text)
        except TakeError as error:
            values.error(
                "E310",
                f"{automation_label}{error.message}",
                "by" if error.field == "by" else "from",
            )
        return ()

    def _use(self, path: Path, name: str, place: Place) -> _FileUse:
        return self._uses.setdefault(path, _FileUse(name, place))

    def report(self, collector: Collector) -> None:
        """Report what is passed over in each file (N404), and bytes after its tracks (W335)."""
        for path, use in self._uses.items():
            if is_musicxml(path):
                _report_musicxml(path, use, collector)
                continue
            try:
                midi_survey = survey(path)
            except TakeError:  # whoever reads the file reports it
                continue
            _report_unused([*_unused_contents(midi_survey, use)], use, collector)
            if n_unread_bytes := midi_survey.n_bytes_after + midi_survey.n_bytes_unread:
                location = "its last track" if midi_survey.n_bytes_after else "the end of a track"
                message = (
                    f"{use.name}: {plural(n_unread_bytes, ('byte', 'bytes'))} after {location} "
                )
                message += f"{'is' if n_unread_bytes == 1 else 'are'} not read"
                collector.error("W335", message, use.place)
            if midi_survey.n_missing:
                tracks_text = plural(midi_survey.n_missing, ("track", "tracks"))
                verb = "is" if midi_survey.n_missing == 1 else "are"
                message = f"{use.name}: {tracks_text} that its head states {verb} missing"
                collector.error("W335", message, use.place)


def _report_unused(unused_texts: Sequence[str], use: _FileUse, collector: Collector) -> None:
    """Report what is passed over in a file, as counts in words."""
    if not unused_texts:
        return
    *words_before, last_word = unused_texts
    unused_list = f"{', '.join(words_before)} and {last_word}" if words_before else last_word
    message = f"{use.name}: the score does not use {unused_list} of this file"
    collector.error("N404", message, use.place, help=_WHEN_UNUSED)


def _report_musicxml(path: Path, use: _FileUse, collector: Collector) -> None:
    try:
        score = read_score(path)
    except TakeError:  # whoever reads the file reports it
        return
    counts = {**score.skipped_counts}
    if not use.has_tempo:
        counts["tempo"] = len(score.tempos)
    if not use.has_meter:
        counts["meter"] = len(score.meters) + counts.get("meter", 0)
    _report_unused(
        [plural(n, (noun, f"{noun}s")) for noun, n in counts.items() if n], use, collector
    )


def _unused_contents(midi_survey: MidiSurvey, use: _FileUse) -> Iterator[str]:
    """What a score does not use of a file, in words."""
    unplayed = {
        midi_channel: n
        for midi_channel, n in midi_survey.notes.items()
        if not use.played_channels & {None, midi_channel}
    }
    if unplayed:
        channels = [str(channel) for channel in sorted(unplayed)]
        noun = "channel" if len(channels) == 1 else "channels"
        notes_text = plural(sum(unplayed.values()), ("note", "notes"))
        yield f"{notes_text} of {noun} {', '.join(channels)}"
    yield from unused_contents(
        midi_survey,
        has_pedal=use.has_lengths,
        has_tempo=use.has_tempo,
        has_meter=use.has_meter,
        has_wheel=use.has_wheel,
        has_pressure=use.has_pressure,
        is_followed=use.follows,
    )
