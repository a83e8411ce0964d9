"""Short texts of a score with grammars of their own: expressions, gestures, plays, laws."""

from __future__ import annotations

import random
from collections.abc import Iterator
from pathlib import Path

from random_scores import LAWS

from ergon import _core
from ergon.instruments import drawing
from ergon.notation.tables import strengths
from ergon.notation.tables.expressions import evaluate, looks_like
from ergon.notation.text.errors import TextError
from ergon.scores.gesture import notation
from ergon.scores.gesture.sampled import sampled_positions
from ergon.scores.pattern import cycle_table, cycle_transforms, turn_chain, words
from ergon.scores.reading.rhythms import checked_text
from tests.fuzz.harness import Target
from tests.fuzz.texts import damaged, soup

PIECES = (
    *("(", ")", "+", "-", "*", "/", "**", "//", " ", "1", "2.5", "1e30", "9" * 38, "1/0", "0"),
    *("400g", "1/3bar", "7st", "A3", "Bb-1", "x", "y1", "__import__", "N/m", "kN/m3", "1e-99"),
    *("..", "%", "\u2212", "\u00e9", "\n", "'", "exp(1)", "1_0", "0x1f", ".", "1.2.3", "Ns2/m2"),
)
_NAMED = {"x": evaluate("400g", {}), "y1": evaluate("A3", {})}


def _expression(chance: random.Random) -> str:
    kind = chance.randrange(20)
    if kind == 0:
        return chance.choice("(-1") * chance.randrange(1, 10_000)
    if kind == 1:
        return "*".join(chance.choice(("9" * 39, "x", "1e40")) for _ in range(chance.randrange(40)))
    return "".join(chance.choice(PIECES) for _ in range(chance.randrange(1, 40)))


def _read_expression(text: str, folder: Path) -> Iterator[str]:
    looks_like(text, _NAMED)
    yield evaluate(text, _NAMED).literal


NOTATIONS = (
    "0mm@0 smooth 6mm@1/8 throw 0mm@1/4 hold 0mm@1/2",
    "0@0 (6@1/8 0@1/4)*4 3@2 | 0@3",
    "1cm@0 -2@1beat 0.5m@1.5 40um@+250ms 6mm@+1/4s",
    "0@0 line (6@1 throw 0@2)*2 6@5",
    "0 0mm smooth\n1/8 6mm throw\n1/2 0mm # back\n",
)
POINTS = (
    *("0@0", "6mm@1/8", "0@1/4", "3@1s", "2@+1", "1@0.5s", "-2@250ms", "900m@2", "throw", "line"),
    *("smooth", "hold", "(", ")*4", ")", "|", "0@0.6s", "5@1/1000", "throw 1@1/9999"),
)


def _gesture(chance: random.Random, depth: int = 2) -> str:
    """A gesture whose times mostly rise, in beats and in seconds."""
    messages = [] if depth < 2 else ["0@0"]
    beats = seconds = 0.0
    for _ in range(chance.randrange(1, 6)):
        if depth and chance.random() < 0.2:
            messages.append(f"({_gesture(chance, depth - 1)})*{chance.choice((1, 2, 3, 40))}")
            continue
        step = chance.choice((1e-7, 1e-4, 0.01, 0.125, 0.5, 1.0))
        if is_beats := chance.random() < 0.7:
            beats += step
        else:
            seconds += step
        position = f"{beats:.10g}" if is_beats else f"{seconds:.10g}s"
        x = chance.choice(("0", "6", "-3mm", "0.5m", "1e3m", "1e-12m", "900m"))
        word = chance.choice(("", "", "smooth ", "line ", "throw ", "hold "))
        messages.append(f"{word}{x}@{chance.choice(('', '', '+'))}{position}")
    return " ".join(messages)


def _notation(chance: random.Random) -> str:
    kind = chance.random()
    if kind < 0.2:
        return soup(chance, POINTS)
    if kind < 0.7:
        return _gesture(chance)
    return damaged(chance.choice(NOTATIONS), chance, POINTS)


