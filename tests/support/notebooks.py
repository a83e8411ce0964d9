"""Runs a notebook as Jupyter does: its code cells one after the other, `!` lines as commands, and
what the last expression of a cell shows.
"""

from __future__ import annotations

import ast
import json
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any

_REPRESENTATIONS = ("_repr_html_", "_repr_svg_")


def code_cells(path: Path) -> list[str]:
    """The text of each code cell. Cells with outputs are refused: they are made, not kept."""
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    code = [cell for cell in cells if cell["cell_type"] == "code"]
    assert all(cell["outputs"] == [] for cell in code), f"{path.name} has outputs; clear them"
    return ["".join(cell["source"]) for cell in code]


def run_notebook(path: Path, folder: Path) -> list[str | None]:
    """Run the cells in a folder; what each shows at its end, as HTML, SVG or text."""
    names: dict[str, Any] = {"__name__": "__main__"}
    return [_run_cell(f"{path.name}[{i}]", cell, names, folder) for i, cell in _numbered(path)]


def _numbered(path: Path) -> list[tuple[int, str]]:
    return list(enumerate(code_cells(path)))


def _run_cell(title: str, cell: str, names: dict[str, Any], folder: Path) -> str | None:
    if cell.lstrip().startswith("!"):
        return "".join(_run_command(line[1:], folder) for line in cell.split("\n") if line.strip())
    tree = ast.parse(cell, title)
    last = tree.body[-1]
    shown = tree.body.pop() if isinstance(last, ast.Expr) else None
    exec(compile(tree, title, "exec"), names)
    if shown is None:
        return None
    value = eval(compile(ast.Expression(shown.value), title, "eval"), names)  # type: ignore[attr-defined]
    for method in _REPRESENTATIONS:
        if hasattr(value, method):
            return str(getattr(value, method)())
    return None if value is None else repr(value)


def _run_command(line: str, folder: Path) -> str:
    program, *words = shlex.split(line)
    assert program == "ergon"
    command = [sys.executable, "-m", "ergon", *words]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, f"{line}\n{done.stderr}"
    return done.stdout + done.stderr
