"""Prepares a piece: the network, and the timeline of all events in it."""

from __future__ import annotations

import math
from collections.abc import Container, Hashable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, NamedTuple, Protocol

from ergon import _core
from ergon.instruments.assemble import Assembly
from ergon.notation.clock.shifted import NEVER, StoppedTempoMap
from ergon.notation.text.errors import Collector
from ergon.notation.text.values import Place
from ergon.notation.text.without_gc import without_gc
from ergon.scores.reading.piece import Piece
from ergon.scores.staging.automating import (
    AutomatedPoints,
    automation_points,
    last_complete_instant,
    takeover_points,
)
from ergon.scores.staging.built_network import (
    COUPLING_ENDED_SECONDS,
    BuiltNetwork,
    build_network,
    coupling_spans,
)
from ergon.scores.staging.drawn_notes import DrawnNote, DrawnNotes
from ergon.scores.staging.drives import add_drives, add_inputs
from ergon.scores.staging.hands import ALL_TIME, Hands, Window
from ergon.scores.staging.known_automation import KnownAutomation
from ergon.scores.staging.late_keys import check_delays
from ergon.scores.staging.listening import check_mix
from ergon.scores.staging.live import (
    LiveHand,
    check_players,
    join_hands,
    stand_in_players,
    with_reduced_keys,
)
from ergon.scores.staging.overlap import check_overlaps
from ergon.scores.staging.parameter_values import ModuleKey, Points
from ergon.scores.staging.refusals import StageError, report_refusals, stage_error
from ergon.scores.staging.stage_memory import StageMemory
from ergon.scores.staging.striking import ALL_INSTANTS, Striking
from ergon.scores.staging.takes import Takes
from ergon.scores.staging.travel import check_travel

if TYPE_CHECKING:
    from ergon.scores.staging.live import RealHands

TAIL_DURATION_MAX = 60.0  # [s] of a score whose tail is `auto`
DURATION_MAX = 24 * 3600.0  # a day; a longer piece is a mistake


class EarlierStage(Protocol):
    """A stage that was prepared before, whose results may be reused."""

    built_network: BuiltNetwork
    takes: Mapping[Hashable, _core.Take]
    paths: Mapping[ModuleKey, Points]
    paths_end: float
    memory: StageMemory
    drawn_notes: Sequence[DrawnNote]


class Span(NamedTuple):
    """A stretch of a session: the part of a piece that it plays."""

    piece: Piece
    window: Window


@dataclass(slots=True)
class PreparedPiece:
    """A piece without its simulation. `collector` holds warnings and notes."""

    built_network: BuiltNetwork
    timeline: _core.Timeline
    n_frames: int
    hands: Hands
    collector: Collector
    live_hands: tuple[LiveHand, ...]
    paths: Mapping[ModuleKey, Points]
    paths_until: float
    fade_start: int | None
    memory: StageMemory
    drawn_notes: Sequence[DrawnNote]

    @property
    def network(self) -> _core.Network:
        """The network of the modules."""
        return self.built_network.network


