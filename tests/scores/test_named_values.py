"""`let:` and arithmetic with units: scores that say the same, and mistakes in their places."""

from __future__ import annotations

import re
import time
from collections.abc import Iterator

import pytest

from ergon.notation.tables.expressions import MAX_LENGTH, Amount, evaluate
from ergon.notation.tables.fields import Record
from ergon.notation.tables.shapes import MISSING, Context, Shape, Text
from ergon.notation.text.document import Mapping, compose
from ergon.notation.text.errors import Collector, TextError
from ergon.notation.text.memory import Memory
from ergon.scores.reading.digest import digest_of
from ergon.scores.reading.load import load
from ergon.scores.reading.sections import SCORE_RECORD as TABLE

SCORE = """\
ergon: 1
{let}tempo: [{{at: 1|1, bpm: {bpm}}}]
keys: {{k: {{M: {mass}, K: {stiffness}, Z: 1.2Ns/m, travel: {travel}}}}}
instruments:
  bell:
    modules:
      m: {{CEL: {{M: 2g, f: {pitch}, t60: {t60}}}}}
      s: {{STRING: {{masses: {masses}, M: 1g, f: A2}}}}
    out: {{SOX: m}}
gestures: {{knock: 0mm@0 smooth 3mm@1/8}}
players: {{ada: {{hand: virtual, key: k}}}}
parts: {{ada: [{{at: 1|1, play: knock, every: {every}, times: {times}}}]}}
mix: {{channels: 1, route: [{{from: bell, to: 1, gain: {gain}}}]}}
"""
PLAIN = {
    "bpm": "90",
    "mass": "800g",
    "stiffness": "60N/m",
    "travel": "-15mm..15mm",
    "pitch": "A2",
    "t60": "2.5s",
    "masses": "20",
    "every": "1/3bar",
    "times": "6",
    "gain": "-6dB",
}
NAMED = {
    "bpm": "2*45",
    "mass": "2*heavy",
    "stiffness": "soft + 20N/m",
    "travel": "-wide..wide",
    "pitch": "low + 7st",
    "t60": "(1s + 250ms)*2",
    "masses": "4*few",
    "every": "(1/3)*one",
    "times": "few + 1",
    "gain": "quiet / 2",
}
LET = (
    "let: {heavy: 400g, low: D2, soft: 40N/m, wide: 1.5cm, few: 5, one: 1bar, deep: -6dB, "
    "quiet: 2*deep}\n"
)


def read(let: str = "", **fields: str):
    return load("s.yaml", text=SCORE.format(let=let, **{**PLAIN, **fields}))


def test_named_values_give_same_digest():
    plain, named = read().piece, read(LET, **NAMED)
    assert plain is not None
    assert named.piece is not None, named.diagnostics
    assert digest_of(named.piece) == digest_of(plain)


def test_glide_to_named_value():
    def glide(to: str):
        more = f"automation: [{{at: 1|1, set: bell.m.f, to: {to}, over: 1bar}}]\n"
        return load("s.yaml", text=SCORE.format(let=LET, **PLAIN) + more)

    plain, named = glide("A2").piece, glide("low + 7st").piece
    assert plain is not None
    assert named is not None
    assert digest_of(named) == digest_of(plain)
    [wrong] = glide("loww + 7st").diagnostics
    assert wrong.suggestion == "low"


def test_arithmetic_without_let():
    piece = read(mass="2*400g", every="1/6bar + 1/6bar").piece
    assert piece is not None
    assert piece.keys["k"].modules[0].fields["M"] == 0.8
    assert piece.parts[0].every is not None
    assert piece.parts[0].every.bars == 1 / 3


@pytest.mark.parametrize(
    ("text", "literal"),
    [
        ("3*100g", "0.3kg"),
        ("3*0.1", "0.3"),
        ("400g/2kg", "0.2"),
        ("1/3bar", "0.3333333333333333bar"),
        ("D2 + 7st", "A2"),
        ("Bb3 - 12st", "A#2"),
        ("C4 - A3", "3st"),
        ("A3 + 50cents", "226.4464920615682Hz"),
        ("2*A3", "440Hz"),
        ("220Hz + 12st", "440Hz"),
        ("A3 + 20Hz", "240Hz"),
        ("-(3mm - 1cm)", "0.007m"),
        ("60kN/m", "60000N/m"),
        ("4e8N/m3*2", "800000000N/m3"),
        ("2 * (3 + 4) - 1", "13"),
        ("60%", "0.6"),
        ("sqrt(2)", "1.4142135623730951"),
        ("3*sqrt (400g/100g) - 1", "5"),
        ("-sqrt(sqrt(16))", "-2"),
        ("sqrt(9)/2*1kg", "1.5kg"),
    ],
)
def test_arithmetic_expression_values_and_units(text, literal):
    result = evaluate(text, {}).literal
    if result != literal:  # transcendentals to the last bit or so
        assert result[-2:] == literal[-2:] == "Hz"
        assert float(result[:-2]) == pytest.approx(float(literal[:-2]), rel=1e-12)


