"""The pages of the manual, which are installed beside the program."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

_PAGES = Path(__file__).parents[1] / "manual"  # a link to docs/, beside that to the commands
_FOLDERS = ("", "howto", "errors", "instruments", "design")
_HEADING = re.compile(r"^#{1,4} +(.+?) *#*$", re.MULTILINE)


@dataclass(frozen=True, slots=True)
class Page:
    """A page; `name` is how it is asked for: `tuning`, `howto/tune`, `E204`."""

    name: str
    path: Path

    @property
    def text(self) -> str:
        """The page as Markdown."""
        return self.path.read_text(encoding="utf-8")

    @property
    def headings(self) -> list[str]:
        """Its headings; the first is its title."""
        return [heading.replace("`", "") for heading in _HEADING.findall(self.text)]


def pages() -> dict[str, Page]:
    """All pages by name, in the order of their names."""
    result: dict[str, Page] = {}
    for folder in _FOLDERS:
        for path in sorted((_PAGES / folder).glob("*.md")):
            name = path.stem if folder in ("", "errors") else f"{folder}/{path.stem}"
            if path.stem == "README":
                name = folder or "start"
            result[name] = Page(name, path)
    return result


def with_heading(word: str, known: dict[str, Page]) -> list[tuple[Page, str]]:
    """The pages with a heading that has a word, each with the first such heading; no pages of
    errors.
    """
    wanted = re.compile(rf"\b{re.escape(word)}", re.IGNORECASE)
    result = []
    for page in known.values():
        if page.path.parent.name == "errors":
            continue
        heading = next((heading for heading in page.headings if wanted.search(heading)), None)
        if heading is not None:
            result.append((page, heading))
    return result
