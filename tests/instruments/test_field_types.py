"""Types of the fields from which modules are built: names are those of tables, values fit."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import UnionType
from typing import Any, NotRequired, Union, get_args, get_origin, get_type_hints, is_typeddict

import pytest

from ergon.instruments.kinds.kind import Kind
from ergon.instruments.module_kinds import KINDS
from ergon.instruments.space import NETS
from ergon.instruments.space.points import add_grains
from ergon.scores.reading.load import load

SCORES = Path(__file__).parents[2] / "scores" / "library"
ADDED = {"axes", "constants", "X0"}  # by the reader, beside what a table says


def field_types(kind: Kind) -> dict[str, Any]:
    """The types of the fields that the functions of a kind read, by name."""
    builders = [kind.add, kind.count, NETS.get(kind.name, kind.count)]
    builders += [add_grains] if kind.name == "GRAINS" else []
    types: dict[str, Any] = {}
    for builder in builders:
        for fields in get_type_hints(builder).values():
            if is_typeddict(fields):
                types |= get_type_hints(fields)
    return types


TYPED = [name for name, kind in KINDS.items() if field_types(kind)]


def holds(value: Any, hint: Any) -> bool:
    origin, arguments = get_origin(hint), get_args(hint)
    if origin in (Union, UnionType):
        return any(holds(value, each) for each in arguments)
    if origin is NotRequired:
        return holds(value, arguments[0])
    if origin is tuple and arguments[-1] is not ...:
        pairs = zip(value, arguments, strict=True) if isinstance(value, tuple) else ()
        return isinstance(value, tuple) and all(holds(*pair) for pair in pairs)
    if origin in (tuple, Sequence):
        return isinstance(value, origin) and all(holds(item, arguments[0]) for item in value)
    if origin is not None and issubclass(origin, Mapping):
        return isinstance(value, Mapping) and all(
            holds(item, arguments[1]) for item in value.values()
        )
    return isinstance(value, (int, float) if hint is float else hint)


def test_field_types_of_expected_kinds():
    assert {"BANK", "BLOCK", "CEL", "CHAIN", "DRY", "LNL", "MODES", "PLATE", "STRING"} <= set(TYPED)


@pytest.mark.parametrize("name", TYPED)
def test_typed_fields_are_fields_of_the_table(name: str):
    kind = KINDS[name]
    names = {field for table in kind.tables.values() for field in table.by_name}
    places = {"from", "to", "at"} if name in NETS or name == "GRAINS" else set()
    assert set(field_types(kind)) <= names | ADDED | places | {"V0", "stretch"}


@pytest.mark.parametrize(
    "score", ["feathers-small", "torn-cloth", "poured-chain", "workshop", "rain"]
)
def test_field_types_fit_values_of_bundled_scores(score: str):
    piece = load(SCORES / f"{score}.yaml").piece
    assert piece is not None
    checked = 0
    for part, module in piece.modules():
        for field, hint in field_types(KINDS[module.kind]).items():
            if field in module.fields:
                value = module.fields[field]
                assert holds(value, hint), (part, module.name, field, value)
                checked += 1
    assert checked > 0
