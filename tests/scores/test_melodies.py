"""Melodies: strikes as lists and tables, and phrases that are played, moved and repeated."""

import numpy as np
import pytest
from checked import check, check_reports
from sweep import few

from ergon.scores.edits import parts
from ergon.scores.edits.excerpt import excerpt_between
from ergon.scores.edits.texts import Texts
from ergon.scores.reading.load import load
from ergon.scores.reading.piece import Piece
from ergon.scores.staging.stage import stage

CELLS = """\
ergon: 1
seed: 7
tempo: [{at: 1|1, bpm: 240}, {at: 5|1, bpm: 240 -> 300, over: 4}]
marks: {B: 3|1}
instruments:
  cell: {CEL: {M: 1g, f: A4, t60: 2s}, notes: C3..C5, out: {SOX: cell}}
  string: {from: string/string, notes: [D3, F3]}
  lone: {CEL: {M: 1g, f: A3, t60: 1s}, out: {SOX: lone}}
render: {tail: 0.1s}
"""
CALL = """\
phrases:
  call:
    to: cell
    length: 4
    impulse: 1mNs
    entries: |
      # at  what  impulse
      0     C3
      1/2   E3 G3   3mNs
      3     Db3     1mNs..2mNs
"""


def piece(text: str) -> Piece:
    loaded = check(CELLS + text)
    assert loaded.piece is not None, loaded.diagnostics
    return loaded.piece


def falls(text: str, name: str = "s") -> list[tuple[float, tuple[str, ...], tuple[float, float]]]:
    built = piece(text)
    strikes = next(s for s in built.strikes if s.name == name)
    return [
        (round(beat, 9), tuple(t.part for t in hit.to), (hit.level.low, hit.level.high))
        for beat, _, hit in strikes.played_hits(built)
    ]


def sound(text: str) -> np.ndarray:
    staged = stage(piece(text))
    out = np.zeros((staged.n_frames, staged.simulation.n_out))
    staged.simulation.process(out)
    assert np.abs(out).max() > 0
    return out


# --- tables and lists ---------------------------------------------------------------------------

BY_HAND = """\
strikes:
  a: {to: cell.C4, at: 1|1, impulse: 2mNs}
  b: {to: [cell.E4, cell.G#4], at: 1|2.5, impulse: 2mNs}
  c: {to: string.F3.hammer, at: B, impulse: 5mNs}
"""


@pytest.mark.parametrize(
    "written",
    few(
        [
            """\
strikes:
  s: |
    # at      what              impulse
    1|1       cell.C4           2mNs
    1|2.5     cell.E4 cell.Ab4
    B         string.F3.hammer  5mNs   # the hammer
""",
            """\
strikes:
  s:
    - {at: 1|1, what: cell.C4, impulse: 2mNs}
    - {at: 1|2.5, what: [cell.E4, cell.G#4]}
    - {at: B, what: string.F3.hammer, impulse: 5mNs}
""",
            """\
strikes:
  s: {to: cell, impulse: 2mNs, entries: [{at: 1|1, what: C4}, {at: 1|2.5, what: E4 G#4}]}
  t: {to: string.hammer, entries: "B F3 5mNs"}
""",
            """\
phrases:
  p: |
    0   C4        2mNs
    3/2 E4 G#4
  q: {to: string.hammer, length: 1bar, entries: [{at: 0, what: F3, impulse: 5mNs}]}
strikes:
  s: {play: p, at: 1|1, to: cell}
  t: {play: q, at: B}
""",
        ],
        2,
    ),
)
def test_melody_notations_equal_strikes_by_hand(written):
    assert sound(written).tobytes() == sound(BY_HAND).tobytes()


def test_melody_impulse_holds_until_next():
    text = "strikes: {s: {to: cell, entries: [{at: 0, what: C3, impulse: 2mNs}, {at: 1, what: D3},"
    text += " {at: 2, what: E3, impulse: 3mNs..4mNs}, {at: 3, what: F3}]}}\n"
    both = (0.003, 0.004)
    assert [impulse for *_, impulse in falls(text)] == [(0.002, 0.002)] * 2 + [both] * 2


def test_melody_to_strikes_several_instruments():
    text = "strikes: {s: {to: [cell, string.hammer], impulse: 1mNs, entries: '0  D3'}}\n"
    assert falls(text) == [(0.0, ("cell.D3", "string.D3"), (0.001, 0.001))]


