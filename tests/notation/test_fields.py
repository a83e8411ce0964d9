import json
from pathlib import Path

import jsonschema
import pytest
import yaml

from docs.generators import reference
from ergon.notation.tables.compound import Either, ListOf, NamesOf
from ergon.notation.tables.fields import Field, Record
from ergon.notation.tables.shapes import MISSING, Context, Reference, Text, choice
from ergon.notation.text.document import Document, compose
from ergon.notation.text.errors import Collector, TextError
from ergon.scores.reading.load import load
from ergon.scores.reading.schema import schema

ROOT = Path(__file__).parents[2]
DUET = (Path(__file__).parents[1] / "data/duet-2.2.yaml").read_text(encoding="utf-8")


def number(text):
    try:
        return float(text)
    except ValueError:
        raise TextError("not a number", length=max(1, len(text))) from None


NUMBER = Text(number, "a number", types=("number", "string"))
POINT = Record(
    "point",
    "a point",
    (
        Field("x", NUMBER, "where", required=True),
        Field("t", NUMBER, "when", 0.5),
        Field("to", ListOf(Reference("a name"), 1, 3, single=True), "whom"),
        Field("side", choice("left", "right"), "which"),
    ),
    refusal_by_name={"z": "space has two dimensions for now"},
)


def read(shape, text):
    collector = Collector()
    document: Document = compose(text, "f", collector)
    return shape.read(document.root, "", Context(collector)), collector.finish()


def test_fields_written_and_default():
    values, result = read(POINT, "{x: 3, to: a}")
    assert not result
    assert (values["x"], values["t"], values["side"]) == (3.0, 0.5, None)
    assert values["to"] == ("a",)
    assert values["to"][0].place.column == 12
    assert values.written("x", "t") == ["x"]


@pytest.mark.parametrize(
    ("text", "code", "column", "suggestion"),
    [
        ("{t: 1}", "E103", 1, None),
        ("{x: 1, sied: left}", "E101", 8, "side"),
        ("{x: 1, side: lefft}", "E206", 14, "left"),
        ("{x: [1]}", "E106", 5, None),
        ("[x, 1]", "E106", 1, None),
        ("{x: 1, to: []}", "E106", 12, None),
        ("{x: 1, to: [a, b, c, d]}", "E106", 12, None),
        ("{x: 1, z: 1}", "E108", 8, None),
        ("{x: abc}", "E204", 5, None),
    ],
)
def test_fields_mistakes_and_codes(text, code, column, suggestion):
    _, found = read(POINT, text)
    assert [(d.code, d.place.column, d.suggestion) for d in found] == [(code, column, suggestion)]


def test_wrong_entry_does_not_hide_the_other_entries():
    value, result = read(NamesOf(POINT, "point"), "{a: {x: 1}, b: {x: no}, 3c: {}, d: {y: 1}}")
    assert list(value) == ["a", "b", "d"]
    assert value["b"] is MISSING
    assert [d.code for d in result] == ["E204", "E110", "E103", "E101"]


def test_either_shape_selected_by_form():
    shape = Either(scalar=NUMBER, mapping=POINT)
    assert read(shape, "3")[0] == 3.0
    assert read(shape, "{x: 4}")[0]["x"] == 4.0
    assert read(shape, "[1]")[1][0].code == "E106"


def test_missing_space_after_colon_help():
    assert "space" in read(POINT, "{x: 1, side:left}")[1][0].help


# --- schema --------------------------------------------------------------------------------------


def walk(node):
    yield node
    for child in (
        node.values() if isinstance(node, dict) else node if isinstance(node, list) else ()
    ):
        yield from walk(child)


def test_schema_is_draft_7_without_alternatives():
    jsonschema.Draft7Validator.check_schema(schema())
    for node in walk(schema()):
        if isinstance(node, dict):
            assert not {"oneOf", "anyOf", "allOf"} & node.keys()
            if isinstance(node.get("properties"), dict):
                assert "additionalProperties" in node
            if "pattern" in node and "types" in node:
                assert "patternErrorMessage" in node
    assert json.loads(json.dumps(schema())) == schema()


def errors(score):
    return list(jsonschema.Draft7Validator(schema()).iter_errors(yaml.safe_load(score)))


def test_schema_accepts_example_score():
    assert errors(DUET) == []


@pytest.mark.parametrize(
    ("right", "wrong"),
    [
        ("players:", "player:"),
        ("every: 1,", "evry: 1,"),
        ("K: 60N/m", "K: 60N/mm/s"),
        ("hand: virtual", "hand: virtul"),
        ("CEL:", "CLE:"),
        ("M: 400g", "M: 400N"),
        ("bits: 24", "bits: 23"),
        ("to: nearest}", "to: near}"),
        ("gain: -6dB", "gain: -6"),
        ("meter: 4/4", "meter: four"),
    ],
)
def test_schema_refuses_scores_with_typos(right, wrong):
    assert right in DUET
    mistyped = DUET.replace(right, wrong, 1)
    assert errors(mistyped)
    assert load(ROOT / "tests/data/duet-2.2.yaml", text=mistyped).piece is None


def test_reference_page_equals_generated_text():
    committed = (ROOT / "docs/reference.md").read_text(encoding="utf-8")
    assert committed == reference.text()  # make docs
