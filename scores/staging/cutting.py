"""A stage whose events end while it plays, made of the stage alone: for what must act at once."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

from ergon import _core
from ergon.instruments.assemble import Assembly
from ergon.notation.clock.meter import SAME
from ergon.notation.clock.positions import Length, Position
from ergon.notation.clock.shifted import StoppedTempoMap
from ergon.notation.text.errors import Collector
from ergon.notation.text.without_gc import without_gc
from ergon.scores.reading.piece import Piece, Strikes
from ergon.scores.staging.automating import AutomatedPoints, automation_points, takeover_points
from ergon.scores.staging.drawn_notes import DrawnNotes
from ergon.scores.staging.parameter_curves import GRID_FRAMES
from ergon.scores.staging.parameter_values import AutomatedModule, ModuleKey, Points
from ergon.scores.staging.planning import Watched, plan_again
from ergon.scores.staging.stage import Stage

_ROUNDING_TOLERANCE = 1e-9  # rounding, not music
_Paths = Mapping[ModuleKey, Points]


@without_gc
def cut_stage(
    stage: Stage, frame: int, *, ends_gestures: bool, is_stopped: bool, resets_masses: bool = False
) -> Stage:
    """The stage that takes over from `stage` at `frame`, and begins nothing from there on.

    Gestures in flight go on to their end, or end too if it `ends_gestures`. Notes that draw or
    press end, unless it `resets_masses` all masses. If it is stopped (`is_stopped`), the piece
    stands on the beat of the frame: automation and couplings stay as they are there. Glides
    of typed values and drives go on in any case; frozen parts end. Raises EngineError and
    StoppedError.
    """
    assert stage.timeline is not None
    cut_instant = frame / stage.rate
    ongoing = [] if ends_gestures else _ongoing_gestures(stage, cut_instant)
    timeline = stage.timeline.cut(frame, ongoing, stops=is_stopped)
    mat_of, rate = stage.built_network.assembly.mats.get, stage.rate
    DrawnNotes(
        timeline, () if resets_masses else stage.drawn_notes, cut_instant, rate
    ).end_discontinued_notes(mat_of, 0)
    piece = _piece_at_instant(stage.piece, cut_instant) if is_stopped else stage.piece
    paths, paths_until = _paths_from(stage, piece, cut_instant, is_stopped=is_stopped)
    _replace_paths(piece, stage.built_network.assembly, timeline, stage.paths, paths)
    plan = None
    if stage.plan is not None:
        accuracy = stage.planned_accuracy or piece.accuracy
        plan = plan_again(
            stage.network, timeline, accuracy, stage.plan, _watched_parts(piece, stage.plan)
        )
    return replace(
        stage,
        piece=piece,
        simulation=_core.Simulation(
            stage.network, timeline, plan=plan, start=frame, on_fault="mute"
        ),
        n_frames=0,
        drawn_notes=(),
        gestures=[stage.gestures[index] for index in ongoing],
        diagnostics=[],
        plan=plan,
        is_plan_kept=False,
        paths=paths,
        paths_end=paths_until,
        recalled_outputs=(),
        timeline=timeline,
    )


def _ongoing_gestures(stage: Stage, cut_instant: float) -> list[int]:
    """The gestures that have begun before an instant [s] and end after it, by their numbers."""
    return [
        index
        for index, gesture in enumerate(stage.gestures)
        if gesture.written_start < cut_instant - _ROUNDING_TOLERANCE and gesture.stop > cut_instant
    ]


def _piece_at_instant(piece: Piece, instant: float) -> Piece:
    """The piece standing on the beat of an instant [s]."""
    tempo = piece.tempo_map
    return replace(piece, tempo_map=StoppedTempoMap(tempo, max(0.0, tempo.beats(instant)), instant))


def _watched_parts(piece: Piece, plan: _core.Plan) -> Watched:
    """The parts that are computed to be seen, as in an earlier plan."""
    all_parts = (*piece.keys, *piece.instruments) if plan.seen() else ()
    return Watched(seen=all_parts, seen_every=piece.motion_step_frames)


def _paths_from(
    stage: Stage, piece: Piece, instant: float, *, is_stopped: bool
) -> tuple[_Paths, float]:
    """The points of automation from an instant [s] on, and the instant up to which they are
    complete [s].
    """
    collector = Collector()  # a piece that plays has no mistakes in its automation
    if is_stopped:
        start_beat = piece.tempo_map.beats(0.0)
        automated_points = automation_points(piece, start_beat, start_beat, collector)
        return _continued_paths(stage, stage.paths, automated_points, piece, instant), float("inf")
    struck_parts = {
        target.part for strikes in piece.strikes if strikes.moves_pitches for target in strikes.to
    }
    if not struck_parts or isinstance(piece.tempo_map, StoppedTempoMap):
        return stage.paths, stage.paths_end
    # The pitches of notes that are not struck any more.
    tempo = piece.tempo_map
    cut_beat = tempo.beats(instant)
    notes_piece = replace(
        piece,
        strikes=tuple(_strikes_before(piece, cut_beat)),
        automation=tuple(
            automation_entry
            for automation_entry in piece.automation
            if any(part in struck_parts for part, _ in automation_entry.modules)
        ),
    )
    last_instant = stage.paths_end + 2 * GRID_FRAMES / stage.rate
    until_beat = tempo.beats(last_instant) if last_instant < float("inf") else cut_beat
    automated_points = automation_points(
        notes_piece, cut_beat, max(cut_beat, until_beat), collector
    )
    struck_paths = {
        module_key: old_points
        for module_key, old_points in stage.paths.items()
        if module_key[0] in struck_parts
    }
    other_paths = {
        module_key: old_points
        for module_key, old_points in stage.paths.items()
        if module_key[0] not in struck_parts
    }
    return {
        **other_paths,
        **_continued_paths(stage, struck_paths, automated_points, piece, instant),
    }, stage.paths_end


def _continued_paths(
    stage: Stage,
    old_paths: _Paths,
    automated_points: AutomatedPoints,
    piece: Piece,
    cut_instant: float,
) -> _Paths:
    complete_end = stage.paths_end
    return takeover_points(
        old_paths,
        automated_points.points,
        piece,
        cut_instant,
        complete_end,
        automated_points.permanent_modules,
    )


def _strikes_before(piece: Piece, cut_beat: float) -> Iterator[Strikes]:
    """The strikes with notes that have begun by a beat, ended there."""
    tempo, end_position = piece.tempo_map, Position(plus=Length(beats=cut_beat))
    for strikes in piece.strikes:
        begin_beat, stop_beat = tempo.resolve(strikes.at), None
        if not strikes.moves_pitches or begin_beat >= cut_beat - SAME:
            continue
        if strikes.span is not None:
            stop_beat = tempo.after(begin_beat, strikes.span)
        elif strikes.until is not None:
            stop_beat = tempo.resolve(strikes.until)
        is_over = stop_beat is not None and stop_beat <= cut_beat + SAME
        yield strikes if is_over else replace(strikes, span=None, until=end_position)


def _replace_paths(
    piece: Piece, assembly: Assembly, timeline: _core.Timeline, old_paths: _Paths, new_paths: _Paths
) -> None:
    """Replace the points of automation on a timeline. Raises EngineError."""
    mat_ranges: list[tuple[int, int]] = []
    link_ranges: list[tuple[int, int]] = []
    for module_key in old_paths:
        automated_module = AutomatedModule.from_piece(piece, module_key)
        if automated_module is None:
            continue
        if automated_module.module.kind in ("CEL", "BANK"):
            mat_ranges.append((assembly.mats[module_key], automated_module.cost))
        else:
            links = assembly.links_of(module_key)
            link_ranges.append((links.start, len(links)))
    timeline.release(mat_ranges, link_ranges)
    for module_key, points in new_paths.items():
        if automated_module := AutomatedModule.from_piece(piece, module_key):
            automated_module.put_points(timeline, assembly, module_key, points)
