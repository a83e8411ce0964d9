"""Loops and conditions among modules: the model they write out, and mistakes in their places."""

from __future__ import annotations

import textwrap
from dataclasses import replace

import pytest
from checked import check, check_reports, codes
from edited import opened
from sessions import Stepped
from sweep import few

from ergon.instruments.model import Module, Target
from ergon.notation.tables import loops
from ergon.notation.tables.conditions import is_true
from ergon.notation.tables.expressions import Amount, evaluate
from ergon.notation.tables.loops import MAX_TURNS
from ergon.notation.text.errors import TextError
from ergon.notation.text.format import formatted
from ergon.notation.text.memory import Memory
from ergon.notation.text.values import Place
from ergon.scores.edits import matter
from ergon.scores.reading.digest import digest_of
from ergon.scores.reading.load import load

NOWHERE = Place("", 0, 0)
HEAD = """\
ergon: 1
let: {n: 8, stiff: 4kN/m}
instruments:
  chain:
    modules:
      left: {SOL: {}}
"""
LOOPS = """\
      for i in 1..n:
        let: {part: i/n}
        m(i): {MAS: {M: 4g*(1 + part)}}
        if i > 1:
          s(i): {REF: {between: [m(i-1), m(i)], K: stiff*i, Z: 20mNs/m}}
        if i mod 3 == 0 and not i == 3:
          rub(i): {FRO: {between: [left, m(i)], Z: 0.01Ns/m}}
"""
TAIL = """\
    out: {x: {SOX: m2}, y: {SOX: m5}}
strikes: {hit: {to: chain.m3, at: 0s, impulse: 1mNs}}
mix: {channels: 2, route: [{from: chain.x, to: 1}, {from: chain.y, to: 2}]}
render: {tail: 0.1s}
"""


def written_modules(n: int = 8) -> str:
    """What `LOOPS` stands for, written out by this test."""
    lines = []
    for i in range(1, n + 1):
        lines.append(f"m{i}: {{MAS: {{M: {4 * (1 + i / n)!r}g}}}}")
        if i > 1:
            lines.append(
                f"s{i}: {{REF: {{between: [m{i - 1}, m{i}], K: {4 * i}kN/m, Z: 20mNs/m}}}}"
            )
        if i == 6:
            lines.append(f"rub{i}: {{FRO: {{between: [left, m{i}], Z: 0.01Ns/m}}}}")
    return textwrap.indent("\n".join(lines), " " * 6) + "\n"


def piece_of(modules: str):
    result = check(HEAD + modules + TAIL)
    assert result.piece is not None, result.diagnostics
    return result.piece


def names_of(modules: str) -> list[str]:
    return [module.name for module in piece_of(modules).instruments["chain"].modules]


def placeless(part):
    """A part without the places where it is written."""
    if isinstance(part, tuple):
        return tuple(map(placeless, part))
    if not isinstance(part, (Module, Target)):
        return part
    fields = {"place": NOWHERE}
    if isinstance(part, Module):
        fields["fields"] = {name: placeless(value) for name, value in part.fields.items()}
    else:
        fields["text"] = ""
    return replace(part, **fields)


def report(modules: str) -> list[tuple[str, int, str]]:
    return check_reports(HEAD + modules + TAIL)


def test_loop_reads_as_the_modules_written_out():
    looped, written = piece_of(LOOPS), piece_of(written_modules())
    modules = looped.instruments["chain"].modules
    assert len(modules) == 1 + 8 + 7 + 1
    assert placeless(modules) == placeless(written.instruments["chain"].modules)
    assert digest_of(looped) == digest_of(written)


def test_nested_loops_with_two_numbers_in_names():
    modules = """\
      for row in 0..1:
        for column in 1..2*row + 2 by 2:
          m(row)_(column): {MAS: {M: 1g}}
      for i in 2..5: {m(i): {MAS: {M: 1g}}}
"""
    assert names_of(modules) == ["left", "m0_1", "m1_1", "m1_3", "m2", "m3", "m4", "m5"]


def test_loop_with_empty_range_makes_no_modules():
    assert names_of("      for i in 3..2: {q(i): {SOL: {}}}\n" + LOOPS) == names_of(LOOPS)


def test_loop_member_number_by_expression():
    modules = """\
      string: {STRING: {masses: 12, M: 2g, f: A2, t60: 1s}}
      for i in 1..3:
        tie(i): {REF: {between: [left, string.(3*i)], K: 10N/m, Z: 0Ns/m}}
"""
    ties = piece_of(modules + LOOPS).instruments["chain"].modules[2:5]
    assert [tie.fields["between"][1].first for tie in ties] == [3, 6, 9]


