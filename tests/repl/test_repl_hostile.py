"""Any text at all is commands or a refusal."""

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st
from spoken import OTHERS, SCOPE, SESSION
from sweep import few

from ergon.repl.language import verbs
from ergon.repl.language.commands import Command
from ergon.repl.language.complete import complete
from ergon.repl.language.highlight import highlighted_tokens
from ergon.repl.language.lines import MAX_LINE
from ergon.repl.language.parse import parse
from ergon.repl.language.refusal import Refusal


def holds(text: str) -> None:
    """What is true of any text at all: commands or a Refusal, and places inside the text."""
    refusal = None
    try:
        assert all(isinstance(command, Command) for command in parse(text, SCOPE))
    except Refusal as caught:
        refusal = caught
    if refusal is not None:
        assert refusal.message.isprintable()
        assert refusal.message
        assert 0 <= refusal.offset <= len(text)
        assert refusal.try_ != text
        assert refusal.try_ is None or isinstance(parse(refusal.try_, SCOPE), tuple)
    last = 0
    for start, end, kind in highlighted_tokens(text, SCOPE):
        assert last <= start < end <= len(text)
        assert kind in {
            "verb", "name", "option", "curve", "number", "unit", "comment", "unknown"
        }  # fmt: skip
        last = end
    cursor = len(text) * 2 // 3
    for suggestion in complete(text, cursor, SCOPE):
        assert 0 <= suggestion.start <= cursor


LINES = [line for line, _ in SESSION + OTHERS]
CHARACTERS = (
    "abkKQ019 \t.,;:|@+-*/=()[]{}#\\\"'?\n\r\x00\x07\x1b\x7f\x85\xa0\u2028éµ名😀\ud800\udfff\u202e"
)
WORDS = [
    *{word for line in LINES for word in line.split()},
    *verbs.SHORT_FORM_BY_VERB.values(),
    "at", "in", "over", "do", "1e999", "-1", "1/0", "9" * 5000, "nan",
    "0@0", "(6@1/8", "0@1/4)*4", "|", "K=", "=", "x", "3|9", "A-1bar", ",", "(" * 50, "*",
]  # fmt: skip


def hostile(rng: random.Random) -> str:
    kind = rng.random()
    if kind < 0.4:  # words in no order
        return " ".join(rng.choices(WORDS, k=rng.randrange(9)))
    if kind < 0.5:  # garbage
        return "".join(rng.choices(CHARACTERS, k=rng.randrange(60)))
    line = rng.choice(LINES)  # a line that is nearly right
    for _ in range(rng.randrange(1, 4)):
        index = rng.randrange(len(line) + 1)
        line = (
            line[:index]
            + rng.choice(CHARACTERS) * rng.randrange(3)
            + line[index + rng.randrange(4) :]
        )
    return line


@pytest.mark.parametrize("n_lines", few([4_000, 20_000], [4_000]))
def test_hostile_lines(n_lines: int):
    rng = random.Random(20181110)
    for _ in range(n_lines):
        holds(hostile(rng))


@given(st.text(st.characters(codec=None), max_size=80))
def test_random_text_is_taken_or_refused(text: str):
    holds(text)


PIECES = (
    "x", "(", "0@0 ", "ada plays ", "\x00", "=", '"', "\\\n", "#", "9", "é\u0301", "a,", "?", ". "
)  # fmt: skip


@pytest.mark.parametrize("piece", PIECES)
@pytest.mark.parametrize("size", [MAX_LINE - 5, 1_000_000])
def test_huge_text_is_taken_or_refused(piece: str, size: int):
    for head in ("", "knock = ", "set ", "ada plays knock ", "tempo ", "py "):
        holds(head + piece * (size // len(piece)))
