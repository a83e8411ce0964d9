"""When every gesture begins, as far as the score's text tells: the number of occurrences, and bar
checks.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ergon.notation.clock.occurrences import MAX_OCCURRENCES, starts
from ergon.notation.clock.positions import Length
from ergon.notation.text.errors import Collector, TextError, quote
from ergon.notation.text.values import Place
from ergon.scores.gesture.notation import BarCheck
from ergon.scores.gesture.transforms import MidpointChance, Transform, apply, apply_to_take
from ergon.scores.pattern.steps import entry_place_beats
from ergon.scores.reading.known_plays import KnownPlays
from ergon.scores.reading.piece import Piece, Strikes
from ergon.scores.reading.playing import Gesture, Play

# The length of a gesture, and one sentence for each thing that its transformations lost.
_LengthAndDropped = tuple[Length, tuple[str, ...]]
_NOTHING_DROPPED: tuple[str, ...] = ()

MAX_STRIKES = 2_000_000  # strikes in a piece: some 340 MB


def start_beats(
    piece: Piece, begin_beats: Sequence[float], known_plays: KnownPlays, collector: Collector
) -> tuple[Sequence[float] | None, ...]:
    """Beats on which each line of the parts is played; None if only a take's file can tell.

    `begin_beats` are the beats on which the lines begin; lines in `known_plays` are not computed
    again. Reports occurrences without end, bar checks that are not on a bar (W311), and points that
    transformations lose (W315).
    """
    line_starts = _all_starts(piece, begin_beats, known_plays, collector)
    strike_counts = known_plays.recall("counts", piece.strikes, piece.seed)
    if not strike_counts.unknown_indices:
        return line_starts
    n_left = float(MAX_STRIKES) - sum(count for count in strike_counts.values if count is not None)
    for strikes_index in strike_counts.unknown_indices:
        n_reports = collector.n_reports
        n_strikes = _strike_count(piece.strikes[strikes_index], piece, n_left, collector)
        if collector.n_reports == n_reports:
            strike_counts.values[strikes_index] = n_strikes
        n_left -= n_strikes
    known_plays.keep_values("counts", strike_counts, piece.seed)
    return line_starts


def _all_starts(
    piece: Piece, begin_beats: Sequence[float], known_plays: KnownPlays, collector: Collector
) -> tuple[Sequence[float] | None, ...]:
    """Beats on which each line of the parts is played; lines in `known_plays` are not computed
    again.
    """
    known_starts = known_plays.known_starts(piece)
    if not known_starts.unknown_indices:
        return known_plays.start_beats(known_starts)
    known_lengths: dict[tuple[str, tuple[Transform, ...], float], _LengthAndDropped] = {}
    n_left = MAX_OCCURRENCES - sum(
        starts_and_count[1]
        for starts_and_count in known_starts.values
        if starts_and_count is not None
    )
    reported_beats: dict[int, Sequence[float] | None] = {}
    for line_index in known_starts.unknown_indices:
        n_reports = collector.n_reports
        line_beats = _line_beats(
            piece,
            piece.parts[line_index],
            begin_beats[line_index],
            known_lengths,
            n_left,
            collector,
        )
        n_beats = 0 if line_beats is None else len(line_beats)
        n_left -= n_beats
        if collector.n_reports == n_reports:
            known_starts.values[line_index] = line_beats, n_beats
        else:
            reported_beats[line_index] = line_beats
    known_plays.keep_starts(piece, known_starts)
    if not reported_beats:
        return known_plays.start_beats(known_starts)
    return tuple(
        [
            starts_and_count[0] if starts_and_count else reported_beats[number]
            for number, starts_and_count in enumerate(known_starts.values)
        ]
    )


def _line_beats(
    piece: Piece,
    part_play: Play,
    begin_beat: float,
    known_lengths: dict[tuple[str, tuple[Transform, ...], float], _LengthAndDropped],
    n_left: int,
    collector: Collector,
) -> Sequence[float] | None:
    """Beats on which a line is played; None if only a take's file can tell."""
    if part_play.pattern is not None:
        return _pattern_beats(piece, part_play, begin_beat, known_lengths, n_left, collector)
    line_beats = None
    gesture = piece.gestures.get(part_play.played_text)
    gesture_length, dropped_reasons = Length(), _NOTHING_DROPPED
    if gesture is not None:
        gesture_length, dropped_reasons = _gesture_length(
            piece, gesture, part_play, begin_beat, known_lengths
        )
    for dropped_reason in dropped_reasons:
        collector.error(
            "W315", f"{quote(part_play.played_text)}: {dropped_reason}", part_play.place
        )
    if gesture is not None or (
        _check_take_transforms(part_play, collector) and part_play.every is not None
    ):
        line_beats = _repetition_beats(
            piece, part_play, begin_beat, gesture_length, n_left, collector
        )
    if gesture is not None and gesture.bar_checks and not part_play.do:
        _check_bar_lines(piece, gesture, line_beats[:1] if line_beats else [], collector)
    return line_beats


