"""No identifier is, or begins with, a word that says nothing of what is stored."""

from collections import Counter
from pathlib import Path

import pytest

from tests.support.identifiers import EMPTY_WORDS, identifiers

ROOT = Path(__file__).parents[2]
# Rooms whose older names (constructors `of`, functions `at`, fields `heard`) are not renamed yet,
# and how many each has. A number may only fall; a room that is not here has none.
OLDER = {
    "cli": 4,
    "core-rs/bridge": 18,
    "ergon/api": 8,
    "ergon/common": 1,
    "ergon/exchange": 5,
    "ergon/live": 8,
    "ergon/notation": 26,
    "ergon/rendering": 4,
    "ergon/view": 1,
    "ergon/workshop": 66,
    "instruments": 11,
    "repl": 7,
    "scores": 66,
}
FOLDERS = (
    "benches",
    "cli",
    "core-rs",
    "docs",
    "ergon",
    "examples",
    "instruments",
    "repl",
    "scores",
)


def room(path: Path) -> str:
    parts = path.relative_to(ROOT).parts
    return "/".join(parts[:2]) if parts[0] in ("ergon", "core-rs") and len(parts) > 2 else parts[0]


def files() -> list[Path]:
    every = [path for name in (*FOLDERS, "tests") for path in (ROOT / name).rglob("*.[pr][ys]")]
    return [path for path in every if "target" not in path.parts and not path.is_symlink()]


def test_names_by_room():
    empty: dict[str, list[str]] = {}
    for path in files():
        for name in identifiers(path):
            if name.is_empty:
                place = f"{path.relative_to(ROOT)}:{name.line}: {name.name}"
                empty.setdefault(room(path), []).append(place)
    counts = Counter({name: len(places) for name, places in empty.items()})
    more = {name: empty[name] for name in counts if counts[name] > OLDER.get(name, 0)}
    assert not more, f"say what is stored, not {', '.join(sorted(EMPTY_WORDS))}"
    assert dict(counts) == OLDER, "names were mended: write the lower numbers into OLDER"


@pytest.mark.parametrize(
    ("suffix", "source", "expected"),
    [
        (".py", "def f(given):\n    a = 1\n    b = 2\n    return given\n", ["given"]),
        (".py", "x = [\n    own\n    for own in y\n]\n\n\n\n", ["own"]),
        (".py", "x = [own for own in y]\n", []),
        (".py", "class A:\n    most_cents: int = 0\n", ["most_cents"]),
        (".py", "for i, (at, name) in z:\n    print(at)\n", ["at"]),
        (".py", "one_time = 1\nonerous = 2\nalone = 3\n", ["one_time"]),
        (".rs", "fn f(given: u8) {\n    let a = 1;\n    let b = 2;\n}\n", ["given"]),
        (".rs", "fn f() {\n    let Some((own, b)) = c else {\n        d\n    };\n}\n", ["own"]),
        (".rs", "fn f() {\n    let a = b.map(|own| own.c);\n    d();\n    e();\n}\n", []),
        (".rs", "struct A {\n    heard: u8,\n}\nconst MOST: u8 = 1;\n", ["heard", "MOST"]),
        (
            ".rs",
            "fn f() {\n    match a {\n        Kept(b) => 1,\n        kept => 2,\n    }\n}\n",
            [],
        ),
        (".rs", "fn f() {\n    let Own { a, b } = c;\n    let d = 1;\n    e();\n}\n", []),
    ],
)
def test_identifiers_of_a_file(tmp_path: Path, suffix: str, source: str, expected: list[str]):
    path = tmp_path / f"file{suffix}"
    path.write_text(source)
    assert [name.name for name in identifiers(path) if name.is_empty] == expected
