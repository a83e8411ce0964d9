"""A journal played again: the same versions at the same frames, for a file or to go on from."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

from ergon.repl.language.parse import parse
from ergon.repl.language.refusal import Refusal
from ergon.repl.language.scope import names
from ergon.repl.session import deeds
from ergon.repl.session.clock import Clock, started
from ergon.repl.session.commits import REFUSALS, Commits, Deed, Waiting, faders
from ergon.repl.session.engine import Steps
from ergon.repl.session.journal import Event
from ergon.repl.session.recorded import Replay
from ergon.repl.session.running import JOIN, Running, begin
from ergon.repl.session.version import NotTakenError, Past, Version, piece_of
from ergon.scores.edits.texts import Texts
from ergon.scores.staging.stage import MAX_SECONDS

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

# What a session that is no session makes of the code that plays it again.
_BROKEN = (ArithmeticError, AssertionError, LookupError, RecursionError, TypeError, ValueError)
_BLOCK = 4096  # frames between two looks for what is due


@contextlib.contextmanager
def _done_again(event: Event) -> Iterator[None]:
    """What a line cannot do is said with its place. Raises JournalError."""
    try:
        yield
    except (*REFUSALS, *_BROKEN) as error:
        what = ascii(event.get("line", str)[:80]) if event.name == "line" else "its score"
        event.wrong(f"{what} cannot be played again: {error}")


class Again:
    """A session that is computed again; what `rendering.render` takes for a stage.

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
