import re
from pathlib import Path

import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from ergon.notation.text.document import Mapping, Scalar, Sequence, compose
from ergon.notation.text.edit import (
    EditError,
    add_row,
    append,
    put,
    put_row,
    quoted,
    remove,
    rows,
)
from ergon.notation.text.errors import Collector
from ergon.scores.reading.sections import SCORE_RECORD

ROOT = Path(__file__).parents[2]
FOLDERS = ("scores/library", "cli/templates", "instruments/library", "tests/data")
SCORES = [path for folder in FOLDERS for path in sorted((ROOT / folder).rglob("*.yaml"))]
ORDER = tuple(SCORE_RECORD.by_name)
ODD = """\
# first
ergon: 1
title: 'it''s'   # quoted
use: [
    a.yaml,   # one
    "b.yaml"  # two
  ]
marks: {A: 1|1, B: 2|1 ,  # three
  C: 3|1,
}
keys:
    k1: {M: 400g}  # four

    k2:
        like: k1
        # five
        M: 300g
gestures: {}
players:          # six
takes: ~
duet:
- couple: [k1, k2]    # seven
  REF:
    K: 1
- {couple: [k2, k1]}

parts:
    ada:
    - at: A
      play: knock      # eight

    # nine
    -   {at: B, play: lean}
    remi: |   # ten
        A  knock   # eleven

        B  lean

    # twelve
mix:
    channels: 2

# thirteen"""
TEXTS = [path.read_text(encoding="utf-8") for path in SCORES] + [ODD]
TEXTS += [text.replace("\n", "\r\n") for text in TEXTS]
TEXTS += [text.rstrip("\r\n") for text in TEXTS[:4]]
COMMENT = re.compile(r"(?:^|(?<=\s))#.*", re.MULTILINE)


def read(text):
    collector = Collector()
    document = compose(text, "s.yaml", collector)
    assert not collector.has_errors(), collector.finish()
    return document


class NamedDocument:
    """A document that hypothesis names in a word."""

    def __init__(self, document, *words):
        self.document, self.words = document, words

    def __repr__(self):
        return f"text, path: {self.words}"


def paths(node, path=()):
    """Every path of a document, with its node."""
    yield path, node
    if isinstance(node, Mapping):
        for name, (_, child) in node.entries.items():
            yield from paths(child, (*path, name))
    elif isinstance(node, Sequence):
        for number, child in enumerate(node.items):
            yield from paths(child, (*path, number))


def comments(text):
    return [comment.rstrip() for comment in COMMENT.findall(text)]


def is_part_of(few, many):
    """Whether lines were only taken away."""
    rest = iter(many)
    return all(any(line == other for other in rest) for line in few)


documents = st.integers(0, len(TEXTS) - 1).map(
    lambda number: NamedDocument(read(TEXTS[number]), number)
)
quiet = settings(max_examples=50, suppress_health_check=list(HealthCheck))


@st.composite
def placed(draw, kind):
    drawn = draw(documents)
    document = drawn.document
    result = [path for path, node in paths(document.root) if path and kind(node)]
    assume(result)
    path = draw(st.sampled_from(result))
    return NamedDocument(document, *drawn.words, path)


def is_word(node):
    """A plain text in one line."""
    is_plain = isinstance(node, Scalar) and node.style is None and not node.is_empty
    return is_plain and "\n" not in node.document.text[node.start : node.end]


@quiet
@given(placed(is_word), st.sampled_from(["x", "5|1", "900N/m", "'a, b'"]))
def test_put_and_put_back_restores_text(outcome, text):
    document, (_, path) = outcome.document, outcome.words
    node = dict(paths(document.root))[path]
    changed = put(document, path, text)
    assert comments(changed) == comments(document.text)
    before, after = document.text.splitlines(), changed.splitlines()
    assert len(before) == len(after)
    assert sum(a != b for a, b in zip(before, after, strict=True)) <= 1
    assert put(read(changed), path, document.text[node.start : node.end]) == document.text


@quiet
@given(placed(lambda node: isinstance(node, Sequence)), st.sampled_from(["x", "{a: 1, b: [c]}"]))
def test_append_and_remove_restores_text(outcome, text):
    document, (_, path) = outcome.document, outcome.words
    node = dict(paths(document.root))[path]
    changed = append(document, path, text)
    assert comments(changed) == comments(document.text)
    assert remove(read(changed), (*path, len(node.items))) == document.text


@quiet
@given(
    placed(lambda node: isinstance(node, Mapping) or (isinstance(node, Scalar) and node.is_empty)),
    st.sampled_from([("new",), ("new", "deeper"), ("new", "deeper", "still")]),
    st.sampled_from([put, append]),
)
def test_insert_and_remove_of_name_restores_text(outcome, names, edit):
    document, (_, path) = outcome.document, outcome.words
    node = dict(paths(document.root))[path]
    changed = edit(document, (*path, *names), "{a: 1}")
    assert comments(changed) == comments(document.text)
    again = remove(read(changed), (*path, names[0]))
    if isinstance(node, Mapping) and node.entries:
        assert again == document.text
    else:  # nothing, ~ and {} say the same
        assert comments(again) == comments(document.text)


