"""What mkdocs calls while it makes the site: order of pages, and links that lead out of docs."""

from __future__ import annotations

import posixpath
import re
import shutil
from pathlib import Path
from typing import Any

# The order of pages; what no group names stands at the end, so that a new page is never lost.
GROUPS: dict[str, tuple[str, ...]] = {
    "Begin": ("README.md", "install.md", "tutorial.md", "gallery.md", "pieces.md", "ideas.md"),
    "How to": ("howto/*.md",),
    "Write": ("language.md", "rhythm.md", "matter.md", "takes.md", "bells.md", "sweeps.md"),
    "Play": ("repl.md", "cheat-sheet.md", "live.md", "midi.md", "osc.md", "socket.md"),
    "See": ("view.md", "motion.md"),
    "Study": (
        *(
            "modes.md",
            "structure.md",
            "charts.md",
            "numerics.md",
            "accuracy.md",
            "ear.md",
            "source.md",
        ),
    ),
    "Instruments": ("instruments/README.md", "instruments/*.md"),
    "Look up": ("reference.md", "glossary.md", "files.md", "security.md"),
    "Errors": ("errors/README.md", "errors/*.md"),
    "Inside": ("design/README.md", "design/*.md"),
}
REST = "More"
PIECES = Path(__file__).parents[2] / "out" / "pieces"  # by docs.generators.shared_pieces
_GALLERY = "gallery.md"
_PICTURE = re.compile(r"^!\[[^\]]*\]\(gallery/([\w-]+)\.svg\)$", re.MULTILINE)
_CODE = re.compile(r"`[^`]+`")
_LINK = re.compile(r"(?<!!)\[([^\]]*)\]\(([^)#\s]+)(?:#[^)]*)?\)")


def pages_in_groups(docs: Path) -> dict[str, list[str]]:
    """All pages of a folder, each in its group, in order."""
    names = sorted(path.relative_to(docs).as_posix() for path in docs.glob("**/*.md"))
    groups: dict[str, list[str]] = {}
    placed: set[str] = set()
    for title, patterns in GROUPS.items():
        groups[title] = []
        for pattern in patterns:
            matching = [name for name in names if _matches(name, pattern) and name not in placed]
            groups[title] += matching
            placed.update(matching)
    return {**groups, REST: [name for name in names if name not in placed]}


def _matches(name: str, pattern: str) -> bool:
    folder, _, last = pattern.rpartition("/")
    return name == pattern or (last == "*.md" and posixpath.dirname(name) == folder)


def without_links_outside(text: str, page: str) -> str:
    """The Markdown of a page, whose links to files beside docs/ are their words alone."""

    def replacement(match: re.Match[str]) -> str:
        words, target = match.groups()
        if "://" in target:
            return match[0]
        leads = posixpath.normpath(posixpath.join(posixpath.dirname(page), target))
        return str(words) if leads.startswith("..") else match[0]

    return _LINK.sub(replacement, text)


def with_plain_bars(text: str) -> str:
    """The Markdown of a page without `\\|` in the code of tables.

    GitHub needs the backslash there; Python-Markdown keeps code together, and would show it.
    """
    return "\n".join(
        _CODE.sub(lambda code: code[0].replace(r"\|", "|"), line) if line.startswith("|") else line
        for line in text.split("\n")
    )


def with_pieces(text: str, folder: Path) -> str:
    """The Markdown of the gallery, with a link to each piece that was built as a page."""

    def linked(match: re.Match[str]) -> str:
        name = match[1]
        if not (folder / f"{name}.html").is_file():
            return match[0]
        # As HTML: what is built lies beside the site's pages, where mkdocs does not look.
        return f'{match[0]}\n\n<a href="../pieces/{name}.html">See and hear it move</a>'

    return _PICTURE.sub(linked, text)


def on_config(config: Any) -> Any:
    """Called by mkdocs: sets the navigation."""
    groups = pages_in_groups(Path(config["docs_dir"]))
    config["nav"] = [{title: names} for title, names in groups.items() if names]
    return config


def on_page_markdown(markdown: str, page: Any, **_: object) -> str:
    """Called by mkdocs for each page."""
    if page.file.src_uri == _GALLERY:
        markdown = with_pieces(markdown, PIECES)
    return with_plain_bars(without_links_outside(markdown, page.file.src_uri))


def on_post_build(config: Any, **_: object) -> None:
    """Called by mkdocs at the end: puts the pieces that were built beside the pages."""
    if PIECES.is_dir():
        shutil.copytree(PIECES, Path(config["site_dir"]) / "pieces", dirs_exist_ok=True)
