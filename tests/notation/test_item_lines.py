"""Lists and mappings of one line each value are composed line by line, to the same nodes."""

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ergon.notation.text import item_lines
from ergon.notation.text.document import Mapping, Scalar, compose
from ergon.notation.text.errors import Collector

ITEM = st.sampled_from(
    [
        "- {at: 1|1, play: knock}",
        "- {at: 2|1, play: knock, every: 1/2, times: 2}",
        "- {at: 3|1, play: 'a}b', do: [scale 2, mirror]}",
        '- {at: 4|1, play: "x: {y}"}',
        "- {}",
        "- lean",
        "# - {a remark}",
        "- {at: 5|1,\n       play: two lines}",
        "- {a: &one 1}",
        "- {a: *one}",
        "- {a: 'open}",
        "- {a: {b: 1}",
        "- {a: 1}  # said",
    ]
)
USUAL = st.sampled_from(["- {at: 1|1, play: knock}", "- {at: 7|1, play: lean, do: [scale 2]}"])
LIST = st.lists(st.one_of(USUAL, USUAL, USUAL, USUAL, ITEM), max_size=30)
ENTRY = st.one_of(
    st.integers(0, 40).map(lambda n: f"m{n}: {{CEL: {{M: 2g, f: {n}Hz}}}}"),
    st.integers(0, 40).map(lambda n: f"b-{n}: {{BUT: {{between: [k, m{n}], 'K': 1kN/m}}}}"),
    st.sampled_from(
        [
            "lines0: {}",
            "a:\n        BUT: {between: [k, m]}",
            "b: {M: &one 1}",
            "c: {M: *one}",
            "d: {M: 1g}  # said",
            "# e: {a remark}",
            "f: {M: 'open}",
            "g: [1, 2]",
        ]
    ),
)
ENTRIES = st.lists(ENTRY, max_size=40)
HEAD = st.sampled_from(["  ada:\n", "  ada: |\n", "  bo:\n", "  mia:  # a remark\n", "  - x\n"])


def _same(actual, other, base=0):
    assert type(actual) is type(other)
    assert (base + actual.start, base + actual.end) == (other.start, other.end)
    if isinstance(actual, Scalar):
        assert (actual.text, actual.style) == (other.text, other.style)
        # Of equal lines the first says where they are; an item in a line of many says where it is
        # in itself.
        assert actual.place.length == other.place.length
        assert actual.place.column in (other.place.column, actual.start + 1)
        assert actual.place.line <= other.place.line
    elif isinstance(actual, Mapping):
        assert list(actual.entries) == list(other.entries)
        for word, (name, value) in actual.entries.items():
            key, item = other.entries[word]
            begin = actual.bases.get(word, base)
            _same(name, key, begin)
            _same(value, item, begin)
    else:
        assert len(actual.items) == len(other.items)
        for number, (entry, item) in enumerate(zip(actual.items, other.items, strict=True)):
            first, end = actual.span(number)
            assert (base + first, base + end) == (item.start, item.end)
            _same(entry, item, actual.bases[number] if actual.bases else base)


def _flow(head, items):
    """The items in one line."""
    return head.rstrip("\n") + " [" + ", ".join(item.removeprefix("- ") for item in items) + "]\n"


@settings(max_examples=300)
@given(
    lists=st.lists(st.tuples(HEAD, LIST, st.booleans()), min_size=1, max_size=4),
    row=st.integers(0, 3),
)
def test_list_lines_compose_as_complete_text(lists, row):
    text = "parts:\n" + "".join(
        _flow(head, items) if is_flow else head + "".join(f"    {item}\n" for item in items)
        for head, items, is_flow in lists
    )
    collector = Collector()
    complete = compose(text, "score.yaml", collector, row)
    result = item_lines.compose_by_lines(text, "score.yaml", Path(), row, {})
    if result is None:
        return
    single, lines = result
    assert not collector.n_reports
    _same(single.root, complete.root)
    assert single.size == complete.size
    again, _ = item_lines.compose_by_lines(text, "score.yaml", Path(), row, lines)
    _same(again.root, complete.root)


@pytest.mark.parametrize("n_lines", [10, 500])
def test_known_list_lines_are_not_composed_again(monkeypatch, n_lines):
    text = "parts:\n  ada:\n" + "".join(
        f"    - {{at: {bar}|1, play: knock}}\n" for bar in range(1, n_lines)
    )
    _, lines = item_lines.compose_by_lines(text, "score.yaml", Path(), 0, {})
    composed = []
    monkeypatch.setattr(
        item_lines, "compose", lambda *of: (composed.append(of[0]), compose(*of))[1]
    )
    item_lines.compose_by_lines(text + "    - {at: 900|1, play: lean}\n", "s", Path(), 0, lines)
    assert composed == [
        "parts:\n  ada:\n    - lines\n",
        "    - {at: 900|1, play: lean}\n",
    ]


def test_block_text_resembling_a_list_is_not_read_by_lines():
    rows = "    - {at: 1|1, play: knock}\n" * 9
    assert item_lines.compose_by_lines(f"parts:\n  ada: |\n{rows}", "s", Path(), 0, {}) is None


@settings(max_examples=300)
@given(
    parts=st.lists(st.tuples(st.booleans(), ENTRIES), min_size=1, max_size=3),
    row=st.integers(0, 3),
)
def test_mapping_lines_compose_as_complete_text(parts, row):
    text = "instruments:\n" + "".join(
        f"  part{number}:{' |' * is_text}\n" + "".join(f"      {entry}\n" for entry in entries)
        for number, (is_text, entries) in enumerate(parts)
    )
    collector = Collector()
    complete = compose(text, "score.yaml", collector, row)
    result = item_lines.compose_by_lines(text, "score.yaml", Path(), row, {})
    if result is None:
        return
    single, lines = result
    assert not collector.n_reports
    _same(single.root, complete.root)
    assert single.size == complete.size
    again, _ = item_lines.compose_by_lines(text, "score.yaml", Path(), row, lines)
    _same(again.root, complete.root)
    lower, _ = item_lines.compose_by_lines(text, "score.yaml", Path(), row + 5, lines)
    _same(lower.root, compose(text, "score.yaml", Collector(), row + 5).root)  # rows of before


ROWS = [f"      m{n}: {{MAS: {{M: {n + 1}g}}}}\n" for n in range(12)]


def test_known_entries_are_not_composed_again(monkeypatch):
    text = "instruments:\n  bell:\n    modules:\n"
    _, lines = item_lines.compose_by_lines(text + "".join(ROWS), "s", Path(), 0, {})
    changed = ROWS[5].replace("6g", "60g")
    composed = []
    monkeypatch.setattr(
        item_lines, "compose", lambda *of: (composed.append(of[0]), compose(*of))[1]
    )
    rows = "".join([*ROWS[:5], changed, *ROWS[6:]])
    item_lines.compose_by_lines(text + rows, "s", Path(), 0, lines)
    assert composed == [f"{text}      lines0: {{}}\n", changed]


def test_duplicate_names_are_not_composed_by_lines():
    rows = "".join([*ROWS, ROWS[3]])
    assert item_lines.compose_by_lines(f"instruments:\n  bell:\n{rows}", "s", Path(), 0, {}) is None