@quiet
@given(documents, st.sampled_from(ORDER), st.sampled_from([("x",), ("x", "y")]))
def test_put_of_section_in_usual_order(outcome, section, names):
    document = outcome.document
    assume(section not in document.root.entries)
    changed = put(document, (section, *names), "1", ORDER)
    known = [name for name in read(changed).root.entries if name in ORDER]
    before = [name for name in document.root.entries if name in ORDER]
    if before == sorted(before, key=ORDER.index):
        assert known == sorted(known, key=ORDER.index)
    assert comments(changed) == comments(document.text)
    assert remove(read(changed), (section,)) == document.text


def is_table(node):
    return isinstance(node, Scalar) and node.style == "|"


@quiet
@given(placed(is_table), st.data())
def test_add_and_remove_of_rows_restores_text(outcome, data):
    document, (_, path) = outcome.document, outcome.words
    node = dict(paths(document.root))[path]
    lines = rows(node.text)
    changed = add_row(document, path, "99|1   x")
    assert comments(changed) == comments(document.text)
    assert rows(dict(paths(read(changed).root))[path].text) == [*lines, "99|1   x"]
    assert put_row(read(changed), path, len(lines), None) == document.text
    row = data.draw(st.sampled_from([i for i, line in enumerate(lines) if line.strip()]))
    if lines[row].startswith("#"):
        return
    code = lines[row].split(" #")[0].rstrip()
    other = put_row(document, path, row, "8|1 y")
    assert comments(other) == comments(document.text)
    assert put_row(read(other), path, row, code) == document.text


@quiet
@given(documents, st.data())
def test_removal_changes_only_the_removed_path(outcome, data):
    document = outcome.document
    path = data.draw(st.sampled_from([path for path, _ in paths(document.root) if path]))
    try:
        changed = remove(document, path)
    except EditError:  # a comment in the way, or something that an alias needs
        assume(False)
    flows = {line for line in changed.splitlines() if line not in document.text.splitlines()}
    assert len(flows) <= 1
    assert is_part_of(comments(changed), comments(document.text))


@pytest.mark.slow
@quiet
@given(documents, st.data())
def test_many_successive_edits_keep_comments(outcome, data):
    """Only what is replaced or removed as a whole takes its comments with it: here nothing is."""
    document = outcome.document
    first = comments(document.text)
    for _ in range(8):
        nodes = list(paths(document.root))
        words = [path for path, node in nodes if path and is_word(node)]
        lists = [path for path, node in nodes if isinstance(node, Sequence)]
        kind = data.draw(st.sampled_from(["put", "append", "new"]))
        if kind == "put" and words:
            text = put(document, data.draw(st.sampled_from(words)), "{a: 1}")
        elif kind == "append" and lists:
            text = append(document, data.draw(st.sampled_from(lists)), "[b]")
        else:
            maps = [path for path, node in nodes if isinstance(node, Mapping)]
            text = put(document, (*data.draw(st.sampled_from(maps)), "n", "m"), "c", ORDER)
        document = read(text)
    assert comments(document.text) == first


@pytest.mark.parametrize(
    ("text", "path", "value", "expected"),
    [
        ("a: 1", ("a",), "2", "a: 2"),
        ("a:   # c\nb: 1\n", ("a",), "2", "a: 2   # c\nb: 1\n"),
        ("a:\n  # c\n  b: 1 # d\ne: 1\n", ("a",), "2", "a: 2\n  # c\ne: 1\n"),
        ("a: |  # c\n  x\n  y\n\nb: 1\n", ("a",), "2", "a: 2  # c\n\nb: 1\n"),
        ("a:\n- b: 1\n  c: 2\n", ("a", 0), "x", "a:\n- x\n"),
        ("a:\n-\n- c\n", ("a", 0), "x", "a:\n- x\n- c\n"),
        ("a: {b, c: }", ("a", "b"), "x", "a: {b: x, c: }"),
        ("a: {b, c: }", ("a", "c"), "x", "a: {b, c: x }"),
        ("a:  # c\n", ("a", "b", "d"), "x", "a:  # c\n  b:\n    d: x\n"),
        ("a: ~  # c\n", ("a", "b", "d"), "x", "a: {b: {d: x}}  # c\n"),
        ("x: &x {b: 1}\na: *x\n", ("a",), "2", "x: &x {b: 1}\na: 2\n"),
        ("", ("a", "b"), "2", "a:\n  b: 2\n"),
        ("# c", ("a",), "2", "# c\na: 2\n"),
        ("{a: 1}\n", ("b", "c"), "2", "{a: 1, b: {c: 2}}\n"),
        ("a:\r\n    b: 1", ("a", "c", "d"), "2", "a:\r\n    b: 1\r\n    c:\r\n        d: 2"),
    ],
)
def test_put_expected_texts(text, path, value, expected):
    assert put(read(text), path, value) == expected


