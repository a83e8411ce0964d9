"""Turns strikes with a rhythm text into what each of its words strikes."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace

from ergon.instruments.model import Target
from ergon.instruments.names import PartNames
from ergon.notation.clock.positions import Length
from ergon.notation.tables import tuning
from ergon.notation.tables.fields import Values
from ergon.notation.tables.shapes import Name
from ergon.notation.tables.strengths import MEZZO_FORTE, ImpulseRange, Levels
from ergon.notation.text.document import Scalar
from ergon.notation.text.errors import TextError, quote
from ergon.notation.text.values import Place
from ergon.scores.pattern.struck import Struck, key_of, name_of, notes_of
from ergon.scores.reading import build
from ergon.scores.reading.clocked import rhythm_of_clock
from ergon.scores.reading.melody import Row
from ergon.scores.reading.note_targets import NoteTargets
from ergon.scores.reading.phrase_do import rhythm_transforms
from ergon.scores.reading.piece import Strikes
from ergon.scores.reading.rhythms import ANY_WORD, Rhythm, Voice, compiled_rhythm, level_of


def strikes_of_rhythm(strike_values: Values, part_names: PartNames) -> Strikes | None:
    """Strikes whose words and notes are those of a rhythm text; None if an error was reported."""
    rhythm_node = strike_values.nodes["rhythm"]
    assert isinstance(rhythm_node, Scalar)

    def place_of_word(leaf: Struck) -> Place:
        return rhythm_node.place_at(leaf.offset, len(name_of(leaf)))

    cycle, skipped_cycles = strike_values["cycle"] or Length(bars=1.0), strike_values["skip"] or 0
    strikes = build.rhythm_strikes(strike_values, ())
    rhythm = Rhythm(strike_values["rhythm"], "", cycle, {}, skipped_cycles)
    transforms_text = rhythm_transforms(strike_values)
    if transforms_text is None:
        return None
    strikes = replace(strikes, rhythm=rhythm)
    note_targets = NoteTargets(part_names, strike_values["to"] or ())
    return _with_voices(strikes, transforms_text, strike_values, note_targets, place_of_word)


def transformed_strikes(
    strikes: Strikes,
    transforms_text: str,
    strike_values: Values,
    part_names: PartNames,
    target_names: tuple[Name, ...],
) -> Strikes | None:
    """Strikes by the clock, of a pattern or a phrase, after the transformations `transforms_text`
    of rhythms: as a rhythm of the same strokes. `target_names` are the instruments whose notes they
    name.

    None if an error was reported.
    """
    try:
        rhythm = rhythm_of_clock(strikes)
    except TextError as error:
        strike_values.error("E306", f"{strike_values.context.label('do')}: {error.message}", "do")
        return None
    word_place = strike_values.place_of(next(iter(strike_values.written("play", "notes", "to"))))
    is_bounded = strike_values.written("times", "for", "until")
    rhythm_strikes = replace(
        strikes,
        rhythm=rhythm,
        pattern=None,
        voices={},
        every=None,
        times=strikes.times if is_bounded else 1,
        impulse_ranges={},
        hits=(),
        length=None,
    )
    return _with_voices(
        rhythm_strikes,
        transforms_text,
        strike_values,
        NoteTargets(part_names, target_names),
        lambda _: word_place,
    )


def _with_voices(
    strikes: Strikes,
    transforms_text: str,
    strike_values: Values,
    note_targets: NoteTargets,
    place_of_word: Callable[[Struck], Place],
) -> Strikes | None:
    """Strikes with what each word of their rhythm strikes, after transformations; `place_of_word`
    returns where a word is written. None if an error was reported.
    """
    label, rhythm = f"strikes {quote(strike_values.context.name)}", strikes.rhythm
    assert rhythm is not None
    try:
        leaves = compiled_rhythm(rhythm.text, transforms_text).leaves
    except TextError as error:  # the transformations make it too large
        strike_values.error("E306", f"{strike_values.context.label('do')}: {error.message}", "do")
        return None
    strike_levels = strike_values["impulse"] or Levels((MEZZO_FORTE,))
    voices: dict[str, Voice] = {}
    for leaf in leaves:
        needs_impulse_range = (
            level_of(leaf) or strike_levels.steps[0]
        ).is_strength or strike_levels.has_strengths
        word_voice = _voice_of_word(
            leaf, place_of_word(leaf), note_targets, label, needs_impulse_range=needs_impulse_range
        )
        if word_voice is None:
            return None
        voices[key_of(leaf)] = word_voice
    all_targets = dict.fromkeys(
        target for word_voice in voices.values() for targets, _ in word_voice for target in targets
    )
    rhythm = replace(rhythm, do=transforms_text, voices=voices, tuning=tuning.written())
    return replace(strikes, to=tuple(all_targets), levels=strike_levels, rhythm=rhythm)


def _voice_of_word(
    leaf: Struck,
    word_place: Place,
    note_targets: NoteTargets,
    label: str,
    *,
    needs_impulse_range: bool,
) -> Voice | None:
    """What a word of a rhythm strikes; None if an error was reported."""
    leaf_name = Name(name_of(leaf), word_place)
    note_words = tuple(Name(note, word_place) for note in notes_of(leaf_name)) or (leaf_name,)
    collector, n_reports = (
        note_targets.part_names.collector,
        note_targets.part_names.collector.n_reports,
    )
    try:
        struck_names = tuple(
            note_targets.transposed(note, leaf.semitones) if leaf.semitones else note
            for note in note_words
        )
    except TextError as error:
        collector.error("E306", f"{label}: {error.message}", word_place)
        return None
    word_targets: Iterable[Target]
    if leaf_name == ANY_WORD and note_targets.instruments:
        word_targets = [
            target
            for name in note_targets.instruments
            for target in note_targets.part_names.struck_targets(name, label)
        ]
    else:
        word_targets = note_targets.targets(
            Row(Length(), struck_names, None, word_place, note_words), label
        )
    targets_by_range: dict[ImpulseRange | None, list[Target]] = {}
    for target in word_targets:
        impulse_range = (
            note_targets.part_names.required_impulse_range(target, label)
            if needs_impulse_range
            else None
        )
        targets_by_range.setdefault(impulse_range, []).append(target)
    if collector.n_reports > n_reports:
        return None
    return tuple(
        (tuple(targets), impulse_range) for impulse_range, targets in targets_by_range.items()
    )