def test_notes_with_zero_transposition_are_unchanged():
    for octave in range(1, 8):
        for name in ("C", "C#", "Eb", "F", "A", "B"):
            here, there = f"{name}{octave}", evaluate(f"{name}{octave} + 12st - 12st", {}).literal
            plain, named = read(pitch=here).piece, read(pitch=f"{here} + 0st").piece
            assert plain is not None
            assert named is not None, there
            assert digest_of(plain) == digest_of(named)


@pytest.mark.parametrize(
    ("let", "fields", "code", "words", "column"),
    [
        (LET, {"mass": "2*hevy"}, "E201", "'hevy' is not a name", 17),
        (LET, {"mass": "heavy + 3N"}, "E201", "cannot add a value in kg and a value in N", 21),
        (LET, {"mass": "2*soft"}, "E203", "does not measure mass", 15),
        (LET, {"mass": "heavy*heavy"}, "E201", "cannot multiply", 20),
        (LET, {"mass": "heavy/0"}, "E201", "divides by zero", 20),
        (LET, {"mass": "(heavy"}, "E201", "never closed", 15),
        (LET, {"mass": "sqrt(heavy)"}, "E201", "cannot take the square root of a value in kg", 15),
        (LET, {"mass": "heavy*sqrt(0 - 1)"}, "E201", "of a number below 0", 21),
        (LET, {"mass": "heavy*sqrt 2"}, "E201", "'sqrt' is not a name", 21),
        (LET, {"mass": "heavy heavy"}, "E201", "is not allowed here", 21),
        (LET, {"mass": "-heavy"}, "E202", "not positive", 15),
        (LET, {"mass": "hevy"}, "E201", "'hevy' is not a name", 15),
        (LET, {"masses": "few/2"}, "E201", "whole number", None),
        ("let: {a: 2*b, b: 3g}\n", {}, "E201", "'b' is named below", 12),
        ("let: {A3: 2g}\n", {}, "E110", "cannot be the name", 7),
        ("let: {mm: 2g}\n", {}, "E110", "cannot be the name", 7),
        ("let: {a: [1, 2]}\n", {}, "E104", "one value", 7),
        ("let: [1, 2]\n", {}, "E106", "is a list", None),
        ("let: {a: 1e99}\n", {}, "E201", "too large", 10),
    ],
)
def test_named_value_mistakes_codes_and_columns(let, fields, code, words, column):
    loaded = read(let, **fields)
    assert loaded.piece is None
    result = loaded.diagnostics[0]
    assert (result.code, words in result.message) == (code, True), result
    assert column in (None, result.place.column)


def test_misspelt_name_has_suggestion():
    assert read(LET, mass="2*hevy").diagnostics[0].suggestion == "heavy"


def test_mistakes_without_let_do_not_mention_let():
    for text in ("400", "4,5", "heavy", "400N", "4e", "40g2", "1:30", "400 kg g"):
        message = read(mass=text).diagnostics
        assert all("let" not in one.message for one in message), (text, message)


def test_memory_with_changed_named_values():
    memory = Memory()
    for mass in ("400g", "500g", "400g"):
        let = f"let: {{heavy: {mass}}}\n"
        text = SCORE.format(let=let, **{**PLAIN, "mass": "heavy", "pitch": "A3"})
        piece = load("s.yaml", text=text, memory=memory).piece
        assert piece is not None
        assert piece.keys["k"].modules[0].fields["M"] == float(mass[:-1]) / 1000


def test_expressions_are_bounded():
    deep = "(" * 50_000 + "1" + ")" * 50_000
    grows = "*".join(["9" * 39] * 5)
    names = {"x": Amount(evaluate("9" * 30, {}).number, "")}
    for text in (deep, "-" * 100 + "1", grows, "1+" * 60_000 + "1", "x" + "*x" * 90):
        began = time.process_time()
        with pytest.raises(TextError) as caught:
            evaluate(text, names)
        assert time.process_time() - began < 0.1
        assert caught.value.offset <= max(len(text), MAX_LENGTH)
    assert evaluate("(" * 15 + "1" + ")" * 15, {}).number == 1