def _pattern_beats(
    piece: Piece,
    part_play: Play,
    begin_beat: float,
    known_lengths: dict[tuple[str, tuple[Transform, ...], float], _LengthAndDropped],
    n_left: int,
    collector: Collector,
) -> Sequence[float]:
    """Beats on which the places of a pattern begin."""
    assert part_play.pattern is not None
    tempo, length_by_name = piece.tempo_map, {}
    for gesture_name in part_play.names:
        gesture = piece.gestures.get(gesture_name)
        if gesture is None:
            for transforms in part_play.transform_chains:
                _check_take_transforms(
                    replace(part_play, played_text=gesture_name, do=transforms), collector
                )
            continue
        length_by_name[gesture_name], dropped_reasons = _gesture_length(
            piece, gesture, part_play, begin_beat, known_lengths
        )
        for dropped_reason in dropped_reasons:
            collector.error("W315", f"{quote(gesture_name)}: {dropped_reason}", part_play.place)
    try:
        return entry_place_beats(
            tempo,
            begin_beat,
            part_play.place_sequence(piece.seed),
            step_length=part_play.every,
            times=part_play.times,
            end_beat=None if part_play.until is None else tempo.resolve(part_play.until),
            length_of_name=length_by_name.get,
            places_left=n_left,
        )
    except TextError as error:
        code = error.code if error.code != "E204" else "E305"
        collector.error(code, f"{quote(part_play.played_text)}: {error.message}", part_play.place)
        return ()


def _repetition_beats(
    piece: Piece,
    part_play: Play,
    begin_beat: float,
    gesture_length: Length,
    n_left: int,
    collector: Collector,
) -> list[float]:
    tempo = piece.tempo_map
    until_beat = None if part_play.until is None else tempo.resolve(part_play.until)
    try:
        return starts(
            tempo,
            begin_beat,
            gesture_length,
            every=part_play.every,
            times=part_play.times,
            until=until_beat,
            room=n_left,
        )
    except TextError as error:
        collector.error("E305", f"{quote(part_play.played_text)}: {error.message}", part_play.place)
        return []