def _read_notation(text: str, _: Path) -> None:
    refused: list[TextError] = []
    for read in (notation.parse, notation.parse_table):
        try:
            points = read(text).points
            last = points[-1].at
            if last.beats + last.seconds < 5.0:  # a longer gesture is no other
                sampled_positions(points, 0.5, 1000.0)
        except TextError as error:
            refused.append(error)
    assert all(0 <= error.offset <= len(text) and error.length >= 0 for error in refused)
    if len(refused) == 2:
        raise refused[0]


PLAYS = (
    "lean every 8 times 2 do scale 0.5, mirror until C layer",
    "knock at B+1bar every 1/2 touch tracked do jitter 4ms 0.2mm, stretch 2, shift -1/8",
)


def _plays(chance: random.Random) -> str:
    known = [
        *words.OPTION_EXAMPLES,
        *words.ARGUMENT_COUNTS,
        "lean",
        ",",
        "do",
        "1/8",
        "2bar",
        "#",
        "C-1",
    ]
    if chance.random() < 0.5:
        return soup(chance, known)
    return damaged(chance.choice(PLAYS), chance, known)


CHAINS = (
    "every 4 (rev, scale 0.5), degrade 0.3",
    "whenmod 4 3 (chunk 4 mirror, sometimes 0.3 rev), iter 4, palindrome",
    "off 1/8 transpose 12st, ply 2, swing 1/6 4, mask t ~ t t, struct t(3,8)",
    "superimpose (fast 3/2, legato 0.3), tremolo 12Hz, roll 8 0.1, arp up 1/16, strum -20ms",
)
_CHAIN_WORDS = (
    *(*cycle_table.FORM_BY_WORD, *turn_chain.TURN_FORMS, *words.ARGUMENT_COUNTS),
    *("(", ")", ",", "1/8", "0.3", "12st", "t", "~", "12Hz", "3/2", "updown", "4th", "do"),
)


def _chain(chance: random.Random, depth: int = 3) -> str:
    """Transformations that mostly have a meaning."""
    if depth < 3 and chance.random() < 0.3:
        return soup(chance, _CHAIN_WORDS, between=chance.choice((" ", ", ")))
    parts = []
    for _ in range(chance.randrange(1, 4)):
        known = {**cycle_table.FORM_BY_WORD, **turn_chain.TURN_FORMS}
        name = chance.choice(list(known))
        example = known[name].example
        if depth and chance.random() < 0.4:
            example = f"every {chance.randrange(6)} ({_chain(chance, depth - 1)})"
        parts.append(example)
    text = ", ".join(parts)
    return damaged(text, chance, _CHAIN_WORDS) if chance.random() < 0.3 else text


def _read_chain(text: str, _: Path) -> None:
    refused: list[TextError] = []
    for read in (turn_chain.parse_chain, cycle_transforms.parse_transforms):
        try:
            read(text)
        except TextError as error:
            refused.append(error)
    assert all(0 <= error.offset <= len(text) and error.length >= 0 for error in refused)
    if len(refused) == 2:
        raise refused[0]


RHYTHMS = (
    "kick:f ~ [snare:p snare]*2 hat(7,16)?0.3",
    "<c4 | e4 | g4> c4.maj:mf@3 _ . a b!2 ! {a b, c}%4",
    "[kick, hat*8]/2 <a <b c>> x:v64",
)
_RHYTHM_WORDS = (
    *("kick", "~", "[", "]", "<", ">", "{", "}%4", "|", ",", ".", "!", "_", "*2", "/3", "@2", "?"),
    *("(3,8)", ":f", ":v127", "c4.maj", ":", "(", ")", "?0.5", "*1.5", "c#5'"),
)


def _rhythm(chance: random.Random) -> str:
    if chance.random() < 0.5:
        return soup(chance, _RHYTHM_WORDS, between=chance.choice((" ", "")))
    return damaged(chance.choice(RHYTHMS), chance, _RHYTHM_WORDS)


def _read_rhythm(text: str, _: Path) -> None:
    checked_text(text)


