"""The name of a test states a function and a case, and is no sentence."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
# With these a sentence begins, not the name of what is tested.
FIRST_WORD = re.compile(
    r"a|an|the|what|who|which|every|no|one|two|it|in|where|when|as|so|each|all|any|another|"
    r"nothing|nobody"
)
# These belong to sentences whose subject is missing; `that` begins a clause.
WORD = re.compile(
    r"told|nobody|none|own|said|made|given|found|whole|kept|heard|felt|stands|who|what|which|whose|"
    r"lies|goes|asks|that"
)
LENGTH_MAX = 60


def python_names() -> Iterator[tuple[Path, str]]:
    for path in sorted((ROOT / "tests").rglob("test_*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef) and node.name.startswith("test_"):
                yield path, node.name.removeprefix("test_")


def rust_names() -> Iterator[tuple[Path, str]]:
    attributes = re.compile(r"#\[test\]\s*(?:#\[[^\]]*\]\s*)*fn (\w+)\(")
    for path in sorted((ROOT / "core-rs").rglob("*.rs")):
        if "target" not in path.parts:
            for match in attributes.finditer(path.read_text(encoding="utf-8")):
                yield path, match.group(1)


def fault(name: str) -> str:
    """What is wrong with a name; empty if nothing."""
    words = name.split("_")
    if FIRST_WORD.fullmatch(words[0]):
        return f"begins with '{words[0]}'"
    if bad := [word for word in words if WORD.fullmatch(word)]:
        return f"has the word '{bad[0]}'"
    return f"has more than {LENGTH_MAX} characters" if len(name) > LENGTH_MAX else ""


def test_names_of_python_and_rust_tests():
    names = [*python_names(), *rust_names()]
    assert len({path.suffix for path, _ in names}) == 2
    wrong = [
        f"{path.relative_to(ROOT)}: {name} {why}" for path, name in names if (why := fault(name))
    ]
    assert not wrong, "\n".join(wrong)


def test_fault_of_sentences_and_of_names():
    assert fault("what_sticks_hangs") == "begins with 'what'"
    assert fault("meters_that_are_none") == "has the word 'that'"
    assert fault("euclid_with_rotation") == ""
    assert "more than" in fault("word_" * 13)
