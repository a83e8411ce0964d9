"""The pages of the manual, which are installed beside the program."""

from __future__ import annotations

import re
import sys
from dataclasses import dataclass
from pathlib import Path

import click

from ergon.common.manual_pages import MANUAL
from ergon.common.terminal import clean

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

    @property
    def is_mistake(self) -> bool:
        """Whether it explains a code that a message shows."""
        return self.path.parent.name == "errors" and self.path.stem != "README"


def pages() -> dict[str, Page]:
    """All pages by name, in the order of their names."""
    pages_by_name: dict[str, Page] = {}
    for folder in _FOLDERS:
        for path in sorted((MANUAL / folder).glob("*.md")):
            page_name = path.stem if folder in ("", "errors") else f"{folder}/{path.stem}"
            if path.stem == "README":
                page_name = folder or "start"
            pages_by_name[page_name] = Page(page_name, path)
    return pages_by_name


def show(page_text: str) -> None:
    """Print a page; a terminal shows it screen by screen."""
    page_text = clean(page_text)
    if sys.stdout.isatty():
        click.echo_via_pager(page_text)
    else:
        click.echo(page_text, nl=False)


def matches(topic: str, pages_by_topic: dict[str, Page]) -> list[tuple[Page, str]]:
    """The pages about a topic, the page that is meant first, each with the heading that says so.

    A match of the name ranks before one of the title, and the title before other headings. A
    heading that begins with the topic ranks before one that contains it. Of equal pages the one
    that mentions the topic most often comes first. If no heading matches, the mentions in the texts
    count. Pages of mistakes are left out.
    """
    asked_stems = _stems(topic)
    synonym = next(
        (synonym for word, synonym in _SYNONYMS.items() if _stems(word) == asked_stems), None
    )
    stems = _stems(synonym) if synonym else asked_stems
    if not stems:
        return []
    patterns = [re.compile(rf"\b{re.escape(part)}", re.IGNORECASE) for part in stems]
    by_heading, by_text = [], []
    for page in pages_by_topic.values():
        if page.is_mistake:
            continue
        n_mentions = min(len(pattern.findall(page.text)) for pattern in patterns)
        is_later = page.name.startswith("design/") or page.name in _DEVELOPER_PAGES
        ranked = _rank(page, stems, patterns)
        if ranked is not None:
            rank, heading = ranked
            by_heading.append((is_later, rank, -n_mentions, page.name, page, heading))
        elif n_mentions >= _MENTIONS_MIN:
            by_text.append((is_later, 0, -n_mentions, page.name, page, page.headings[0]))
    ranked_pages = sorted(by_heading or by_text, key=lambda row: row[:4])
    return [(page, heading) for *_, page, heading in ranked_pages]


_MENTIONS_MIN = 2  # mentions by which a page is about a topic that no heading has
# Pages for those who change ergon: they come after those for players.
_DEVELOPER_PAGES = (
    "accuracy",
    "benchmarks",
    "charts",
    "ear",
    "faults",
    "fuzzing",
    "security",
    "start",
)
# Topics that the pages call by other words.
_SYNONYMS = {
    "audio": "sound",
    "beginner": "tutorial",
    "drums": "skins",
    "first steps": "tutorial",
    "getting started": "tutorial",
    "headphones": "dome",
    "keyboard": "midi",
    "movie": "film",
    "notes": "melody",
    "quickstart": "tutorial",
    "quiet": "soft",
    "random": "chance",
    "recording": "takes",
    "reverb": "space",
    "scale": "tune",
    "setup": "install",
    "shortcuts": "cheat-sheet",
    "silence": "silent",
    "sound card": "sound",
    "swing": "rhythm",
    "volume": "soft",
    "vscode": "editors",
}
_STOP_WORDS = frozenset(
    ("a", "an", "do", "how", "i", "in", "is", "it", "of", "the", "to", "what", "why")
)
_ENDINGS = ("ings", "ing", "ers", "er", "ed", "es", "s", "e")
_WORD = re.compile(r"[\w'-]+")


def _rank(page: Page, stems: list[str], patterns: list[re.Pattern[str]]) -> tuple[int, str] | None:
    """How well the name and the headings of a page fit, 0 the best, and the heading; None if they
    do not.
    """
    page_title, *subheadings = page.headings
    if _stems(page.name.split("/")[-1]) == stems:
        return 0, page_title
    for heading_rank, headings in ((1, [page_title]), (3, subheadings)):
        fitting_headings = [
            heading for heading in headings if all(pattern.search(heading) for pattern in patterns)
        ]
        starting_heading = next(
            (heading for heading in fitting_headings if patterns[0].match(heading)), None
        )
        if starting_heading is not None:
            return heading_rank, starting_heading
        if fitting_headings:
            return heading_rank + 1, fitting_headings[0]
    return None


def _stems(topic: str) -> list[str]:
    """The words of a topic without their endings, so that `tune`, `tunings` and `tuned` are one."""
    words = [word for word in _WORD.findall(topic.lower()) if word not in _STOP_WORDS]
    return [_stem(word) for word in words]


def _stem(word: str) -> str:
    ending = next((end for end in _ENDINGS if word.endswith(end) and len(word) - len(end) > 2), "")
    return word.removesuffix(ending)