def texts(shape: Shape, path: str, seen: set[int]) -> Iterator[tuple[str, Text]]:
    """Every scalar of the tables, with where it stands."""
    if id(shape) in seen:
        return
    seen.add(id(shape))
    if isinstance(shape, Text):
        yield path, shape
        return
    if isinstance(shape, Record):
        for field in shape.fields:
            yield from texts(field.shape, f"{shape.noun}.{field.name}", seen)
        for kind, item in shape.kinds.items():
            yield from texts(item, f"{shape.noun}/{kind}", seen)
    for item in vars(shape).values():
        if isinstance(item, Shape):
            yield from texts(item, path, seen)


# Words, names, texts and positions, whose names are those of marks.
NO_VALUES = (
    *("score.ergon", "score.title", "tempo entry.meter", "key.calib", "module.clamp"),
    "key.simple",
    *(
        "module.law",
        "score.blocks",
        "score.marks",
        "automation.by",
        "strikes.rhythm",
        "tempo entry.at",
        "route.to",
        "include.file",
        "include.at",
    ),
)


def test_named_values_in_every_value_field():
    """In each field of the tables that takes a value."""
    n_values = 0
    for path, shape in texts(TABLE, "score", set()):
        if shape.choices or path in NO_VALUES:
            continue
        assert shape.is_value or shape.has_values, path
        for example in re.findall(r"such as ([^ ,]+)", shape.what) if shape.is_value else ():
            if example[:1] == "x" or ".." in example or "->" in example:
                continue
            collector = Collector()
            document = compose(f"let: {{own: {example}}}\nx: own", "f", collector)
            assert isinstance(document.root, Mapping)
            node = document.root.entries["x"][1]
            result = shape.read(node, "x", Context(collector))
            assert result is not MISSING, (path, example)
            assert result == shape.parse(example) or path.endswith("at"), (path, example)
            n_values += 1
    assert n_values > 40


WORDS = """\
ergon: 1
LETkeys: {k: {M: 400g, K: 60N/m, Z: 1.2Ns/m}}
instruments: {bell: {modules: {m: {CEL: {M: 2g, f: A4, t60: 1s}}}, out: {SOX: m}}}
gestures:
  knock: 0mm@0 DEEP@1 (DEEPER@1/3 0mm@1)*2
  table:
    points: |
      0  0mm
      1  DEEP
  soft: {like: knock, do: [scale HALF, stretch TWICE]}
players: {ada: {key: k}}
parts:
  ada: |
    0  knock every LENGTH times COUNT
strikes:
  hit: {to: bell.m, at: 0, every: 1, times: 2, impulse: 1mNs, notes: LOW C4 HIGH}
  tune:
    entries: |
      1|1  bell.m  SOFT
      1|2  bell.m  STRONG
automation:
  - {at: 0, set: bell.m.f, to: A3@0 smooth LOW@2 line HIGH@3}
  - {at: 4, set: bell.m.f, to: LOW C4 HIGH, every: 1}
  - {at: 12, lfo: bell.m.t60, range: HALFLONG..LONG, period: 1}
"""
LITERALS = {
    **{"DEEPER": "6mm", "DEEP": "3mm", "HALFLONG": "1s", "HALF": "0.5", "TWICE": "2"},
    **{"LENGTH": "1/2", "COUNT": "3", "LOW": "A2", "HIGH": "E3", "SOFT": "1mNs"},
    **{"STRONG": "2mNs", "LONG": "2s"},
}
BY_NAME = {
    **{"DEEPER": "2*deep", "DEEP": "deep", "HALFLONG": "half*long", "HALF": "half", "TWICE": "2"},
    **{"LENGTH": "half", "COUNT": "n", "LOW": "low", "HIGH": "low+7st", "SOFT": "soft"},
    **{"STRONG": "2*soft", "LONG": "long"},
}


def written(words: dict[str, str], let: str = "") -> str:
    text = WORDS
    for word, message in words.items():
        text = text.replace(word, message)
    return text.replace("LET", let)


