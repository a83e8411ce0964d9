"""Lines of prose have at most 120 columns, and the tool that wraps them changes no page."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest
from markdown_it import MarkdownIt

from docs.generators.wrap import COLUMNS, long_lines, wrapped

ROOT = Path(__file__).parents[2]
WORDS = "the quick brown fox jumps over the lazy dog " * 6


def tracked_pages() -> list[Path]:
    listed = subprocess.run(
        ["git", "ls-files", "*.md"], cwd=ROOT, capture_output=True, text=True, check=True
    )
    return [ROOT / name for name in listed.stdout.splitlines()]


def rendered(text: str) -> str:
    """A page as HTML, whatever its line breaks are."""
    html = MarkdownIt("commonmark").enable("table").render(text)
    return re.sub(r"\s+", " ", html)


def test_prose_lines_of_at_most_120_columns():
    """`python -m docs.generators.wrap FILE` wraps a page that fails here."""
    pages = {page: [*long_lines(page.read_text(encoding="utf-8"))] for page in tracked_pages()}
    assert {str(page): lines for page, lines in pages.items() if lines} == {}


@pytest.mark.parametrize(
    "text",
    [
        WORDS,
        f"* {WORDS}\n  {WORDS}\n* short\n  - {WORDS}\n",
        f"12. {WORDS}\n",
        f"{WORDS}\n\n    {WORDS}\n",
        f"```text\n{WORDS}\n```\n{WORDS}",
        f"| a | b |\n|---|---|\n| {WORDS} | c |\n",
        f"{WORDS}`a long code span with {WORDS[:80]}` and [a link {WORDS[:60]}](page.md) {WORDS}",
        "word " * 23 + "- not a list\n" + "word " * 23 + "1. not one\n" + "word " * 23 + "# none",
        "word " * 23 + "+ not | a > table = here\n" + "word " * 40,
        f"# {WORDS}\n{WORDS}\n---\n",
        f"{WORDS}  \nafter a hard break\n",
        f"> {WORDS}\n\n<!-- {WORDS} -->\n{WORDS}\n",
    ],
)
def test_wrapped_page_renders_unchanged(text: str):
    result = wrapped(text)
    assert rendered(result) == rendered(text)
    assert wrapped(result) == result
    assert [*long_lines(result)] == ([1] if "hard break" in text else [])


def test_wrapped_leaves_short_paragraph():
    text = "a line\nand another\n"
    assert wrapped(text) == text


def test_wrapped_word_longer_than_line():
    word = "x" * (COLUMNS + 1)
    assert wrapped(f"before {word} after\n") == f"before\n{word}\nafter\n"