LEVELS = ("f p mf p", "p -> f", "1mNs..4mNs", "f! v64 -6dB 2 mNs", "pp..mf 0.4 2/3")


def _levels(chance: random.Random) -> str:
    known = (*strengths.DYNAMICS, "->", "..", "!", "v64", "mNs", "dB", "x0.5", "-", "/")
    if chance.random() < 0.5:
        return soup(chance, known, between=chance.choice((" ", "")))
    return damaged(chance.choice(LEVELS), chance, known)


def _read_levels(text: str, _: Path) -> None:
    strengths.levels(text)


BOWS = ("hair 0.2N..2N", "hair 0.04m/s..0.4m/s", "lips 20mN .. 1N")


def _bow(chance: random.Random) -> tuple[str, str]:
    known = ("hair", "..", "N", "m/s", "mN", " ", "0", "-")
    if chance.random() < 0.3:
        return chance.choice(list(drawing.BOW_FIELDS)), soup(chance, known, between="")
    return chance.choice(list(drawing.BOW_FIELDS)), damaged(chance.choice(BOWS), chance, known)


def _read_bow(case: tuple[str, str], _: Path) -> None:
    word, text = case
    drawing.BOW_FIELDS[word].parse(text)


LAW_TEXTS = tuple(law.partition(",")[0] for law in LAWS.values())
_LAW_WORDS = (
    "d v k q w + - * / ** ( ) , < >= == . if [ ] ^ max min abs sqrt sign exp tanh noise where clip"
)
LAW_WORDS = (*_LAW_WORDS.split(), "1e308", "2.5", "3N/m")


def _law_text(chance: random.Random, depth: int = 4) -> str:
    """A law that mostly has a meaning."""
    kind = chance.randrange(6) if depth else 0
    if kind <= 1:
        return chance.choice(("d", "d", "v", "k", "q", "w", "f", "0", "1e308", "1e-308", "2.5"))
    left, right = (_law_text(chance, depth - 1) for _ in range(2))
    if kind == 2:
        return f"{chance.choice(('abs', 'sqrt', 'sign', 'exp', 'tanh', '-'))}({left})"
    if kind == 3:
        return f"{chance.choice(('max', 'min'))}({left}, {right})"
    return f"({left}){chance.choice(('+', '-', '*', '/', '**', '<', '>='))}({right})"


def _law(chance: random.Random) -> tuple[str, str | None, dict[str, float], float]:
    def text() -> str:
        kind = chance.random()
        if kind < 0.2:
            return soup(chance, LAW_WORDS, between="")
        if kind < 0.7:
            return _law_text(chance)
        return damaged(chance.choice(LAW_TEXTS), chance, LAW_WORDS)

    edges = (0.0, 1.0, -1.0, 1e308, 5e-324, float("inf"), float("nan"), 200.0)
    usual = (200.0,) * 20
    constants = {name: chance.choice((*usual, *edges)) for name in "kqwf"}
    damping = text() if chance.random() < 0.2 else None
    return text(), damping, constants, chance.choice((*usual, *edges))


def _read_law(case: tuple[str, str | None, dict[str, float], float], _: Path) -> None:
    expression, damping, constants, reach = case
    law = _core.Law(expression, damping, constants, reach=reach)
    for x in (0.0, 1e-3, -1e308, float("nan")):
        law.force(x, -x)
        law.potential(x)
    law.rows()


TARGETS = (
    Target("notation", _notation, _read_notation, (TextError,), 2000),
    Target("expressions", _expression, _read_expression, (TextError,), 3000, limit=0.5),
    Target("plays", _plays, lambda text, _: words.parse(text) and None, (TextError,), 2000),
    Target("transformations", _chain, _read_chain, (TextError,), 1000, limit=1.0),
    Target("rhythms", _rhythm, _read_rhythm, (TextError,), 1000, limit=1.0),
    Target("levels", _levels, _read_levels, (TextError,), 1000),
    Target("bows", _bow, _read_bow, (TextError,), 500),
    Target("laws", _law, _read_law, (_core.EngineError,), 1000),
)
