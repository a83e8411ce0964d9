"""Words of rhythms on what a hand plays: rev, fast, slow, every, whenmod, sometimes, degrade, …"""

from __future__ import annotations

import pytest

from ergon.notation.text.errors import TextError
from ergon.scores.pattern.turn_chain import parse_chain, split_chain
from ergon.scores.pattern.words import parse
from ergon.scores.reading.load import load
from ergon.scores.reading.piece import Piece
from ergon.scores.staging.preparing import prepare

SCORE = """\
ergon: 1
seed: {seed}
tempo: [{{at: 1|1, bpm: 120, meter: 4/4}}]
keys: {{k: {{M: 400g, K: 60N/m, Z: 1.2Ns/m, travel: -15mm..15mm}}}}
players: {{p: {{key: k}}}}
gestures:
  knock: 0mm@0 smooth 6mm@60ms 0mm@160ms
  lean: 0mm@0 smooth 3mm@1/8 smooth 0mm@1/2
parts:
  p: |
{rows}
"""


def loaded(rows: str, seed: int = 5):
    lines = "\n".join(f"    {row.strip()}" for row in rows.strip().splitlines())
    return load("s.yaml", text=SCORE.format(seed=seed, rows=lines))


def piece(rows: str, seed: int = 5) -> Piece:
    read = loaded(rows, seed)
    assert read.piece is not None, read.diagnostics
    return read.piece


def paths(rows: str, seed: int = 5) -> list[tuple[str, tuple[float, ...], tuple[float, ...]]]:
    """Each gesture that is played: its name, and the instants and positions of its points."""
    return [
        (g.name, tuple(round(t, 9) for t in g.instants), tuple(g.positions))
        for g in prepare(piece(rows, seed)).hands.gestures
    ]


def spelled(names: list[str], changes: dict[int, str]) -> str:
    """A table with a row for each beat, transformed by the words that gestures always had."""
    rows = []
    for number, name in enumerate(names):
        do = f" do {changes[number]}" if number in changes else ""
        rows.append(f"{1 + number // 4}|{1 + number % 4} {name}{do}")
    return "\n".join(rows)


@pytest.mark.parametrize(
    ("do", "changes"),
    [
        ("rev", dict.fromkeys(range(8), "reverse")),
        ("palindrome", dict.fromkeys((1, 3, 5, 7), "reverse")),
        ("every 4 rev", dict.fromkeys((0, 4), "reverse")),
        ("every 3 (rev, scale 0.5)", dict.fromkeys((0, 3, 6), "reverse, scale 0.5")),
        ("whenmod 4 2 mirror", dict.fromkeys((2, 3, 6, 7), "mirror")),
        ("every 4 fast 2", dict.fromkeys((0, 4), "stretch 1/2")),
        ("scale 0.5, every 4 slow 2", {n: "scale 0.5" for n in range(8)}
         | dict.fromkeys((0, 4), "scale 0.5, stretch 2")),
        ("every 2 every 4 rev", dict.fromkeys((0, 4), "reverse")),
        ("every 2 from 60ms, stretch 2", {n: "stretch 2" for n in range(8)}
         | dict.fromkeys((0, 2, 4, 6), "from 60ms, stretch 2")),
        ("sometimes 1 rev", dict.fromkeys(range(8), "reverse")),
        ("sometimes 0 rev, degrade 0", {}),
    ],
)  # fmt: skip
def test_gesture_rounds_equal_written_out_rounds(do, changes):
    expected = paths(spelled(["knock"] * 8, changes))
    assert paths(f"1|1 knock every 1 times 8 do {do}") == expected


def test_pattern_rounds_are_passes_through_names():
    names = ["knock", "lean"] * 4
    expected = paths(spelled(names, dict.fromkeys((0, 1, 4, 5), "reverse")))
    assert paths("1|1 knock lean every 1 times 4 do every 2 rev") == expected


def test_iter_begins_each_round_later():
    names = ["knock", "lean", "knock", "~", "lean", "knock", "~", "knock", "knock", "~"]
    names += ["knock", "lean", "~", "knock", "lean", "knock"]
    row = "1|1 knock lean knock ~ every 1 times 4 do iter 4"
    rows = [(n, name) for n, name in enumerate(names) if name != "~"]
    assert paths(row) == paths("\n".join(f"{1 + n // 4}|{1 + n % 4} {name}" for n, name in rows))


