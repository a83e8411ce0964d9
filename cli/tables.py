"""Tables of words for a terminal."""

from __future__ import annotations

from collections.abc import Iterable, Sequence


def table(text_rows: Iterable[Sequence[str]], *, right: bool = False) -> str:
    """Rows of as many cells as the first, a line each, in columns as wide as their widest cell.

    Cells are aligned to the left of their column, or to the `right`.
    """
    cell_rows = list(text_rows)
    widths = [max(len(cell) for cell in column) for column in zip(*cell_rows, strict=True)]
    align = str.rjust if right else str.ljust
    padded_lines = (
        "  ".join(align(cell, width) for cell, width in zip(row, widths, strict=True))
        for row in cell_rows
    )
    return "".join(f"{line.rstrip()}\n" for line in padded_lines)