# --- phrases ------------------------------------------------------------------------------------


def test_phrase_repeats_after_its_length():
    text = f"{CALL}strikes: {{s: {{play: call, at: 1|1, times: 2}}}}\n"
    assert [beat for beat, *_ in falls(text)] == [0.0, 0.5, 3.0, 4.0, 4.5, 7.0]
    text = f"{CALL}strikes: {{s: {{play: call, at: B, every: 2, until: 4|1}}}}\n"
    assert [beat for beat, *_ in falls(text)] == [8.0, 8.5, 11.0, 10.0, 10.5, 13.0]


def test_phrase_without_length_ends_on_next_beat():
    text = "phrases: {p: '5/2  lone 1mNs'}\nstrikes: {s: {play: p, at: 0, times: 3}}\n"
    assert [beat for beat, *_ in falls(text)] == [2.5, 5.5, 8.5]


def test_phrase_lengths_in_bars_and_seconds():
    text = "phrases: {p: {length: 1bar, entries: '250ms  lone 1mNs'}}\n"
    text += "strikes: {s: {play: p, at: 1|1, times: 2}}\n"
    assert [beat for beat, *_ in falls(text)] == [1.0, 5.0]


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ("transpose: 5st", "0 F3 1, 0.5 A3 C4 3, 3 F#3 1"),
        ("transpose: -100cents, to: low", "0 B2 1, 0.5 D#3 F#3 3, 3 C3 1"),
        ("do: stretch 2", "0 C3 1, 1 E3 G3 3, 6 C#3 1"),
        ("do: scale 0.5", "0 C3 0.5, 0.5 E3 G3 1.5, 3 C#3 0.5"),
        ("do: shift 1/4", "0.25 C3 1, 0.75 E3 G3 3, 3.25 C#3 1"),
        ("do: reverse", "0 C#3 1, 2.5 E3 G3 3, 3 C3 1"),
        ("do: quantise 1", "0 C3 1, 1 E3 G3 3, 3 C#3 1"),
        ("do: 'mirror', transpose: 12st", "0 C4 1, 0.5 G#3 F3 3, 3 B3 1"),
        ("do: [stretch 2, reverse]", "0 C#3 1, 5 E3 G3 3, 6 C3 1"),
    ],
)
def test_phrase_transposed_and_transformed(options, expected):
    low = "  low: {CEL: {M: 1g, f: A4, t60: 2s}, notes: C2..C4}\n"
    text = f"{CALL}strikes: {{s: {{play: call, at: 0, {options}}}}}\n"
    loaded = check(CELLS.replace("render:", f"{low}render:") + text)
    assert loaded.piece is not None, loaded.diagnostics
    built = loaded.piece
    message = [
        f"{beat:.9g} {' '.join(t.part.split('.')[1] for t in hit.to)} {hit.level.low * 1e3:.9g}"
        for beat, _, hit in built.strikes[0].played_hits(built)
    ]
    assert ", ".join(message) == expected


def test_phrases_of_used_files():
    text = "use: {lib: lib.yaml}\nstrikes: {s: {play: lib.call, at: 0}}\n"
    loaded = check(CELLS + text, lib=f"ergon: 1\n{CALL}")
    assert loaded.piece is not None, loaded.diagnostics
    assert len(loaded.piece.strikes[0].hits) == 3


# --- patterns -----------------------------------------------------------------------------------


def test_notes_pattern_equals_melody_by_hand():
    text = (
        "strikes: {s: {to: cell, at: 0, impulse: 1mNs, notes: C4 E4 ~ Ab4, every: 1, times: 2}}\n"
    )
    by_hand = """\
strikes:
  s: |
    0  cell.C4   1mNs
    1  cell.E4
    3  cell.G#4
    4  cell.C4
    5  cell.E4
    7  cell.G#4
"""
    assert sound(text).tobytes() == sound(by_hand).tobytes()


def test_notes_pattern_with_scales_and_chance():
    text = "strikes: {s: {to: string.hammer, at: 0, impulse: 1mNs, notes: D3.min, every: 1}}\n"
    built = piece(text.replace("D3.min", "choose D3 F3"))
    assert {t.part for t in built.strikes[0].to} == {"string.D3", "string.F3"}
    (message,) = check(CELLS + text).diagnostics
    known = "; its notes are D3 to F3"
    assert message.code == "E301"
    assert message.message == f"strikes 's': 'string.hammer' has no note 'A3'{known}"
    (message,) = check(CELLS + text.replace("D3.min", "D3 221Hz")).diagnostics
    assert message.message == f"strikes 's': 'string.hammer' has no note '221Hz'{known}"


