"""A journal played again: the same versions at the same frames, for a file or to go on from."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from ergon.repl.language.parse import parse
from ergon.repl.language.refusal import Refusal
from ergon.repl.language.scope import names
from ergon.repl.session import deeds
from ergon.repl.session.clock import Clock, started
from ergon.repl.session.commits import REFUSALS, Commits, Deed, Waiting, faders
from ergon.repl.session.disk import Disk
from ergon.repl.session.engine import Steps
from ergon.repl.session.journal import Event, JournalError, read
from ergon.repl.session.named import NameRefused, file_of, name_of, score_of
from ergon.repl.session.running import JOIN, Running, begin
from ergon.repl.session.texts import Texts
from ergon.repl.session.version import Desk, NotTakenError, Past, Version, piece_of
from ergon.scores.staging.stage import MAX_SECONDS

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

_EVERY_MAX = 1 << 16  # frames of a tick
_FRAME_MAX = 1 << 40  # at any rate longer than a session
_NUMBER_MAX = 1 << 40
_BEAT_MAX = 1e7
_RATIO_MAX = 1e10  # as much as a score may say
_HIGHPASS_MAX = 1000.0  # [Hz]
_HASH = 64  # digits
# What a session that is no session makes of the code that plays it again.
_BROKEN = (ArithmeticError, AssertionError, LookupError, RecursionError, TypeError, ValueError)
_BLOCK = 4096  # frames between two looks for what is due


@dataclass(frozen=True, slots=True)
class Opening:
    """How a session began: its score, the beat where it stood, the faders, and how it was heard
    (`gain` and `limit` are ratios)."""

    texts: Texts
    at: float
    desk: Desk
    every: int
    gain: float
    limit: float
    highpass: float | None

    def version(self) -> Version:
        """What it began with. Raises NotTakenError."""
        return Version(0, "", self.texts, piece_of(self.texts), self.desk)

    def fields(self) -> dict[str, object]:
        """As a journal says it."""
        return {
            **said(self.texts),
            "at": self.at,
            "gains": dict(self.desk.gains),
            "muted": sorted(self.desk.muted),
            "solo": sorted(self.desk.solo),
            "master": self.desk.master,
            "every": self.every,
            "gain": self.gain,
            "limit": self.limit,
            "highpass": self.highpass,
        }


def said(texts: Texts) -> dict[str, object]:
    """Texts as a journal says them, with every file that they use: those may be edited later."""
    folder = Path(texts.path).parent
    overlay = {name_of(file, folder): text for file, text in texts.complete().overlay.items()}
    return {"score": texts.path, "text": texts.text, "overlay": overlay}


@dataclass(slots=True)
class Replay:
    """What a journal says: how it began, and what came into effect when.

    `texts` are those that lines read, by the line of the journal; `disk` is what was known last of
    files on the disk.
    """

    opening: Opening
    first: Event
    disk: Disk
    lines: dict[int, Event] = field(default_factory=dict)
    texts: dict[int, Texts] = field(default_factory=dict)
    commits: list[tuple[int, float, Event]] = field(default_factory=list)  # frame, beat, line
    dropped: set[int] = field(default_factory=set)
    late: dict[int, float] = field(default_factory=dict)  # by number: the beat it waits for
    n_frames: int = 0


def opened(path: Path, score: str | None = None, *, resumes: bool = False) -> Replay:
    """Read a journal. Raises JournalError.

    A `score` that is named takes the place of the one that the journal names. One that is named by
    the journal alone lies below the journal's folder or this one; where another is meant, nobody
    `resumes` it, and for all else it is as if it lay beside the journal.
    """
    events = read(path)
    first = next(events, None)
    if first is None or first.name != "session":
        raise JournalError(f"{path}: this is no journal of a session")
    where = _Where(path, first.get("score", str), score, resumes)
    texts = where.texts(first)
    opening = Opening(
        texts,
        _beat(first, "at", 0.0),
        _desk(first),
        first.number_of("every", int, 1, _EVERY_MAX),
        first.number_of("gain", float, 1.0 / _RATIO_MAX**2, _RATIO_MAX),
        first.number_of("limit", float, 1.0 / _RATIO_MAX**2, _RATIO_MAX),
        None
        if first.fields.get("highpass") is None
        else first.number_of("highpass", float, 0.01, _HIGHPASS_MAX),
    )
    replay = Replay(opening, first, Disk.of(texts))
    replay.disk.claim(where.hashes(first))
    for event in events:
        _heard(replay, event, where)
    replay.commits.sort(key=lambda commit: commit[0])
    return replay


@dataclass(frozen=True, slots=True)
class _Where:
    """Where the files are that a journal names; `named` is its score, `score` where that is."""

    journal: Path
    named: str
    score: str | None
    resumes: bool

    def path(self, event: Event) -> Path:
        """The score that a line names."""
        name = event.get("score", str)
        if name == self.named and self.score is not None:
            return Path(self.score)
        try:
            found = score_of(name, self.journal)
        except NameRefused as error:
            event.wrong(str(error))
        if found is not None:
            return found
        if self.resumes and name == self.named:
            event.wrong(f"its score is elsewhere: name it, `ergon repl {name} --resume FILE`")
        return self.journal.parent / Path(name).name

    def texts(self, event: Event) -> Texts:
        """The texts that a line has; no file is read."""
        path = self.path(event)
        try:
            overlay = {
                file_of(name, path.parent): text
                for name, text in event.mapping("overlay", str).items()
            }
        except NameRefused as error:
            event.wrong(str(error))
        return Texts(str(path), event.get("text", str), overlay, sealed=True)

    def hashes(self, event: Event) -> dict[str, str]:
        """What a line says of files on the disk."""
        found = {}
        if "disk" in event.fields:
            folder = self.path(event).parent
            for name, known in event.mapping("disk", str).items():
                with contextlib.suppress(NameRefused):  # it is not written, then
                    found[file_of(name, folder)] = known[:_HASH]
        return found


def _beat(event: Event, name: str, default: float | None = None) -> float:
    return float(event.number_of(name, float, 0.0, _BEAT_MAX, default))


def _desk(event: Event) -> Desk:
    muted, solo = event.words("muted"), event.words("solo")
    master = event.number_of("master", float, 0.0, _RATIO_MAX, 1.0)
    return Desk(event.mapping("gains", float), muted, solo, master)


def _heard(replay: Replay, event: Event, where: _Where) -> None:
    if event.name in ("line", "commit", "late", "dropped"):
        number = event.number_of("number", int, 0, _NUMBER_MAX)
    if event.name == "line":
        replay.lines[number] = event
        event.get("line", str)
        _beat(event, "beat")
        if "text" in event.fields:
            replay.texts[event.number] = texts = where.texts(event)
            replay.disk.saw(texts)
    elif event.name == "commit":
        if number not in replay.lines:
            event.wrong(f"no line has the number {number}")
        frame = event.number_of("frame", int, 0, _FRAME_MAX)
        replay.commits.append((frame, _beat(event, "beat"), replay.lines[number]))
    elif event.name == "late":
        replay.late[number] = _beat(event, "beat")
    elif event.name == "dropped":
        replay.dropped.add(number)
    if event.name in ("line", "saved"):
        replay.disk.claim(where.hashes(event))
    if "frame" in event.fields:
        frame = event.number_of("frame", int, 0, _FRAME_MAX)
        replay.n_frames = max(replay.n_frames, frame)


@contextlib.contextmanager
def _done_again(event: Event) -> Iterator[None]:
    """What a line cannot do is said with its place. Raises JournalError."""
    try:
        yield
    except (*REFUSALS, *_BROKEN) as error:
        what = ascii(event.get("line", str)[:80]) if event.name == "line" else "its score"
        event.wrong(f"{what} cannot be played again: {error}")


class Again:
    """A session that is computed again; what `exchange.render` takes for a stage.

    Its simulation gives loudspeakers' frames, and its mixer leaves them as they are.
    """

    def __init__(self, replay: Replay) -> None:
        """From the beginning. Raises JournalError, NotTakenError, StageError."""
        opening = replay.opening
        with _done_again(replay.first):
            version = opening.version()
        running = begin(version, Clock(None, opening.at), {}, None)
        self._engine = Steps(running.stage, every=opening.every, highpass=opening.highpass)
        self._engine.faders(faders(running))
        self._commits = Commits(self._engine, running, {}, 0, version)
        self._versions = {0: Past.of(version)}
        self._coming = list(replay.commits)
        self._texts = replay.texts
        self._done = replay.first
        self.rate = running.stage.rate
        self.n_frames = replay.n_frames
        if replay.n_frames > MAX_SECONDS * self.rate:
            raise NotTakenError("it says that it lasted longer than a day")
        self.n_channels = self.n_out = running.stage.n_channels

    @property
    def simulation(self) -> Again:
        """What gives frames."""
        return self

    @property
    def running(self) -> Running:
        """What plays."""
        return self._commits.running

    def mixer(self, *, highpass: float | None = None) -> _Through:
        """Everything is mixed already."""
        return _Through()

    def stems(self, *, highpass: float | None = None) -> list[tuple[str, _Through]]:
        """A session is one sound."""
        return []

    def process(self, out: NDArray[np.float64]) -> None:
        """Fill (n_frames, n_channels) with the next frames."""
        done = 0
        while done < len(out):
            self._due()
            n = min(_BLOCK, len(out) - done, *self._next(len(out)))
            out[done : done + n] = self._engine.process(n)
            done += n

    def _next(self, most: int) -> Iterator[int]:
        """Frames to the next line that comes into effect."""
        for frame, *_ in self._coming[:1]:
            yield max(1, frame - self._engine.frame)
        yield most

    def _due(self) -> None:
        """Lines that come into effect now; what is asked of the engine now is done now."""
        while self._coming and self._coming[0][0] <= self._engine.frame:
            frame, beat, event = self._coming.pop(0)
            number = event.get("number", int)
            goes = event.fields.get("goes")
            with _done_again(event):
                waiting = Waiting(
                    event.get("line", str),
                    deed_of(event, self._versions, self._commits.head, self._texts),
                    beat,
                    frame,
                    goes if isinstance(goes, bool) else None,
                    bool(event.fields.get("resets")),
                    number=number,
                )
                self._versions[number] = Past.of(self._commits.take(waiting).version)
                self._done = event
        with _done_again(self._done):
            self._commits.tick()


def resumed(replay: Replay) -> tuple[Version, Clock]:
    """What was last, and the bar in which its piece stands then; nothing is computed.

    Raises JournalError, NotTakenError.
    """
    opening = replay.opening
    with _done_again(replay.first):
        version = opening.version()
    versions, clock = {0: Past.of(version)}, Clock(None, opening.at)
    rate, lead = version.piece.rate, JOIN + opening.every / version.piece.rate
    done = {event.get("number", int) for _, _, event in replay.commits}
    waited = [
        (replay.n_frames, replay.late.get(number, event.get("beat", float)), event)
        for number, event in sorted(replay.lines.items())
        if number not in done and number not in replay.dropped
    ]
    waited.sort(key=lambda line: line[1])  # as they would have come into effect
    for frame, beat, event in (*replay.commits, *waited):
        with _done_again(event):
            version = deed_of(event, versions, version, replay.texts)(version, beat)
            versions[event.get("number", int)] = Past.of(version)
            tempo, goes = version.piece.tempo_map, event.fields.get("goes")
            if goes is True:
                clock = started(tempo, beat, frame / rate + lead)
            elif goes is False:
                clock = Clock(None, clock.beat(tempo, frame / rate))
    tempo = version.piece.tempo_map
    beat = clock.beat(tempo, replay.n_frames / rate)
    if not (math.isfinite(beat) and replay.n_frames <= MAX_SECONDS * rate):
        raise NotTakenError("it says that it lasted longer than a day")
    bar, _ = tempo.bar_beat(beat)
    # Hands that come back are free: nobody is pulled who has not asked for it.
    return replace(version, number=0, line="", leads={}), Clock(None, tempo.bars.start(bar))


def deed_of(
    event: Event, versions: Mapping[int, Past], on: Version, read: Mapping[int, Texts]
) -> Deed:
    """What a line of a journal does: nothing but make a version. Raises NotTakenError."""
    if event.fields.get("resets"):
        return deeds.hushed
    if (texts := read.get(event.number)) is not None:
        return lambda version, beat: replace(version, texts=texts, piece=piece_of(texts))
    restores = event.fields.get("restores")
    if isinstance(restores, int):
        target = versions.get(restores)
        return deeds.same if target is None else target.restored
    try:
        commands = parse(event.get("line", str), names(on.piece))
    except Refusal as refusal:
        raise NotTakenError(refusal.message) from None
    if any(type(one) in deeds.READ for one in commands):  # whoever renders it reads no other file
        raise NotTakenError("what was read then is missing")
    return deeds.together([one for one in commands if type(one) in deeds.DEEDS])


class _Through:
    """Frames as they are."""

    def process(self, frames: NDArray[np.float64], mixed: NDArray[np.float64]) -> None:
        """(n_frames, n_channels) to the same."""
        mixed[:] = frames