@without_gc
def prepare(
    piece: Piece,
    real_hands: RealHands | None = None,
    silent: Container[str] = (),
    spans: Sequence[Span] | None = None,
    old_stage: EarlierStage | None = None,
    start: int = 0,
) -> PreparedPiece:
    """Build the network and the timeline of a piece. Raises StageError with every mistake found.

    `real_hands`: players whose hands are real, with their position at every tick if it is known;
    `silent`: instruments that are not listened to; `spans`: what parts of this piece and of earlier
    ones play, by default all of this one; `old_stage`: a stage whose takes, and whose network if
    it is the same, are reused; `start`: the frame at which this stage takes over from
    `old_stage`.
    """
    collector = Collector()
    real_hands = stand_in_players(piece) | dict(real_hands or {})
    check_players(piece, real_hands, collector)
    memory = StageMemory() if old_stage is None else old_stage.memory
    known_automation = memory.automation
    try:
        computed_piece = with_reduced_keys(piece, real_hands)
        built = (
            old_stage and old_stage.built_network.for_piece(computed_piece, silent)
        ) or build_network(computed_piece, silent)
        assembly, couplings = built.assembly, built.coupling_links
        timeline = _core.Timeline(assembly.network, piece.rate)
        if piece.accuracy.is_unguarded:
            timeline.leave_unguarded()
        for (part, module), port in assembly.ports.items():
            timeline.delay_forces(port, assembly.mats[part, module], piece.keys[part].delay)
        takes = Takes(piece, collector, old_stage.takes if old_stage else {})
        hands = Hands(piece, timeline, takes, collector)
        # A session has no end up to which a stand-in could play.
        is_resting = spans is not None
        live_hands = tuple(
            join_hands(piece, real_hands, assembly, timeline, collector, is_resting=is_resting)
        )
        played_spans = [Span(piece, ALL_TIME)] if spans is None else spans
        inputs = add_inputs(piece, timeline, takes)
        add_drives(piece, assembly, hands, {name: index for name, (index, _) in inputs.items()})
        takeover_instant = -math.inf if old_stage is None else start / piece.rate
        drawn_notes = DrawnNotes(
            timeline, old_stage.drawn_notes if old_stage else (), takeover_instant, piece.rate
        )
        events_end = _put_events(
            piece, assembly, hands, couplings, real_hands, played_spans, memory, drawn_notes
        )
        end_instant = max(events_end, _hands_end(piece, live_hands))
        end_instant = max([end_instant, *(seconds for _, seconds in inputs.values())])
        check_overlaps(piece, hands.gestures, collector)
        check_travel(piece, timeline, hands.gestures, collector)
        check_delays(computed_piece, collector)
        check_mix(piece, collector)
        n_frames = _n_frames(piece, end_instant, collector) if spans is None else 0
        (paths, permanent_modules), paths_until = _automation_of_spans(
            piece, spans, n_frames, collector, takeover_instant, known_automation
        )
        if old_stage is not None:
            paths = takeover_points(
                old_stage.paths,
                paths,
                piece,
                takeover_instant,
                old_stage.paths_end,
                permanent_modules,
                known_automation,
            )
        _put_paths(piece, paths, assembly, timeline, known_automation, collector)
    except _core.EngineError as error:
        raise stage_error(piece, collector, error) from error
    if collector.has_errors():
        raise StageError(collector.finish())
    fade_start = int(end_instant * piece.rate + 0.5) if piece.render.tail == "auto" else None
    path_arguments = paths, paths_until
    piece_arguments = built, timeline, n_frames, hands, collector, live_hands
    return PreparedPiece(*piece_arguments, *path_arguments, fade_start, memory, drawn_notes.notes)


def _automation_of_spans(
    piece: Piece,
    piece_spans: Sequence[Span] | None,
    n_frames: int,
    collector: Collector,
    begin_instant: float,
    known_automation: KnownAutomation,
) -> tuple[AutomatedPoints, float]:
    """The points of automated modules, up to the end of the piece or of its last stretch, and the
    instant up to which they are complete [s]. A stretch needs them from `begin_instant` [s] on.
    """
    tempo = piece.tempo_map
    if not piece.automation and not any(strikes.moves_pitches for strikes in piece.strikes):
        return AutomatedPoints({}), math.inf
    if piece_spans is None:
        end = tempo.beats(n_frames / piece.rate)
        return automation_points(piece, -math.inf, end, collector), math.inf
    if isinstance(tempo, StoppedTempoMap) or not piece_spans:
        stopped_beat = tempo.beats(0.0)
        return automation_points(piece, stopped_beat, stopped_beat, collector), math.inf
    since, until, _ = piece_spans[-1].window
    points = automation_points(piece, since, until, collector, begin_instant, known_automation)
    return points, last_complete_instant(piece, until)


