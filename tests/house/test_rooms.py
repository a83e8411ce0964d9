"""Arrows point one way: what each room may import, as DESIGN.md says."""

import ast
from pathlib import Path

import pytest
from rust_imports import circles

ROOT = Path(__file__).parents[2]
TEXT, CLOCK, TABLES = (f"notation.{step}" for step in ("text", "clock", "tables"))
GESTURE, PATTERN, READING, EDITS, STAGING = (
    f"scores.{step}" for step in ("gesture", "pattern", "reading", "edits", "staging")
)
# What all dialects of models share: errors, names, sentences, numbers, and their last page.
MODELS = {f"models.{one}" for one in ("errors", "exact_numbers", "naming", "page", "refused")}
MAY = {
    "common": set(),
    "view": set(),
    "space": {"_core"},
    "exchange": {"space", "_core"},
    "rendering": {"exchange", "_core"},
    TEXT: set(),
    CLOCK: {TEXT, "_core"},
    TABLES: {TEXT, CLOCK, "_core"},
    "instruments": {"notation", "_core"},
    GESTURE: {"notation", "_core"},
    PATTERN: {"notation", GESTURE, "_core"},
    READING: {"notation", "instruments", "space", GESTURE, PATTERN},
    EDITS: {"notation", "instruments", GESTURE, PATTERN, READING},
    STAGING: {"notation", "instruments", "space", GESTURE, PATTERN, READING, "_core"},
    "repl.language": {"notation", "instruments", "scores"},
    "lab": {"notation", "instruments", "scores", "exchange", "rendering", "api", "_core"},
    "metrology": {"view", "_core"},
    "bells": {"notation", "exchange", "_core"},
    "models": {"notation", "instruments", "_core"},
    "models.mims": {"notation", "instruments", "_core", *MODELS},
    "models.pmpd": {"notation", "instruments", "_core", *MODELS},
    "models.sam": {"notation", "instruments", "_core", *MODELS},
    "models.miphysics": {"notation", "instruments", "_core", *MODELS},
    "models.programs": {"notation", "instruments", "_core", "models.mims.laws", *MODELS},
    "movies": set(),
    "live": {"notation", "scores", "exchange", "rendering", "_core"},
    "repl.session": {
        "notation",
        "instruments",
        "scores",
        "exchange",
        "rendering",
        "live",
        "view",
        "repl.session_protocol",
        "repl.line_queue",
        "repl.language",
        "_core",
    },
    "repl.prompt": {"repl.session_protocol", "repl.line_queue"},
    "repl.wire": {"repl.session_protocol", "repl.line_queue"},
    "api": {
        "notation",
        "scores",
        "exchange",
        "rendering",
        "live",
        "repl",
        "bells",
        "models",
        "movies",
        "space",
        "view",
        "_core",
    },
    "lsp": {"api", "notation", "scores", "_core"},
    "cli": {
        "api",
        "lsp",
        "notation",
        "instruments",
        "scores",
        "exchange",
        "rendering",
        "lab",
        "live",
        "metrology",
        "bells",
        "repl",
        "space",
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


ROOMS = sorted({room.split(".")[0] for room in MAY})
# Their files name each other in annotations alone: boards and calibration, render and its journals.
CIRCLES_OF_TYPES = ("live", "cli")


def modules() -> dict[tuple[str, ...], Path]:
    """Every file of the package, by the parts of its module's name."""
    paths = (path for room in ROOMS for path in (ROOT / room).rglob("*.py"))
    found = {}
    for path in paths:
        parts = path.relative_to(ROOT).with_suffix("").parts
        found[parts[:-1] if parts[-1] == "__init__" else parts] = path
    return found


def files_imported(
    module: tuple[str, ...], known: dict[tuple[str, ...], Path], *, annotations: bool
) -> set[tuple[str, ...]]:
    """Files that a file imports, also inside its functions."""
    tree = ast.parse(known[module].read_text(encoding="utf-8"))
    skipped = {
        id(inner)
        for node in ast.walk(tree)
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"
        for inner in ast.walk(node)
    }
    package = module if known[module].name == "__init__.py" else module[:-1]
    names: set[tuple[str, ...]] = set()
    for node in ast.walk(tree):
        if id(node) in skipped and not annotations:
            continue
        if isinstance(node, ast.ImportFrom):
            base = tuple((node.module or "").split(".")) if node.module else ()
            if node.level:
                base = (*package[: len(package) - node.level + 1], *base)
            elif base[:1] == ("ergon",):
                base = base[1:]
            else:
                continue
            names |= {base, *((*base, alias.name) for alias in node.names)}
        elif isinstance(node, ast.Import):
            parts = (alias.name.split(".") for alias in node.names)
            names |= {tuple(part[1:]) for part in parts if part[0] == "ergon"}
    return {name for name in names if name in known and name != module}


def no_kin(graph: dict[tuple[str, ...], set[tuple[str, ...]]]) -> dict:
    """Without what a package and its own children import of each other."""
    return {
        module: {
            other
            for other in others
            if other[: len(module)] != module and module[: len(other)] != other
        }
        for module, others in graph.items()
    }


def test_files_import_in_no_circle():
    """At run time, in the whole package; imports inside functions count too."""
    known = modules()
    graph = {one: files_imported(one, known, annotations=False) for one in known}
    assert circles(no_kin(graph)) == []


@pytest.mark.parametrize("room", [room for room in ROOMS if room not in CIRCLES_OF_TYPES])
def test_files_of_a_room_name_each_other_in_no_circle(room: str):
    """In annotations neither: what two files need of each other has a file of its own."""
    known = {module: path for module, path in modules().items() if module[0] == room}
    graph = {one: files_imported(one, known, annotations=True) for one in known}
    assert circles(no_kin(graph)) == []
