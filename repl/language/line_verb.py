"""The verb of a line, or what is wrong with its first words."""

from __future__ import annotations

from ergon.notation.text.errors import TextError, quote
from ergon.notation.text.spelling import is_misspelt, is_one_slip, nearest
from ergon.repl.language import hearing, values, verbs
from ergon.repl.language.commands import Word
from ergon.repl.language.scope import Scope, playable_instruments, unused_family
from ergon.scores.pattern.cycle_table import FORM_BY_WORD as TRANSFORMS

_NAMING_VERBS = ("strikes", "takes", "=")  # these verbs may follow a new name


def split_verb(line_words: list[Word], scope: Scope) -> tuple[str, list[Word]]:
    """The verb, and the other words."""
    first_word = line_words[0].text
    second_word = line_words[1].text if len(line_words) > 1 else ""
    if second_word == "=":
        return "=", [line_words[0], *line_words[2:]]
    if first_word in scope.blocks and not _is_near_subject_verb(second_word):
        return "run", line_words  # the other words are the block's values
    _check_family(line_words[0], second_word, scope)
    subject_verbs = verbs.verbs_matching(second_word, verbs.SUBJECT_VERBS) if second_word else ()
    is_player = first_word in scope.players
    is_instrument = first_word in playable_instruments(scope)
    is_playable = first_word in scope.gestures or first_word in scope.takes or is_instrument
    is_name = (
        first_word not in verbs.LEADING_VERBS or is_instrument
    )  # an instrument may be called `pan`
    has_subject_verb = second_word in verbs.SUBJECT_VERBS and is_name
    has_subject_verb = has_subject_verb and not (second_word == "every" and is_playable)
    if subject_verbs and (is_player or has_subject_verb):
        return subject_verbs[0], [line_words[0], *line_words[2:]]
    if is_name and _is_stroke(line_words, scope):
        return "hear", line_words
    matching_verbs = verbs.verbs_matching(first_word, verbs.LEADING_VERBS)
    if len(matching_verbs) == 1 and not (is_player and first_word != matching_verbs[0]):
        return matching_verbs[0], line_words[1:]
    raise _unknown_verb_error(line_words, matching_verbs, scope)


def _check_family(instrument_word: Word, second_word: str, scope: Scope) -> None:
    """Refuse a first word that is neither a verb nor a name, but an instrument of a family that is
    not in use.
    """
    instrument_name = instrument_word.text.split(".")[0]
    known_names = (
        scope.players,
        scope.strikes,
        scope.blocks,
        scope.gestures,
        scope.takes,
        scope.phrases,
    )
    is_name = second_word in _NAMING_VERBS or any(instrument_name in names for names in known_names)
    family = unused_family(instrument_name, scope)
    if (
        family is not None
        and not is_name
        and not verbs.verbs_matching(instrument_name, verbs.LEADING_VERBS)
    ):
        error = values.missing_family_error(instrument_name, family)
        error.offset = instrument_word.start
        raise error


def _is_stroke(words: list[Word], scope: Scope) -> bool:
    """Whether a line is an instrument, notes and a level alone: `kick f`, `vib C4 E4 mf`."""
    instrument_path, *later_words = (word.text for word in words)
    is_instrument = instrument_path.partition(".")[0] in playable_instruments(scope)
    return (
        is_instrument
        and bool(later_words)
        and all(hearing.is_stroke_word(text) for text in later_words)
    )


def _is_near_subject_verb(word: str) -> bool:
    return any(is_misspelt(word, verb) for verb in verbs.SUBJECT_VERBS)


def _unknown_verb_error(
    line_words: list[Word], matching_verbs: tuple[str, ...], scope: Scope
) -> TextError:
    first_word, word_start = line_words[0].text, line_words[0].start
    if first_word in scope.players:
        second_word = line_words[1] if len(line_words) > 1 else None
        example = f"{first_word} plays {next(iter(scope.gestures), 'knock')}"
        if second_word is None:
            return TextError(
                f"what does {first_word} play? write {example}", offset=line_words[0].end
            )
        nearest_verb = nearest(second_word.text, verbs.SUBJECT_VERBS)
        message = f"unknown verb {quote(second_word.text)}"
        return TextError(
            message if nearest_verb else f"{message}; after a player write plays or do: {example}",
            offset=second_word.start,
            length=len(second_word.text),
            suggestion=nearest_verb,
        )
    if matching_verbs:
        return verbs.ambiguous_verb_error(first_word, matching_verbs, word_start)
    is_playable = first_word in scope.gestures or first_word in scope.takes
    if is_playable and (first_player := next(iter(scope.players), None)):
        message = f"{quote(first_word)} is not a verb; a player plays it"
        suggestion = f"{first_player} plays {first_word}"
        return TextError(message, offset=word_start, length=len(first_word), suggestion=suggestion)
    if first_word in TRANSFORMS:
        message = f"{quote(first_word)} is a transformation, of a rhythm or of strikes"
        voice = next(iter(scope.strikes), "d1")
        line_words_text = " ".join(word.text for word in line_words)
        raise TextError(
            f"{message}: {voice} do {line_words_text}", offset=word_start, length=len(first_word)
        )
    for word_index, later_word in enumerate(line_words[1:], 1):
        if later_word.text in ("at", "in") and _is_stroke(line_words[:word_index], scope):
            message = (
                f"one stroke acts at once: leave out '{later_word.text}', or write a rhythm, such "
            )
            message += f'as {first_word} = "{first_word}*4"'
            return TextError(message, offset=later_word.start, length=len(later_word.text))
    if first_word in scope.acts or first_word in scope.instruments:
        return TextError(
            _instrument_line_advice(line_words, scope), offset=word_start, length=len(first_word)
        )
    known_words = (*verbs.LEADING_VERBS, *list(scope.players)[: values.MAX_COMPARED_NAMES])
    nearest_verb = verbs.VERB_BY_SYNONYM.get(first_word) or nearest(first_word, known_words)
    is_synonym = first_word in verbs.VERB_BY_SYNONYM
    if (
        not is_synonym
        and nearest_verb in verbs.REMOVING_VERBS
        and not is_one_slip(first_word, nearest_verb)
    ):
        nearest_verb = nearest(
            first_word, [verb for verb in known_words if verb not in verbs.REMOVING_VERBS]
        )
    message = f"unknown verb {quote(first_word)}"
    message = message if nearest_verb else f"{message}; `help` lists them all"
    return TextError(message, offset=word_start, length=len(first_word), suggestion=nearest_verb)


def _instrument_line_advice(line_words: list[Word], scope: Scope) -> str:
    """The lines that play an instrument, where its name replaces a verb."""
    instrument_name, second_word = (
        line_words[0].text,
        line_words[1].text if len(line_words) > 1 else "",
    )
    message = f"{quote(instrument_name)} is an instrument, not a verb; "
    if second_word == "every":
        later_words = " ".join(word.text for word in line_words[1:])
        return f"{message}write d1 strikes {instrument_name} {later_words}"
    if any(part.startswith(f"{instrument_name}.") for part in scope.instruments):
        return (
            message
            + f'write {instrument_name} = "c4 e4*2", '
            + f"{instrument_name} notes C4 E4 every 1, or {instrument_name} C4 f"
        )
    return (
        message
        + f'write {instrument_name} = "{instrument_name}*4", or {instrument_name} f for one stroke'
    )
