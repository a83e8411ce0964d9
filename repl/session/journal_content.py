"""The checked content of a journal: how a session began, and what took effect when."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

from ergon.notation.text.bounds import FileBounds
from ergon.rendering.silence import FadedSilence
from ergon.repl.session.block_rules import Rule, read_rules, rules_field
from ergon.repl.session.disk import Disk
from ergon.repl.session.frozen_parts import FrozenFolder, frozen_fields, read_frozen_folder
from ergon.repl.session.history import History, PastVersions
from ergon.repl.session.history_content import (
    faders_fields,
    history_fields,
    read_history,
    read_sounding,
    sounding_field,
)
from ergon.repl.session.journal import BEAT_MAX, FRAME_MAX, JournalError, JournalEvent, read_events
from ergon.repl.session.journal_hands import JournalTake, read_take
from ergon.repl.session.journal_names import JournalNameError, file_named, journal_name, score_named
from ergon.repl.session.midi_maps import Map, maps_field, read_maps
from ergon.repl.session.strike_levels import StrikeLevels, levels_fields, read_levels
from ergon.repl.session.struck_places import Place
from ergon.repl.session.version import GLIDE_DURATION, Faders, Version, piece_of
from ergon.scores.edits.texts import Texts
from ergon.scores.reading.sounding import SoundingNames

_TICK_FRAMES_MAX = 1 << 16  # frames of a tick
_NUMBER_MAX = 1 << 40
_RATIO_MAX = 1e10  # the largest that a score allows
_HIGHPASS_MAX = 1000.0  # [Hz]
_HASH_CHARACTERS = 64  # digits
_GLIDE_MAX = 86_400.0  # [s]
_VALUE_MAX = sys.float_info.max  # largest value of an input


@dataclass(frozen=True, slots=True)
class SessionStart:
    """How a session began: its score, the beat at which it stood, the faders, and how it was heard
    (`gain`, `limit` and `reference` are ratios). `take` is the recording of real hands; `frozen`
    has the frozen parts. If it `is_seen`, parts that were not heard were computed too, so that
    they were already moving when a later line made them heard.
    """

    texts: Texts
    beat: float
    faders: Faders
    tick_frames: int
    gain: float
    limit: float
    highpass: float | None
    history: PastVersions | None = None
    file_texts: Texts | None = None
    take: JournalTake | None = None
    maps: Mapping[str, Map] = field(default_factory=dict)
    rules: Mapping[str, Rule] = field(default_factory=dict)
    reference: float | None = None
    sounds_as: SoundingNames = field(default_factory=SoundingNames)
    frozen: FrozenFolder | None = None
    is_seen: bool = False
    strike_levels: StrikeLevels = field(default_factory=StrikeLevels)

    def version(self) -> Version:
        """The first version. Raises NotTakenError."""
        version = Version(0, "", self.texts, piece_of(self.texts), self.faders)
        return replace(
            version,
            maps=self.maps,
            rules=self.rules,
            sounds_as=self.sounds_as,
            strike_levels=self.strike_levels,
        )

    def fields(self) -> dict[str, object]:
        """The fields of the journal's first event."""
        return {
            **text_fields(self.texts),
            "at": self.beat,
            **faders_fields(self.faders),
            **levels_fields(self.strike_levels),
            "every": self.tick_frames,
            "gain": self.gain,
            "limit": self.limit,
            "highpass": self.highpass,
            "reference": self.reference,
            **maps_field(self.maps),
            **rules_field(self.rules),
            **sounding_field(self.sounds_as),
            **({} if self.history is None else history_fields(self.history)),
            **({} if self.file_texts is None else {"base": text_fields(self.file_texts)}),
            **({} if self.take is None else self.take.fields()),
            **({} if self.frozen is None else frozen_fields(self.frozen)),
            **({"see": "all"} if self.is_seen else {}),
        }


def text_fields(score_texts: Texts) -> dict[str, object]:
    """The journal fields for texts; they include all files that the score uses, which may change
    later.
    """
    folder = Path(score_texts.path).parent
    overlay = {
        journal_name(file, folder): text for file, text in score_texts.complete().overlay.items()
    }
    return {"score": score_texts.path, "text": score_texts.text, "overlay": overlay}


def effect_fields(version: Version) -> dict[str, object]:
    """The journal fields for how a version read from files takes over."""
    effect_values: dict[str, object] = {}
    if version.glide_duration != GLIDE_DURATION:
        effect_values["glide"] = version.glide_duration
    if version.takeover_beat is not None:
        effect_values["enters"] = version.takeover_beat
    return effect_values


class JournalAct(NamedTuple):
    """A strike of a place by an impulse [N·s], or a value of an input, by the input's name; `line`
    is the number of its line in the journal.
    """

    frame: int
    target: Place | str
    amount: float
    line: int


