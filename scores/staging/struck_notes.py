"""The notes of a staged piece: which instrument is struck when, at which pitch and how hard."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from ergon._core import Impulse
from ergon.instruments.assemble import Assembly
from ergon.instruments.model import PRESS, Instrument, Target
from ergon.notation.tables.strengths import MEZZO_FORTE, ImpulseRange
from ergon.scores.reading.piece import Piece
from ergon.scores.staging.stage import Stage

_SAME_STROKE_SECONDS = 1e-6  # [s] strikes of one stroke on several modules
_NOTE_SECONDS_MAX = 1.0  # [s] of a note that nothing ends, where no other follows


@dataclass(frozen=True, slots=True)
class StruckNote:
    """A stroke on an instrument (one with `notes` is one instrument).

    `pitch` [Hz] is None where the instrument has none, `strength` lies from 0 to 1. The note lasts
    to its release, or to the next stroke of the same member, but not longer than a second.
    """

    instrument: str
    member: str
    pitch: float | None
    begin: float
    end: float
    strength: float


def struck_notes(stage: Stage) -> tuple[StruckNote, ...]:
    """All strokes of `strikes` and rhythms, in the order of time. What hands play is not there."""
    piece, families = stage.piece, stage.piece.note_families()
    all_notes: list[StruckNote] = []
    for struck_part in _struck_parts(piece):
        instrument = piece.instruments.get(struck_part)
        if instrument is not None:
            all_notes += _notes_of_part(stage, instrument, families.get(struck_part, struck_part))
    return tuple(
        sorted(all_notes, key=lambda note: (note.begin, note.instrument, note.pitch or 0.0))
    )


def _struck_parts(piece: Piece) -> list[str]:
    targets = (target for strikes in piece.strikes for target in strikes.to)
    return list(dict.fromkeys(target.part for target in targets))


def _notes_of_part(stage: Stage, instrument: Instrument, family: str) -> Iterator[StruckNote]:
    mats_of_dampers = list(_damper_mats(stage.built_network.assembly, instrument))
    impulse_range = instrument.acts[0].reach if instrument.acts else None
    strokes = _stroke_impulses(stage, instrument, {*mats_of_dampers})
    lift_instants = sorted(
        stroke.at
        for mat in mats_of_dampers[:1]
        for stroke in _strikes_on(stage, mat)
        if stroke.impulse > 0.0
    )
    note_spans = [*_drawn_spans(stage, instrument)]
    for index, (note_begin, impulse) in enumerate(strokes):
        next_strike = strokes[index + 1][0] if index + 1 < len(strokes) else math.inf
        damp_instant = next(
            (instant for instant in lift_instants if instant > note_begin + _SAME_STROKE_SECONDS),
            math.inf,
        )
        # A damper that comes down after the next stroke ends that one.
        is_ended = damp_instant <= next_strike + _SAME_STROKE_SECONDS and math.isfinite(
            damp_instant
        )
        note_end = min(next_strike, damp_instant if is_ended else note_begin + _NOTE_SECONDS_MAX)
        note_spans.append((note_begin, note_end, impulse))
    impulse_max = max((impulse for *_, impulse in note_spans), default=0.0)
    for note_begin, note_end, impulse in sorted(note_spans):
        strength = _stroke_strength(impulse, impulse_max, impulse_range)
        yield StruckNote(
            family, instrument.name, _instrument_pitch(instrument), note_begin, note_end, strength
        )


def _damper_mats(assembly: Assembly, instrument: Instrument) -> Iterator[int]:
    """The MATs of dampers, which a note lifts."""
    for act in instrument.acts:
        for hold in act.holds:
            if hold.is_lifted:
                for target in hold.targets:
                    yield from _members(assembly, target)


def _drawn_spans(stage: Stage, instrument: Instrument) -> Iterator[tuple[float, float, float]]:
    """The beginning and end [s] of the notes that are drawn, and their impulses [N·s]. What only
    presses is no note of its own.
    """
    drawn_modules = {
        (target.part, target.module)
        for act in instrument.acts
        if act.is_drawn and act.name != PRESS
        for target in act.targets
    }
    for note in stage.drawn_notes:
        if note.module_key in drawn_modules and note.impulse:
            yield note.begin, note.end, abs(note.impulse)


def _stroke_impulses(
    stage: Stage, instrument: Instrument, damper_mats: set[int]
) -> list[tuple[float, float]]:
    """Instants [s] and impulses [N·s] of strokes, without what is drawn; those of one instant are
    one.
    """
    stroke_by_microsecond: dict[int, tuple[float, float]] = {}
    assembly = stage.built_network.assembly
    targets = (target for strikes in stage.piece.strikes for target in strikes.to)
    part_targets = {target for target in targets if target.part == instrument.name}
    mats = {mat for target in part_targets for mat in _members(assembly, target)}
    drawn_targets = [
        drawn_target for act in instrument.acts if act.is_drawn for drawn_target in act.targets
    ]
    drawn_mats = {mat for target in drawn_targets for mat in _members(assembly, target)}
    for mat in sorted(mats - damper_mats - drawn_mats):
        for stroke in _strikes_on(stage, mat):
            microsecond = round(stroke.at / _SAME_STROKE_SECONDS)
            impulse_before = stroke_by_microsecond.get(microsecond, (stroke.at, 0.0))[1]
            stroke_by_microsecond[microsecond] = stroke.at, max(impulse_before, abs(stroke.impulse))
    return [stroke for _, stroke in sorted(stroke_by_microsecond.items()) if stroke[1] > 0.0]


def _strikes_on(stage: Stage, mat: int) -> Sequence[Impulse]:
    assert stage.timeline is not None
    return stage.timeline.strikes_on(mat)


def _members(assembly: Assembly, target: Target) -> Sequence[int]:
    return assembly.members(target) if (target.part, target.module) in assembly.mats else ()


def _instrument_pitch(instrument: Instrument) -> float | None:
    if instrument.pitch is not None:
        return instrument.pitch
    pitches = [module.fields.get("f") for module in instrument.modules]
    known_pitches = [pitch for pitch in pitches if isinstance(pitch, float)]
    return known_pitches[0] if len(known_pitches) == 1 else None


def _stroke_strength(
    impulse: float, impulse_max: float, impulse_range: ImpulseRange | None
) -> float:
    if impulse_range is None or not 0.0 < impulse_range.soft < impulse_range.hard:
        return MEZZO_FORTE.low * impulse / impulse_max
    return impulse_range.strength(impulse)
