"""Tables as CSV: first lines with the facts, then a row of names, then numbers."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence

Value = str | float | int | bool | None


def csv_text(
    facts: Sequence[str], column_names: Sequence[str], table_rows: Iterable[Sequence[Value]]
) -> str:
    """The whole file. A value that was not measured is an empty field."""
    csv_buffer = io.StringIO()
    for fact in ("made by ergon", *facts):
        csv_buffer.write(f"# {' '.join(fact.split())}\n")
    writer = csv.writer(csv_buffer, lineterminator="\n")
    writer.writerow(column_names)
    writer.writerows([_cell_text(value) for value in row] for row in table_rows)
    return csv_buffer.getvalue()


def _cell_text(table_value: Value) -> str:
    if table_value is None:
        return ""
    if isinstance(table_value, bool):
        return "yes" if table_value else "no"
    return f"{table_value:.6g}" if isinstance(table_value, float) else str(table_value)
