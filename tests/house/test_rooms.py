"""Arrows point one way: what each room may import, as DESIGN.md says."""

import ast
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest
from design_tables import uses
from rust_imports import circles
from sweep import few

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "ergon"
LINKS = {"cli", "instruments", "manual", "repl", "scores"}


MAY = {
    name: used
    for heading in ("room", "step")
    for name, used in uses(heading)
    if not name.startswith("core-rs/")
}


@cache
def statements(path: Path) -> list[tuple[ast.Import | ast.ImportFrom, bool]]:
    """Imports anywhere in a file, and whether only type checkers see each."""
    every = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
    only_types = {
        inner
        for node in every
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"
        for inner in ast.walk(node)
    }
    return [
        (node, node in only_types)
        for node in every
        if isinstance(node, ast.Import | ast.ImportFrom)
    ]


def imported(path: Path) -> set[str]:
    """Modules of the package that a file names, anywhere in it, but for its annotations."""
    names = set()
    for node, is_for_types in statements(path):
        if is_for_types:
            continue
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("ergon"):
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
        elif isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names if alias.name.startswith("ergon")}
    return names


@pytest.mark.parametrize("room", MAY)
def test_room_imports_only_allowed_rooms(room: str):
    folder = PACKAGE / room.replace(".", "/")
    files = list(folder.rglob("*.py"))
    assert files
    allowed = tuple(f"ergon.{name}" for name in (*MAY[room], room, "common"))
    for path in files:
        for name in imported(path):
            known = name.startswith(tuple(f"{one}." for one in allowed)) or name in allowed
            assert known, f"{path.relative_to(PACKAGE)} imports {name}"


def room_of(name: str) -> str:
    """The room of a step."""
    parts = name.split(".")
    return ".".join(parts[: 2 if parts[0] == "workshop" else 1])


ROOMS = sorted({room_of(name) for name in MAY})


def test_tables_of_rooms_and_links():
    folders = {path.parent for path in PACKAGE.glob("*/*.py")} - {PACKAGE / "workshop"}
    folders |= {path.parent for path in PACKAGE.glob("workshop/*/*.py")}
    assert {".".join(folder.relative_to(PACKAGE).parts) for folder in folders} == set(ROOMS)
    assert {path.name for path in PACKAGE.iterdir() if path.is_symlink()} == LINKS
    links = subprocess.run(
        ["git", "ls-files", "--stage"], cwd=ROOT, capture_output=True, check=True, text=True
    ).stdout.splitlines()
    linked = {line.split("\t")[1] for line in links if line.startswith("120000")}
    assert linked == {f"ergon/{name}" for name in LINKS}


@pytest.mark.parametrize("room", [room for room in ROOMS if not room.startswith("workshop.")])
def test_rooms_without_workshop_imports(room: str):
    used = {name for name in MAY[room] if name.startswith("workshop")}
    assert room == "cli" or not used


WITHOUT_WORKSHOP = """
import sys
sys.modules["ergon.workshop"] = None
from ergon.cli.start import main
main()
"""
SCORE = """
ergon: 1
use: [instruments/bars.yaml]
strikes: {tap: {to: triangle.hammer, at: 0, impulse: 4mNs}}
"""
REPEATED = "d1 strikes triangle.hammer every 1 impulse 4mNs"


@pytest.mark.parametrize(
    ("command", "typed"),
    few([("render", ""), ("repl", REPEATED + "\nquit\n"), ("check", ""), ("plan", "")], 2),
)
def test_commands_without_the_workshop(command: str, typed: str, tmp_path: Path):
    (tmp_path / "piece.yaml").write_text(SCORE, encoding="utf-8")
    run = subprocess.run(
        [sys.executable, "-c", WITHOUT_WORKSHOP, command, "piece.yaml"],
        cwd=tmp_path,
        input=typed,
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stdout + run.stderr
    assert "workshop" not in run.stderr


# Their files name each other in annotations alone: boards and calibration, render and its journals.
CIRCLES_OF_TYPES = ("live", "cli")


def modules() -> dict[tuple[str, ...], Path]:
    """Every file of the package, by the parts of its module's name."""
    rooms = (PACKAGE / room.replace(".", "/") for room in ROOMS)
    paths = (path for room in rooms for path in room.rglob("*.py"))
    result = {}
    for path in paths:
        parts = path.relative_to(PACKAGE).with_suffix("").parts
        result[parts[:-1] if parts[-1] == "__init__" else parts] = path
    return result


def files_imported(
    module: tuple[str, ...], known: dict[tuple[str, ...], Path], *, annotations: bool
) -> set[tuple[str, ...]]:
    """Files that a file imports, also inside its functions."""
    package = module if known[module].name == "__init__.py" else module[:-1]
    names: set[tuple[str, ...]] = set()
    for node, is_for_types in statements(known[module]):
        if is_for_types and not annotations:
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


def test_files_without_import_cycles():
    """At run time, in the whole package; imports inside functions count too."""
    known = modules()
    graph = {one: files_imported(one, known, annotations=False) for one in known}
    assert circles(no_kin(graph)) == []


@pytest.mark.parametrize("room", [room for room in ROOMS if room not in CIRCLES_OF_TYPES])
def test_room_files_without_annotation_cycles(room: str):
    """In annotations neither: what two files need of each other has a file of its own."""
    known = {
        module: path for module, path in modules().items() if room_of(".".join(module)) == room
    }
    graph = {one: files_imported(one, known, annotations=True) for one in known}
    assert circles(no_kin(graph)) == []
