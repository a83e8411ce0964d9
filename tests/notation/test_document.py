import gc
import tracemalloc

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from ergon.notation.text import document as module
from ergon.notation.text.document import Mapping, Scalar, Sequence, compose
from ergon.notation.text.errors import Collector
from ergon.notation.text.syntax import MAX_BYTES, decode


def read(text):
    collector = Collector()
    return compose(text, "s.yaml", collector), collector.finish()


def errors(text):
    return [(d.code, d.place.line, d.place.column) for d in read(text)[1]]


def test_scalars_remain_text():
    root = read("a: 1e-3\nb: 1:30\nc: 012\nd: no\ne: 0x1F\nf: 2001-01-01\ng: ~\n")[0].root
    texts = [value.text for _, value in root.entries.values()]
    assert texts == ["1e-3", "1:30", "012", "no", "0x1F", "2001-01-01", "~"]


def test_nodes_equal_those_of_yaml():
    text = "a: [1, {b: 'x'}]\nc:\n  - d\n  - |\n    e\n     f\n  - >\n    g\n    h\ni: {}\n"

    def plain(node):
        if isinstance(node, Scalar):
            return node.text
        if isinstance(node, Sequence):
            return [plain(item) for item in node.items]
        return {key: plain(value) for key, (_, value) in node.entries.items()}

    assert plain(read(text)[0].root) == {
        **yaml.load(text, yaml.BaseLoader),
    }


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("é: ab cd", "cd"),
        ("a: 'ab cd'", "cd"),
        ('a: "ab cd"', "cd"),
        ("a: ab\n   cd ef", "ef"),
        ("a: 'ab\n\n   cd'", "cd"),
        ("a: |\n  ab\n    cd ef\n", "ef"),
        ("a: |  # table\n\n     ab\n\n     é cd", "cd"),
        ("a:\r\n  - |2\r\n     x\r\n    cd\r\n", "cd"),
        ("a: 😀😀 cd", "cd"),
    ],
)
def test_scalar_character_places(text, word):
    document, _ = read(text)
    scalar = document.root.entries[next(iter(document.root.entries))][1]
    if isinstance(scalar, Sequence):
        scalar = scalar.items[0]
    place = scalar.place_at(scalar.text.index(word), len(word))
    line = text.replace("\r\n", "\n").split("\n")[place.line - 1]
    assert line[place.column - 1 :][: place.length] == word


@pytest.mark.parametrize("text", ['a: "x\\n ab"', "a: 'it''s ab'", "a: >\n  x\n  ab"])
def test_escaped_and_folded_texts_point_at_their_start(text):
    scalar = read(text)[0].root.get("a")
    place = scalar.place_at(scalar.text.index("ab"), 2)
    assert (place.line, place.column) == (1, 4)


@settings(max_examples=300)
@given(st.lists(st.text("abc \t", max_size=6), min_size=1, max_size=8), st.integers(1, 5))
def test_literal_block_character_places(lines, indent):
    text = f"k: |{indent}\n" + "".join(" " * indent + line + "\n" for line in lines)
    document, result = read(text)
    if result:  # a tab where YAML wants none
        return
    scalar = document.root.get("k")
    for offset, character in enumerate(scalar.text):
        if character != "\n":
            place = scalar.place_at(offset)
            assert text.split("\n")[place.line - 1][place.column - 1] == character


def test_duplicates_name_the_first_line():
    document, result = read("a: 1\nb:\n  c: 1\n  c: 2\na: 3\n")
    assert [(d.code, d.place.line, d.message) for d in result] == [
        ("E102", 4, "'c' is already defined on line 3"),
        ("E102", 5, "'a' is already defined on line 1"),
    ]
    assert document.root.get("a").text == "1"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a:\n\t- x", ("E100", 2, 1)),
        ("keys:\n  a: 1\n b: 2\n", ("E100", 3, 2)),
        ('a: "x\nb: 2\n', ("E100", 1, 4)),
        ("a: [x, y\nb: 2\n", ("E100", 1, 4)),
        ("a: {b: 1 c: 2}", ("E100", 1, 11)),
        ("a: \x07", ("E100", 1, 4)),
        ("a: !!python/object:os.system x", ("E104", 1, 4)),
        ("a: 1\n---\nb: 2", ("E104", 2, 1)),
        ("a: &x [*x]", ("E104", 1, 8)),
        ("a: *u", ("E104", 1, 4)),
        ("<<: {a: 1}", ("E104", 1, 1)),
        ("? [a]\n: b", ("E106", 1, 3)),
        ("[" * 100_000, ("E105", 1, 65)),
        ("a: [[1], [2]]\nb: {c: " + "[" * 5_000, ("E105", 2, 70)),
        ("{a: " * 5_000, ("E105", 1, 4 * 64 + 1)),
    ],
)
def test_refused_yaml_features(text, expected):
    assert errors(text) == [expected]


def test_alias_bomb_is_refused_in_little_memory():
    bomb = "a0: &a0 [x,x,x,x,x,x,x,x,x,x]\n"
    for i in range(1, 40):
        bomb += f"a{i}: &a{i} [{','.join([f'*a{i - 1}'] * 10)}]\n"
    gc.collect()
    tracemalloc.start()
    result = errors(bomb)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert result[0][0] == "E105"
    assert peak < 5e6


def test_nesting_through_aliases_is_refused():
    text = "a: &a " + "[" * 40 + "]" * 40 + "\nb: " + "[" * 40 + "*a" + "]" * 40
    assert [code for code, *_ in errors(text)] == ["E105"]


def test_too_many_entries(monkeypatch):
    monkeypatch.setattr(module, "MAX_NODES", 1000)
    assert errors("[" + "a," * 2000 + "]")[0][0] == "E105"


def test_block_scalar_of_100000_rows_places():
    rows = "".join(f"    {i} {i % 7}mm\n" for i in range(100_000))
    document, result = read("a: |\n" + rows)
    scalar = document.root.get("a")
    assert not result
    place = scalar.place_at(scalar.text.index("99999 "), 5)
    assert (place.line, place.column) == (100_001, 5)


@pytest.mark.parametrize(
    ("data", "code"),
    [
        (b"\xff\xfea\x00", "E107"),
        (b"a: 1\nb\xe9: 2", "E107"),
        (b"\x00" * (MAX_BYTES + 1), "E105"),
    ],
)
def test_decode_of_invalid_bytes_codes(data, code):
    collector = Collector()
    assert decode(data, "s", collector) is None
    assert [d.code for d in collector.finish()] == [code]


def test_decode_removes_byte_order_mark():
    assert decode(b"\xef\xbb\xbfa: 1", "s", Collector()) == "a: 1"


def test_decode_of_invalid_utf8_place():
    collector = Collector()
    decode("é: 1\nüb".encode() + b"\xe9", "s", collector)
    assert collector.finish()[0].place.line == 2
    assert collector.finish()[0].place.column == 3


@settings(max_examples=500)
@given(st.text("ab:{}[],-|>&*!#'\"\\%@` \n\t\r?~1.é\u2028\x85\x00\ud800", max_size=40))
def test_compose_of_random_text_never_raises(text):
    document, _ = read(text)
    assert document.root is None or isinstance(document.root, (Scalar, Sequence, Mapping))
