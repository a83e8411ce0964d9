"""Pages as readers use them: fenced blocks, each a file or commands to type.

An HTML comment right above a block says what it is:

* `<!-- file: piece.yaml -->` — the whole text of a file;
* `<!-- in: piece.yaml -->` — sections that replace those of the same name there, or follow;
* `<!-- mistake -->` — after one of these: the snippet is wrong on purpose.

A yaml block without a comment is a whole score.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

_BLOCK = re.compile(
    r"(?P<notes>(?:^<!-- [^\n]* -->\n)*)^```(?P<language>\w*)\n(?P<text>.*?)^```$",
    re.MULTILINE | re.DOTALL,
)
_SECTION = re.compile(r"^(?=[a-z]+:)", re.MULTILINE)


@dataclass(frozen=True)
class Block:
    """A fenced block: its language, its text, its comments, and its page and line."""

    language: str
    text: str
    notes: tuple[str, ...]
    where: str

    def note(self, word: str) -> str | None:
        """The text of a comment after `word:`."""
        suggestions = [note.removeprefix(f"{word}: ") for note in self.notes]
        return next((f for f, note in zip(suggestions, self.notes, strict=True) if f != note), None)


def blocks(page: Path) -> Iterator[Block]:
    """The blocks of a page, from top to bottom."""
    text = page.read_text(encoding="utf-8")
    for match in _BLOCK.finditer(text):
        notes = tuple(line[5:-4] for line in match["notes"].splitlines())
        line = text.count("\n", 0, match.start("text"))
        yield Block(match["language"], match["text"], notes, f"{page.name}:{line}")


def commands(block: Block) -> Iterator[tuple[list[str], str]]:
    """The words of each `$ ergon …` of a console block, without `ergon`, and the output shown below
    it.

    Raises ValueError if a command is of another program.
    """
    for part in re.split(r"^(?=\$ )", block.text, flags=re.MULTILINE):
        if part.startswith("$ "):
            command, _, shown = part[2:].partition("\n")
            program, *words = command.split(" #")[0].split()
            if program != "ergon":
                raise ValueError(f"{block.where}: {command}")
            yield words, shown.strip()


def merged(text: str, more: str) -> str:
    """The file with sections replaced by those of the same name, or with them at its end."""
    for section in filter(None, _SECTION.split(more)):
        name = section[: section.index(":") + 1]
        parts = _SECTION.split(text)
        same = [i for i, part in enumerate(parts) if part.startswith(name)]
        if same:
            parts[same[0]] = section
            text = "".join(parts)
        else:
            text = text.rstrip("\n") + "\n" + section
    return text


def put(block: Block, folder: Path) -> Path:
    """Write a block into the folder as the reader would."""
    if (name := block.note("in")) is not None:
        path = folder / name
        path.write_text(merged(path.read_text("utf-8"), block.text), "utf-8")
        return path
    path = folder / (block.note("file") or "snippet.yaml")
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(block.text, "utf-8")
    return path