# --- what is refused ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "report"),
    [
        (
            "strikes: {s: {play: nope, at: 0}}",
            ("E301", "strikes 's': no phrase or MIDI take is called 'nope'"),
        ),
        (
            "phrases: {p: '1s  lone 1mNs'}\nstrikes: {s: {play: p, at: 0}}",
            ("E103", "phrase 'p' has no 'length': not all its entries are in beats"),
        ),
        (
            "strikes: {s: '0  lone'}",
            (
                "E103",
                "strikes 's': how strongly? 'lone' has no `play` that says what soft and hard "
                "are; write an impulse with its unit, such as impulse: 2mNs",
            ),
        ),
        (
            "strikes: {s: '0  C3  1mNs'}",
            ("E103", "strikes 's': 'C3' is a note; write `to`, whose notes are struck"),
        ),
        (
            "strikes: {s: {to: lone, entries: '0  C3  1mNs'}}",
            ("E304", "strikes 's': 'lone' has no notes; write `notes` in the instrument"),
        ),
        (
            "strikes: {s: {to: string, entries: '0  E3  1mNs'}}",
            ("E301", "strikes 's': 'string' has no note 'E3'; its notes are D3 to F3"),
        ),
        (
            f"{CALL}strikes: {{s: {{play: call, at: 0, transpose: 24st}}}}",
            (
                "E301",
                "strikes 's': 'cell' has no note 'E5', to which 'E3' is moved; "
                "its notes are C3 to C5",
            ),
        ),
        (
            f"{CALL}strikes: {{s: {{play: call, at: 0, transpose: 50cents}}}}",
            (
                "E301",
                "strikes 's': 'cell' has no note 'C3+50cents', to which 'C3' is moved; "
                "its notes are C3 to C5",
            ),
        ),
        (
            "phrases: {p: '0  lone 1mNs'}\nstrikes: {s: {play: p, at: 0, transpose: 1st}}",
            ("E306", "transpose of strikes 's': 'lone' has no note that could be transposed"),
        ),
        (
            "phrases: {p: '0  lone 1mNs'}\nstrikes: {s: {play: p, at: 0, do: mirror}}",
            ("E306", "do of strikes 's': 'lone' has no note to mirror about"),
        ),
        (
            f"{CALL}strikes: {{s: {{play: call, at: 0, do: jitter 1ms 1mm}}}}",
            (
                "E306",
                "do of strikes 's': a phrase has instants and no positions to move; write "
                "jitter 4ms 0mm",
            ),
        ),
        (
            f"{CALL}strikes: {{s: {{play: call, at: 0, do: from 4}}}}",
            ("E306", "do of strikes 's': 'from' begins after the last entry of this phrase"),
        ),
        (
            f"{CALL}strikes: {{s: {{play: call, at: 0, do: from 1s}}}}",
            (
                "E306",
                "do of strikes 's': 'from' needs entries and a length in its own unit: all in "
                "beats or in seconds",
            ),
        ),
        (
            f"{CALL}strikes: {{s: {{play: call, at: 0, rate: 3Hz, for: 4}}}}",
            ("E111", "rate of strikes 's' cannot be used together with `play`; remove it"),
        ),
        (
            "strikes: {s: {to: lone, at: 0, impulse: 1mNs, transpose: 3st}}",
            (
                "E111",
                "transpose of strikes 's' needs `play` beside it; write that, or remove this",
            ),
        ),
        ("strikes: {s: 'Q  lone  1mNs'}", ("E301", "no mark is called 'Q'")),
        (
            "strikes: {s: '0  1mNs'}",
            (
                "E204",
                "a row has a time, what is struck and an impulse, such as 1|1  D3 F3  2mNs",
            ),
        ),
        (
            "strikes: {s: []}",
            ("E106", "strikes 's': the number of items is 0, but must be at least 1"),
        ),
        ("strikes: {s: '# nothing'}", ("E106", "strikes 's': the table has no row")),
        (
            "strikes: {s: {at: 0, impulse: 1mNs}}",
            ("E103", "strikes 's' has no 'to': a list, each modules, such as sky.all"),
        ),
        (
            f"{CALL}strikes: {{s: {{play: call, at: 0, times: 900000}}}}",
            ("E105", "strikes 's': the piece has more than 2,000,000 strikes"),
        ),
        (
            f"{CALL}strikes: {{s: {{play: call, at: 0, times: 9, every: 0}}}}",
            ("E305", "strikes 's': 'every' must be above 0"),
        ),
        (
            "phrases: {p: {length: 0, entries: '0  lone 1mNs'}}\n"
            "strikes: {s: {play: p, at: 0, times: 2}}",
            (
                "E305",
                "strikes 's': the gesture has no duration; write the time between repetitions, "
                "such as every: 1",
            ),
        ),
    ],
)
def test_melody_mistakes_are_refused(text, report):
    code, _, message = check_reports(f"{CELLS}{text}\n")[0]
    assert (code, message) == report


