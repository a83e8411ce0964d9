"""docs/security.md: every promise names a test that is there."""

from __future__ import annotations

import ast
import re
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_security_page_rows_name_existing_tests() -> None:
    text = (ROOT / "docs" / "security.md").read_text(encoding="utf-8")
    tables = text.split("## What is not promised")[0]
    rows = [row for row in re.findall(r"^\| [A-Z].*\|$", tables, re.MULTILINE)]
    assert len(rows) > 15
    for row in rows:
        named = re.search(r"\| `([\w/-]+\.(?:py|rs))::(\w+)` \|$", row)
        assert named, row
        assert named[2] in _tests_in(ROOT / named[1]), row


def _tests_in(path: Path) -> set[str]:
    """The names of the tests of a file of Python or Rust."""
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".rs":
        return set(re.findall(r"#\[test\]\s+fn (\w+)", text))
    result = {node.name for node in ast.parse(text).body if isinstance(node, ast.FunctionDef)}
    return {name for name in result if name.startswith("test_")}
