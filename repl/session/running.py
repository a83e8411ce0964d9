"""The running version, staged on an engine, with what still plays of earlier versions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from ergon.notation.clock.positions import Length, Position
from ergon.repl.session.frozen_parts import LoadedPart, place_samples, still_frozen
from ergon.repl.session.midi_maps import strike_points
from ergon.repl.session.rehearsing import keys_for
from ergon.scores.reading.piece import NO_OPTIONS, Play
from ergon.scores.staging.hands import Window
from ergon.scores.staging.preparing import Span
from ergon.scores.staging.stage import StageTakeover, stage
from ergon.scores.staging.version_glides import (
    Glide,
    LeavingLink,
    glides,
    leaving_links,
    with_leaving,
)

if TYPE_CHECKING:
    from ergon.live.force_bounds import HandForceBounds
    from ergon.notation.clock.tempo import TempoMap
    from ergon.repl.session.clock import Clock
    from ergon.repl.session.version import Version
    from ergon.scores.reading.piece import Piece
    from ergon.scores.staging.live import Real
    from ergon.scores.staging.planning import Store
    from ergon.scores.staging.stage import Stage

# Endless parts are put on the timeline this many seconds ahead, with a least and a greatest number
# of bars; they are extended when half of these bars are over. A longer timeline would delay the
# answer to a line; a shorter one could end while a long line is computed.
_AHEAD, _FEWEST_BARS, _MOST_BARS = 16.0, 4, 32
# The joining curve before a gesture [s]; a version takes over before it begins.
JOIN_SECONDS = 0.02


@dataclass(frozen=True, slots=True)
class RunningVersion:
    """A version that plays from frame `start` on, and spans of earlier versions that go on.

    The timeline has occurrences up to beat `timeline_end`; `force_bounds` are the forces on real
    hands; `leaving` are removed links that still separate. `frozen` parts are played from their
    samples. If it `is_seen`, parts that are not heard are computed too.
    """

    version: Version
    clock: Clock
    spans: tuple[Span, ...]
    stage: Stage
    start: int
    timeline_end: float
    glides: tuple[Glide, ...] = ()
    force_bounds: Sequence[HandForceBounds] = ()
    leaving: tuple[LeavingLink, ...] = ()
    frozen: tuple[LoadedPart, ...] = ()
    is_seen: bool = False

    def beat(self, frame: int) -> float:
        """The beat of the piece at a frame."""
        return self.clock.beat(self.version.piece.tempo_map, frame / self.stage.rate)

    def in_flight(self, frame: int) -> tuple[tuple[str, str], ...]:
        """Who plays what at a frame."""
        at = frame / self.stage.rate
        gestures = self.stage.gestures
        return tuple((g.player, g.name) for g in gestures if g.start <= at < g.stop)


def horizon(tempo: TempoMap, beat: float) -> tuple[float, int]:
    """The beat up to which endless parts are put on the timeline, seen from `beat`, and how many
    bars that is.
    """
    first, reached = tempo.bars.bar_beat(beat)[0], tempo.seconds(beat) + _AHEAD
    n_bars = _FEWEST_BARS
    while n_bars < _MOST_BARS and tempo.seconds(tempo.bars.start(first + n_bars)) < reached:
        n_bars += _FEWEST_BARS
    return tempo.bars.start(first + n_bars), n_bars


def rehearsal(piece: Piece) -> Piece:
    """A piece in which each player plays each gesture that its key can follow, once.

    It serves to measure the level of the piece.
    """
    plays, starts, beat = [], [], 0.0
    able = {name: keys_for(piece, name) for name in piece.gestures}
    for player in piece.players.values():
        for gesture in piece.gestures.values():
            if player.key not in able[gesture.name]:
                continue
            at, place = Position(plus=Length(beats=beat)), gesture.place
            plays.append(
                Play(
                    player.name, gesture.name, at, None, 1, None, (), NO_OPTIONS, place, place, None
                )
            )
            starts.append((beat,))
            beat += max(1.0, gesture.points[-1].at.beats + gesture.points[-1].at.seconds)
    return replace(piece, parts=tuple(plays), starts=tuple(starts))


def stage_first(
    version: Version,
    clock: Clock,
    real: Real,
    store: Store | None,
    frozen: tuple[LoadedPart, ...] = (),
    *,
    is_seen: bool = False,
) -> RunningVersion:
    """Stage a version whose piece is stopped, at frame 0."""
    staged = _staged(version, clock, (), None, 0, real, store, frozen=frozen, is_seen=is_seen)
    return RunningVersion(
        version, clock, (), staged, 0, clock.stopped_beat, frozen=frozen, is_seen=is_seen
    )


def stage_next(
    before: RunningVersion,
    version: Version,
    clock: Clock,
    start: int,
    *,
    leave: float,
    enter: float,
    real: Real,
    extends: bool = False,
) -> RunningVersion:
    """Stage a version that takes over at frame `start`.

    What the version before began by beat `leave` goes on; the new one plays from beat `enter`. A
    version that only `extends` the timeline keeps all glides, removed links and frozen parts, so
    that it is inaudible at whichever frame it comes.
    """
    after = start / before.stage.rate
    old = () if version.ends_gestures else tuple(_continuing_spans(before, leave, after))
    until = horizon(version.piece.tempo_map, enter)[0]
    piece = replace(version.sounding, tempo_map=clock.tempo(version.piece.tempo_map, after))
    new = (Span(piece, Window(enter, until, after)),) if clock.is_running else ()
    moving, links, frozen = before.glides, before.leaving, before.frozen
    if not extends:
        frozen = still_frozen(frozen, before.version, version, real)
        pieces = before.version.sounding, version.sounding
        moving = glides(*pieces, before.glides, after, version.glide)
        links = leaving_links(*pieces, before.glides, before.leaving, after)
        moving = (*moving, *(one.glide for one in links))
    spans = (*old, *new)
    staged = _staged(
        version,
        clock,
        spans,
        before.stage,
        start,
        real,
        None,
        moving,
        links,
        frozen=frozen,
        is_seen=before.is_seen,
    )
    of_stage = version, clock, spans, staged, start, until, moving, (), links, frozen
    return RunningVersion(*of_stage, is_seen=before.is_seen)


def _continuing_spans(before: RunningVersion, leave: float, after: float) -> Sequence[Span]:
    """The spans of earlier versions, the last one cut at a beat, of which something goes on after
    `after` [s].
    """
    on = [(gesture.start, gesture.stop) for gesture in before.stage.gestures]
    kept = []
    for index, (piece, window) in enumerate(before.spans):
        is_last = index == len(before.spans) - 1 and before.clock.is_running
        until = min(window.until, leave) if is_last else window.until
        first, last = (piece.tempo_map.seconds(beat) for beat in (window.since, until))
        if last > after or any(
            first - JOIN_SECONDS <= start <= last and stop > after for start, stop in on
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
    links: tuple[LeavingLink, ...] = (),
    *,
    frozen: tuple[LoadedPart, ...],
    is_seen: bool,
) -> Stage:
    piece = with_leaving(version.sounding, links)
    tempo = clock.tempo(piece.tempo_map, 0.0 if like is None else start / like.rate)
    piece = replace(piece, tempo_map=tempo)
    staged = stage(
        piece,
        planned=True,
        store=store,
        real=real,
        silent=frozenset(part.name for part in frozen),
        on_fault="mute",
        going=StageTakeover(spans, like, start, moving, strike_points(version)),
        is_seen=is_seen,
    )
    staged.placed = place_samples(frozen, staged.listening, clock, staged.rate)
    return staged