def test_loop_in_outputs():
    text = (HEAD + LOOPS + TAIL).replace(
        "    out: {x: {SOX: m2}, y: {SOX: m5}}\n",
        "    out:\n      for i in 1..3: {ear(i): {SOX: m(2*i)}}\n",
    )
    outputs = check(text.replace("chain.x", "chain.ear1").replace("chain.y", "chain.ear3")).piece
    listened = outputs.instruments["chain"].outputs
    assert [(output.name, output.targets[0].module) for output in listened] == [
        ("ear1", "m2"),
        ("ear2", "m4"),
        ("ear3", "m6"),
    ]


@pytest.mark.parametrize("is_above", [False, True])
def test_module_beside_a_loop_is_an_exception_from_it(is_above):
    exception = "      m3: {MAS: {M: 9g}}\n"
    modules = exception + LOOPS if is_above else LOOPS + exception
    chain = {module.name: module for module in piece_of(modules).instruments["chain"].modules}
    plain = {module.name: module for module in piece_of(LOOPS).instruments["chain"].modules}
    assert chain["m3"].fields["M"] == 9e-3
    assert chain.keys() == plain.keys()
    others = chain.keys() - {"m3"}
    assert all(placeless(chain[name]) == placeless(plain[name]) for name in others)


def test_loop_exception_preserves_other_fields():
    exception = "      s3: {REF: {K: 1kN/m}}\n"
    modules = {m.name: m for m in piece_of(LOOPS + exception).instruments["chain"].modules}
    assert modules["s3"].fields["K"] == 1e3
    assert modules["s3"].fields["Z"] == 20e-3
    assert [end.module for end in modules["s3"].fields["between"]] == ["m2", "m3"]


def test_set_value_of_looped_module(tmp_path):
    texts, piece = opened(tmp_path / "s.yaml", HEAD + LOOPS + TAIL)
    piece = matter.set_value(texts, piece, "chain.m3.M", "9g").load().piece
    assert {m.name: m for m in piece.instruments["chain"].modules}["m3"].fields["M"] == 9e-3


def test_set_of_looped_module_replays_from_journal(tmp_path):
    session = Stepped(HEAD + LOOPS + TAIL, tmp_path)
    session.ok("play")
    session.run(0.1)
    session.ok("set chain.s4.K 9kN/m")
    session.run(0.2)
    sound = session.sound
    session.close()
    assert abs(sound).max() > 0
    assert (session.again() == sound).all()


@pytest.mark.parametrize(
    ("modules", "code", "line", "words"),
    [
        ("for 1 to 3: {q: {SOL: {}}}", "E113", 7, "write `for i in 1..12:`"),
        ("for m in 1..3: {q: {SOL: {}}}", "E110", 7, "no unit"),
        ("for n in 1..3: {q: {SOL: {}}}", "E102", 7, "named already"),
        ("for i in 1..1e6: {q: {SOL: {}}}", "E105", 7, "20,000 turns, not 1,000,000"),
        ("for i in 1..n/3: {q: {SOL: {}}}", "E202", 7, "'n/3' is 2.66"),
        ("for i in 1..3 by 0: {q: {SOL: {}}}", "E202", 7, "1 or more"),
        ("for i in 1..3: {q(i/2): {SOL: {}}}", "E202", 7, "'q(i/2)' has 0.5"),
        ("for i in 1..3: {q(-i): {SOL: {}}}", "E202", 7, "'q(-i)' has -1"),
        ("for i in 1..3: {q(j): {SOL: {}}}", "E201", 7, "'j' is not a name"),
        ("for i in 1..3: {q(i: {SOL: {}}}", "E201", 7, "never closed"),
        ("for i in 1..3: {q: {SOL: {}}}", "E102", 7, "'q' is already made on line 7"),
        ("for i in 1..3: [q]", "E106", 7, "names stand"),
        ("for i in 1..3:", "E106", 7, "nothing is written below"),
        ("if n = 8: {q: {SOL: {}}}", "E113", 7, "compared by =="),
        ("if n: {q: {SOL: {}}}", "E113", 7, "'n' compares nothing"),
        ("if n > 3g: {q: {SOL: {}}}", "E113", 7, "a plain number and a value in kg"),
        ("for i in 1..3: {let: {n: 3}, q(i): {SOL: {}}}", "E102", 7, "'n' is named already"),
    ],
)
def test_loop_mistakes_with_place_and_suggestion(modules, code, line, words):
    reports = report(f"      {modules}\n{LOOPS}")
    assert len(reports) == 1, reports
    assert reports[0][:2] == (code, line)
    assert words in reports[0][2]