@pytest.mark.parametrize(
    ("row", "words"),
    [
        ("1|1 knock every 1 times 4 do iter 4", "needs several names"),
        ("1|1 knock lean every 1 times 4 do iter 3", "there are 2; write iter 2"),
        ("1|1 knock (lean lean) every 1 times 4 do iter 2", "without groups"),
        ("1|1 choose knock lean every 1 times 4 do iter 2", "without groups and choices"),
        ("1|1 knock lean euclid 3 8 times 4 do iter 2", "go on from pulse to pulse"),
        ("1|1 knock lean times 4 do iter 2", "write `every`"),
    ],
)
def test_iter_without_equal_shares_is_refused(row, words):
    read = loaded(row)
    assert read.piece is None
    assert words in str(read.diagnostics)


def test_chunk_changes_a_share_of_each_round():
    names = ["knock", "lean"] * 4
    expected = paths(spelled(names, dict.fromkeys((0, 3, 4, 7), "mirror")))
    assert paths("1|1 knock lean every 1 times 4 do chunk 2 mirror") == expected


def test_do_of_rounds_as_list_and_as_table():
    table = piece("1|1 knock every 1 times 8 do scale 0.5, every 4 (rev, fast 2), degrade 0.3")
    begin, _, _ = SCORE.partition("  p: |")
    for do in ("[scale 0.5, 'every 4 (rev, fast 2)', degrade 0.3]",
               "'scale 0.5, every 4 (rev, fast 2), degrade 0.3'"):  # fmt: skip
        text = (
            f"{begin.format(seed=5)}  p: [{{at: 1|1, play: knock, every: 1, times: 8, do: {do}}}]\n"
        )
        read = load("s.yaml", text=text)
        assert read.piece is not None, read.diagnostics
        result = prepare(read.piece).hands.gestures
        expected = prepare(table).hands.gestures
        assert [(g.start, tuple(g.positions)) for g in result] == [
            (g.start, tuple(g.positions)) for g in expected
        ]


@pytest.mark.parametrize(
    ("row", "same"),
    [
        ("1|1 knock every 1 times 4 do fast 2", "1|1 knock every 1/2 times 4 do stretch 1/2"),
        ("1|1 knock every 1 times 4 do slow 2", "1|1 knock every 2 times 4 do stretch 2"),
        ("1|1 knock lean every 1 until 3|1 do fast 2, fast 2",
         "1|1 knock lean every 1/4 until 3|1 do stretch 1/4"),
        ("1|1 knock euclid 3 8 times 2 do slow 2",
         "1|1 knock euclid 3 8 every 1 times 2 do stretch 2"),
        ("1|1 lean times 4 do fast 2", "1|1 lean times 4 do stretch 1/2"),
    ],
)  # fmt: skip
def test_fast_and_slow_change_the_gesture_and_its_spacing(row, same):
    assert paths(row) == paths(same)


def test_degrade_leaves_out_by_chance():
    everything = paths("1|1 knock every 1/2 times 2000")
    some = paths("1|1 knock every 1/2 times 2000 do degrade 0.3")
    assert set(some) < set(everything)
    assert 1.0 - len(some) / len(everything) == pytest.approx(0.3, abs=0.041)  # four deviations
    assert paths("1|1 knock every 1/2 times 2000 do degrade 0.3") == some
    assert paths("1|1 knock every 1/2 times 2000 do degrade 0.3", seed=6) != some


@pytest.mark.parametrize(("word", "share"), [("sometimes", 0.5), ("often", 0.75), ("rarely", 0.25)])
def test_sometimes_changes_a_share_by_chance(word, share):
    result = paths(f"1|1 knock every 1/2 times 2000 do {word} mirror")
    mirrored = [path for path in result if min(path[2]) < 0.0]
    assert len(result) == 2000
    assert len(mirrored) / 2000 == pytest.approx(share, abs=0.045)


