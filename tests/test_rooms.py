"""Arrows point one way: what each room may import, as DESIGN.md says."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
TEXT, CLOCK, TABLES = (f"notation.{step}" for step in ("text", "clock", "tables"))
GESTURE, READING, EDITS, STAGING = (
    f"scores.{step}" for step in ("gesture", "reading", "edits", "staging")
)
MAY = {
    "common": set(),
    "view": {"_core"},
    "exchange": {"_core"},
    "rendering": {"exchange", "_core"},
    TEXT: set(),
    CLOCK: {TEXT, "_core"},
    TABLES: {TEXT, CLOCK, "_core"},
    "instruments": {"notation", "_core"},
    GESTURE: {"notation", "_core"},
    READING: {"notation", "instruments", GESTURE},
    EDITS: {"notation", "instruments", GESTURE, READING},
    STAGING: {"notation", "instruments", GESTURE, READING, "_core"},
    "repl.language": {"notation", "instruments", "scores"},
    "lab": {"notation", "instruments", "scores", "exchange", "rendering", "_core"},
    "live": {"notation", "scores", "exchange", "rendering", "_core"},
    "repl.session": {
        "notation",
        "instruments",
        "scores",
        "exchange",
        "rendering",
        "live",
        "view",
        "repl.face",
        "repl.language",
        "_core",
    },
    "repl.prompt": {"repl.face", "repl.turns"},
    "repl.wire": {"repl.face", "repl.turns"},
    "api": {
        "notation",
        "scores",
        "exchange",
        "rendering",
        "live",
        "repl",
        "_core",
    },
    "cli": {
        "api",
        "notation",
        "instruments",
        "scores",
        "exchange",
        "rendering",
        "lab",
        "live",
        "repl",
        "view",
        "_core",
    },
}


def nodes(path: Path) -> list[ast.AST]:
    """The syntax of a file, but for what only type checkers see."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    only_types = {
        id(inner)
        for node in ast.walk(tree)
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"
        for inner in ast.walk(node)
    }
    return [node for node in ast.walk(tree) if id(node) not in only_types]


def imported(path: Path) -> set[str]:
    """Modules of the package that a file names, anywhere in it, but for its annotations."""
    names = set()
    for node in nodes(path):
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


def test_no_files_import_each_other_in_a_circle():
    """Imports inside functions count as well; those for annotations do not."""
    folders = {room.partition(".")[0] for room in MAY}
    files = {
        ".".join(("ergon", *path.relative_to(ROOT).with_suffix("").parts)): path
        for folder in folders
        for path in (ROOT / folder).rglob("*.py")
    }
    graph = {name: _files_imported(name, path) & files.keys() for name, path in files.items()}
    assert sum(map(len, graph.values())) > 500
    while leaves := {name for name, uses in graph.items() if not uses}:
        graph = {name: uses - leaves for name, uses in graph.items() if name not in leaves}
    assert not graph, f"in a circle, or using one: {', '.join(sorted(graph))}"


def _files_imported(name: str, path: Path) -> set[str]:
    """All that a file's imports may name, relative ones in full; not itself."""
    found = imported(path)
    for node in nodes(path):
        if isinstance(node, ast.ImportFrom) and node.level == 1:
            base = f"{name.rpartition('.')[0]}.{node.module or ''}".rstrip(".")
            found |= {base, *(f"{base}.{alias.name}" for alias in node.names)}
    return (found | {one.rpartition(".")[0] for one in found}) - {name}