def _strike_count(strikes: Strikes, piece: Piece, n_left: float, collector: Collector) -> float:
    """The number of strikes; reports an error if there are more than `n_left`, before any is
    drawn.
    """
    tempo = piece.tempo_map
    start_beat = tempo.resolve(strikes.at)
    if strikes.until is not None:
        stop_beat = tempo.resolve(strikes.until)
    else:
        stop_beat = (
            tempo.after(start_beat, strikes.span) if strikes.span is not None else start_beat
        )
    striking_seconds = tempo.seconds(stop_beat) - tempo.seconds(start_beat)
    n_steps = 1.0
    if strikes.rhythm is not None:
        if strikes.stop_beat(tempo) is None and strikes.times is None:
            message = f"strikes {quote(strikes.name)}: the rhythm has no end; write `times`, `for` "
            collector.error("E103", message + "or `until`", strikes.place)
            return 0.0
        try:
            draws = piece.seed, strikes.draw_key
            strikes_per_cycle = strikes.rhythm.strokes_per_cycle(tempo, start_beat, draws)
        except TextError as error:
            message = f"strikes {quote(strikes.name)}: {error.message}"
            collector.error("E305", message, strikes.place)
            return 0.0
        return _count_within(
            strikes, float(strikes.cycles(tempo) * strikes_per_cycle), n_left, collector
        )
    if strikes.has_rounds:
        try:
            n_targets = sum(target.count for hit in strikes.hits for target in hit.to)
            if strikes.passing is not None:
                n_targets = (
                    sum(passed_target.count for passed_target in strikes.to)
                    * strikes.passing.visits_max
                )
            n_strikes = float(n_targets * len(strikes.rounds(tempo)))
        except TextError as error:
            message = f"strikes {quote(strikes.name)}: {error.message}"
            collector.error("E305", message, strikes.place)
            return 0.0
        return _count_within(strikes, n_strikes, n_left, collector)
    if strikes.pattern is not None:
        try:
            n_steps = float(len(strikes.place_beats(piece)))
        except TextError as error:
            message = f"strikes {quote(strikes.name)}: {error.message}"
            collector.error("E305", message, strikes.place)
            return 0.0
    elif strikes.rate is not None:
        n_steps = strikes.rate * striking_seconds
    elif strikes.every is not None:
        period = tempo.seconds(tempo.after(start_beat, strikes.every)) - tempo.seconds(start_beat)
        if period <= 0.0:
            message = f"strikes {quote(strikes.name)}: 'every' must be above 0"
            collector.error("E305", message, strikes.place)
            return 0.0
        n_steps = float(strikes.times) if strikes.times is not None else striking_seconds / period
        if strikes.times is None and stop_beat == start_beat:
            message = (
                f"strikes {quote(strikes.name)}: the number of strikes "
                "has no limit; write `times`, `for` or `until`"
            )
            collector.error("E103", message, strikes.place)
    voices = strikes.voices.values() or (strikes.to,)
    targets_per_step = max(sum(target.count for target in voice) for voice in voices)
    return _count_within(strikes, n_steps * targets_per_step, n_left, collector)


def _count_within(strikes: Strikes, n_strikes: float, n_left: float, collector: Collector) -> float:
    """`n_strikes`; 0 if an error was reported because it is above `n_left`."""
    if n_strikes <= n_left:
        return n_strikes
    message = f"strikes {quote(strikes.name)}: the piece has more than {MAX_STRIKES:,} strikes"
    if n_strikes <= MAX_STRIKES:
        message += ", with those above"
    collector.error("E105", message, strikes.place)
    return 0.0


def _check_take_transforms(play: Play, collector: Collector) -> bool:
    try:
        apply_to_take(play.do)
    except TextError as error:
        collector.error("E306", f"{quote(play.played_text)}: {error.message}", play.place)
        return False
    return True


def _gesture_length(
    piece: Piece,
    gesture: Gesture,
    part_play: Play,
    begin_beat: float,
    known_lengths: dict[tuple[str, tuple[Transform, ...], float], _LengthAndDropped],
) -> _LengthAndDropped:
    """The length of a gesture from beat `begin_beat` on, after its transformations."""
    transforms = (*gesture.do, *part_play.do)
    if not transforms:
        return gesture.length(gesture.points[-1].at), ()
    gesture_beat = gesture.beat(piece.tempo_map, begin_beat)
    memo_key = gesture.name, part_play.do, gesture_beat
    if memo_key not in known_lengths:
        points, dropped_reasons = apply(gesture.points, transforms, MidpointChance(), gesture_beat)
        known_lengths[memo_key] = gesture.length(points[-1].at), dropped_reasons
    return known_lengths[memo_key]


def _check_bar_lines(
    piece: Piece, gesture: Gesture, start_beats: list[float], collector: Collector
) -> None:
    """Check that each '|' in a notation is on a bar line when the gesture is first played."""
    tempo = piece.tempo_map
    for start in start_beats:
        for bar_check in gesture.bar_checks:
            check_beats = tempo.beats(tempo.instant(start, bar_check.at))
            _, beat = tempo.bar_beat(check_beats)
            if abs(beat - 1.0) > 1e-6:
                position_text = tempo.written(check_beats)
                message = (
                    f"'|' in gesture {quote(gesture.name)} is not on a bar line, but at "
                    f"{position_text}"
                )
                collector.error("W311", message, _bar_check_place(gesture, bar_check))


def _bar_check_place(gesture: Gesture, bar_check: BarCheck) -> Place:
    return gesture.written.place_at(bar_check.offset) if gesture.written else gesture.place
