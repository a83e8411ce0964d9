"""Arrows point one way: what each room may import, as DESIGN.md says."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
TEXT, TABLES, CLOCK, GESTURE, READING, STAGING = (
    f"scores.{step}" for step in ("text", "tables", "clock", "gesture", "reading", "staging")
)
MAY = {
    "common": set(),
    "view": {"_core"},
    "exchange": {"_core"},
    TEXT: set(),
    TABLES: {TEXT, CLOCK, GESTURE, "_core"},
    CLOCK: {TEXT, "_core"},
    GESTURE: {TEXT, CLOCK, "_core"},
    "instruments": {TEXT, TABLES, "_core"},
    READING: {TEXT, TABLES, CLOCK, GESTURE, "instruments"},
    STAGING: {TEXT, TABLES, CLOCK, GESTURE, READING, "instruments", "_core"},
    "repl.language": {"scores", "instruments"},
    "lab": {"scores", "instruments", "exchange", "_core"},
    "live": {"scores", "exchange", "_core"},
    "repl.session": {
        "scores",
        "instruments",
        "exchange",
        "live",
        "view",
        "repl.face",
        "repl.language",
        "_core",
    },
    "repl.prompt": {"repl.face", "repl.turns"},
    "repl.wire": {"repl.face", "repl.turns"},
    "cli": {"scores", "instruments", "exchange", "lab", "live", "repl", "view", "_core"},
}


def imported(path: Path) -> set[str]:
    """Modules of the package that a file names, anywhere in it, but for its annotations."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    only_types = {
        id(inner)
        for node in ast.walk(tree)
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"
        for inner in ast.walk(node)
    }
    names = set()
    for node in ast.walk(tree):
        if id(node) in only_types:
            continue
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("ergon"):
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
        elif isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names if alias.name.startswith("ergon")}
    return names


@pytest.mark.parametrize("room", MAY)
def test_a_room_imports_only_what_it_may(room: str):
    folder = ROOT / room.replace(".", "/")
    files = list(folder.rglob("*.py"))
    assert files
    allowed = tuple(f"ergon.{name}" for name in (*MAY[room], room, "common"))
    for path in files:
        for name in imported(path):
            known = name.startswith(tuple(f"{one}." for one in allowed)) or name in allowed
            assert known, f"{path.relative_to(ROOT)} imports {name}"
