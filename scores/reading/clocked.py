"""Strikes by the clock, in a pattern of notes, or of a phrase, as a rhythm text."""

from __future__ import annotations

from ergon.notation.clock.positions import Length
from ergon.notation.tables import notes
from ergon.notation.text.errors import TextError, quote
from ergon.scores.pattern.order import Group, Leaf
from ergon.scores.pattern.rhythm import EVEN_SWING
from ergon.scores.pattern.rhythm_text import WORD
from ergon.scores.reading.phrased import rhythm_of_phrase
from ergon.scores.reading.piece import Strikes
from ergon.scores.reading.rhythms import ANY_WORD, Rhythm

NO_CYCLES_REASON = "melodies, sweeps and strikes by chance have no cycle to transform"
# Ways of a pattern to take one of its items in each round, as brackets of a rhythm.
_CHOICE_BRACKETS = {"choose": "[{}]", "walk": "<{}>"}
_UNSUPPORTED_CHOICE_MESSAGE = (
    "`{}` plays all of its items in each round, in a new order; a rhythm has one of them by chance "
    "([c4 | e4]) or a walk (<c4 | e4>)"
)


def rhythm_of_clock(strikes: Strikes) -> Rhythm:
    """Strikes by the clock, of a pattern or a phrase, as a rhythm whose words strike nothing yet.

    A cycle is a round of the pattern or the phrase, or the time of one strike. Raises TextError if
    there is none.
    """
    pattern, step_length = strikes.pattern, strikes.every
    if strikes.hits and strikes.length is not None:
        return rhythm_of_phrase(strikes)
    if (
        strikes.is_melody
        or strikes.passing is not None
        or strikes.rate is not None
        or (pattern is None and step_length is None)
    ):
        raise TextError(f'{NO_CYCLES_REASON}; write {strikes.name} = "…" for a rhythm')
    fields = {"mass": strikes.mass, "along": strikes.along, "skip": pattern and pattern.skip}
    for field, field_value in fields.items():
        if field_value:
            raise TextError(f"strikes with `{field}` cannot be written as a rhythm")
    if pattern is None:
        rhythm_text, n_steps = _single_strike_text(strikes), 1
    else:
        rhythm_text, n_steps = _pattern_text(pattern.order, strikes)
        if pattern.euclid is not None:
            if n_steps > 1:
                raise TextError(
                    "notes on the pulses of `euclid` cannot be written as a rhythm; write one, "
                    f'such as {strikes.name} = "c4(3,8)"'
                )
            if pattern.order.way == "walk":
                raise TextError("`walk` goes on at each pulse of `euclid`, a rhythm at each cycle")
            euclid = pattern.euclid
            rotation_text = f",{euclid.rotate}" if euclid.rotate else ""
            rhythm_text, n_steps = (
                f"{rhythm_text}({euclid.pulses},{euclid.steps}{rotation_text})",
                euclid.steps,
            )
        if pattern.chance is not None:
            rhythm_text = (
                f"[{rhythm_text}]?{1.0 - pattern.chance:.6g}" if n_steps == 1 else rhythm_text
            )
            if n_steps > 1:
                raise TextError("`chance` of a pattern cannot be written as a rhythm; use degrade")
        if pattern.swing != EVEN_SWING:
            raise TextError("`swing` of a pattern cannot be written as a rhythm; use do swing")
    return Rhythm(
        rhythm_text, "", Length(bars=1.0) if step_length is None else step_length.times(n_steps), {}
    )


def _single_strike_text(strikes: Strikes) -> str:
    """The text of one strike in each cycle, with its level if levels come in turn."""
    levels = strikes.levels
    if levels is None or len(levels.steps) == 1:
        return ANY_WORD
    level_words = [f"{ANY_WORD}:{level.written}" for level in levels.steps]
    if levels.is_line or not all(map(WORD.fullmatch, level_words)):
        message = (
            "a line of levels, or one that chance draws in turn, cannot be written as a rhythm"
        )
        raise TextError(f"{message} of one stroke; write one level, or levels such as f p")
    return f"<{' '.join(level_words)}>"


def _pattern_text(pattern_order: Group, strikes: Strikes) -> tuple[str, int]:
    """A pattern as a rhythm text, and how many steps it takes."""
    if not strikes.voices and any(leaf.name in strikes.notes for leaf in pattern_order.leaves()):
        part = strikes.to[0].part
        raise TextError(
            f"`do` orders the notes of an instrument with `notes`, and {quote(part)} has none; "
            "give it some, such as `notes: C3..C5` (at the prompt `notes=C3..C5`)"
        )
    item_words = [_item_text(item, strikes) for item in pattern_order.items]
    if pattern_order.way in _CHOICE_BRACKETS:
        return _CHOICE_BRACKETS[pattern_order.way].format("|".join(item_words)), 1
    if pattern_order.way != "in turn":
        raise TextError(_UNSUPPORTED_CHOICE_MESSAGE.format(pattern_order.way))
    return " ".join(item_words), pattern_order.steps


def _item_text(order_item: Leaf | Group, strikes: Strikes) -> str:
    weight_text = f"@{order_item.span}" if order_item.span != 1 else ""
    if isinstance(order_item, Leaf):
        name = ANY_WORD if strikes.voices == {} else notes.scale_step(order_item.name or "")
        return f"{'~' if order_item.name is None else name}{weight_text}"
    inner_texts = [_item_text(part, strikes) for part in order_item.items]
    if order_item.way in _CHOICE_BRACKETS:
        return _CHOICE_BRACKETS[order_item.way].format("|".join(inner_texts)) + weight_text
    if order_item.way != "in turn":
        raise TextError(_UNSUPPORTED_CHOICE_MESSAGE.format(order_item.way))
    return f"[{' '.join(inner_texts)}]{weight_text}"