def test_loop_mistake_in_every_turn_reported_once():
    reports = report(LOOPS.replace("K: stiff*i", "K: 4kN*i"))
    assert [(code, line) for code, line, _ in reports] == [("E203", 11)]


def test_loop_with_unreadable_range_single_report():
    reports = report(LOOPS.replace("for i in 1..n", "for i in 1..nn"))
    assert [(code, line) for code, line, _ in reports] == [("E201", 7)]


def test_place_of_a_mistake_inside_a_copied_value():
    (diagnostic,) = check(HEAD + LOOPS.replace("1 + part", "1 + prat") + TAIL).diagnostics
    line = "        m(i): {MAS: {M: 4g*(1 + prat)}}"
    assert diagnostic.place.line == 9
    assert diagnostic.place.column == line.index("prat") + 1


def test_law_functions_are_no_names():
    modules = (
        LOOPS
        + """\
      for i in 1..2:
        law(i): {LNL: {between: [left, m(i)], law: "k*max(d, 0) + tanh(d)", k: 100*i}}
"""
    )
    modules_by_name = {m.name: m for m in piece_of(modules).instruments["chain"].modules}
    assert modules_by_name["law2"].fields["constants"]["k"] == 200.0


def test_loop_turns_limit_of_parallel_loops():
    half = MAX_TURNS // 2 + 1
    modules = "".join(
        f"      for {name} in 1..{half}: {{if {name} < 0: {{q({name}): {{SOL: {{}}}}}}}}\n"
        for name in "ij"
    )
    assert [code for code, *_ in report(modules + LOOPS)] == ["E105"]


@pytest.mark.parametrize(("limit", "turns"), few([(20_000, 800), (loops.MAX_NODES, MAX_TURNS)], 1))
def test_loop_values_limit(limit: int, turns: int, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(loops, "MAX_NODES", limit)
    nodes = ", ".join(f"q{j}(i): {{SOL: {{}}}}" for j in range(20))
    codes_of = [code for code, *_ in report(f"      for i in 1..{turns}: {{{nodes}}}\n{LOOPS}")]
    assert codes_of[:1] == ["E105"]


def test_loops_are_read_anew_where_a_value_changes():
    memory = Memory(is_loose=True)
    counts = []
    for n in (6, 4, 7):
        text = (HEAD + LOOPS + TAIL).replace("n: 8", f"n: {n}").replace("m5", "m4")
        piece = load("s.yaml", text=text, memory=memory).piece
        counts.append(sum(m.name.startswith("m") for m in piece.instruments["chain"].modules))
    assert counts == [6, 4, 7]


def test_formatting_leaves_loops_as_they_are():
    text = HEAD + LOOPS + TAIL
    assert formatted(text) == text


def test_loop_names_refused_outside_loops():
    assert codes(HEAD + "      q(1): {SOL: {}}\n" + LOOPS + TAIL) == ["E110"]


@pytest.mark.parametrize(
    ("condition", "expected"),
    [
        ("i < 5", True),
        ("1 < i <= 4", True),
        ("1 < i < 4", False),
        ("i == 4 and i != 3", True),
        ("i < 2 or i mod 2 == 0", True),
        ("not i == 4", False),
        ("not not i == 4", True),
        ("i > 5 and 1/(i-4) > 0", False),
        ("i*1Hz >= 4Hz", True),
        ("A4 > G4", True),
    ],
)
def test_is_true_of_conditions(condition, expected):
    assert is_true(condition, 0, {"i": Amount(4, "")}) is expected


@pytest.mark.parametrize("condition", ["", "and", "i <", "i < 3 or", "< 3", "i ! 3"])
def test_is_true_refuses_non_conditions(condition):
    with pytest.raises(TextError):
        is_true(condition, 0, {"i": Amount(4, "")})


@pytest.mark.parametrize("number", [0, 1, 5, 6, 7, 13])
def test_mod_operator_with_numbers(number):
    assert evaluate(f"{number} mod 6", {}).number == number % 6


@pytest.mark.parametrize("text", ["3g mod 2", "3 mod 0", "3 mod"])
def test_mod_of_other_values_is_refused(text):
    with pytest.raises(TextError):
        evaluate(text, {})
