"""What plays: stretches of versions, each with its own tempo and gestures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from ergon.notation.clock.positions import Length, Position
from ergon.scores.reading.piece import UNSAID, Play
from ergon.scores.staging.gliding import Glide, glides
from ergon.scores.staging.hands import Window
from ergon.scores.staging.stage import Going, Span, stage

if TYPE_CHECKING:
    from ergon.live.guard import HandForceBounds
    from ergon.repl.session.clock import Clock
    from ergon.repl.session.version import Version
    from ergon.scores.reading.piece import Piece
    from ergon.scores.staging.live import Real
    from ergon.scores.staging.planning import Store
    from ergon.scores.staging.stage import Stage

# What repeats is put on the timeline for so many bars, and for as many again when half are over:
# a version of four players costs some 10 ms.
HORIZON = 32
# A curve that joins a gesture begins before it; what takes over does so before that [s].
JOIN = 0.02


@dataclass(frozen=True, slots=True)
class Running:
    """A version from an engine's frame `start` on, and stretches of those before it.

    Occurrences up to beat `until` are on the timeline; `bearings` are what real hands get of it.
    """

    version: Version
    clock: Clock
    spans: tuple[Span, ...]
    stage: Stage
    start: int
    until: float
    glides: tuple[Glide, ...] = ()
    bearings: Sequence[HandForceBounds] = ()

    def beat(self, frame: int) -> float:
        """Where the piece is at a frame."""
        return self.clock.beat(self.version.piece.tempo_map, frame / self.stage.rate)

    def in_flight(self, frame: int) -> tuple[tuple[str, str], ...]:
        """Who plays what at a frame."""
        at = frame / self.stage.rate
        gestures = self.stage.gestures
        return tuple((g.player, g.name) for g in gestures if g.start <= at < g.stop)


def rehearsal(piece: Piece) -> Piece:
    """A piece that plays nothing, with every gesture once on every player's key: how loud it is."""
    plays, starts, beat = [], [], 0.0
    for player in piece.players.values():
        for gesture in piece.gestures.values():
            at, place = Position(plus=Length(beats=beat)), gesture.place
            plays.append(
                Play(player.name, gesture.name, at, None, 1, None, (), UNSAID, place, place, None)
            )
            starts.append((beat,))
            beat += max(1.0, gesture.points[-1].at.beats + gesture.points[-1].at.seconds)
    return replace(piece, parts=tuple(plays), starts=tuple(starts))


def begin(version: Version, clock: Clock, real: Real, store: Store | None) -> Running:
    """A version whose piece stands, at the engine's first frame."""
    staged = _staged(version, clock, (), None, 0, real, store)
    return Running(version, clock, (), staged, 0, clock.at)


def follow(
    before: Running,
    version: Version,
    clock: Clock,
    start: int,
    *,
    leave: float,
    enter: float,
    real: Real,
) -> Running:
    """A version that takes over at frame `start`.

    What the one before began by beat `leave` goes on, and the new one plays from beat `enter`.
    """
    after = start / before.stage.rate
    old = () if version.cuts else tuple(_left(before, leave, after))
    bars = version.piece.tempo_map.bars
    until = bars.start(bars.bar_beat(enter)[0] + HORIZON)
    piece = replace(version.piece, tempo_map=clock.tempo(version.piece.tempo_map, after))
    new = (Span(piece, Window(enter, until, after)),) if clock.goes else ()
    pieces = before.version.piece, version.piece
    moving = glides(*pieces, before.glides, after, version.glide)
    staged = _staged(version, clock, (*old, *new), before.stage, start, real, None, moving)
    return Running(version, clock, (*old, *new), staged, start, until, moving)


def _left(before: Running, leave: float, after: float) -> Sequence[Span]:
    """Stretches that were before, up to a beat, of which something goes on after an instant [s]."""
    on = [(gesture.start, gesture.stop) for gesture in before.stage.gestures]
    kept = []
    for index, (piece, window) in enumerate(before.spans):
        is_last = index == len(before.spans) - 1 and before.clock.goes
        until = min(window.until, leave) if is_last else window.until
        first, last = (piece.tempo_map.seconds(beat) for beat in (window.since, until))
        if last > after or any(
            first - JOIN <= start <= last and stop > after for start, stop in on
        ):
            kept.append(Span(piece, Window(window.since, until, after)))
    return kept


def _staged(
    version: Version,
    clock: Clock,
    spans: tuple[Span, ...],
    like: Stage | None,
    start: int,
    real: Real,
    store: Store | None,
    moving: tuple[Glide, ...] = (),
) -> Stage:
    piece = version.piece
    tempo = clock.tempo(piece.tempo_map, 0.0 if like is None else start / like.rate)
    piece = replace(piece, tempo_map=tempo)
    return stage(
        piece,
        planned=True,
        store=store,
        real=real,
        on_fault="mute",
        going=Going(spans, like, start, moving),
    )
