"""The checked content of a journal: how a session began, and what took effect when."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

from ergon.notation.text.bounds import FileBounds
from ergon.rendering.silence import Silence
from ergon.repl.session.block_rules import Rule, read_rules, rules_field
from ergon.repl.session.disk import Disk
from ergon.repl.session.frozen_parts import FrozenFolder, frozen_fields, frozen_of
from ergon.repl.session.history import History, PastVersions
from ergon.repl.session.history_content import (
    faders_fields,
    history_fields,
    read_history,
    read_sounding,
    sounding_field,
)
from ergon.repl.session.journal import (
    BEAT_MAX,
    FRAME_MAX,
    JournalError,
    JournalEvent,
    read_events,
)
from ergon.repl.session.journal_hands import JournalTake, take_of
from ergon.repl.session.journal_names import JournalNameError, file_named, journal_name, score_named
from ergon.repl.session.midi_maps import Map, maps_field, read_maps
from ergon.repl.session.strike_levels import StrikeLevels, levels_fields, read_levels
from ergon.repl.session.struck_places import Place
from ergon.repl.session.version import GLIDE, Faders, Version, piece_of
from ergon.scores.edits.texts import Texts
from ergon.scores.reading.sounding import SoundingNames

_EVERY_MAX = 1 << 16  # frames of a tick
_NUMBER_MAX = 1 << 40
_RATIO_MAX = 1e10  # the largest that a score allows
_HIGHPASS_MAX = 1000.0  # [Hz]
_HASH = 64  # digits
_GLIDE_MAX = 86_400.0  # [s]
_VALUE_MAX = sys.float_info.max  # of an input


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
    base: Texts | None = None
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
            **({} if self.base is None else {"base": text_fields(self.base)}),
            **({} if self.take is None else self.take.fields()),
            **({} if self.frozen is None else frozen_fields(self.frozen)),
            **({"see": "all"} if self.is_seen else {}),
        }


def text_fields(texts: Texts) -> dict[str, object]:
    """The journal fields for texts; they include all files that the score uses, which may change
    later.
    """
    folder = Path(texts.path).parent
    overlay = {journal_name(file, folder): text for file, text in texts.complete().overlay.items()}
    return {"score": texts.path, "text": texts.text, "overlay": overlay}


def effect_fields(version: Version) -> dict[str, object]:
    """The journal fields for how a version read from files takes over."""
    fields: dict[str, object] = {}
    if version.glide != GLIDE:
        fields["glide"] = version.glide
    if version.enter_beat is not None:
        fields["enters"] = version.enter_beat
    return fields


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
    glide: float
    enters: float | None


@dataclass(slots=True)
class JournalGaps:
    """Events that a journal lacks, by the numbers of those that it has."""

    last: int = 0
    n_missing: int = 0
    first: int = 0  # the line of the file before which the first is missing

    def see(self, event: JournalEvent) -> None:
        """Note the next event. Journals of earlier versions have no numbers."""
        if "n" not in event.fields:
            return
        number = event.number_of("n", int, 1, _NUMBER_MAX)
        if number > self.last + 1:
            self.n_missing += number - self.last - 1
            self.first = self.first or event.number
        self.last = number

    def sentence(self, file: str) -> str:
        """What is missing; empty where nothing is."""
        if not self.n_missing:
            return ""
        events = "event is" if self.n_missing == 1 else "events are"
        return (
            f"{file}: {self.n_missing:,} {events} missing, the first before line {self.first}; "
            "what was heard is not all in it"
        )


@dataclass(slots=True)
class JournalContent:
    """How a session began, and which line took effect at which frame.

    `versions_from_files` has the versions that lines read from files, by line of the journal;
    `disk` has the last known hashes of files. A journal that `ended` is complete.
    """

    start: SessionStart
    first: JournalEvent
    disk: Disk
    lines: dict[int, JournalEvent] = field(default_factory=dict)
    versions_from_files: dict[int, FileVersion] = field(default_factory=dict)
    commits: list[JournalCommit] = field(default_factory=list)
    # (frame at which the piece went on, beat from which on nothing had begun)
    skips: list[tuple[int, float]] = field(default_factory=list)
    dropped: set[int] = field(default_factory=set)
    # The beat, and the frame, that a late line waits for, by its number.
    late: dict[int, float] = field(default_factory=dict)
    starts: dict[int, int] = field(default_factory=dict)
    n_frames: int = 0
    ended: bool = False
    silences: list[Silence] = field(default_factory=list)
    base: Texts | None = None  # what the files held when they were last read or saved
    # Lines and drops, in the order written.
    events: list[JournalEvent] = field(default_factory=list)
    # Strikes by MIDI notes and values of inputs by OSC, in the order in which they were done.
    acts: list[JournalAct] = field(default_factory=list)
    gaps: JournalGaps = field(default_factory=JournalGaps)

    def order(self) -> dict[int, float]:
        """The place of every line in the order of effect, by number."""
        done = {one.line.get("number", int): float(i) for i, one in enumerate(self.commits)}
        waits = [number for number in self.lines if number not in done]
        waits.sort(key=self._due)
        return done | {number: len(done) + i for i, number in enumerate(waits)}

    def _due(self, number: int) -> tuple[int, float]:
        """When a waiting line would take effect, as `WaitingLine.is_before` orders them."""
        line = self.lines[number]
        start = self.starts.get(number, line.number_of("start", int, 0, FRAME_MAX, FRAME_MAX))
        if start == FRAME_MAX:  # the piece must be played up to its beat first
            return start, self.late.get(number, line.get("beat", float))
        return start, number

    def history(self) -> History:
        """The history at the end of the session."""
        before = self.start.history
        history = History()
        if before is not None:
            history = History([one.number for one in before.versions], before.index)
        order = self.order()
        for event in self.events:
            number = event.get("number", int)
            restores = event.fields.get("restores")
            if event.name == "dropped":
                history.remove(number)
            elif event.fields.get("typed") is False:
                continue
            elif isinstance(restores, int):
                history.go_to(restores)
            else:
                history.add(number)
                replaced = event.fields.get("replaces")
                if isinstance(replaced, int):
                    history.remove(replaced)
                history.sort(order)
        return history

    def all_texts(self) -> Iterator[Texts]:
        """Every version of the score that was read from files."""
        yield self.start.texts
        yield from (one.texts for one in self.versions_from_files.values())


def read_journal(
    path: Path, score: str | None = None, *, resumes: bool = False, trust: bool = False
) -> JournalContent:
    """Read a journal. Raises JournalError.

    `score` replaces the score that the journal names. Without it, the score must be in or below
    the journal's folder or the current one: otherwise, a journal that `resumes` is refused, and
    any other is read as if the score were beside it.
    """
    events = read_events(path)
    first = next(events, None)
    if first is None or first.name != "session":
        raise JournalError(f"{path}: this is not a session's journal")
    where = _FileLocations(path, first.get("score", str), score, resumes, trust)
    texts = where.texts(first)
    opening = SessionStart(
        texts,
        _beat(first, "at", 0.0),
        _read_faders(first),
        first.number_of("every", int, 1, _EVERY_MAX),
        first.number_of("gain", float, 1.0 / _RATIO_MAX**2, _RATIO_MAX),
        first.number_of("limit", float, 1.0 / _RATIO_MAX**2, _RATIO_MAX),
        None
        if first.fields.get("highpass") is None
        else first.number_of("highpass", float, 0.01, _HIGHPASS_MAX),
        read_history(first, where.texts, _read_faders),
        take=take_of(first, path),
        maps=read_maps(first),
        rules=read_rules(first),
        sounds_as=read_sounding(first),
        frozen=frozen_of(first, path, trust=trust),
        reference=None
        if first.fields.get("reference") is None  # a journal that knows no reference level
        else first.number_of("reference", float, 1.0 / _RATIO_MAX**2, _RATIO_MAX),
        is_seen=_is_seen(first),
        strike_levels=read_levels(first),
    )
    replay = JournalContent(opening, first, Disk.from_texts(texts))
    replay.disk.add_hashes(where.hashes(first))
    replay.base = opening.texts
    if "base" in first.fields:
        fields = first.get("base", dict)
        replay.base = where.texts(JournalEvent(first.file, first.number, "base", fields))
    replay.gaps.see(first)
    for event in events:
        replay.gaps.see(event)
        _add_event(replay, event, where)
    replay.commits.sort(key=lambda commit: commit.frame)
    replay.skips.sort()
    replay.acts.sort(key=lambda act: act.frame)
    return replay


def _is_seen(first: JournalEvent) -> bool:
    if first.fields.get("see", "all") != "all":
        first.refuse("`see` is neither absent nor all")
    return "see" in first.fields


@dataclass(frozen=True, slots=True)
class _FileLocations:
    """Finds the files that a journal names; `named` is its score, `score` the file used in its
    place.
    """

    journal: Path
    named: str
    score: str | None
    resumes: bool
    trust: bool

    def path(self, event: JournalEvent) -> Path:
        """The score that an event names."""
        name = event.get("score", str)
        if name == self.named and self.score is not None:
            return Path(self.score)
        try:
            path = score_named(name, self.journal)
        except JournalNameError as error:
            event.refuse(str(error))
        if path is not None:
            return path
        if self.resumes and name == self.named:
            event.refuse(
                "its score is outside this folder and the journal's: name it, "
                f"`ergon repl {name} --resume FILE`"
            )
        return self.journal.parent / Path(name).name

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
        by_file = {}
        if "disk" in event.fields:
            folder = self.path(event).parent
            for name, known in event.mapping("disk", str).items():
                with contextlib.suppress(JournalNameError):  # such a file is never written
                    by_file[file_named(name, folder)] = known[:_HASH]
        return by_file


def _beat(event: JournalEvent, name: str, default: float | None = None) -> float:
    return float(event.number_of(name, float, 0.0, BEAT_MAX, default))


def _read_faders(event: JournalEvent) -> Faders:
    muted, solo = event.name_set("muted"), event.name_set("solo")
    master = event.number_of("master", float, 0.0, _RATIO_MAX, 1.0)
    return Faders(event.mapping("gains", float), muted, solo, master)


def _read_version(event: JournalEvent, where: _FileLocations) -> FileVersion:
    glide = event.number_of("glide", float, 0.0, _GLIDE_MAX, GLIDE)
    enters = _beat(event, "enters") if "enters" in event.fields else None
    return FileVersion(where.texts(event), glide, enters)


def _add_event(replay: JournalContent, event: JournalEvent, where: _FileLocations) -> None:
    if event.name in ("line", "commit", "late", "dropped"):
        number = event.number_of("number", int, 0, _NUMBER_MAX)
    if event.name in ("line", "dropped"):
        replay.events.append(event)
    if event.name == "line":
        replay.lines[number] = event
        event.get("line", str)
        _beat(event, "beat")
        if "text" in event.fields:
            replay.versions_from_files[event.number] = version = _read_version(event, where)
            replay.disk.note_read(version.texts)
    elif event.name == "commit":
        if number not in replay.lines:
            event.refuse(f"the journal has no line with the number {number}")
        if "text" in event.fields:  # other than when the line was typed
            replay.versions_from_files[replay.lines[number].number] = _read_version(event, where)
        frame = event.number_of("frame", int, 0, FRAME_MAX)
        change = (
            event.number_of("change", int, 0, _NUMBER_MAX, -1) if "change" in event.fields else None
        )
        replay.commits.append(
            JournalCommit(frame, _beat(event, "beat"), replay.lines[number], change)
        )
    elif event.name == "late":
        replay.late[number] = _beat(event, "beat")
        replay.starts[number] = event.number_of("start", int, 0, FRAME_MAX, FRAME_MAX)
    elif event.name == "dropped":
        replay.dropped.add(number)
    elif event.name == "skip":
        frame = event.number_of("frame", int, 0, FRAME_MAX)
        replay.skips.append((frame, _beat(event, "begin")))
    elif event.name in _ACTS:
        replay.acts.append(_ACTS[event.name](event))
    elif event.name == "silence":
        _add_silence(replay, event)
    elif event.name == "end":
        replay.ended = True
    if "base" in event.fields:
        fields = event.get("base", dict)
        replay.base = where.texts(JournalEvent(event.file, event.number, "base", fields))
    if event.name in ("line", "saved"):
        replay.disk.add_hashes(where.hashes(event))
    if "frame" in event.fields:
        frame = event.number_of("frame", int, 0, FRAME_MAX)
        replay.n_frames = max(replay.n_frames, frame)


def _strike(event: JournalEvent) -> JournalAct:
    place = (
        event.get("part", str),
        event.get("module", str),
        event.number_of("member", int, -1, _NUMBER_MAX),
    )
    impulse = event.number_of("impulse", float, -_RATIO_MAX, _RATIO_MAX)
    return JournalAct(event.number_of("frame", int, 0, FRAME_MAX), place, impulse, event.number)


def _value(event: JournalEvent) -> JournalAct:
    frame, name = event.number_of("frame", int, 0, FRAME_MAX), event.get("input", str)
    value = event.number_of("value", float, -_VALUE_MAX, _VALUE_MAX)
    return JournalAct(frame, name, value, event.number)


_ACTS = {"strike": _strike, "value": _value}


def _add_silence(replay: JournalContent, event: JournalEvent) -> None:
    """Add the begin or the end of a panic's silence; they must alternate."""
    frame = event.number_of("frame", int, 0, FRAME_MAX)
    last = replay.silences[-1] if replay.silences else None
    is_open = last is not None and last.stop is None
    begins = event.get("begins", bool)
    if begins is is_open or (last is not None and frame < (last.stop or last.start)):
        event.refuse("silences neither overlap nor end before they begin")
    if last is not None and is_open:
        replay.silences[-1] = Silence(last.start, frame)
    else:
        replay.silences.append(Silence(frame))