@pytest.mark.parametrize(
    ("text", "path", "expected"),
    [
        ("a:  # c\nb: 1\n", ("a",), "a:  # c\n  - x\nb: 1\n"),
        ("a: []  # c\n", ("a",), "a: [x]  # c\n"),
        ("a: [1, 2,]\n", ("a",), "a: [1, 2, x,]\n"),
        ("a: [\n  1,  # c\n  2  # d\n]\n", ("a",), "a: [\n  1,  # c\n  2,  # d\n  x\n]\n"),
        ("a: [\n  1,\n  2,\n]\n", ("a",), "a: [\n  1,\n  2,\n  x,\n]\n"),
        ("a: [1,\n    2]\n", ("a",), "a: [1,\n    2, x]\n"),
        ("a: {b: 1}  # c\n", ("a",), "a: [{b: 1}, x]  # c\n"),
        ("a:\n  b: 1  # c\n  d: 1\ne: 1\n", ("a",), "a:\n  - b: 1  # c\n    d: 1\n  - x\ne: 1\n"),
        ("a:\n-   b\n\nc: 1\n", ("a",), "a:\n-   b\n- x\n\nc: 1\n"),
        ("a:\n    b: 1\n", ("c", "d"), "a:\n    b: 1\nc:\n    d:\n        - x\n"),
        ("a: 1\n\nb: 1", ("c",), "a: 1\n\nb: 1\n\nc:\n  - x"),
        ("a: &n\n  - b\n", ("a",), "a: &n\n  - b\n  - x\n"),
    ],
)
def test_append_expected_texts(text, path, expected):
    assert append(read(text), path, "x") == expected


@pytest.mark.parametrize(
    ("edit", "text", "path"),
    [
        (put, "x: &x {b: 1}\na: *x\n", ("a", "b")),  # what an alias shares
        (put, "x: &x {b: 1}\na: *x\n", ("x", "b")),
        (put, "x: &x 1\na: *x\n", ("x",)),
        (append, "x: &x [1]\na: *x\n", ("x",)),
        (append, "x: &x [1]\na: *x\n", ("a",)),
        (put, "a: 1\n", ("a", "b")),
        (put, "a: [1]\n", ("a", 3)),
        (append, "a: |\n  b\n", ("a",)),
    ],
)
def test_editing_aliases_and_missing_paths_is_refused(edit, text, path):
    with pytest.raises(EditError):
        edit(read(text), path, "2")


@pytest.mark.parametrize("value", ["a: b", "[", "x\ny: 1", "", "*n", "- 1", "# c"])
def test_put_of_invalid_value_is_refused(value):
    with pytest.raises(EditError):
        put(read("a: {b: 1}\n"), ("a", "b"), value)


def test_comments_between_shared_lines_are_not_lost():
    with pytest.raises(EditError, match="comment"):
        remove(read("a:\n- b: 1\n  # c\n  d: 2\n"), ("a", 0, "b"))
    assert remove(read("a:\n- b: 1\n  d: 2\n"), ("a", 0, "b")) == "a:\n- d: 2\n"


def test_add_row_to_table_of_one_row():
    text = add_row(read("parts:\n  ada: A knock\n"), ("parts", "ada"), "B lean")
    assert read(text).root.get("parts").get("ada").text == "A knock\nB lean"


def is_list(node):
    return isinstance(node, (Sequence, Mapping)) and bool(children(node))


def children(node):
    return [*node.entries] if isinstance(node, Mapping) else [*range(len(node.items))]


@quiet
@given(placed(is_list), st.data())
def test_joint_removal_equals_successive_removals(outcome, data):
    document, (_, path) = outcome.document, outcome.words
    node = dict(paths(document.root))[path]
    gone = data.draw(st.lists(st.sampled_from(children(node)), unique=True, min_size=1))
    try:
        changed = remove(document, *((*path, name) for name in gone))
    except EditError:  # a comment in the way, or something that an alias needs
        assume(False)
    left = [name for name in children(node) if name not in gone]
    after = dict(paths(read(changed).root))[path]
    assert len(children(after) if is_list(after) else []) == len(left)
    if isinstance(node, Mapping):
        assert (children(after) if is_list(after) else []) == left
    assert is_part_of(comments(changed), comments(document.text))


def test_joint_removal_from_different_parents_is_refused():
    with pytest.raises(EditError, match="together"):
        remove(read("a: {b: 1}\nc: {d: 1}\n"), ("a", "b"), ("c", "d"))


PRINTABLE = st.characters(exclude_categories=("C", "Z")) | st.just(" ")


@given(st.text(PRINTABLE, max_size=20))
def test_quoted_text_round_trip(text):
    item = read(f"[{quoted(text)}]").root.items[0]
    assert (item.text, item.is_empty) == (text, False)