def test_sometimes_twice_in_do_draws_independently():
    result = paths("1|1 knock every 1/2 times 1000 do sometimes mirror, sometimes scale 0.5")
    kinds = {(min(x) < 0.0, round(max(map(abs, x)), 6)) for _, _, x in result}
    assert kinds == {(False, 0.006), (False, 0.003), (True, 0.006), (True, 0.003)}


@pytest.mark.parametrize(
    ("do", "marked", "words"),
    [
        ("off 1/8 rev", "off", "one place at a time"),
        ("every 4 ply 2", "ply", "one place at a time"),
        ("superimpose rev", "superimpose", "one place at a time"),
        ("stack", "stack", "one place at a time"),
        ("jux rev", "jux", "one place at a time"),
        ("echo 3 1/8 0.7", "echo", "one place at a time"),
        ("every 2 iter 4", "every", "changes the order of all rounds"),
        ("swing 4", "swing", "beside `every`"),
        ("late 1/8", "late", "write shift 1/8"),
        ("transpose 12st", "transpose", "it has no pitch"),
        ("every rev", "every", "write for instance every 4 rev"),
        ("every 4", "every", "needs a transformation after it"),
        ("every 0 rev", "0", "write for instance every 4 rev"),
        ("sometimes 2 rev", "2", "write for instance sometimes 0.3 rev"),
        ("every 4 (rev", "(", "is not closed"),
        ("rev)", ")", "has no '(' before it"),
        ("degrade 0.3 rev", "rev", "does not belong to 'degrade'"),
        ("evry 4 rev", "evry", "unknown transformation"),
        ("fast 0", "0", "above 0"),
    ],
)
def test_gesture_round_mistakes_have_a_place(do, marked, words):
    with pytest.raises(TextError) as caught:
        parse_chain(do)
    error = caught.value
    assert words in error.message
    assert do[error.offset : error.offset + error.length] == marked


def test_deeply_nested_do_is_refused():
    with pytest.raises(TextError, match="at most 32"):
        parse_chain("often " * 40 + "rev")


def test_do_of_rounds_among_options_of_row():
    play = parse("knock every 1 do every 4 (rev, fast 2), degrade until C chance 0.5")
    assert {name: word.text for name, word in play.options.items()} == {
        "every": "1", "until": "C", "chance": "0.5"
    }  # fmt: skip
    assert len(play.transforms) == 2
    again = parse("fast rev every 1 do mirror")  # names of gestures, as before
    assert again.played.text == "fast rev"


def test_do_of_rounds_in_gesture_definition_is_refused():
    text = SCORE.format(seed=5, rows="    1|1 knock").replace(
        "  knock: 0mm@0 smooth 6mm@60ms 0mm@160ms",
        "  knock: {points: 0mm@0 smooth 6mm@60ms 0mm@160ms, do: every 4 rev}",
    )
    result = load("s.yaml", text=text)
    assert result.piece is None
    assert "a gesture by itself has none" in str(result.diagnostics)


def test_rounds_of_a_take(tmp_path):
    """Instants of a take that lasts 0.3 s, twice as slow in every second round."""
    (tmp_path / "hand.csv").write_text("t [s],x [mm]\n0.0,0.0\n0.1,7.0\n0.2,2.0\n0.3,0.0\n")
    score = SCORE.format(seed=5, rows="    1|1 nod every 1 times 4 do every 2 (slow 2, rev)")
    text = score.replace("parts:", "takes: {nod: {file: hand.csv, channel: x}}\nparts:")
    read = load(tmp_path / "s.yaml", text=text)
    assert read.piece is not None, read.diagnostics
    spans = [(g.start, g.stop) for g in prepare(read.piece).hands.gestures]
    expected = [(0.0, 0.6), (0.5, 0.8), (1.0, 1.6), (1.5, 1.8)]
    assert spans == [pytest.approx(span) for span in expected]


def test_rev_is_reverse():
    assert paths("1|1 lean do rev") == paths("1|1 lean do reverse")


def test_commas_in_parentheses_do_not_split_do():
    assert split_chain("rev, every 4 (rev, fast 2), mirror") == (
        "rev", "every 4 (rev, fast 2)", "mirror"
    )  # fmt: skip