class JournalCommit(NamedTuple):
    """A line that took effect at a frame, on a beat; lines of one `change` did so together."""

    frame: int
    beat: float
    line: JournalEvent
    change: int | None


class FileVersion(NamedTuple):
    """The texts that a line read from files, and how their version takes over, as in `Version`."""

    texts: Texts
    glide_duration: float
    enter_beat: float | None


@dataclass(slots=True)
class JournalGaps:
    """Events that a journal lacks, by the numbers of those that it has."""

    last_number: int = 0
    n_missing: int = 0
    first_number: int = 0  # the line of the file before which the first is missing

    def note_event(self, journal_event: JournalEvent) -> None:
        """Note the next event. Journals of earlier versions have no numbers."""
        if "n" not in journal_event.fields:
            return
        number = journal_event.number_of("n", int, 1, _NUMBER_MAX)
        if number > self.last_number + 1:
            self.n_missing += number - self.last_number - 1
            self.first_number = self.first_number or journal_event.number
        self.last_number = number

    def sentence(self, file: str) -> str:
        """What is missing; empty where nothing is."""
        if not self.n_missing:
            return ""
        events_text = "event is" if self.n_missing == 1 else "events are"
        return (
            f"{file}: {self.n_missing:,} {events_text} missing, the first before line "
            f"{self.first_number}; "
            "what was heard is not all in it"
        )


@dataclass(slots=True)
class JournalContent:
    """How a session began, and which line took effect at which frame.

    `versions_from_files` has the versions that lines read from files, by line of the journal;
    `disk` has the last known hashes of files. A journal that `has_ended` is complete.
    """

    session_start: SessionStart
    first_event: JournalEvent
    disk: Disk
    lines: dict[int, JournalEvent] = field(default_factory=dict)
    versions_from_files: dict[int, FileVersion] = field(default_factory=dict)
    commits: list[JournalCommit] = field(default_factory=list)
    # (frame at which the piece went on, beat from which on nothing had begun)
    skips: list[tuple[int, float]] = field(default_factory=list)
    dropped_numbers: set[int] = field(default_factory=set)
    # The beat, and the frame, that a late line waits for, by its number.
    late_beats: dict[int, float] = field(default_factory=dict)
    start_frames: dict[int, int] = field(default_factory=dict)
    n_frames: int = 0
    has_ended: bool = False
    silences: list[FadedSilence] = field(default_factory=list)
    file_texts: Texts | None = None  # the files when they were last read or saved
    # Lines and drops, in the order written.
    events: list[JournalEvent] = field(default_factory=list)
    # Strikes by MIDI notes and values of inputs by OSC, in the order in which they were done.
    acts: list[JournalAct] = field(default_factory=list)
    gaps: JournalGaps = field(default_factory=JournalGaps)

    def effect_order(self) -> dict[int, float]:
        """The place of every line in the order of effect, by number."""
        line_order = {
            commit.line.get("number", int): float(line_index)
            for line_index, commit in enumerate(self.commits)
        }
        waiting_numbers = [number for number in self.lines if number not in line_order]
        waiting_numbers.sort(key=self._due_order)
        return line_order | {
            number: len(line_order) + line_index
            for line_index, number in enumerate(waiting_numbers)
        }

    def _due_order(self, number: int) -> tuple[int, float]:
        """When a waiting line would take effect, as `WaitingLine.is_before` orders them."""
        line_event = self.lines[number]
        start_frame = self.start_frames.get(
            number, line_event.number_of("start", int, 0, FRAME_MAX, FRAME_MAX)
        )
        if start_frame == FRAME_MAX:  # the piece must be played up to its beat first
            return start_frame, self.late_beats.get(number, line_event.get("beat", float))
        return start_frame, number

    def history(self) -> History:
        """The history at the end of the session."""
        old_history = self.session_start.history
        history = History()
        if old_history is not None:
            history = History(
                [past_version.number for past_version in old_history.versions], old_history.index
            )
        effect_order = self.effect_order()
        for journal_event in self.events:
            line_number = journal_event.get("number", int)
            restored_number = journal_event.fields.get("restores")
            if journal_event.name == "dropped":
                history.remove(line_number)
            elif journal_event.fields.get("typed") is False:
                continue
            elif isinstance(restored_number, int):
                history.go_to(restored_number)
            else:
                history.add(line_number)
                replaced_number = journal_event.fields.get("replaces")
                if isinstance(replaced_number, int):
                    history.remove(replaced_number)
                history.sort(effect_order)
        return history

    def all_texts(self) -> Iterator[Texts]:
        """Every version of the score that was read from files."""
        yield self.session_start.texts
        yield from (file_version.texts for file_version in self.versions_from_files.values())


