"""The running version, staged on an engine, with what still plays of earlier versions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from ergon.notation.clock.positions import Length, Position
from ergon.repl.session.frozen_parts import LoadedPart, place_samples
from ergon.repl.session.rehearsing import keys_for
from ergon.repl.session.struck_places import strike_points
from ergon.scores.reading.playing import NO_OPTIONS, Play
from ergon.scores.staging.preparing import Span
from ergon.scores.staging.stage import StageTakeover, stage
from ergon.scores.staging.version_glides import FadingLink, Glide, with_fading_links

if TYPE_CHECKING:
    from ergon.live.force_bounds import HandForceBounds
    from ergon.notation.clock.tempo import TempoMap
    from ergon.repl.session.clock import Clock
    from ergon.repl.session.version import Version
    from ergon.scores.reading.piece import Piece
    from ergon.scores.staging.live import RealHands
    from ergon.scores.staging.planning import TrialStore
    from ergon.scores.staging.stage import Stage

# Endless parts are put on the timeline this many seconds ahead, with a least and a greatest number
# of bars; they are extended when half of these bars are over. A longer timeline would delay the
# answer to a line; a shorter one could end while a long line is computed.
_AHEAD_SECONDS, _BARS_MIN, _BARS_MAX = 16.0, 4, 32


@dataclass(frozen=True, slots=True)
class RunningVersion:
    """A version that plays from frame `start_frame` on, and spans of earlier versions that go on.

    The timeline has occurrences up to beat `timeline_end`; `force_bounds` are the forces on real
    hands; `fading_links` are removed links that still separate. `frozen` parts are played from
    their samples. If it `is_seen`, parts that are not heard are computed too. `damping_t60` [s] is
    a T60 for all that sounds. Versions of one `serial` differ only by faders and by how far their
    timeline goes. `skipped_from` is the beat from which on nothing began, because the timeline
    before had ended there.
    """

    version: Version
    clock: Clock
    spans: tuple[Span, ...]
    stage: Stage
    start_frame: int
    timeline_end: float
    glides: tuple[Glide, ...] = ()
    force_bounds: Sequence[HandForceBounds] = ()
    fading_links: tuple[FadingLink, ...] = ()
    frozen: tuple[LoadedPart, ...] = ()
    is_seen: bool = False
    damping_t60: float | None = None
    serial: int = 0
    skipped_from: float | None = None

    def beat(self, frame: int) -> float:
        """The beat of the piece at a frame."""
        return self.clock.beat(self.version.piece.tempo_map, frame / self.stage.rate)

    def is_ending(self, from_beat: float) -> bool:
        """Whether more than half of the timeline's bars is over at a beat."""
        if not self.clock.is_running or self.timeline_end == math.inf:
            return False
        tempo_map = self.version.piece.tempo_map
        n_bars = timeline_horizon(tempo_map, from_beat)[1]
        end_bar = tempo_map.bars.bar_beat(self.timeline_end)[0]
        return from_beat > tempo_map.bars.start(end_bar - n_bars // 2)

    def ongoing_gestures(self, frame: int) -> tuple[tuple[str, str], ...]:
        """Pairs of players and gestures at a frame."""
        instant = frame / self.stage.rate
        gestures = self.stage.gestures
        return tuple(
            (gesture.player, gesture.name)
            for gesture in gestures
            if gesture.start <= instant < gesture.stop
        )


def timeline_horizon(tempo_map: TempoMap, from_beat: float) -> tuple[float, int]:
    """The beat up to which endless parts are put on the timeline, seen from `from_beat`, and how
    many bars that is.
    """
    first_bar = tempo_map.bars.bar_beat(from_beat)[0]
    ahead_instant = tempo_map.seconds(from_beat) + _AHEAD_SECONDS
    n_bars = _BARS_MIN
    while (
        n_bars < _BARS_MAX
        and tempo_map.seconds(tempo_map.bars.start(first_bar + n_bars)) < ahead_instant
    ):
        n_bars += _BARS_MIN
    return tempo_map.bars.start(first_bar + n_bars), n_bars


def rehearsal_piece(piece: Piece) -> Piece:
    """A piece in which each player plays each gesture that its key can follow, once.

    It serves to measure the level of the piece.
    """
    rehearsal_plays, starts, start_beat = [], [], 0.0
    keys_by_gesture = {name: keys_for(piece, name) for name in piece.gestures}
    for player in piece.players.values():
        for gesture in piece.gestures.values():
            if player.key not in keys_by_gesture[gesture.name]:
                continue
            play_position, gesture_place = Position(plus=Length(beats=start_beat)), gesture.place
            rehearsal_plays.append(
                Play(
                    player.name,
                    gesture.name,
                    play_position,
                    None,
                    1,
                    None,
                    (),
                    NO_OPTIONS,
                    gesture_place,
                    gesture_place,
                    None,
                )
            )
            starts.append((start_beat,))
            start_beat += max(1.0, gesture.points[-1].at.beats + gesture.points[-1].at.seconds)
    return replace(piece, parts=tuple(rehearsal_plays), starts=tuple(starts))


def stage_first(
    version: Version,
    clock: Clock,
    real_hands: RealHands,
    store: TrialStore | None,
    frozen: tuple[LoadedPart, ...] = (),
    *,
    is_seen: bool = False,
) -> RunningVersion:
    """Stage a version whose piece is stopped, at frame 0."""
    first_stage = stage_spans(
        version, clock, (), None, 0, real_hands, store, frozen=frozen, is_seen=is_seen
    )
    return RunningVersion(
        version, clock, (), first_stage, 0, clock.stopped_beat, frozen=frozen, is_seen=is_seen
    )


def stage_spans(
    version: Version,
    clock: Clock,
    spans: tuple[Span, ...],
    old_stage: Stage | None,
    start_frame: int,
    real_hands: RealHands,
    store: TrialStore | None,
    moving_glides: tuple[Glide, ...] = (),
    leaving_links: tuple[FadingLink, ...] = (),
    *,
    frozen: tuple[LoadedPart, ...],
    is_seen: bool,
) -> Stage:
    """Stage what `spans` play, from frame `start_frame` on, in place of the stage `old_stage`.

    `moving_glides` are parameters that glide, `leaving_links` removed links that still separate.
    """
    piece = with_fading_links(version.sounding, leaving_links)
    tempo_map = clock.engine_tempo_map(
        piece.tempo_map, 0.0 if old_stage is None else start_frame / old_stage.rate
    )
    piece = replace(piece, tempo_map=tempo_map)
    new_stage = stage(
        piece,
        planned=True,
        store=store,
        real_hands=real_hands,
        silent=frozenset(part.name for part in frozen),
        on_fault="mute",
        takeover=StageTakeover(
            spans, old_stage, start_frame, moving_glides, strike_points(version)
        ),
        is_seen=is_seen,
    )
    new_stage.recalled_outputs = place_samples(frozen, new_stage.listening, clock, new_stage.rate)
    return new_stage
