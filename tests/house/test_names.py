"""No identifier is, or begins with, a word that says nothing of what is stored."""

from pathlib import Path
from statistics import fmean

import pytest

from tests.support.identifiers import EMPTY_WORDS, identifiers

ROOT = Path(__file__).parents[2]
# Words of the language of scores. The records that hold what a score says of them call them the
# same, and the digest by which takes and journals know a piece hashes the names of these fields.
WORDS_OF_SCORES = {
    "ergon/notation/clock/tempo.py": {"at"},
    "ergon/notation/text/values.py": {"at"},
    "instruments/following.py": {"of"},
    "instruments/model.py": {"at"},
    "instruments/starts.py": {"at"},
    "scores/gesture/midi_file.py": {"at"},
    "scores/gesture/musicxml_file.py": {"at"},
    "scores/gesture/musicxml_notes.py": {"at"},
    "scores/gesture/notation.py": {"at"},
    "scores/pattern/order.py": {"way"},
    "scores/pattern/pattern.py": {"at"},
    "scores/pattern/words.py": {"at"},
    "scores/reading/automation.py": {"at"},
    "scores/reading/curves.py": {"at", "way"},
    "scores/reading/include.py": {"at"},
    "scores/reading/melody.py": {"at"},
    "scores/reading/mixing.py": {"at"},
    "scores/reading/part.py": {"at"},
    "scores/reading/piece.py": {"at"},
    "scores/reading/playing.py": {"at"},
}
# Keys of JSON that users and other versions read: records are written with the names of fields.
KEYS_OF_JSON = {
    "ergon/api/take_stats.py": {"given"},
    "ergon/live/faults.py": {"said"},
    "ergon/rendering/remote.py": {"at"},
}
EXCEPTED = WORDS_OF_SCORES | KEYS_OF_JSON
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


# Letters of a name that `let` binds in product code, on the average: enough for two words.
LET_LETTERS_MIN = 7.0


def files() -> list[Path]:
    every = [path for name in (*FOLDERS, "tests") for path in (ROOT / name).rglob("*.[pr][ys]")]
    return [path for path in every if "target" not in path.parts and not path.is_symlink()]


def test_identifiers_without_empty_words():
    empty: list[str] = []
    unused = {(path, name) for path, names in EXCEPTED.items() for name in names}
    let_lengths: list[int] = []
    for path in files():
        relative = path.relative_to(ROOT).as_posix()
        for name in identifiers(path):
            if name.is_empty and name.name not in EXCEPTED.get(relative, ()):
                empty.append(f"{relative}:{name.line}: {name.name}")
            unused.discard((relative, name.name))
            if name.is_let and "/src/" in relative:
                let_lengths.append(len(name.name.replace("_", "")))
    assert not empty, f"say what is stored, not {', '.join(sorted(EMPTY_WORDS))}"
    assert not unused, "these exceptions are not needed"
    assert fmean(let_lengths) >= LET_LETTERS_MIN, "names of let are too short"


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