def read_journal(
    path: Path, score: str | None = None, *, resumes: bool = False, trust: bool = False
) -> JournalContent:
    """Read a journal. Raises JournalError.

    `score` replaces the score that the journal names. Without it, the score must be in or below
    the journal's folder or the current one: otherwise, a journal that `resumes` is refused, and
    any other is read as if the score were beside it.
    """
    journal_events = read_events(path)
    first_event = next(journal_events, None)
    if first_event is None or first_event.name != "session":
        raise JournalError(f"{path}: this is not a session's journal")
    file_locations = _FileLocations(path, first_event.get("score", str), score, resumes, trust)
    first_texts = file_locations.texts(first_event)
    start = SessionStart(
        first_texts,
        _parse_beat(first_event, "at", 0.0),
        _read_faders(first_event),
        first_event.number_of("every", int, 1, _TICK_FRAMES_MAX),
        first_event.number_of("gain", float, 1.0 / _RATIO_MAX**2, _RATIO_MAX),
        first_event.number_of("limit", float, 1.0 / _RATIO_MAX**2, _RATIO_MAX),
        None
        if first_event.fields.get("highpass") is None
        else first_event.number_of("highpass", float, 0.01, _HIGHPASS_MAX),
        read_history(first_event, file_locations.texts, _read_faders),
        take=read_take(first_event, path),
        maps=read_maps(first_event),
        rules=read_rules(first_event),
        sounds_as=read_sounding(first_event),
        frozen=read_frozen_folder(first_event, path, trust=trust),
        reference=None
        if first_event.fields.get("reference") is None  # a journal that knows no reference level
        else first_event.number_of("reference", float, 1.0 / _RATIO_MAX**2, _RATIO_MAX),
        is_seen=_is_seen(first_event),
        strike_levels=read_levels(first_event),
    )
    journal_content = JournalContent(start, first_event, Disk.from_texts(first_texts))
    journal_content.disk.add_journal_hashes(file_locations.hashes(first_event))
    journal_content.file_texts = start.texts
    if "base" in first_event.fields:
        fields = first_event.get("base", dict)
        journal_content.file_texts = file_locations.texts(
            JournalEvent(first_event.file, first_event.number, "base", fields)
        )
    journal_content.gaps.note_event(first_event)
    for event in journal_events:
        journal_content.gaps.note_event(event)
        _add_event(journal_content, event, file_locations)
    journal_content.commits.sort(key=lambda commit: commit.frame)
    journal_content.skips.sort()
    journal_content.acts.sort(key=lambda act: act.frame)
    return journal_content


def _is_seen(first_event: JournalEvent) -> bool:
    if first_event.fields.get("see", "all") != "all":
        first_event.refuse("`see` is neither absent nor all")
    return "see" in first_event.fields


@dataclass(frozen=True, slots=True)
class _FileLocations:
    """Finds the files that a journal names; `score_name` is its score, `score` the file used in its
    place.
    """

    journal: Path
    score_name: str
    score: str | None
    resumes: bool
    trust: bool

    def path(self, event: JournalEvent) -> Path:
        """The score that an event names."""
        score_name = event.get("score", str)
        if score_name == self.score_name and self.score is not None:
            return Path(self.score)
        try:
            path = score_named(score_name, self.journal)
        except JournalNameError as error:
            event.refuse(str(error))
        if path is not None:
            return path
        if self.resumes and score_name == self.score_name:
            event.refuse(
                "its score is outside this folder and the journal's: name it, "
                f"`ergon repl {score_name} --resume FILE`"
            )
        return self.journal.parent / Path(score_name).name

    def texts(self, event: JournalEvent) -> Texts:
        """The texts that an event holds; no file is read."""
        path = self.path(event)
        try:
            overlay = {
                file_named(name, path.parent): text
                for name, text in event.mapping("overlay", str).items()
            }
        except JournalNameError as error:
            event.refuse(str(error))
        bounds = FileBounds.around(path.parent, trust=self.trust)
        return Texts(str(path), event.get("text", str), overlay, sealed=True, bounds=bounds)

    def hashes(self, event: JournalEvent) -> dict[str, str]:
        """The hashes of files on the disk that an event holds."""
        hash_by_file = {}
        if "disk" in event.fields:
            folder = self.path(event).parent
            for name, file_hash in event.mapping("disk", str).items():
                with contextlib.suppress(JournalNameError):  # such a file is never written
                    hash_by_file[file_named(name, folder)] = file_hash[:_HASH_CHARACTERS]
        return hash_by_file


def _parse_beat(event: JournalEvent, name: str, default: float | None = None) -> float:
    return float(event.number_of(name, float, 0.0, BEAT_MAX, default))


def _read_faders(event: JournalEvent) -> Faders:
    muted, solo = event.name_set("muted"), event.name_set("solo")
    master_ratio = event.number_of("master", float, 0.0, _RATIO_MAX, 1.0)
    return Faders(event.mapping("gains", float), muted, solo, master_ratio)