def test_melody_table_mistake_places():
    text = f"{CELLS}strikes:\n  s: |\n    0  lone  1mNs\n    1  lne  1mNs\n    2  lone  1mNx\n"
    message = [
        (d.code, d.place.line, d.place.column, d.suggestion) for d in check(text).diagnostics
    ]
    first = text.count("\n") - 1
    assert message == [("E203", first + 1, 15, "mNs")]
    message = [
        (d.code, d.place.line, d.place.column, d.suggestion)
        for d in check(text.replace("mNx", "mNs")).diagnostics
    ]
    assert message == [("E301", first, 8, "lone")]


# --- in a session -------------------------------------------------------------------------------

TABLE = (
    "strikes: {s: {to: cell, impulse: 1mNs, entries: [{at: 0, what: C3}, {at: 9, what: D3 E3}]}}\n"
)


def texts(more: str) -> tuple[Texts, Piece]:
    single = Texts("s.yaml", CELLS + more)
    built = single.load().piece
    assert built is not None
    return single, built


def falling(texts: Texts) -> list[tuple[float, int]]:
    built = texts.load().piece
    assert built is not None, texts.load().diagnostics
    result = [hit for s in built.strikes for hit in s.played_hits(built)]
    return sorted((round(beat, 9), len(hit.to)) for beat, _, hit in result)


def test_hush_ends_melodies():
    assert falling(parts.end_all_parts(*texts(TABLE), 4.0)) == [(0.0, 1)]
    phrase = f"{CALL}strikes: {{s: {{play: call, at: 0, times: 4}}}}\n"
    assert falling(parts.end_all_parts(*texts(phrase), 8.0)) == [
        *((0.0, 1), (0.5, 2), (3.0, 1), (4.0, 1), (4.5, 2), (7.0, 1)),
    ]


def test_keep_of_bars_of_a_melody():
    assert falling(excerpt_between(*texts(TABLE), "kept", 8.0, 12.0)) == [(1.0, 2)]
    phrase = f"{CALL}strikes: {{s: {{play: call, at: 0, times: 4}}}}\n"
    assert falling(excerpt_between(*texts(phrase), "kept", 4.0, 12.0)) == [
        *((0.0, 1), (0.5, 2), (3.0, 1), (4.0, 1), (4.5, 2), (7.0, 1)),
    ]


def test_phrase_with_from_drops_first_beats():
    """Two beats are left out, of its length too; what is left out first gave the impulse."""
    inside = falls(f"{CALL}strikes: {{s: {{play: call, at: 0, times: 2, do: from 1/2}}}}")
    assert inside == [
        (0.0, ("cell.E3", "cell.G3"), (3e-3, 3e-3)),
        (2.5, ("cell.C#3",), (1e-3, 2e-3)),
        (3.5, ("cell.E3", "cell.G3"), (3e-3, 3e-3)),
        (6.0, ("cell.C#3",), (1e-3, 2e-3)),
    ]


def onsets(do: str, seed: int = 7) -> list[float]:
    """Instants at which strikes of different cells begin, from the sound [s]."""
    entries = "0 C3 1mNs, 1 E3 1mNs, 2 G3 1mNs, 3 B3 1mNs".replace(", ", "\n      ")
    phrase = f"phrases:\n  p:\n    to: cell\n    length: 4\n    entries: |\n      {entries}\n"
    text = f"{phrase}strikes: {{s: {{play: p, at: 1, do: '{do}'}}}}"
    loaded = check(CELLS.replace("seed: 7", f"seed: {seed}") + text)
    assert loaded.piece is not None, loaded.diagnostics
    staged = stage(loaded.piece)
    out = np.zeros((staged.n_frames, staged.simulation.n_out))
    staged.simulation.process(out)
    listened = [np.flatnonzero(column) for column in out.T]
    return sorted(own[0] / staged.rate for own in listened if len(own))


