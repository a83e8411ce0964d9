"""The verb of a line, or what is wrong with its first words."""

from __future__ import annotations

from ergon.notation.text.errors import TextError, quote
from ergon.notation.text.spelling import is_misspelt, is_one_slip, nearest
from ergon.repl.language import hearing, verbs
from ergon.repl.language import values as v
from ergon.repl.language.commands import Word
from ergon.repl.language.scope import Scope, playable, unused_family
from ergon.scores.pattern.cycle_table import TABLE as TRANSFORMS

_NAMING_VERBS = ("strikes", "takes", "=")  # the name before them may be new


def find_verb_of(words: list[Word], scope: Scope) -> tuple[str, list[Word]]:
    """The verb, and the other words."""
    first = words[0].text
    second = words[1].text if len(words) > 1 else ""
    if second == "=":
        return "=", [words[0], *words[2:]]
    if first in scope.blocks and not _is_near_subject_verb(second):
        return "run", words  # what else follows are its values
    _check_family(words[0], second, scope)
    about_player = verbs.verbs_matching(second, verbs.SUBJECT_VERBS) if second else ()
    is_player = first in scope.players
    is_instrument = first in playable(scope)
    is_played = first in scope.gestures or first in scope.takes or is_instrument
    is_name = first not in verbs.VERBS or is_instrument  # an instrument may be `pan`
    sure = second in verbs.SUBJECT_VERBS and is_name
    sure = sure and not (second == "every" and is_played)
    if about_player and (is_player or sure):
        return about_player[0], [words[0], *words[2:]]
    if is_name and _is_stroke(words, scope):
        return "hear", words
    some = verbs.verbs_matching(first, verbs.VERBS)
    if len(some) == 1 and not (is_player and first != some[0]):
        return some[0], words[1:]
    raise _unknown_verb(words, some, scope)


def _check_family(word: Word, second: str, scope: Scope) -> None:
    """Refuse a first word that is neither a verb nor a name, but an instrument of a family that is
    not in use.
    """
    name = word.text.split(".")[0]
    known = (scope.players, scope.strikes, scope.blocks, scope.gestures, scope.takes, scope.phrases)
    is_name = second in _NAMING_VERBS or any(name in names for names in known)
    family = unused_family(name, scope)
    if family is not None and not is_name and not verbs.verbs_matching(name, verbs.VERBS):
        error = v.family_missing(name, family)
        error.offset = word.start
        raise error


def _is_stroke(words: list[Word], scope: Scope) -> bool:
    """Whether a line is an instrument, notes and a level alone: `kick f`, `vib C4 E4 mf`."""
    first, *rest = (word.text for word in words)
    is_instrument = first.partition(".")[0] in playable(scope)
    return is_instrument and bool(rest) and all(hearing.is_stroke_word(text) for text in rest)


def _is_near_subject_verb(word: str) -> bool:
    return any(is_misspelt(word, verb) for verb in verbs.SUBJECT_VERBS)


def _unknown_verb(words: list[Word], some: tuple[str, ...], scope: Scope) -> TextError:
    first, place = words[0].text, words[0].start
    if first in scope.players:
        second = words[1] if len(words) > 1 else None
        example = f"{first} plays {next(iter(scope.gestures), 'knock')}"
        if second is None:
            return TextError(f"what does {first} play? write {example}", offset=words[0].end)
        near = nearest(second.text, verbs.SUBJECT_VERBS)
        message = f"unknown verb {quote(second.text)}"
        return TextError(
            message if near else f"{message}; after a player write plays or do: {example}",
            offset=second.start,
            length=len(second.text),
            suggestion=near,
        )
    if some:
        return verbs.ambiguous(first, some, place)
    played = first in scope.gestures or first in scope.takes
    if played and (player := next(iter(scope.players), None)):
        message = f"{quote(first)} is not a verb; a player plays it"
        suggestion = f"{player} plays {first}"
        return TextError(message, offset=place, length=len(first), suggestion=suggestion)
    if first in TRANSFORMS:
        message = f"{quote(first)} is a transformation, of a rhythm or of strikes"
        voice = next(iter(scope.strikes), "d1")
        what = " ".join(word.text for word in words)
        raise TextError(f"{message}: {voice} do {what}", offset=place, length=len(first))
    for i, word in enumerate(words[1:], 1):
        if word.text in ("at", "in") and _is_stroke(words[:i], scope):
            message = f"one stroke acts at once: leave out '{word.text}', or write a rhythm, such "
            message += f'as {first} = "{first}*4"'
            return TextError(message, offset=word.start, length=len(word.text))
    if first in scope.acts or first in scope.instruments:
        return TextError(_instrument_lines(words, scope), offset=place, length=len(first))
    known = (*verbs.VERBS, *list(scope.players)[: v.MAX_COMPARED])
    near = verbs.MEANT.get(first) or nearest(first, known)
    is_meant = first in verbs.MEANT
    if not is_meant and near in verbs.TAKING_AWAY and not is_one_slip(first, near):
        near = nearest(first, [verb for verb in known if verb not in verbs.TAKING_AWAY])
    message = f"unknown verb {quote(first)}"
    message = message if near else f"{message}; `help` lists them all"
    return TextError(message, offset=place, length=len(first), suggestion=near)


def _instrument_lines(words: list[Word], scope: Scope) -> str:
    """The lines that play an instrument, where its name replaces a verb."""
    name, second = words[0].text, words[1].text if len(words) > 1 else ""
    message = f"{quote(name)} is an instrument, not a verb; "
    if second == "every":
        rest = " ".join(word.text for word in words[1:])
        return f"{message}write d1 strikes {name} {rest}"
    if any(part.startswith(f"{name}.") for part in scope.instruments):
        return message + f'write {name} = "c4 e4*2", {name} notes C4 E4 every 1, or {name} C4 f'
    return message + f'write {name} = "{name}*4", or {name} f for one stroke'
