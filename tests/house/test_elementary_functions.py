"""Between a score and its samples no elementary function is of the C library or of numpy: their
last bit differs from one processor to another.

clippy.toml holds the same for Rust.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
ROOMS = ("scores", "instruments", "ergon/notation", "ergon/rendering", "ergon/space")
LIBRARIES = {"math", "cmath", "np", "numpy"}
# `sqrt` and `hypot` of Python are correctly rounded.
FUNCTIONS = {
    *("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "arcsin", "arccos", "arctan"),
    *("arctan2", "sinh", "cosh", "tanh", "exp", "exp2", "expm1", "log", "log2", "log10", "log1p"),
    *("pow", "power", "cbrt", "sinc", "hanning", "hamming", "blackman", "kaiser"),
    *("logspace", "geomspace"),
}
# What these compute is printed, drawn, rounded to hundredths of a decibel, or a filter of a fold.
EXCEPTIONS = {
    "ergon/notation/tables/scala.py": "a bound on ratios",
    "ergon/rendering/loudness.py": "gains in steps of 0.01 dB",
    "ergon/rendering/measures.py": "figures of sweeps",
    "ergon/space/head.py": "filters of `ergon fold`",
    "ergon/space/quality.py": "figures of a layout",
    "scores/edits/space.py": "a pan that is written into the text",
    "scores/gesture/movement.py": "figures of a take",
    "scores/staging/planning.py": "digits of a message",
    "scores/staging/travel.py": "a bound of a warning",
}


def calls(path: Path) -> Iterator[str]:
    """The elementary functions of libraries that a file names."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module in LIBRARIES:
            yield from (alias.name for alias in node.names if alias.name in FUNCTIONS)
        if (
            isinstance(node, ast.Attribute)
            and node.attr in FUNCTIONS
            and isinstance(node.value, ast.Name)
            and node.value.id in LIBRARIES
        ):
            yield node.attr


def test_elementary_functions_of_libraries_beside_samples_alone():
    users = {
        str(path.relative_to(ROOT))
        for room in ROOMS
        for path in (ROOT / room).rglob("*.py")
        if any(calls(path))
    }
    assert users == set(EXCEPTIONS)
