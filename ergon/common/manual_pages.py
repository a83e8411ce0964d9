"""Where the pages of the manual are, which are installed beside the program."""

from __future__ import annotations

from pathlib import Path

MANUAL = Path(__file__).parents[1] / "manual"  # a link to docs/ in a checkout


def mistake_page_uri(code: str) -> str | None:
    """The address of the page on a mistake, such as E204, as a `file:` URI; None without one."""
    page = MANUAL / "errors" / f"{code}.md"
    return page.resolve().as_uri() if page.is_file() else None
