"""Tables of DESIGN.md that say which parts may use which."""

import re
from collections.abc import Iterator
from pathlib import Path

_PAGE = Path(__file__).parents[2] / "DESIGN.md"


def uses(heading: str) -> Iterator[tuple[str, set[str]]]:
    """Each name in the first column of the tables with this first heading, and the names in the
    last column.
    """
    text = _PAGE.read_text(encoding="utf-8")
    pattern = rf"^\| {re.escape(heading)} \|.*\n\|[-|]+\n((?:\|.*\n)+)"
    for table in re.findall(pattern, text, flags=re.MULTILINE):
        for row in table.splitlines():
            names, *_, used = row.strip("|").split(" | ")
            for name in re.findall(r"`([\w./-]+)`", names):
                yield name, set(re.findall(r"`([\w./-]+)`", used))
