"""Phrases among the entries of phrases, and levels that lead to the next one."""

from __future__ import annotations

import pytest
from checked import check, check_reports

HEAD = """\
ergon: 1
instruments:
  cell:
    CEL: {M: 1g, f: A4, t60: 2s}
    notes: C3..C5
    play: {strike: {impulse: 1mNs..100mNs}}
    out: {SOX: cell}
  gong: {CEL: {M: 9g, f: A2, t60: 2s}, notes: A2 B2, out: {SOX: gong}}
strikes: {song: {play: line, at: 1|1}}
phrases:
"""


def hits(phrases: str) -> list[tuple[float, str, float]]:
    """Beat, what is struck, and level of each strike, in the order of time."""
    piece = check(HEAD + phrases).piece
    (song,) = piece.strikes
    rows = [(hit.at.beats, hit.to[0].part, round(hit.level.low, 9)) for hit in song.hits]
    return sorted(rows)


def test_phrase_named_by_an_entry():
    inner = "  turn: {to: cell, entries: [{at: 0, what: C4, impulse: 2mNs}, {at: 1/2, what: D4}]}\n"
    line = "  line: {to: cell, entries: [{at: 0, what: turn}, {at: 2, what: E4, impulse: 9mNs},"
    line += " {at: 3, what: turn}]}\n"
    assert hits(inner + line) == [
        (0.0, "cell.C4", 0.002),
        (0.5, "cell.D4", 0.002),
        (2.0, "cell.E4", 0.009),
        (3.0, "cell.C4", 0.002),
        (3.5, "cell.D4", 0.002),
    ]


def test_named_phrase_with_instrument_length_and_do():
    inner = "  boom: {to: gong, length: 3, do: [stretch 2], entries: [{at: 0, what: A2,"
    inner += " impulse: 1mNs}, {at: 1, what: B2}]}\n"
    line = "  line: {to: cell, entries: [{at: 1, what: boom}]}\n"
    assert hits(inner + line) == [(1.0, "gong.A2", 0.001), (3.0, "gong.B2", 0.001)]
    song = check(HEAD.replace("at: 1|1}", "at: 1|1, times: 2}") + inner + line).piece.strikes[0]
    assert song.length.beats == 7.0  # 1 and 3 stretched to 6


def test_level_beside_named_phrase():
    inner = "  turn: {to: cell, entries: [{at: 0, what: C4}, {at: 1, what: D4, impulse: 7mNs}]}\n"
    line = (
        "  line: {to: cell, entries: [{at: 0, what: turn, impulse: 3mNs}, {at: 2, what: turn}]}\n"
    )
    levels = [level for *_, level in hits(inner + line)]
    assert levels == [0.003, 0.007, pytest.approx(4 / 7), 0.007]


@pytest.mark.parametrize("is_table", [True, False])
def test_arrow_between_levels(is_table):
    if is_table:
        rows = ["0 C4 p ->", "1 D4", "5 E4", "6 F4 f ->", "7 G4", "8 A4 pp", "9 B4"]
        line = "  line: {to: cell, entries: |\n".replace("{to: cell, entries: |", "")
        line += "    to: cell\n    entries: |\n" + "".join(f"      {row}\n" for row in rows)
    else:
        words = [
            "C4, impulse: p ->",
            "D4",
            "E4",
            "F4, impulse: f ->",
            "G4",
            "A4, impulse: pp",
            "B4",
        ]
        rows = [f"{{at: {at}, what: {word}}}" for at, word in zip("0156789", words, strict=True)]
        line = f"  line: {{to: cell, entries: [{', '.join(rows)}]}}\n"
    steps = [round(7 * level, 6) for *_, level in hits(line)]
    assert steps == [2, 3, 4, 5, 3, 1, 1]


def test_impulse_line_of_entries():
    rows = ", ".join(f"{{at: {n}, what: C4}}" for n in range(4))
    steps = [
        round(7 * s, 6)
        for *_, s in hits(f"  line: {{to: cell, impulse: p -> f, entries: [{rows}]}}\n")
    ]
    assert steps == [2, 3, 4, 5]


@pytest.mark.parametrize(
    ("phrases", "code", "words"),
    [
        (
            "  line: {to: cell, entries: [{at: 0, what: turn}]}\n"
            "  turn: {to: cell, entries: [{at: 0, what: line}]}\n",
            "E302",
            "line, which plays turn, which plays line: a circle",
        ),
        ("  line: {to: cell, entries: [{at: 0, what: tern}]}\n", "E301", "tern"),
        (
            "  line: {to: cell, entries: [{at: 0, what: C4, impulse: p ->}]}\n",
            "E204",
            "no entry after this one has a level",
        ),
        (
            "  line: {to: cell, entries: [{at: 0, what: C4, impulse: p ->},"
            " {at: 1, what: C4, impulse: 1mNs}]}\n",
            "E204",
            "of its kind",
        ),
    ],
)
def test_nested_phrase_mistakes_have_one_message(phrases, code, words):
    reports = [(c, message) for c, _, message in check_reports(HEAD + phrases) if c[0] == "E"]
    assert len(reports) == 1, reports
    assert reports[0][0] == code
    assert words in reports[0][1]


def test_arrow_without_a_level():
    line = "  line:\n    to: cell\n    entries: |\n      0 C4 ->\n      1 D4 f\n"
    ((code, position, message),) = [r for r in check_reports(HEAD + line) if r[0][0] == "E"]
    assert (code, position) == ("E204", 14)
    assert "write p ->" in message