def test_phrase_jitter_draws_by_strike():
    plain, moved = onsets("scale 1"), onsets("jitter 20ms 0mm")
    apart = [a - b for a, b in zip(moved, plain, strict=True)]
    assert all(0 < abs(one) <= 0.0201 for one in apart)
    assert len({round(one, 6) for one in apart}) == 4
    assert moved == onsets("jitter 20ms 0mm")
    assert moved != onsets("jitter 20ms 0mm", seed=8)
    assert onsets("jitter 0ms 0mm") == plain


def test_notes_of_instrument_share_output_channels():
    """Without routes: a channel for each output of an instrument, whatever its notes."""
    built = piece(f"{CALL}strikes: {{s: {{play: call, at: 0}}}}")
    staged = stage(built)
    assert staged.n_channels == 3  # cell, string, lone
    assert {way.channel for way in staged.listening.tap_routes if way.part.startswith("cell.")} == {
        0
    }


def test_melody_rows_on_one_module_have_their_places():
    text = """\
ergon: 1
instruments:
  bell: {modules: {m: {CEL: {M: 2g, f: A3, t60: 0.5s}}}, out: {SOX: m}}
strikes:
  tab: |
    1|1 bell.m 1mNs
    1|2 bell.m
    1|3 bell.q
    1|4 bell.q
"""
    good = load("s.yaml", text=text.partition("    1|3")[0]).piece
    assert good is not None
    assert [hit.to[0].place.line for hit in good.strikes[0].hits] == [6, 7]
    wrong = [one.place.line for one in load("s.yaml", text=text).diagnostics]
    assert [line for line in wrong if line > 7] == [8, 9]


# --- phrases like others ------------------------------------------------------------------------

LIKE = """\
phrases:
  call: {to: cell, entries: "0 C3 1mNs\\n1 D3 2mNs\\n3/2 F3 4mNs", length: 3}
  back: {like: call, do: reverse}
  long: {like: back, length: 4, do: [stretch 2, scale 0.5]}
  other: {like: call, entries: "1/2 F3 1mNs"}
strikes: {s: {play: PLAYED, at: 0, every: 8, times: 1}}
"""


@pytest.mark.parametrize(
    ("name", "expected", "length"),
    [
        ("call", [(0.0, "cell.C3", 1.0), (1.0, "cell.D3", 2.0), (1.5, "cell.F3", 4.0)], 3.0),
        ("back", [(0.0, "cell.F3", 4.0), (0.5, "cell.D3", 2.0), (1.5, "cell.C3", 1.0)], 3.0),
        ("long", [(0.0, "cell.F3", 2.0), (1.0, "cell.D3", 1.0), (3.0, "cell.C3", 0.5)], 8.0),
        ("other", [(0.5, "cell.F3", 1.0)], 3.0),
    ],
)
def test_phrases_with_like_and_transform(name, expected, length):
    result = check(CELLS + LIKE.replace("PLAYED", name))
    assert result.piece is not None, result.diagnostics
    (strikes,) = result.piece.strikes
    hits = [(hit.at.beats, hit.to[0].part, 1e3 * hit.level.low) for hit in strikes.hits]
    assert sorted(hits) == [(at, part, pytest.approx(mns)) for at, part, mns in expected]
    assert strikes.length.beats == length


@pytest.mark.parametrize(
    ("old", "new", "code", "words"),
    [
        ("like: call, do", "like: cal, do", "E301", "no phrase is called 'cal'"),
        ("like: call, do", "like: long, do", "E302", "begins with the values of long (line"),
        ("do: reverse", "do: every 2 rev", "E204", "'every' is of rhythms; write it in `do`"),
        ("do: reverse", "do: [reverse, degrade]", "E204", "'degrade' is of rhythms"),
        ("do: reverse", "do: from 9", "E306", "'from' begins after the last entry"),
        ("like: call, do: reverse", "length: 2", "E103", "phrase 'back' has no 'entries'"),
    ],
)
def test_phrases_with_invalid_like_are_refused(old, new, code, words):
    text = LIKE.replace("PLAYED", "back")
    assert old in text
    first, *_ = check(CELLS + text.replace(old, new, 1)).diagnostics
    assert first.code == code
    assert words in first.message
