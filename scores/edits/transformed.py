"""Transforms what strikes play from a cycle on; strikes by the clock become a rhythm first."""

from __future__ import annotations

from ergon.notation.clock.meter import SAME
from ergon.notation.clock.positions import Length
from ergon.notation.text import edit
from ergon.notation.text.edit import EditError
from ergon.notation.text.errors import quote
from ergon.scores.edits import strikes as edits
from ergon.scores.edits.names import free_name
from ergon.scores.edits.positions import written
from ergon.scores.edits.texts import Texts
from ergon.scores.pattern.order import Group, Leaf
from ergon.scores.pattern.rhythm import EVEN
from ergon.scores.reading.piece import Piece, Strikes
from ergon.scores.reading.rhythms import HERE, Rhythm

NONE = "none"  # ends all transformations
_BY_PATTERN = ("every", "euclid", "notes", "chance", "swing")  # fields that a rhythm replaces
_NO_RHYTHM = "melodies, phrases, sweeps and strikes by chance have no cycle to transform"

# Ways of a pattern to take one of its items in each round, as brackets of a rhythm.
_BY_CHANCE = {"choose": "[{}]", "walk": "<{}>"}
_NOT_WRITTEN = (
    "`{}` plays all of its items in each round, in a new order; a rhythm has one of them by chance "
    "([c4 | e4]) or a walk (<c4 | e4>)"
)

Body = dict[str, edit.Tree]


def transform(texts: Texts, piece: Piece, name: str, at: float, do: str) -> Texts:
    """Transform what strikes of a name play from the first cycle on that begins at a beat or later.

    Raises EditError if they play nothing then, or have no cycles.
    """
    tempo, changed = piece.tempo_map, False
    section = edit.tree(texts.section("strikes"))
    taken = {strikes.name for strikes in piece.strikes}
    for strikes in edits.named(piece, name):
        stop = strikes.stop(tempo)
        if stop is not None and stop <= at + SAME:
            continue
        assert isinstance(section, dict)
        body = section[strikes.name]
        assert isinstance(body, dict)
        rhythm, body = _as_rhythm(strikes, body)
        begin = tempo.resolve(strikes.at)
        passed = rhythm.count(tempo, begin, at) if at > begin else 0
        if strikes.times is not None and passed >= strikes.times:
            continue
        where = rhythm.begin(tempo, begin, passed)
        texts = edits.end(texts, piece, strikes, where)
        body = {**body, "at": written(piece, where), **_transforms(body, do)}
        if first := rhythm.first + passed:
            body["skip"] = str(first)
        if strikes.times is not None:
            body["times"] = str(strikes.times - passed)
        if strikes.span is not None and stop is not None:
            body = {**body, "for": "", "until": written(piece, stop)}
        for field in [field for field, value in body.items() if value == ""]:
            del body[field]
        new = strikes.name if where <= begin + SAME else free_name(name, taken)
        taken.add(new)
        texts = texts.put(("strikes", new), edit.flow(_in_order(body)))
        changed = True
    if not changed:
        raise EditError(f"{quote(name)} plays nothing now that could be transformed")
    return texts


def _transforms(body: Body, do: str) -> Body:
    """The transformations after more are added; an empty text if there are none."""
    before = body.get("do", "")
    if isinstance(before, list):
        before = ", ".join(str(each) for each in before)
    if do == NONE:
        return {"do": ""}
    return {"do": f"{before}, {do}" if before else do}


def _in_order(body: Body) -> Body:
    """The fields in the order in which they are written by hand."""
    order = ("rhythm", "to", "at", "until", "for", "times", "skip", "cycle", "impulse", "do")
    return {name: body[name] for name in order if name in body}


# --- strikes by the clock as a rhythm ------------------------------------------------------------


def _as_rhythm(strikes: Strikes, body: Body) -> tuple[Rhythm, Body]:
    """The rhythm of strikes, and their fields with it. Raises EditError if they have none."""
    if strikes.rhythm is not None:
        return strikes.rhythm, body
    pattern, every = strikes.pattern, strikes.every
    if (
        strikes.is_melody
        or strikes.passing is not None
        or strikes.rate is not None
        or (pattern is None and every is None)
    ):
        raise EditError(f'{_NO_RHYTHM}; write {strikes.name} = "…" for a rhythm')
    for field in ("mass", "along", "skip"):
        if field in body:
            raise EditError(f"strikes with `{field}` cannot be written as a rhythm")
    text, steps = HERE, 1
    if pattern is not None:
        text, steps = _text(pattern.order, strikes)
        if pattern.euclid is not None:
            if steps > 1:
                raise EditError(
                    "notes on the pulses of `euclid` cannot be written as a rhythm; write one, "
                    f'such as {strikes.name} = "c4(3,8)"'
                )
            euclid = pattern.euclid
            turn = f",{euclid.rotate}" if euclid.rotate else ""
            text, steps = f"{text}({euclid.pulses},{euclid.steps}{turn})", euclid.steps
        if pattern.chance is not None:
            text = f"[{text}]?{1.0 - pattern.chance:.6g}" if steps == 1 else text
            if steps > 1:
                raise EditError("`chance` of a pattern cannot be written as a rhythm; use degrade")
        if pattern.swing != EVEN:
            raise EditError("`swing` of a pattern cannot be written as a rhythm; use do swing")
    cycle = Length(bars=1.0) if every is None else every.times(steps)
    fields = {name: value for name, value in body.items() if name not in _BY_PATTERN}
    fields["rhythm"] = text
    if every is not None:
        fields["cycle"] = _length(cycle)
    if strikes.times is not None and pattern is None:
        fields["times"] = str(strikes.times)
    return Rhythm(text, "", cycle, {}), fields


def _length(length: Length) -> str:
    parts = [(length.bars, "bar"), (length.beats, ""), (length.seconds, "s")]
    (written_length,) = [f"{value!r}{unit}" for value, unit in parts if value] or ["0"]
    return written_length


def _text(order: Group, strikes: Strikes) -> tuple[str, int]:
    """A pattern as a rhythm text, and how many steps it takes."""
    if not strikes.voices and any(leaf.name in strikes.notes for leaf in order.leaves()):
        raise EditError("notes of a CEL without `notes` cannot be written as a rhythm")
    is_plain = not strikes.voices
    words = [_item(item, is_plain=is_plain) for item in order.items]
    if order.way in _BY_CHANCE:
        return _BY_CHANCE[order.way].format("|".join(words)), 1
    if order.way != "in turn":
        raise EditError(_NOT_WRITTEN.format(order.way))
    return " ".join(words), order.steps


def _item(item: Leaf | Group, *, is_plain: bool) -> str:
    weight = f"@{item.span}" if item.span != 1 else ""
    if isinstance(item, Leaf):
        name = "~" if item.name is None else HERE if is_plain else item.name
        return f"{name}{weight}"
    inner = [_item(part, is_plain=is_plain) for part in item.items]
    if item.way in _BY_CHANCE:
        return _BY_CHANCE[item.way].format("|".join(inner)) + weight
    if item.way != "in turn":
        raise EditError(_NOT_WRITTEN.format(item.way))
    return f"[{' '.join(inner)}]{weight}"
