import json
import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from docs.generators.error_pages import codes, pages, reports_and_score
from ergon.notation.text.errors import (
    MAX_SHOWN,
    RENDERERS,
    Collector,
    Diagnostic,
    concise,
    full,
    github,
    json_line,
    quote,
)
from ergon.notation.text.values import Place
from ergon.scores.reading.load import load

ROOT = Path(__file__).parents[2]
SCORE = """\
ergon: 1
gestures:
  knock: 0mm@0 smoth 6mm@1/8 throw 0mm@1/4 hold 0mm@1/3
"""


def report():
    loaded = load("score", text=SCORE)
    return loaded.diagnostics[0], loaded.files


def test_full_diagnostic_shows_caret_and_suggestion():
    assert full(*report()).split("\n") == [
        "score:3:16: error[E204] gesture 'knock': unknown word 'smoth'; "
        "curves are smooth, line, hold, throw",
        " 3 |   knock: 0mm@0 smoth 6mm@1/8 throw 0mm@1/4 hold 0mm@1/3",
        "   |                ^^^^^ did you mean 'smooth'?",
    ]


def test_concise_diagnostic_is_one_line():
    assert concise(*report()).endswith("hold, throw     did you mean 'smooth'?")


def test_render_as_github_annotations():
    d = Diagnostic("W310", "50% here", Place("a,b.yaml", 2, 3))
    assert github(d) == "::warning file=a%2Cb.yaml,line=2,col=3,title=W310::50%25 here"


def test_render_as_json_lines():
    assert json.loads(json_line(*report())) == {
        "v": 1,
        "event": "error",
        "code": "E204",
        "file": "score",
        "line": 3,
        "column": 16,
        "message": "gesture 'knock': unknown word 'smoth'; curves are smooth, line, hold, throw",
        "suggestion": "smooth",
    }


def test_caret_under_wide_and_combining_characters():
    text = "ergon: 1\ntitle: {音e\u0301: x}\n"
    loaded = load("s", text=text)
    lines = full(loaded.diagnostics[0], loaded.files).split("\n")
    assert lines[2].index("^") == len(" 2 | title: ")
    text = "ergon: 1\nkeys: {音: {M: 1N, K: 1}}\n"
    loaded = load("s", text=text)
    lines = full(loaded.diagnostics[0], loaded.files).split("\n")
    assert lines[2].index("^") == lines[1].index("N") + 1  # 音 is two columns wide


def test_long_lines_are_cut_round_the_caret():
    text = "ergon: 1\ngestures: {g: 0@0 " + "1@1 " * 5000 + "smoth 2@2}\n"
    loaded = load("s", text=text)
    for d in loaded.diagnostics:
        shown = full(d, loaded.files).split("\n")
        assert len(shown[1]) < 200


def test_rendered_diagnostics_without_control_characters():
    # YAML lets C1 controls through in quotes; \x9b is an escape sequence's beginning
    loaded = load("s", text='ergon: 1\n"\\u009b2J": 1\nuse: ["\\e[2J"]\n')
    for d in loaded.diagnostics:
        for render in RENDERERS.values():
            assert not re.search("[\x00-\x09\x0b-\x1f\x7f-\x9f]", render(d, loaded.files))


def test_diagnostics_deduplicated_and_in_file_order():
    collector = Collector()
    for name in ("main", "used"):
        collector.file(name)
    for line in (3, 1, 3):
        collector.error("E101", "x", Place("used", line, 1))
        collector.error("E101", "x", Place("main", line, 1))
    result = [(d.place.file, d.place.line) for d in collector.finish()]
    assert result == [("main", 1), ("main", 3), ("used", 1), ("used", 3)]


def test_collector_limits_each_severity():
    collector = Collector()
    for line in range(30):
        collector.error("E101", "x", Place("f", line + 1, 1))
        collector.error("W310", "x", Place("f", line + 1, 1))
    assert len(collector.finish()) == 2 * MAX_SHOWN
    assert collector.left_out() == {"error": 10, "warning": 10, "note": 0}


def test_help_lists_names_without_near_match():
    loaded = load("s", text="ergon: 1\nkeys: {a: {M: 1kg, K: 1}}\nplayers: {p: {key: zzz}}\n")
    assert loaded.diagnostics[0].help == "known here: a"


@given(st.text())
def test_quote_is_printable_and_short(text):
    assert quote(text).isprintable()
    assert len(quote(text)) <= 42


# --- pages ---------------------------------------------------------------------------------------


def test_error_pages_equal_generated_pages():
    committed = {p.name: p.read_text(encoding="utf-8") for p in (ROOT / "docs/errors").iterdir()}
    assert committed == pages()  # make docs


@pytest.mark.parametrize("entry", codes().values(), ids=codes())
def test_good_examples_get_no_report(entry):  # the bad ones stand in the pages
    after, _ = reports_and_score(entry, entry.good)
    assert not [d for d in after if d.code != "N401"]


def test_error_codes_equal_codes_in_source():
    source = [
        *ROOT.glob("ergon/notation/**/*.py"),
        *ROOT.glob("scores/**/*.py"),
        *ROOT.glob("ergon/api/*.py"),
        *ROOT.glob("instruments/*.py"),
    ]
    used = {
        code
        for path in source
        for code in re.findall(r'"([EWN]\d{3})"', path.read_text(encoding="utf-8"))
    }
    assert used == set(codes())