def test_named_values_in_notations_tables_and_curves():
    plain = load("s.yaml", text=written(LITERALS))
    let = "let: {deep: 3mm, half: 0.5, n: 3, low: A2, soft: 1mNs, long: 2s}\n"
    named = load("s.yaml", text=written(BY_NAME, let))
    assert plain.piece is not None
    assert [item.message for item in named.diagnostics if item.code[0] == "E"] == []
    assert named.piece is not None
    item, two = plain.piece, named.piece
    for mine, other in zip(item.gestures.values(), two.gestures.values(), strict=True):
        points = [[(p.at, p.x, p.curve) for p in own.points] for own in (mine, other)]
        assert points[0] == points[1]
        assert mine.do == other.do
    assert item.starts == two.starts
    assert [[hit.level for hit in s.hits] for s in item.strikes] == [
        [hit.level for hit in s.hits] for s in two.strikes
    ]
    for mine, other in zip(item.automation, two.automation, strict=True):
        assert mine.points == other.points
        assert list(mine.amounts.values()) == list(other.amounts.values())
        assert mine.swing == other.swing


def test_mistake_beside_a_named_value_has_its_place():
    text = written(BY_NAME, "let: {deep: 3mm, half: 0.5, n: 3, low: A2, soft: 1mNs, long: 2s}\n")
    text = text.replace("line low+7st@3", "lime low+7st@3")
    result = [d for d in load("s.yaml", text=text).diagnostics if d.code[0] == "E"]
    assert [(d.code, d.suggestion) for d in result] == [("E204", "line")]
    place = result[0].place
    assert place is not None
    assert text.splitlines()[place.line - 1][place.column - 1 :].startswith("lime")


TABLE_SCORE = """\
ergon: 1
let: {{soft: 1mNs, low: D3, late: 2, heavy: 3g}}
instruments:
  s: {{notes: [D3, F3, A3], modules: {{m: {{CEL: {{M: 1g, f: D4, t60: 1s}}}}}}, out: {{SOX: m}}}}
strikes:
  t:
    to: s
    entries: |
{rows}
"""
TABLES = [
    ("1|1  low  soft", "1|1  D3  1mNs"),
    ("1|1  low+3st  2*soft", "1|1  F3  2mNs"),
    ("1|1  low low+7st  soft/2", "1|1  D3 A3  0.5mNs"),
    ("late*2  D3  2mNs", "4  D3  2mNs"),
    ("1|1  D3  soft\n      1|2  low+7st", "1|1  D3  1mNs\n      1|2  A3"),
]


def struck(rows: str):
    read = load("score.yaml", text=TABLE_SCORE.format(rows="      " + rows))
    assert read.piece is not None, read.diagnostics
    (strikes,) = read.piece.strikes
    return [(hit.at, [(to.part, to.module) for to in hit.to], hit.level) for hit in strikes.hits]


@pytest.mark.parametrize(("named", "plain"), TABLES)
def test_strikes_table_with_named_values(named: str, plain: str) -> None:
    assert struck(named) == struck(plain)


@pytest.mark.parametrize(
    ("rows", "code", "message", "suggestion"),
    [
        ("1|1  D3  sofd*2", "E201", "'sofd' is not a name of `let:`", "soft"),
        ("1|1  D3  2*low", "E203", "'2*low' is 293.6647679174076Hz: unit 'Hz'", None),
        ("1|1  D3  2*heavy", "E203", "'2*heavy' is 0.006kg: unit 'kg'", None),
        ("1|1  lov+3st  soft", "E201", "'lov' is not a name of `let:`", "low"),
        ("lat*2  D3  soft", "E201", "'lat' is not a name of `let:`", "late"),
        ("late*heavy  D3  soft", "E203", "'late*heavy' is 0.006kg", None),
    ],
)
def test_strikes_table_mistakes_in_named_values(
    rows: str, code: str, message: str, suggestion: str | None
) -> None:
    (result,) = load("score.yaml", text=TABLE_SCORE.format(rows="      " + rows)).diagnostics
    assert (result.code, result.suggestion) == (code, suggestion)
    assert message in result.message


def test_wrong_value_in_unknown_field_has_one_message() -> None:
    text = "ergon: 1\ninstruments: {b: {from: bell/bell, t60: 3x}}\n"
    (result,) = load("score.yaml", text=text).diagnostics
    assert (result.code, result.place.column) == ("E203", 42)