def _read_version(event: JournalEvent, file_locations: _FileLocations) -> FileVersion:
    glide = event.number_of("glide", float, 0.0, _GLIDE_MAX, GLIDE_DURATION)
    enter_beat = _parse_beat(event, "enters") if "enters" in event.fields else None
    return FileVersion(file_locations.texts(event), glide, enter_beat)


def _add_event(
    journal_content: JournalContent, journal_event: JournalEvent, file_locations: _FileLocations
) -> None:
    if journal_event.name in ("line", "commit", "late", "dropped"):
        line_number = journal_event.number_of("number", int, 0, _NUMBER_MAX)
    if journal_event.name in ("line", "dropped"):
        journal_content.events.append(journal_event)
    if journal_event.name == "line":
        journal_content.lines[line_number] = journal_event
        journal_event.get("line", str)
        _parse_beat(journal_event, "beat")
        if "text" in journal_event.fields:
            journal_content.versions_from_files[journal_event.number] = version = _read_version(
                journal_event, file_locations
            )
            journal_content.disk.note_read(version.texts)
    elif journal_event.name == "commit":
        if line_number not in journal_content.lines:
            journal_event.refuse(f"the journal has no line with the number {line_number}")
        if "text" in journal_event.fields:  # other than when the line was typed
            journal_content.versions_from_files[journal_content.lines[line_number].number] = (
                _read_version(journal_event, file_locations)
            )
        event_frame = journal_event.number_of("frame", int, 0, FRAME_MAX)
        change = (
            journal_event.number_of("change", int, 0, _NUMBER_MAX, -1)
            if "change" in journal_event.fields
            else None
        )
        journal_content.commits.append(
            JournalCommit(
                event_frame,
                _parse_beat(journal_event, "beat"),
                journal_content.lines[line_number],
                change,
            )
        )
    elif journal_event.name == "late":
        journal_content.late_beats[line_number] = _parse_beat(journal_event, "beat")
        journal_content.start_frames[line_number] = journal_event.number_of(
            "start", int, 0, FRAME_MAX, FRAME_MAX
        )
    elif journal_event.name == "dropped":
        journal_content.dropped_numbers.add(line_number)
    elif journal_event.name == "skip":
        event_frame = journal_event.number_of("frame", int, 0, FRAME_MAX)
        journal_content.skips.append((event_frame, _parse_beat(journal_event, "begin")))
    elif journal_event.name in _ACT_PARSERS:
        journal_content.acts.append(_ACT_PARSERS[journal_event.name](journal_event))
    elif journal_event.name == "silence":
        _add_silence(journal_content, journal_event)
    elif journal_event.name == "end":
        journal_content.has_ended = True
    if "base" in journal_event.fields:
        fields = journal_event.get("base", dict)
        journal_content.file_texts = file_locations.texts(
            JournalEvent(journal_event.file, journal_event.number, "base", fields)
        )
    if journal_event.name in ("line", "saved"):
        journal_content.disk.add_journal_hashes(file_locations.hashes(journal_event))
    if "frame" in journal_event.fields:
        event_frame = journal_event.number_of("frame", int, 0, FRAME_MAX)
        journal_content.n_frames = max(journal_content.n_frames, event_frame)


def _parse_strike(journal_event: JournalEvent) -> JournalAct:
    place = (
        journal_event.get("part", str),
        journal_event.get("module", str),
        journal_event.number_of("member", int, -1, _NUMBER_MAX),
    )
    impulse = journal_event.number_of("impulse", float, -_RATIO_MAX, _RATIO_MAX)
    return JournalAct(
        journal_event.number_of("frame", int, 0, FRAME_MAX), place, impulse, journal_event.number
    )


def _parse_value(event: JournalEvent) -> JournalAct:
    frame, name = event.number_of("frame", int, 0, FRAME_MAX), event.get("input", str)
    value = event.number_of("value", float, -_VALUE_MAX, _VALUE_MAX)
    return JournalAct(frame, name, value, event.number)


_ACT_PARSERS = {"strike": _parse_strike, "value": _parse_value}


def _add_silence(journal_content: JournalContent, journal_event: JournalEvent) -> None:
    """Add the begin or the end of a panic's silence; they must alternate."""
    event_frame = journal_event.number_of("frame", int, 0, FRAME_MAX)
    last_silence = journal_content.silences[-1] if journal_content.silences else None
    is_open = last_silence is not None and last_silence.stop is None
    begins = journal_event.get("begins", bool)
    if begins is is_open or (
        last_silence is not None and event_frame < (last_silence.stop or last_silence.start)
    ):
        journal_event.refuse("silences neither overlap nor end before they begin")
    if last_silence is not None and is_open:
        journal_content.silences[-1] = FadedSilence(last_silence.start, event_frame)
    else:
        journal_content.silences.append(FadedSilence(event_frame))