def _put_paths(
    piece: Piece,
    paths: Mapping[ModuleKey, Points],
    assembly: Assembly,
    timeline: _core.Timeline,
    known_automation: KnownAutomation,
    collector: Collector,
) -> None:
    """Put the points of automated modules on the timeline, and report those that it refuses."""
    for module_key, points in paths.items():
        if automated_module := known_automation.automated_module(piece, module_key):
            try:
                automated_module.put_points(timeline, assembly, module_key, points)
            except _core.EngineError as error:
                report_refusals(piece, collector, error)


def _hands_end(piece: Piece, live_hands: Sequence[LiveHand]) -> float:
    """When the parts of real hands have ended [s]."""
    return max((hand.tick_frames * hand.n_ticks / piece.rate for hand in live_hands), default=0.0)


def _put_events(
    piece: Piece,
    assembly: Assembly,
    hands: Hands,
    couplings: Sequence[int],
    real_hands: RealHands,
    piece_spans: Sequence[Span],
    memory: StageMemory,
    drawn_notes: DrawnNotes,
) -> float:
    """Put all virtual events on the timeline; returns when the last one ends [s]."""
    timeline = hands.timeline
    live_keys = {piece.players[name].key for name in real_hands}
    for name, key in piece.keys.items():
        if name not in live_keys:
            hands.add_key(name, assembly.mats[name, key.struck])
    for played_piece, window in piece_spans:
        span_hands = hands if window is ALL_TIME else hands.for_piece(played_piece, window)
        span_hands.play_parts(
            played_piece, live_keys, None if live_keys else memory.unfinished_lines
        )
    players = [
        player for player in piece.players.values() if player.hand == "live" and player.standin
    ]
    names_with_part = {*real_hands}
    if players:
        names_with_part |= {play.player for play in piece.parts}
    for player in players:
        if player.name not in names_with_part:
            hands.play_standin(player)
    event_ends = [gesture.stop for gesture in hands.gestures]
    for played_piece, window in piece_spans:
        span_instants = _window_instants(played_piece, window)
        for strikes in memory.strikes.unfinished(played_piece, window.since_beat):
            targets = (
                struck_target
                for struck_target in strikes.to
                if (struck_target.part, struck_target.module) in assembly.mats
            )
            mats = [mat for target in targets for mat in assembly.members(target)]
            source = hands.ergon_places.add(partial(_same_place, strikes.place))
            striking = Striking(
                played_piece, timeline, strikes, mats, source, span_instants, assembly, drawn_notes
            )
            event_ends.append(striking.play(hands.collector))
    drawn_notes.end_discontinued_notes(
        assembly.mats.get, hands.ergon_places.add(partial(_same_place, piece.place))
    )
    for link, (begin, until) in zip(couplings, coupling_spans(piece), strict=True):
        if until == COUPLING_ENDED_SECONDS:
            begin, until = NEVER, None
        timeline.couple(link, begin, until)
    return max(event_ends, default=0.0)


def _window_instants(piece: Piece, window: Window) -> tuple[float, float]:
    """The instants of a window [s], in the engine's time."""
    if window is ALL_TIME:
        return ALL_INSTANTS
    tempo = piece.tempo_map
    start_instant = tempo.seconds(window.since_beat) if window.since_beat > -math.inf else 0.0
    stop_instant = tempo.seconds(window.until_beat) if window.until_beat < math.inf else math.inf
    return max(0.0, start_instant), stop_instant


def _n_frames(piece: Piece, end: float, collector: Collector) -> int:
    """⌈(end + tail)·rate⌉ frames; rounding errors do not add a frame."""
    tail = piece.render.tail
    duration = end + (TAIL_DURATION_MAX if tail == "auto" else tail)
    if duration > DURATION_MAX:
        message = f"the piece lasts {duration / 3600:.0f} hours; the maximum is 24 hours"
        collector.error("E308", message, piece.place)
        return 0
    frames = duration * piece.rate
    nearest_frames = int(frames + 0.5)
    return nearest_frames if abs(frames - nearest_frames) < 1e-6 else int(frames) + 1


def _same_place(place: Place) -> Place:
    return place
