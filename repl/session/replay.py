"""A journal played again: the same versions at the same frames, for a file or to go on from."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from ergon.repl.language.parse import parse
from ergon.repl.language.refusal import Refusal
from ergon.repl.language.scope import names
from ergon.repl.session import deeds
from ergon.repl.session.clock import Clock, started
from ergon.repl.session.commits import Commits, Deed, Waiting, faders
from ergon.repl.session.engine import Steps
from ergon.repl.session.journal import Event, JournalError, read
from ergon.repl.session.running import JOIN, Running, begin
from ergon.repl.session.texts import Texts
from ergon.repl.session.version import Desk, NotTakenError, Past, Version, piece_of
from ergon.scores.staging.stage import MAX_SECONDS
from ergon.scores.text.bounds import Bounds

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

_EVERY_MAX = 1 << 16  # frames of a tick
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
    files = {name: document.text for name, document in texts.load().files.items()}
    files.pop(texts.path, None)
    return {"score": texts.path, "text": texts.text, "overlay": {**files, **texts.overlay}}


def _texts(event: Event, bounds: Bounds | None) -> Texts:
    score, text = event.get("score", str), event.get("text", str)
    return Texts(score, text, event.get("overlay", dict, {}), bounds=bounds)


@dataclass(slots=True)
class Replay:
    """What a journal says: how it began, and what came into effect when."""

    opening: Opening
    lines: dict[int, Event] = field(default_factory=dict)
    commits: list[tuple[int, float, Event]] = field(default_factory=list)  # frame, beat, line
    dropped: set[int] = field(default_factory=set)
    late: dict[int, float] = field(default_factory=dict)  # by number: the beat it waits for
    n_frames: int = 0

    def texts(self) -> Iterator[Texts]:
        """What it read from files: its score, and what lines read later."""
        yield self.opening.texts
        for event in self.lines.values():
            if "text" in event.fields:
                yield _texts(event, self.opening.texts.bounds)


def opened(path: Path, *, trust: bool = False) -> Replay:
    """Read a journal. Raises JournalError.

    It comes from anybody, as a score does: what its scores name lies in its own folder, wherever
    it says that they lay.
    """
    bounds = Bounds.around(path.parent, trust=trust)
    events = read(path)
    first = next(events, None)
    if first is None or first.name != "session":
        raise JournalError(f"{path}: this is no journal of a session")
    highpass = first.fields.get("highpass")
    replay = Replay(
        Opening(
            _texts(first, bounds),
            first.get("at", float, 0.0),
            _desk(first),
            first.get("every", int),
            first.get("gain", float),
            first.get("limit", float),
            None if highpass is None else first.get("highpass", float),
        )
    )
    for event in events:
        _heard(replay, event)
    opening = replay.opening
    if not (1 <= opening.every <= _EVERY_MAX and opening.gain > 0.0 and opening.limit > 0.0):
        raise JournalError(f"{path}: no session begins like that")
    return replay


def _desk(event: Event) -> Desk:
    muted, solo = (event.get(name, list, []) for name in ("muted", "solo"))
    gains = event.get("gains", dict, {})
    return Desk(gains, frozenset(muted), frozenset(solo), event.get("master", float, 1.0))


def _heard(replay: Replay, event: Event) -> None:
    if event.name == "line":
        replay.lines[event.get("number", int)] = event
    elif event.name == "commit":
        number, frame = event.get("number", int), event.get("frame", int)
        if number not in replay.lines:
            raise JournalError(f"line {event.number}: no line has the number {number}")
        replay.commits.append((frame, event.get("beat", float), replay.lines[number]))
    elif event.name == "late":
        replay.late[event.get("number", int)] = event.get("beat", float)
    elif event.name == "dropped":
        replay.dropped.add(event.get("number", int))
    if "frame" in event.fields:
        replay.n_frames = max(replay.n_frames, event.get("frame", int))


class Again:
    """A session that is computed again; what `exchange.render` takes for a stage.

    Its simulation gives loudspeakers' frames, and its mixer leaves them as they are.
    """

    def __init__(self, replay: Replay) -> None:
        """From the beginning. Raises NotTakenError, StageError."""
        opening = replay.opening
        version = opening.version()
        running = begin(version, Clock(None, opening.at), {}, None)
        self._engine = Steps(running.stage, every=opening.every, highpass=opening.highpass)
        self._engine.faders(faders(running))
        self._commits = Commits(self._engine, running, {}, 0, version)
        self._versions = {0: Past.of(version)}
        self._coming = list(replay.commits)
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
            waiting = Waiting(
                event.get("line", str),
                deed_of(event, self._versions, self._commits.head),
                beat,
                frame,
                goes if isinstance(goes, bool) else None,
                bool(event.fields.get("resets")),
                number=number,
            )
            self._versions[number] = Past.of(self._commits.take(waiting).version)
        self._commits.tick()


def resumed(replay: Replay) -> tuple[Version, Clock]:
    """What was last, and the bar in which its piece stands then; nothing is computed.

    Raises NotTakenError.
    """
    opening = replay.opening
    texts = opening.texts
    if texts.bounds is not None and not texts.bounds.allow(Path(texts.path)):  # lines may write it
        raise NotTakenError(f"its score {texts.path} lies outside the journal's folder (--trust)")
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
        version = deed_of(event, versions, version)(version, beat)
        versions[event.get("number", int)] = Past.of(version)
        tempo, goes = version.piece.tempo_map, event.fields.get("goes")
        if goes is True:
            clock = started(tempo, beat, frame / rate + lead)
        elif goes is False:
            clock = Clock(None, clock.beat(tempo, frame / rate))
    tempo = version.piece.tempo_map
    bar, _ = tempo.bar_beat(clock.beat(tempo, replay.n_frames / rate))
    # Hands that come back are free: nobody is pulled who has not asked for it.
    return replace(version, number=0, line="", leads={}), Clock(None, tempo.bars.start(bar))


def deed_of(event: Event, versions: Mapping[int, Past], on: Version) -> Deed:
    """What a line of a journal does. Raises NotTakenError where it is none."""
    if event.fields.get("resets"):
        return deeds.hushed
    if "text" in event.fields:
        texts = _texts(event, on.texts.bounds)
        return lambda version, beat: replace(version, texts=texts, piece=piece_of(texts))
    restores = event.fields.get("restores")
    if isinstance(restores, int):
        target = versions.get(restores)
        return deeds.same if target is None else target.restored
    try:
        commands = parse(event.get("line", str), names(on.piece))
    except Refusal as refusal:
        raise NotTakenError(f"line {event.number}: {refusal.message}") from None
    if any(type(one) in deeds.READ for one in commands):  # whoever renders it reads no other file
        raise NotTakenError(f"line {event.number}: what was read then is missing")
    return deeds.together([one for one in commands if type(one) in deeds.DEEDS])


class _Through:
    """Frames as they are."""

    def process(self, frames: NDArray[np.float64], mixed: NDArray[np.float64]) -> None:
        """(n_frames, n_channels) to the same."""
        mixed[:] = frames
