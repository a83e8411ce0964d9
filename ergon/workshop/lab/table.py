"""Tables as CSV: first lines with the facts, then a row of names, then numbers."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence

Value = str | float | int | bool | None


def text(facts: Sequence[str], names: Sequence[str], rows: Iterable[Sequence[Value]]) -> str:
    """The whole file. A value that was not measured is an empty field."""
    out = io.StringIO()
    for fact in ("made by ergon", *facts):
        out.write(f"# {' '.join(fact.split())}\n")
    table = csv.writer(out, lineterminator="\n")
    table.writerow(names)
    table.writerows([_written(value) for value in row] for row in rows)
    return out.getvalue()


def _written(value: Value) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.6g}" if isinstance(value, float) else str(value)