PLACED = """\
ergon: 1
{let}tempo: [{{at: 1|1, bpm: 60}}]
marks: {{A: {mark}, c: 3|1}}
instruments: {{bell: {{modules: {{m: {{CEL: {{M: 2g, f: A4, t60: 1s}}}}}}, out: {{SOX: m}}}}}}
keys: {{k: {{M: 400g, K: 60N/m, Z: 1.2Ns/m}}}}
gestures: {{knock: 0mm@0 smooth 3mm@1/8}}
players: {{ada: {{key: k}}}}
strikes:
  one: {{to: bell.m, at: {one}, until: {until}, every: 1, impulse: 1mNs}}
  rows: |
    {row}  bell.m  1mNs
parts:
  ada: |
    {at}  knock every 1 until {cell}
mix: {{channels: 1, route: [{{from: bell, to: 1}}]}}
"""


def test_named_values_and_arithmetic_in_positions():
    let = "let: {first: 4, gap_: 1/2, later: 250ms, c: 7, step: 2bar}\n"
    named = {
        "mark": "1|1 + first*2",
        "one": "(first + 1)*2",
        "until": "3|1 + step",
        "row": "A+3*gap_",
        "at": "c+later",  # a mark has the name: it wins
        "cell": "c+2*step",
    }
    plain = {
        "mark": "1|1+8",
        "one": "10",
        "until": "3|1+2bar",
        "row": "A+1.5",
        "at": "c+250ms",
        "cell": "c+4bar",
    }
    result = [
        load("s.yaml", text=PLACED.format(let=message, **values))
        for message, values in ((let, named), ("", plain))
    ]
    assert [item.diagnostics for item in result] == [[], []]
    marks, strikes, parts = (
        [
            [item.piece.tempo_map.resolve(value.at) for value in getattr(item.piece, name)]
            for item in result
        ]
        for name in ("marks", "strikes", "parts")
    )
    assert marks[0] == marks[1]
    assert strikes[0] == strikes[1]
    assert parts[0] == parts[1]


@pytest.mark.parametrize(
    ("written", "code", "message"),
    [
        ("step*2", "E204", "'step*2' is 4bar: a number of bars is not a position"),
        ("first*400g", "E203", "is 1.6kg"),
        ("A+frst", "E201", "'frst' is not a name"),
        ("first*", "E201", "a value is missing"),
        ("A+(first", "E201", "never closed"),
        ("3|1+first*x", "E201", "'x' is not a name"),
    ],
)
def test_invalid_positions_with_named_values(written: str, code: str, message: str):
    text = f"ergon: 1\nlet: {{first: 4, step: 2bar}}\nmarks: {{A: 2|1, B: '{written}'}}\n"
    (result,) = load("s.yaml", text=text).diagnostics
    assert result.code == code
    assert message in result.message
    assert result.place.line == 3


@pytest.mark.parametrize(
    ("written", "suggestion", "help"),
    [
        ("c-gap", "c - gap", None),
        ("c-gap+1", "c - gap", None),
        ("last-verse-gap", "last-verse - gap", None),
        ("c-gap-first", "c - gap - first", None),
        ("c-A", None, "a mark is not a length; write how far before it, such as c-1bar"),
        ("c-gapp", None, "known here: A, c, last-verse, x"),
        ("last-vers", "last-verse", None),
    ],
)
def test_mark_minus_name_without_spaces_suggestion(written, suggestion, help):
    text = (
        "ergon: 1\nlet: {first: 4, gap: 1/2}\n"
        f"marks: {{A: 2|1, c: 3|1, last-verse: 5|1, x: '{written}'}}\n"
    )
    (result,) = load("s.yaml", text=text).diagnostics
    assert (result.code, result.suggestion, result.help) == ("E301", suggestion, help)


def test_mark_with_hyphen_versus_spaced_difference():
    text = "ergon: 1\nlet: {gap: 1/2}\nmarks: {c: 3|1, c-gap: 9|1, x: c-gap, y: c - gap}\n"
    result = load("s.yaml", text=text)
    assert not result.diagnostics
    marks = {mark.name: result.piece.tempo_map.resolve(mark.at) for mark in result.piece.marks}
    assert (marks["x"], marks["y"]) == (32, 7.5)


def test_position_in_let_suggests_marks():
    (found,) = load("s.yaml", text="ergon: 1\nlet: {first: 3|1}\n").diagnostics
    assert "name it under `marks:`" in found.message


@pytest.mark.parametrize(("pitch", "same"), [("500Hz/2", "250Hz"), ("2kHz/(4+4)", "250Hz")])
def test_quantity_divided_without_spaces(pitch: str, same: str):
    assert read("", pitch=pitch).piece == read("", pitch=same).piece
